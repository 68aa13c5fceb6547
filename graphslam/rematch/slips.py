"""Places where a path may have slipped by one line: parallel lines at one spacing look alike.

A wrong match by one spacing between two sightings of a direction bends the path there, against
odometry or not, and everything after fits again. So does a turn by the angle between two directions
of lines. No single match looks wrong, so none is moved; the way out is to move a whole stretch of
the path and to let the objective judge.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from graphslam.geometry import (
    Array,
    compose,
    distance_from_line,
    points_on_line,
    position_along,
    rotation,
    wrap,
)
from graphslam.measurements import IntArray
from graphslam.models.line import LINE
from graphslam.rematch.fitted import Fitted, table_of
from graphslam.rematch.moving import SLACK_M, Move

SAME_DIRECTION = np.radians(20.0)
SAME_TURN = np.radians(5.0)
"""Turns that differ by less are one."""
MOST_TURN = np.radians(120.0)
NEAR_M = 2.0
"""How far beyond each other's ends, m, lines may lie that a robot takes for each other."""
MOST_SPACINGS = 4
"""By how many spacings, and of how many turns and places after a turn, a stretch is moved."""
MOST_SHIFTS, MOST_TURNS = 160, 24
"""Shifts, and turns, that are looked at closely."""
NEXT = 6
"""Nodes between gaps in two directions in which a path may slip at once."""
NEXT_BACK, BEST_BACK = 16, 48
"""Gaps after a slip in which it may be taken back: the next, and the likeliest of all."""
BIN_M = 0.02
PLACES = 3
"""Places across each direction of lines where a stretch is laid after a turn: the nearest."""
APART_M = 0.1
"""Places that are nearer to each other are one, m."""
REACH_M = 0.5
"""How far from where it was a stretch is laid after a turn, m."""
LEAST_VOTES = 0.25
"""Part of the votes for the best place that another needs."""
HEAD = 120
"""Sightings after a turn by which its place is found."""


@dataclass(frozen=True, slots=True)
class Direction:
    """Lines that are nearly parallel.

    Attributes:
        normal: (2,) unit vector across the lines, floor frame.
        alpha: its angle, rad.
        lines: (k,) landmarks.
        rho: (k,) where they are along the normal, m.
    """

    normal: Array
    alpha: float
    lines: IntArray
    rho: Array


@dataclass(frozen=True, slots=True)
class Gap:
    """A stretch of the path between two sightings of lines of one direction, or of any.

    Attributes:
        first: last node that saw the direction before.
        last: next node that saw it.
        tension: how much further along the normal the path went than odometry did, m; or how
            much further it turned, rad.
        sigma: standard deviation of odometry's way along the normal, m; or turn, rad.
    """

    first: int
    last: int
    tension: float
    sigma: float

    def gain(self, size: float) -> float:
        """Returns what odometry saves when the path's slip of ``size`` is taken back."""
        return 0.5 * (self.tension**2 - (self.tension - size) ** 2) / self.sigma**2

    def widest(self, least_gain: float) -> float:
        """Returns the largest size that gains so much, 0 where none does."""
        square = self.tension**2 - 2.0 * least_gain * self.sigma**2
        return abs(self.tension) + float(np.sqrt(max(square, 0.0)))


def moves(fitted: Fitted, least_gain: float) -> list[Move]:
    """Returns moves of stretches of the path that odometry allows.

    Args:
        fitted: path, map and matches.
        least_gain: smallest gain by odometry, in units of the cost; below 0 where the path may have
            been bent in odometry's favour.
    """
    groups = list(directions(fitted))
    shifts = [shift for group in groups for shift in _shifts(fitted, group, least_gain)]
    shifts += _diagonal(shifts, len(fitted.problem.pose), least_gain)
    shifts.sort(key=lambda move: (-move.gain, move.first, move.last))
    return shifts[:MOST_SHIFTS] + list(_turns(fitted, groups, least_gain))


def _diagonal(shifts: list[Move], nodes: int, least_gain: float) -> list[Move]:
    """Returns shifts across two directions at once, in gaps next to each other."""
    tails = [move for move in shifts if move.last == nodes]
    tails.sort(key=lambda move: (-move.gain, move.first))
    found = []
    for number, a in enumerate(tails[:MOST_SHIFTS]):
        for b in tails[number + 1 : MOST_SHIFTS]:
            near = abs(a.first - b.first) <= NEXT
            across = abs(a.motion @ b.motion) < 0.5 * np.sqrt(
                a.motion @ a.motion * b.motion @ b.motion
            )
            if near and across and a.gain + b.gain > least_gain:
                first = min(a.first, b.first)
                found.append(Move(first, nodes, a.motion + b.motion, a.gain + b.gain))
    return found


