"""Ways to close a loop that say the same, and ways of which only one can be true."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graphslam.association import mahalanobis
from graphslam.geometry import compose_jacobians, wrap
from graphslam.line_maps.alignment import Alignment
from graphslam.rematch.spread import Spread
from graphslam.rematch.submaps import Submap

COMMON = 2
"""Landmarks that two pairs of submaps must match alike to agree."""
CLEARLY = 2.0
"""How many times the score of any rival a closure must have."""


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
    another: as the way between them has it, or not. As with sightings there are two gates: what
    lies between them neither says the same, nor is it another place.
    """

    def __init__(
        self, maps: tuple[Submap, ...], spread: Spread, gate: float, gate_other: float
    ) -> None:
        """Takes what closings are compared by.

        Args:
            maps: that are laid on each other.
            spread: how far odometry may be off.
            gate: squared Mahalanobis distance up to which two closings lay the path alike.
            gate_other: the same, beyond which only one of them can be true.
        """
        self._maps, self._spread = maps, spread
        self._gate, self._gate_other = gate, gate_other

    def agree(self, one: list[Closing], other: list[Closing]) -> bool:
        """Returns whether two groups match landmarks alike, and nothing in them differs."""
        alike = _all_pairs(one) & _all_pairs(other)
        if len(alike) < COMMON:
            return False
        return not any(self._differ(c, d, self._gate) for c in one for d in other)

    def contradict(self, one: list[Closing], other: list[Closing]) -> bool:
        """Returns whether a closing of one group cannot be true with one of the other."""
        return any(self._differ(c, d, self._gate_other) for c in one for d in other)

    def _differ(self, one: Closing, other: Closing, gate: float) -> bool:
        """Returns whether two closings name different landmarks, or lie farther apart than a gate.

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
        return self._distance(one, other) > gate

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


def _all_pairs(group: list[Closing]) -> set[tuple[int, int]]:
    return {pair for closing in group for pair in closing.pairs}


def _differences(
    one: frozenset[tuple[int, int]], other: frozenset[tuple[int, int]]
) -> set[tuple[int, int]]:
    """Returns the pairs that match a landmark which the other pairs match with another one."""
    first, second = dict(other), {b: a for a, b in other}
    return {(a, b) for a, b in one if first.get(a, b) != b or second.get(b, a) != a}


def grouped(found: list[Closing], compared: Compared) -> list[list[Closing]]:
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


def pairs_of(group: list[Closing]) -> tuple[tuple[int, int], ...]:
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
