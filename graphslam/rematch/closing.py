"""Closing loops: local line maps laid on each other, wherever odometry allows the robot to be."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from graphslam.association import gate_for, mahalanobis
from graphslam.config import RematchConfig
from graphslam.geometry import (
    Array,
    compose_jacobians,
    points_on_line,
    rotation,
    transform_points,
    wrap,
)
from graphslam.line_maps.alignment import Alignment, find_alignments
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.votes import Near
from graphslam.measurements import IntArray
from graphslam.rematch.fitted import Fitted
from graphslam.rematch.spread import Spread
from graphslam.rematch.submaps import Submap

NEIGHBOURS, MOST = 96, 32
"""A submap is compared with the nearest `MOST` of its nearest `NEIGHBOURS`; see `candidates`."""
JOINED = 3
"""Submaps that share so many landmarks are on each other already."""
COMMON = 2
"""Landmarks that two pairs of submaps must match alike to agree."""
ALIGNING = AlignmentConfig(hypotheses=6, most=4, least=COMMON + 1)
"""Fewer motions are tried than for whole maps: odometry says roughly where to look."""
CLEARLY = 2.0
"""How many times the score of any rival a closure must have."""
SAME_TURN = math.radians(5.0)
"""Closures that differ by less are shifts of each other."""
STRAIGHT_M, STRAIGHT = 0.05, 0.1
"""A shift is along an axis of the floor where the rest is smaller, m or part of it."""
DIM = 3
REFUSED = "loop not closed: "


@dataclass(frozen=True, slots=True)
class Closing:
    """One way in which two submaps, far from each other along the path, may be one place.

    Attributes:
        a: number of the earlier submap.
        b: number of the later one.
        pairs: landmarks that are one by it, the earlier submap's first.
        score_m: length of line in agreement, less that in conflict, m.
        alignment: how the later map lies on the earlier.
    """

    a: int
    b: int
    pairs: frozenset[tuple[int, int]]
    score_m: float
    alignment: Alignment


class Compared:
    """Whether closings say the same.

    They do by the landmarks that they match alike, and by how they lay one stretch of the path on
    another: as the way between them has it, or not.
    """

    def __init__(self, maps: tuple[Submap, ...], spread: Spread, gate: float) -> None:
        self._maps, self._spread, self._gate = maps, spread, gate

    def agree(self, one: list[Closing], other: list[Closing]) -> bool:
        """Returns whether two groups match landmarks alike, and nothing in them contradicts."""
        alike = _pairs_of(one) & _pairs_of(other)
        return len(alike) >= COMMON and not self.contradict(one, other)

    def contradict(self, one: list[Closing], other: list[Closing]) -> bool:
        """Returns whether a closing of one group cannot be true with one of the other."""
        return any(self._differ(c, d) for c in one for d in other)

    def _differ(self, one: Closing, other: Closing) -> bool:
        """Returns whether only one of two closings can be true.

        One landmark in two pairs is a mishap while both lay the path alike: short lines lie near
        to each other. Several are another place.
        """
        alike = len(one.pairs & other.pairs)
        different = len(_differences(one.pairs, other.pairs))
        same_maps = (one.a, one.b) == (other.a, other.b)
        if one is other or not (alike or different or same_maps):
            return False
        if different >= COMMON and CLEARLY * different > alike:
            return True
        return self._distance(one, other) > self._gate

    def _distance(self, one: Closing, other: Closing) -> float:
        """Returns the squared Mahalanobis distance between two ways to lay a place on another.

        Where the other's later submap lies in the frame of this one's earlier: by this closing and
        the way between the later submaps, or by the way between the earlier ones and the other.
        """
        first = [m.first for m in self._maps]
        early, early_cov = self._spread.relative(first[one.a], first[other.a])
        late, late_cov = self._spread.relative(first[one.b], first[other.b])
        here, J_here, J_late = compose_jacobians(one.alignment.motion, late)
        there, J_early, J_there = compose_jacobians(early, other.alignment.motion)
        cov = J_here @ one.alignment.cov @ J_here.T + J_late @ late_cov @ J_late.T
        cov += J_early @ early_cov @ J_early.T + J_there @ other.alignment.cov @ J_there.T
        e = there - here
        return float(mahalanobis(np.array([e[0], e[1], wrap(e[2])]), cov))


def _pairs_of(group: list[Closing]) -> set[tuple[int, int]]:
    return {pair for closing in group for pair in closing.pairs}


def _differences(
    one: frozenset[tuple[int, int]], other: frozenset[tuple[int, int]]
) -> set[tuple[int, int]]:
    """Returns the pairs that match a landmark which the other pairs match with another one."""
    first, second = dict(other), {b: a for a, b in other}
    return {(a, b) for a, b in one if first.get(a, b) != b or second.get(b, a) != a}


@dataclass(frozen=True, slots=True)
class Closures:
    """Loops that can be closed, and those that cannot, and why.

    Attributes:
        groups: for each loop the landmarks (P, 2) that are one, best supported loop first.
        refused: how many loops are not closed, by reason.
    """

    groups: tuple[tuple[tuple[int, int], ...], ...]
    refused: dict[str, int]


def closures(
    fitted: Fitted, maps: tuple[Submap, ...], config: RematchConfig, slips: bool
) -> Closures:
    """Returns which submaps are one place beyond doubt.

    A closure needs at least two pairs of submaps that agree, both directions fixed, and no rival
    that fits nearly as well.

    Args:
        fitted: path, map and matches.
        maps: of stretches of the path.
        config: the gate within which odometry must agree.
        slips: whether odometry may be wrong altogether.
    """
    spread = Spread(fitted.problem.pose, fitted.problem.measurements.odometry)
    found = list(_closings(fitted, maps, spread, config, slips))
    compared = Compared(maps, spread, gate_for(config.gate, DIM))
    groups = _groups(found, compared)
    strength = [sum(c.score_m for c in group) for group in groups]
    accepted, refused = [], Counter[str]()
    for n in sorted(range(len(groups)), key=lambda n: (-strength[n], n)):
        group = groups[n]
        if len(group) < 2:
            continue
        rivals = [k for k, other in enumerate(groups) if compared.contradict(group, other)]
        strongest = max((strength[k] for k in rivals if k != n), default=0.0)
        if strength[n] >= CLEARLY * strongest:
            accepted.append(_pairs(group))
        elif strength[n] >= strongest:
            refused[REFUSED + _why(group, found, fitted, maps)] += 1
    return Closures(tuple(accepted), dict(refused))


def _closings(
    fitted: Fitted, maps: tuple[Submap, ...], spread: Spread, config: RematchConfig, slips: bool
) -> Iterator[Closing]:
    """Yields the ways to lay later submaps on earlier ones that odometry allows."""
    gate = gate_for(config.gate, DIM)
    for a, b in candidates(maps, spread, config.submap_m, np.inf if slips else math.sqrt(gate)):
        earlier, later = maps[a], maps[b]
        near = None if slips else Near(*spread.relative(earlier.first, later.first), gate)
        for alignment in find_alignments(earlier.lines, later.lines, ALIGNING, near):
            if not alignment.fixed or len(alignment.matches) < ALIGNING.least:
                continue
            if slips or spread.distance(earlier.first, later.first, alignment) <= gate:
                pairs = zip(
                    earlier.landmark[alignment.matches[:, 0]].tolist(),
                    later.landmark[alignment.matches[:, 1]].tolist(),
                    strict=True,
                )
                yield Closing(a, b, frozenset(pairs), alignment.score_m, alignment)


def candidates(
    maps: tuple[Submap, ...], spread: Spread, reach: float, sigmas: float
) -> list[tuple[int, int]]:
    """Returns pairs of an earlier and a later submap that may be one place, in order.

    Each later one is compared with the `MOST` earlier ones that are nearest by what odometry is
    sure of, of the `NEIGHBOURS` nearest in all: the number of pairs grows with the length of the
    path, not with its square.

    Args:
        maps: of stretches of the path, in order.
        spread: how far odometry may be off.
        reach: how far two stretches that meet may be apart, m.
        sigmas: largest number of standard deviations by which they are farther apart.
    """
    middle = np.array([(m.first + m.last) // 2 for m in maps], np.int64)
    a, b = _neighbours(spread.pose[middle, :2].reshape(-1, 2))
    passed = np.array([m.last for m in maps])[a] <= np.array([m.first for m in maps])[b]
    a, b = a[passed], b[passed]
    away = spread.apart(middle[a], middle[b], reach)
    kept, count = [], Counter[int]()
    for k in np.lexsort((a, away)).tolist():
        pair = int(a[k]), int(b[k])
        if away[k] > sigmas or count[pair[1]] == MOST or _joined(*(maps[n] for n in pair)):
            continue
        count[pair[1]] += 1
        kept.append(pair)
    return sorted(kept)


def _neighbours(place: Array) -> tuple[IntArray, IntArray]:
    """Returns pairs (k,), (k,) of places (n, 2), each with its `NEIGHBOURS` nearest, in order."""
    if len(place) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    near = cKDTree(place).query(place, k=min(NEIGHBOURS, len(place)))[1]
    own = np.broadcast_to(np.arange(len(place))[:, None], near.shape)
    pairs = np.sort(np.column_stack([own.ravel(), near.ravel()]), axis=1)
    pairs = np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0)
    return pairs[:, 0], pairs[:, 1]


def _joined(a: Submap, b: Submap) -> bool:
    """Returns whether two submaps share so many landmarks that they are on each other already."""
    return len(np.intersect1d(a.landmark, b.landmark, assume_unique=True)) >= JOINED


def _groups(found: list[Closing], compared: Compared) -> list[list[Closing]]:
    """Returns closings that agree with each other, best first; each stands in one group."""
    groups: list[list[Closing]] = []
    for closing in sorted(found, key=lambda c: (-c.score_m, c.a, c.b)):
        own = [closing]
        for group in list(groups):
            if compared.agree(own, group):
                groups.remove(group)
                own = group + own
        groups.append(own)
    return groups


def _pairs(group: list[Closing]) -> tuple[tuple[int, int], ...]:
    """Returns the landmarks that are one by a group, each in one pair: those of most score."""
    votes: dict[tuple[int, int], float] = {}
    for closing in group:
        for pair in closing.pairs:
            votes[pair] = votes.get(pair, 0.0) + closing.score_m
    first: dict[int, int] = {}
    second: dict[int, int] = {}
    for a, b in sorted(votes, key=lambda pair: (-votes[pair], pair)):
        if a not in first and b not in second:
            first[a], second[b] = b, a
    return tuple(sorted(first.items()))


def _why(
    group: list[Closing], found: list[Closing], fitted: Fitted, maps: tuple[Submap, ...]
) -> str:
    """Returns in words what else would fit nearly as well as the best of a group.

    On a periodic floor these are shifts by its periods, floor frame; all that odometry allows.
    """
    best = group[0]
    theta = fitted.problem.pose[maps[best.a].first, 2]
    lines = maps[best.b].lines.lines[best.alignment.matches[:, 1]]
    centre = points_on_line(lines, best.alignment.common.mean(axis=1)).mean(axis=0)
    here = transform_points(best.alignment.motion, centre)
    shifts = []
    for other in found:
        same = (other.a, other.b) == (best.a, best.b) and other is not best
        turn = wrap(other.alignment.motion[2] - best.alignment.motion[2])
        if same and CLEARLY * other.score_m > best.score_m and abs(turn) < SAME_TURN:
            there = transform_points(other.alignment.motion, centre)
            shifts.append(rotation(theta) @ (there - here))
    return shifts_in_words(np.array(shifts)) or "other places fit nearly as well"


def shifts_in_words(shifts: Array) -> str:
    """Returns shifts (n, 2), m, in words: "shifted in x by 0.60 m or 1.20 m it also fits"."""
    found: dict[str, list[str]] = {}
    for x, y in sorted(shifts.tolist(), key=lambda shift: math.hypot(*shift)):
        rest = max(STRAIGHT_M, STRAIGHT * math.hypot(x, y))
        axis = "x" if abs(y) < rest else "y" if abs(x) < rest else "x and y"
        values = {"x": f"{x:.2f} m", "y": f"{y:.2f} m", "x and y": f"({x:.2f}, {y:.2f}) m"}
        found.setdefault(axis, []).append(values[axis])
    parts = [f"{axis} by {' or '.join(found[axis])}" for axis in sorted(found)]
    return f"shifted in {', in '.join(parts)} it also fits" if parts else ""