def directions(fitted: Fitted) -> Iterator[Direction]:
    """Yields the directions of lines, each with its lines."""
    params = fitted.problem.params
    lines = fitted.of_kind(LINE.kind)
    left = lines[np.argsort(wrap(2.0 * params[lines, 1]))] if len(lines) else lines
    while len(left):
        turn = 0.5 * wrap(2.0 * (params[left, 1] - params[left[0], 1]))
        same = np.abs(turn) < SAME_DIRECTION
        group, left = left[same], left[~same]
        alpha = float(params[group[0], 1] + np.mean(turn[same]))
        normal = np.array([np.cos(alpha), np.sin(alpha)])
        sign = np.sign(np.cos(params[group, 1] - alpha))
        yield Direction(normal, alpha, group, sign * params[group, 0])


def _shifts(fitted: Fitted, group: Direction, least_gain: float) -> Iterator[Move]:
    """Yields shifts across a direction: of all that follows a gap, and between two gaps."""
    nodes = len(fitted.problem.pose)
    seen = np.unique(fitted.node[np.isin(fitted.problem.match, group.lines)])
    gaps = list(_gaps(fitted, seen, group.normal))
    widest = max((gap.widest(least_gain) for gap in gaps), default=0.0)
    spacings = _spacings(fitted, group, widest)
    likeliest: dict[float, list[int]] = {}
    for number, gap in enumerate(gaps):
        for size in _sizes(gap, spacings, least_gain):
            motion, gain = np.append(-size * group.normal, 0.0), gap.gain(size)
            yield Move(gap.last, nodes, motion, gain)
            if size not in likeliest:
                likeliest[size] = _likeliest(gaps, -size)
            later = set(range(number + 1, min(number + 1 + NEXT_BACK, len(gaps))))
            later |= {back for back in likeliest[size] if back > number}
            for back in sorted(later):
                both = gain + gaps[back].gain(-size)
                if both > least_gain:
                    yield Move(gap.last, gaps[back].last, motion, both)


def _likeliest(gaps: list[Gap], size: float) -> list[int]:
    """Returns the gaps in which a slip of ``size`` is the likeliest."""
    gain = np.array([gap.gain(size) for gap in gaps])
    return [int(number) for number in np.argsort(-gain, kind="stable")[:BEST_BACK]]


def _gaps(fitted: Fitted, nodes: IntArray, normal: Array) -> Iterator[Gap]:
    pose, odometry = fitted.problem.pose, fitted.problem.measurements.odometry
    turn = rotation(pose[:-1, 2])
    driven = (turn @ odometry.increment[:, :2, None])[..., 0] @ normal
    went = np.diff(pose[:, :2], axis=0) @ normal
    across = np.einsum("i,kij->kj", normal, turn)
    variance = np.einsum("ki,kij,kj->k", across, odometry.cov[:, :2, :2], across)
    yield from _between(nodes, went - driven, variance)


def _between(nodes: IntArray, off: Array, variance: Array) -> Iterator[Gap]:
    """Yields the gaps between nodes, of what each increment is off and how sure it is."""
    tension = np.concatenate([[0.0], np.cumsum(off)])
    total = np.concatenate([[0.0], np.cumsum(variance)])
    for first, last in zip(nodes[:-1].tolist(), nodes[1:].tolist(), strict=True):
        sigma = float(np.sqrt(total[last] - total[first]))
        yield Gap(first, last, float(tension[last] - tension[first]), sigma)


def _spacings(fitted: Fitted, group: Direction, widest: float) -> Array:
    """Returns the distances (S,), m, up to the widest, between nearly parallel lines.

    Only between lines that a robot may take for each other: one lies beside the other, or not far
    from where that ends. Where they are, not at the origin, where a line's rho is lever arm.
    """
    params, extent = fitted.problem.params[group.lines, :2], fitted.extent[group.lines]
    middle = points_on_line(params, extent.mean(axis=1))
    half = 0.5 * np.ptp(extent, axis=1)
    found = [np.zeros(0)]
    for i in range(len(params) - 1):
        others = slice(i + 1, None)
        aside = np.abs(distance_from_line(params[i], middle[others]))
        along = np.abs(position_along(params[i], middle[others] - middle[i]))
        near = along <= half[i] + half[others] + NEAR_M
        near &= np.abs(0.5 * wrap(2.0 * (params[others, 1] - params[i, 1]))) < SAME_TURN
        unknown = np.isnan(along)
        aside = np.where(unknown, np.abs(group.rho[others] - group.rho[i]), aside)
        found.append(aside[(near | unknown) & (aside <= widest)])
    apart = np.sort(np.concatenate(found))
    groups = np.split(apart, np.flatnonzero(np.diff(apart) > SLACK_M) + 1)
    means = np.array([own.mean() for own in groups if len(own)])
    return means[means > 0.5 * SLACK_M]


