"""Closing loops: local line maps laid on each other, wherever odometry allows the robot to be."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from graphslam.association import gate_for
from graphslam.config import RematchConfig
from graphslam.estimate import LOOP_OPEN
from graphslam.geometry import (
    Array,
    points_on_line,
    rotation,
    transform_points,
    wrap,
)
from graphslam.line_maps.alignment import find_alignments
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.votes import Near
from graphslam.measurements import IntArray
from graphslam.rematch.accord import CLEARLY, COMMON, Closing, Compared, grouped, pairs_of
from graphslam.rematch.fitted import Fitted
from graphslam.rematch.spread import Spread
from graphslam.rematch.submaps import Submap
from graphslam.rematch.torn import MOST_SHIFT_M, MOST_TURN_DEG

NEIGHBOURS, MOST = 96, 32
"""A submap is compared with the nearest `MOST` of its nearest `NEIGHBOURS`; see `candidates`."""
JOINED = 3
"""Submaps that share so many landmarks are on each other already."""
ALIGNING = AlignmentConfig(hypotheses=6, most=4, least=COMMON + 1)
"""Fewer motions are tried than for whole maps: odometry says roughly where to look."""
SAME_TURN = math.radians(5.0)
"""Closures that differ by less are shifts of each other."""
STRAIGHT_M, STRAIGHT = 0.05, 0.1
"""A shift is along an axis of the floor where the rest is smaller, m or part of it."""
DIM = 3
SLIP = np.array([MOST_SHIFT_M, MOST_SHIFT_M, math.radians(MOST_TURN_DEG)]) / 3.0
"""Standard deviations of a slip, m, m, rad: what `torn` looks for is three of them."""


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
    that fits nearly as well. What contradicts a closure beyond doubt is no rival of another.

    Args:
        fitted: path, map and matches.
        maps: of stretches of the path.
        config: the gates within which odometry must agree, and beyond which places are others.
        slips: whether the robot may have slipped between any two places.
    """
    slip = SLIP if slips else None
    spread = Spread(fitted.problem.pose, fitted.problem.measurements.odometry, slip)
    found = list(_closings(maps, spread, config))
    gates = (gate_for(gate, DIM) for gate in (config.gate, config.gate_new))
    compared = Compared(maps, spread, *gates)
    groups = grouped(found, compared)
    strength = [sum(c.score_m for c in group) for group in groups]
    accepted, refused = [], Counter[str]()
    possible = set(range(len(groups)))
    for n in sorted(range(len(groups)), key=lambda n: (-strength[n], n)):
        group = groups[n]
        if len(group) < 2 or n not in possible:
            continue
        rivals = {k for k in possible - {n} if compared.contradict(group, groups[k])}
        strongest = max((strength[k] for k in rivals), default=0.0)
        if strength[n] >= CLEARLY * strongest:
            accepted.append(pairs_of(group))
            possible -= rivals
        elif strength[n] >= strongest:
            refused[LOOP_OPEN + _why(group, found, fitted, maps)] += 1
    return Closures(tuple(accepted), dict(refused))


def _closings(maps: tuple[Submap, ...], spread: Spread, config: RematchConfig) -> Iterator[Closing]:
    """Yields the ways to lay later submaps on earlier ones that odometry allows."""
    gate = gate_for(config.gate, DIM)
    for a, b in candidates(maps, spread, config.submap_m, math.sqrt(gate)):
        earlier, later = maps[a], maps[b]
        near = Near(*spread.relative(earlier.first, later.first), gate)
        for alignment in find_alignments(earlier.lines, later.lines, ALIGNING, near):
            if not alignment.fixed or len(alignment.matches) < ALIGNING.least:
                continue
            if spread.distance(earlier.first, later.first, alignment) <= gate:
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
