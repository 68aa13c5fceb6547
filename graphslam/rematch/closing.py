"""Closing loops: local line maps laid on each other, wherever odometry allows the robot to be."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from graphslam.association import gate_for, mahalanobis
from graphslam.config import RematchConfig
from graphslam.geometry import Array, between, rotation, wrap
from graphslam.line_maps.alignment import Alignment, find_alignments
from graphslam.line_maps.ambiguity import ambiguity
from graphslam.line_maps.config import AlignmentConfig
from graphslam.models.odometry import transition
from graphslam.rematch.fitted import Fitted
from graphslam.rematch.submaps import Submap

ALIGNING = AlignmentConfig(hypotheses=12, most=4)
"""Fewer motions are tried than for whole maps: odometry says roughly where to look."""
JOINED = 3
"""Submaps that share so many landmarks are on each other already."""
COMMON = 2
"""Landmarks that two pairs of submaps must match alike to agree."""
CLEARLY = 2.0
"""How many times the score of any rival a closure must have."""
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
    found = list(_closings(fitted, maps, config, slips))
    groups = _groups(found)
    strength = [sum(c.score_m for c in group) for group in groups]
    accepted, refused = [], Counter[str]()
    for n in sorted(range(len(groups)), key=lambda n: (-strength[n], n)):
        group = groups[n]
        rivals = [k for k in range(len(groups)) if k != n and _contradict(group, groups[k])]
        if len(group) < 2:
            continue
        strongest = max((strength[k] for k in rivals), default=0.0)
        if strength[n] >= CLEARLY * strongest:
            accepted.append(tuple(sorted(set().union(*(c.pairs for c in group)))))
        elif strength[n] >= strongest:
            refused[REFUSED + _why(group, maps)] += 1
    return Closures(tuple(accepted), dict(refused))


def _closings(
    fitted: Fitted, maps: tuple[Submap, ...], config: RematchConfig, slips: bool
) -> Iterator[Closing]:
    """Yields the ways to lay later submaps on earlier ones that odometry allows."""
    spread = _Spread(fitted)
    gate = gate_for(config.gate, DIM)
    for b, later in enumerate(maps):
        for a, earlier in enumerate(maps[:b]):
            shared = len(np.intersect1d(earlier.landmark, later.landmark))
            if earlier.last > later.first or shared >= JOINED:
                continue
            if not slips and not spread.may_meet(earlier, later, config.submap_m, gate):
                continue
            for alignment in find_alignments(earlier.lines, later.lines, ALIGNING):
                if not alignment.fixed or len(alignment.matches) <= COMMON:
                    continue
                if slips or spread.distance(earlier.first, later.first, alignment) <= gate:
                    pairs = zip(
                        earlier.landmark[alignment.matches[:, 0]].tolist(),
                        later.landmark[alignment.matches[:, 1]].tolist(),
                        strict=True,
                    )
                    yield Closing(a, b, frozenset(pairs), alignment.score_m, alignment)


class _Spread:
    """How far odometry may be off between any two nodes."""

    def __init__(self, fitted: Fitted) -> None:
        odometry = fitted.problem.measurements.odometry
        self.pose = pose = fitted.problem.pose
        _, Q, _ = transition(pose[:-1], pose[1:], odometry.increment, odometry.cov)
        A = _about(-pose[1:, :2])
        self.total = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(A @ Q @ _T(A), axis=0)])

    def cov(self, i: int, j: int) -> Array:
        """Returns the covariance (3, 3) of node j's pose as seen from node i, floor frame."""
        A = _about(self.pose[j, :2])
        return np.asarray(A @ (self.total[j] - self.total[i]) @ A.T)

    def may_meet(self, a: Submap, b: Submap, reach: float, gate: float) -> bool:
        """Returns whether two stretches of the path may have come within ``reach``, m."""
        i, j = (a.first + a.last) // 2, (b.first + b.last) // 2
        apart = self.pose[j, :2] - self.pose[i, :2]
        way = float(np.hypot(*apart))
        if way <= reach:
            return True
        toward = apart / way
        sigma = float(np.sqrt(toward @ self.cov(i, j)[:2, :2] @ toward))
        return bool(way - reach <= np.sqrt(gate) * sigma)

    def distance(self, i: int, j: int, alignment: Alignment) -> float:
        """Returns the squared Mahalanobis distance of a motion between nodes from odometry's."""
        e = alignment.motion - between(self.pose[i], self.pose[j])
        turn = np.eye(3)
        turn[:2, :2] = rotation(-self.pose[i, 2])
        S = turn @ self.cov(i, j) @ turn.T + alignment.cov
        return float(mahalanobis(np.array([e[0], e[1], wrap(e[2])]), S))


def _T(A: Array) -> Array:
    return np.asarray(np.swapaxes(A, -1, -2))


def _about(lever: Array) -> Array:
    """Returns (..., 3, 3) what a small motion is at a point ``lever`` (..., 2) away."""
    out = np.broadcast_to(np.eye(3), (*lever.shape[:-1], 3, 3)).copy()
    out[..., 0, 2], out[..., 1, 2] = -lever[..., 1], lever[..., 0]
    return out


def _groups(found: list[Closing]) -> list[list[Closing]]:
    """Returns closings that agree with each other, best first; each stands in one group."""
    groups: list[list[Closing]] = []
    for closing in sorted(found, key=lambda c: (-c.score_m, c.a, c.b)):
        home = [g for g in groups if any(_agree(closing, other) for other in g)]
        home = [g for g in home if not _contradict([closing], g)]
        if home:
            home[0].append(closing)
        else:
            groups.append([closing])
    return groups


def _agree(one: Closing, other: Closing) -> bool:
    same_maps = one.a == other.a and one.b == other.b
    return not same_maps and len(one.pairs & other.pairs) >= COMMON


def _contradict(one: list[Closing], other: list[Closing]) -> bool:
    """Returns whether groups match a landmark with different ones, or lay maps differently."""
    if {(c.a, c.b) for c in one} & {(c.a, c.b) for c in other}:
        return True
    first = dict(pair for c in one for pair in c.pairs)
    second = dict(pair for c in other for pair in c.pairs)
    if any(second.get(a, b) != b for a, b in first.items()):
        return True
    back = {b: a for a, b in first.items()}
    return any(back.get(b, a) != a for a, b in second.items())


def _why(group: list[Closing], maps: tuple[Submap, ...]) -> str:
    """Returns in words what else would fit as well as the best of a group."""
    best = group[0]
    earlier, later = maps[best.a].lines, maps[best.b].lines
    found = ambiguity(find_alignments(earlier, later, ALIGNING), later, ALIGNING)
    if found is None or found.unique:
        return "other places fit nearly as well"
    return str(found)
