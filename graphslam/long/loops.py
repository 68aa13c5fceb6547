"""Loops: places where a patch of the path lies on an earlier one, found and closed one by one."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from graphslam.config import SmootherConfig
from graphslam.geometry import Array, compose, inverse, rotation, transform_points, wrap
from graphslam.long.joining import Joined, Minimise, Pair, join
from graphslam.long.laying import LAID_COLUMNS, lay, settle
from graphslam.long.patches import Patch, covariance_between, in_frame, patches_of
from graphslam.rematch.fitted import Fitted
from graphslam.rematch.found import travelled
from graphslam.rematch.spread import Spread
from graphslam.smoother.problem import Minimum, Problem

WAYS = 12
"""Different ways to lay one patch on another that are compared."""
TOLERANCE_M = 0.12
"""Largest offset of two lines that are one, after settling, m."""
WIDER = 1.5
"""Factor on standard deviations: an estimate that has linearised often is too sure."""
FLOOR = np.diag([0.05**2, 0.05**2, 0.01**2])
REVISIT_M = 15.0
"""Way from one patch to another from which seeing a place again is a loop, m."""
NEAR_M = 20.0
"""Farthest that patches see, m."""
PRICE = 2.0
"""Gates that a loop may cost on top of one for each landmark saved."""


@dataclass(frozen=True, slots=True)
class Rules:
    """When a patch lies on another beyond doubt, and when several such findings agree.

    Attributes:
        length_m: least common length of lines, m.
        across_m: least part of it across the direction that is fixed worse, m.
        lines: fewest pairs of lines.
        second: largest share of the best way's length that any other way may have.
        surprise: largest squared Mahalanobis distance from where it should lie.
        apart_m: largest difference of findings that agree, m.
        turned: the same, rad.
        findings: fewest that agree.
        spread: how many patches on the first and last of them must be apart.
        rival: largest share of the best group's length that another group may have.
        back: how many patches back findings are remembered.
    """

    length_m: float
    across_m: float
    lines: int
    second: float
    surprise: float
    apart_m: float
    turned: float
    findings: int
    spread: int
    rival: float
    back: int


NEAR = Rules(4.0, 1.0, 3, 0.85, 25.0, 0.4, 0.06, 2, 0, 0.7, 3)
"""Where the estimate says how sure it is of a place."""
TORN = Rules(6.0, 1.5, 4, 0.80, 20.0, 0.8, 0.08, 3, 2, 0.6, 6)
"""Where only odometry is trusted: wrong matches make an estimate sure of a wrong place."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One patch laid on another.

    Attributes:
        a: number of the earlier patch.
        b: number of the later one.
        length_m: common length of lines, m.
        motion: (3,) rigid motion of the floor that lays b on a.
        pairs: landmarks that are one by it.
    """

    a: int
    b: int
    length_m: float
    motion: Array
    pairs: tuple[Pair, ...]


class Search:
    """The search for loops along a path, from its beginning to its end.

    Attributes:
        fitted: the matches so far, at their minimum.
        closed: how many loops have been closed.
        mended: how many of them needed the path to be mended.
        refused: by patch, why a loop that was found could not be closed.
    """

    def __init__(self, fitted: Fitted, config: SmootherConfig, minimise: Minimise) -> None:
        self.config, self.minimise = config, minimise
        self.closed = self.mended = 0
        self.refused: dict[int, str] = {}
        self._take(fitted)

    def _take(self, fitted: Fitted) -> None:
        self.fitted = fitted
        self.patches = patches_of(fitted)
        self.way = travelled(fitted.problem.pose)
        self.spread = Spread(fitted.problem.pose, fitted.problem.measurements.odometry)
        self.found: list[Finding] = []
        saw = np.zeros((len(self.patches), len(fitted.problem.kinds)), np.float32)
        for b, patch in enumerate(self.patches):
            saw[b, patch.landmark] = 1.0
        self.shared = saw @ saw.T

    def close(self) -> int:
        """Closes what lies where the estimate expects it; returns how many loops it closed."""
        before = self.closed
        self.found = []
        for b in range(len(self.patches)):
            if len(self.patches[b].landmark) >= NEAR.lines:
                self._consider(b, None)
        return self.closed - before

    def mend(self) -> int:
        """Closes what odometry allows where no loop is closed; returns how many loops it closed."""
        before, last = self.closed, 0
        self.found = []
        for b in range(len(self.patches)):
            if self.is_anchored(b):
                last = b
            elif b > last and len(self.patches[b].landmark) >= TORN.lines:
                closed = self.closed
                self._consider(b, last)
                last = b if self.closed > closed else last
        self.mended += self.closed - before
        return self.closed - before

    def is_anchored(self, b: int) -> bool:
        """Returns whether a patch shares lines of two directions with one seen long before."""
        patch = self.patches[b]
        for a in self.patches[:b]:
            if self._is_revisit(a, patch):
                shared = np.intersect1d(a.landmark, patch.landmark)
                alpha = self.fitted.problem.params[shared, 1]
                if len(shared) >= NEAR.lines and np.ptp(np.cos(2.0 * alpha)) > 0.5:
                    return True
        return False

    def open_places(self) -> Counter[str]:
        """Returns why patches that lie near earlier ones are not anchored, a run of them once."""
        out: Counter[str] = Counter()
        previous = False
        for b, patch in enumerate(self.patches):
            here = self.fitted.problem.pose[patch.middle, :2]
            near = any(
                self._is_revisit(a, patch)
                and np.hypot(*(self.fitted.problem.pose[a.middle, :2] - here)) < 0.2 * NEAR_M
                for a in self.patches[:b]
            )
            is_open = near and not self.is_anchored(b)
            if is_open and not previous:
                out[self.refused.get(b, "no earlier place fits clearly best")] += 1
            previous = is_open
        return out

    def _is_revisit(self, a: Patch, b: Patch) -> bool:
        last = min(a.last, len(self.way) - 1)
        return bool(self.way[b.first] - self.way[last] >= REVISIT_M)

    # ---- finding -------------------------------------------------------------------------------

    def _consider(self, b: int, anchor: int | None) -> None:
        """Looks where patch b lies, and closes the loop if earlier findings agree."""
        rules = NEAR if anchor is None else TORN
        new = [f for a in range(b) if (f := self._find(a, b, anchor, rules)) is not None]
        self.found = [f for f in self.found if f.b >= b - rules.back] + new
        if not new:
            return
        here = self.fitted.problem.pose[self.patches[b].middle, :2]
        best, strength, rival = _best_group(self.found, here, b, rules)
        if not best:
            return
        if rival > rules.rival * strength:
            self.refused[b] = "other places fit nearly as well"
            return
        votes = Counter(pair for f in best for pair in f.pairs if pair[0] != pair[1])
        start = None if anchor is None else self._torn_path(best[-1].motion, anchor, b)
        problem = self.fitted.problem
        joined = join(problem, votes, start, self.config, self.minimise) if votes else ""
        if isinstance(joined, str):
            if joined:
                self.refused[b] = joined
        elif not self._worth(joined, start is not None):
            self.refused[b] = "it would bend the path more than odometry allows"
        else:
            self.closed += 1
            self._take(Fitted.of(joined.problem, joined.minimum))

    def _find(self, a: int, b: int, anchor: int | None, rules: Rules) -> Finding | None:
        """Returns how patch b lies on patch a, if there is one clearly best way."""
        one, other = self.patches[a], self.patches[b]
        if one.last > other.first or len(one.landmark) < NEAR.lines:
            return None
        if anchor is not None and not self._is_revisit(one, other):
            return None
        if self.shared[a, b] >= 0.6 * min(len(one.landmark), len(other.landmark)):
            return None
        pose = self.fitted.problem.pose
        centre = pose[other.middle]
        apart = float(np.hypot(*(pose[one.middle, :2] - centre[:2])))
        cov = self._prior(one, other, anchor)
        if apart - NEAR_M > 3.0 * np.sqrt(max(cov[0, 0], cov[1, 1])):
            return None
        lines_a, lines_b = in_frame(one.lines, centre), in_frame(other.lines, centre)
        information = np.linalg.inv(cov)
        ways = np.zeros((WAYS, LAID_COLUMNS))
        count = lay(lines_a, lines_b, np.sqrt(np.diag(cov)), information, TOLERANCE_M, ways)
        ways = ways[:count]
        far = np.einsum("ni,ij,nj->n", ways[:, :3], information, ways[:, :3])
        ways = ways[far < rules.surprise]
        ways = ways[np.argsort(-ways[:, 3], kind="stable")]
        if not len(ways) or not _is_clear(ways, rules):
            return None
        motion, rows = ways[0, :3].copy(), np.zeros((len(lines_b) + 1, 2), np.int64)
        _, count, _ = settle(lines_a, lines_b, motion, information, TOLERANCE_M, rows)
        found = np.column_stack([one.landmark[rows[:count, 0]], other.landmark[rows[:count, 1]]])
        pairs = tuple((min(p), max(p)) for p in found.tolist())
        on_floor = compose(compose(centre, motion), inverse(centre))
        return Finding(a, b, float(ways[0, 3]), on_floor, pairs)

    def _prior(self, one: Patch, other: Patch, anchor: int | None) -> Array:
        """Returns how uncertain one patch is from another, in the frame of the later's middle."""
        pose = self.fitted.problem.pose
        centre = pose[other.middle]
        if anchor is None:
            return WIDER**2 * covariance_between(self.fitted, one, other, centre) + FLOOR
        held = self.patches[anchor]
        turn = np.eye(3)
        turn[:2, :2] = rotation(-centre[2])
        free = turn @ self.spread.cov(np.array(held.middle), np.array(other.middle)) @ turn.T
        known = covariance_between(self.fitted, one, held, pose[held.middle])
        return np.asarray(WIDER**2 * free + known + FLOOR)

    # ---- closing -------------------------------------------------------------------------------

    def _torn_path(self, motion: Array, anchor: int, b: int) -> Array:
        """Returns the path with all from patch b on moved."""
        path = self.fitted.problem.pose.copy()
        first = max(self.patches[b].first, self.patches[anchor].middle + 1)
        later = path[first:]
        path[first:] = compose(np.broadcast_to(motion, later.shape), later)
        return path

    def _worth(self, joined: Joined, torn: bool) -> bool:
        """Returns whether a closed loop lowers the penalised cost, or raises it by little.

        The cost of the minimum, half a gate for each sighting left out, a gate for each landmark.
        """
        gate = self.config.rematching.gate
        before = _cost(self.fitted.problem, self.fitted.minimum, gate)
        after = _cost(joined.problem, joined.minimum, gate)
        allowed = 0.0 if torn else PRICE * gate
        return after - before < gate * joined.landmarks + allowed