def _sizes(gap: Gap, spacings: Array, least_gain: float) -> list[float]:
    """Returns by how much the path may have slipped in a gap, m, to either side.

    Args:
        gap: where it slipped.
        spacings: (S,) distances between lines, in order.
        least_gain: what odometry must save at least; the nearer a size is to the gap's tension, the
            more that is.
    """
    either = np.concatenate([-spacings[::-1], spacings])
    at = int(np.searchsorted(either, gap.tension))
    sizes = either[max(at - MOST_SPACINGS, 0) : at + MOST_SPACINGS].tolist()
    sizes = [size for size in sizes if gap.gain(size) > least_gain]
    sizes.sort(key=lambda size: (-gap.gain(size), size))
    return sizes[:MOST_SPACINGS]


def _turns(fitted: Fitted, groups: list[Direction], least_gain: float) -> Iterator[Move]:
    """Yields turns of all that follows a gap by the angle between two directions of lines."""
    pose, odometry = fitted.problem.pose, fitted.problem.measurements.odometry
    first, table = table_of(fitted.problem, LINE.kind)
    seen = np.unique(table.node[fitted.problem.match[first : first + len(table)] >= 0])
    off, angles = wrap(np.diff(pose[:, 2]) - odometry.increment[:, 2]), _angles(groups)
    found = [
        (gap.gain(-turn), gap.last, turn)
        for gap in _between(seen, off, odometry.cov[:, 2, 2])
        for turn in angles
    ]
    found = sorted(turn for turn in found if turn[0] > least_gain)[::-1]
    for gain, last, turn in found[:MOST_TURNS]:
        for motion in _places(fitted, groups, last, turn):
            yield Move(last, len(pose), motion, gain)


def _angles(groups: list[Direction]) -> list[float]:
    """Returns the turns, rad, that lay lines of one direction on another's."""
    found: list[float] = []
    for a, b in product(groups, groups):
        turn = 0.5 * wrap(2.0 * (a.alpha - b.alpha))
        for angle in (turn, turn - np.sign(turn) * np.pi):
            near = [abs(angle - other) < SAME_TURN for other in found]
            if SAME_DIRECTION < abs(angle) < MOST_TURN and not any(near):
                found.append(float(angle))
    return found


def _places(fitted: Fitted, groups: list[Direction], node: int, turn: float) -> Iterator[Array]:
    """Yields motions (3,) that turn the path about a node and lay what is seen next on lines."""
    problem = fitted.problem
    _, table = table_of(problem, LINE.kind)
    row = np.flatnonzero(table.node >= node)[:HEAD]
    pivot = problem.pose[node, :2]
    about = np.append(pivot - rotation(turn) @ pivot, turn)
    pose = compose(about, problem.pose[table.node[row]])
    offsets = [_offsets(pose, table.z[row], group) for group in groups[:2]]
    for across in product(*offsets):
        normals = np.array([group.normal for group in groups[: len(across)]])
        shift = np.linalg.lstsq(normals, np.array(across), rcond=None)[0]
        yield about + np.append(shift, 0.0)


def _offsets(pose: Array, z: Array, group: Direction) -> list[float]:
    """Returns the shifts across a direction that lay most sightings on one of its lines, m."""
    line = np.zeros((len(z), 2))
    line[:, 1] = group.alpha
    e, _, _ = LINE.residual(pose, line, z)  # prediction - measurement, modulo the twin
    near = np.abs(e[:, 1]) < SAME_DIRECTION
    alpha = wrap(group.alpha - pose[near, 2] - z[near, 1])
    sign = np.where(np.abs(alpha) > 0.5 * np.pi, -1.0, 1.0)
    rho = -sign * e[near, 0]
    off = (group.rho[None, :] - rho[:, None]).ravel()
    votes, edges = np.histogram(off, np.arange(-REACH_M, REACH_M + BIN_M, BIN_M))
    votes = np.convolve(votes, [1.0, 2.0, 1.0], "same")
    found: list[float] = []
    for k in np.argsort(-votes, kind="stable").tolist():
        place = float(edges[k] + 0.5 * BIN_M)
        if votes[k] > LEAST_VOTES * votes.max() and all(abs(place - f) > APART_M for f in found):
            found.append(place)
    found.sort(key=abs)
    return found[:PLACES] or [0.0]