def _cost(problem: Problem, minimum: Minimum, gate: float) -> float:
    return float(minimum.cost + 0.5 * gate * np.sum(problem.match < 0))


def _is_clear(ways: Array, rules: Rules) -> bool:
    """Returns whether the first way has enough in common, and the second much less."""
    best = ways[0]
    enough = best[3] >= rules.length_m and best[5] >= rules.across_m and best[4] >= rules.lines
    second = ways[1, 3] if len(ways) > 1 else 0.0
    return bool(enough and second <= rules.second * best[3])


def _best_group(
    found: list[Finding], here: Array, b: int, rules: Rules
) -> tuple[list[Finding], float, float]:
    """Returns the findings that agree best, patch b's among them, their strength and a rival's."""
    moved = np.array([transform_points(f.motion, here) - here for f in found])
    turned = np.array([f.motion[2] for f in found])
    groups = []
    for k in range(len(found)):
        shift, turn = np.hypot(*(moved - moved[k]).T), np.abs(wrap(turned - turned[k]))
        group = [found[q] for q in np.flatnonzero((shift < rules.apart_m) & (turn < rules.turned))]
        number = [f.b for f in group]
        if len(group) >= rules.findings and b in number and b - min(number) >= rules.spread:
            groups.append((sum(f.length_m for f in group), k, group))
    if not groups:
        return [], 0.0, 0.0
    strength, k, group = max(groups, key=lambda entry: (entry[0], -entry[1]))
    rivals = [
        other
        for other, q, _ in groups
        if np.hypot(*(moved[q] - moved[k])) > 2.0 * rules.apart_m
        or abs(wrap(turned[q] - turned[k])) > 2.0 * rules.turned
    ]
    return group, strength, max(rivals, default=0.0)
