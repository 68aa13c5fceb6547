"""Places where a path may have slipped by one line: parallel lines at one spacing look alike.

A wrong match by one spacing between two sightings of a direction bends the path there, against
odometry, and everything after fits again. No single match looks wrong, so none is moved; the way
out is to shift a whole stretch of the path and to let the penalised cost judge.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from graphslam.association import mahalanobis, same_label
from graphslam.config import RematchConfig
from graphslam.geometry import Array, rotation, wrap
from graphslam.measurements import IntArray
from graphslam.models import MODELS
from graphslam.models.line import LINE
from graphslam.rematch.fitted import UNMATCHED, Fitted, table_of
from graphslam.smoother.problem import Problem

SAME_DIRECTION = np.radians(20.0)
SNAP_SIGMA = 3.0
"""How far from what odometry suggests a shift by a spacing may be, standard deviations."""
MOST_SPACINGS = 3
SLACK_M = 0.05
"""Standard deviation of lines after a shift that is not exact, m."""


@dataclass(frozen=True, slots=True)
class Gap:
    """A stretch of the path between two sightings of lines of one direction.

    Attributes:
        first: last node that saw the direction before.
        last: next node that saw it.
        normal: (2,) unit vector across the lines, floor frame.
        tension_m: how much further along the normal the path went than odometry did, m.
        sigma_m: standard deviation of odometry's way along the normal, m.
    """

    first: int
    last: int
    normal: Array
    tension_m: float
    sigma_m: float


@dataclass(frozen=True, slots=True)
class Shift:
    """A stretch of the path that may lie elsewhere.

    Attributes:
        first: first node that moves.
        last: node after the last that moves.
        vector: (2,) by how much, m, floor frame.
        gain: by how much odometry alone would like it, in units of the cost.
    """

    first: int
    last: int
    vector: Array
    gain: float


def shifts(fitted: Fitted, least_gain: float, most: int) -> tuple[Shift, ...]:
    """Returns the shifts that odometry would like most, best first.

    Args:
        fitted: path, map and matches.
        least_gain: smallest gain worth a trial.
        most: largest number returned.
    """
    nodes, found = len(fitted.problem.pose), []
    for gaps, spacings in _directions(fitted):
        for number, gap in enumerate(gaps):
            for size in _sizes(gap, spacings):
                gain = _gain(gap, size)
                found.append(Shift(gap.last, nodes, -size * gap.normal, gain))
                found += [
                    Shift(gap.last, back.last, -size * gap.normal, gain + _gain(back, -size))
                    for back in gaps[number + 1 :]
                ]
    good = [shift for shift in found if shift.gain > least_gain]
    good.sort(key=lambda shift: (-shift.gain, shift.first, shift.last))
    return tuple(good[:most])


def shifted(fitted: Fitted, shift: Shift, config: RematchConfig) -> Problem:
    """Returns the problem with a stretch of the path moved, and its sightings matched there.

    Landmarks that only the stretch saw move with it; its other sightings take the nearest landmark.
    """
    problem = fitted.problem
    moves = np.zeros(len(problem.pose), bool)
    moves[shift.first : shift.last] = True
    pose = problem.pose.copy()
    pose[moves, :2] += shift.vector
    inside = moves[fitted.node]
    matched = problem.match >= 0
    outside = np.bincount(problem.match[matched & ~inside], minlength=len(problem.kinds))
    params, lines = problem.params.copy(), fitted.of_kind(LINE.kind)
    own = lines[(outside[lines] == 0) & ~problem.fixed[lines]]
    alpha = params[own, 1]
    params[own, 0] += np.cos(alpha) * shift.vector[0] + np.sin(alpha) * shift.vector[1]
    moved = replace(problem, pose=pose, params=params)
    return replace(moved, match=_nearest(moved, inside, lines, fitted.label[lines], config))


def _directions(fitted: Fitted) -> Iterator[tuple[list[Gap], Array]]:
    """Yields for each direction of lines its gaps and the spacings (S,) of its lines, m."""
    problem = fitted.problem
    lines = fitted.of_kind(LINE.kind)
    left = lines[np.argsort(wrap(2.0 * problem.params[lines, 1]))] if len(lines) else lines
    while len(left):
        alpha = problem.params[left[0], 1]
        turn = 0.5 * wrap(2.0 * (problem.params[left, 1] - alpha))
        same = np.abs(turn) < SAME_DIRECTION
        group, left = left[same], left[~same]
        alpha = alpha + float(np.mean(turn[same]))
        normal = np.array([np.cos(alpha), np.sin(alpha)])
        seen = np.isin(problem.match, group)
        gaps = list(_gaps(fitted, np.unique(fitted.node[seen]), normal))
        yield gaps, _spacings(problem.params[group, :2], normal)


def _gaps(fitted: Fitted, nodes: IntArray, normal: Array) -> Iterator[Gap]:
    pose, odometry = fitted.problem.pose, fitted.problem.measurements.odometry
    turn = rotation(pose[:-1, 2])
    driven = (turn @ odometry.increment[:, :2, None])[..., 0] @ normal
    went = np.diff(pose[:, :2], axis=0) @ normal
    across = np.einsum("i,kij->kj", normal, turn)
    variance = np.einsum("ki,kij,kj->k", across, odometry.cov[:, :2, :2], across)
    tension = np.concatenate([[0.0], np.cumsum(went - driven)])
    total = np.concatenate([[0.0], np.cumsum(variance)])
    for first, last in zip(nodes[:-1].tolist(), nodes[1:].tolist(), strict=True):
        sigma = float(np.sqrt(total[last] - total[first]))
        yield Gap(first, last, normal, float(tension[last] - tension[first]), sigma)


def _spacings(lines: Array, normal: Array) -> Array:
    """Returns the distances (S,) between any two of a group of nearly parallel lines, m."""
    sign = np.sign(np.cos(lines[:, 1]) * normal[0] + np.sin(lines[:, 1]) * normal[1])
    rho = np.sort(sign * lines[:, 0])
    apart = np.abs(rho[:, None] - rho[None, :])[np.triu_indices(len(rho), 1)]
    apart.sort()
    groups = np.split(apart, np.flatnonzero(np.diff(apart) > SLACK_M) + 1)
    return np.array([group.mean() for group in groups if len(group)])


def _sizes(gap: Gap, spacings: Array) -> list[float]:
    """Returns by how much the path may have slipped in a gap, m: spacings near the tension."""
    wanted = abs(gap.tension_m)
    off = np.abs(spacings - wanted)
    near = (off < SNAP_SIGMA * gap.sigma_m) & (spacings > 0.5 * SLACK_M)
    best = spacings[near][np.argsort(off[near], kind="stable")][:MOST_SPACINGS]
    return [float(np.copysign(size, gap.tension_m)) for size in best]


def _gain(gap: Gap, size: float) -> float:
    """Returns what odometry saves in a gap when the path's slip of ``size`` is taken back."""
    before, after = gap.tension_m, gap.tension_m - size
    return 0.5 * (before**2 - after**2) / gap.sigma_m**2


def _nearest(
    problem: Problem, inside: Array, lines: IntArray, label: IntArray, config: RematchConfig
) -> IntArray:
    """Returns matches (K,) where the sightings ``inside`` take the nearest line, one a node."""
    match = problem.match.copy()
    first, table = table_of(problem, LINE.kind)
    rows = np.flatnonzero(inside[first : first + len(table)])
    pose = problem.pose[table.node[rows]]
    model = MODELS[LINE.kind]
    e, _, _ = model.residual(pose[:, None], problem.params[lines, :2], table.z[rows][:, None])
    S = table.cov[rows] + np.diag([SLACK_M**2, 0.0])
    distance = mahalanobis(e, S[:, None])
    match[first + rows] = UNMATCHED
    taken: set[tuple[int, int]] = set()
    pairs = np.argwhere((distance <= config.gate) & same_label(table.label[rows], label))
    for i, j in pairs[np.argsort(distance[tuple(pairs.T)], kind="stable")].tolist():
        place = (int(table.node[rows[i]]), j)
        if match[first + rows[i]] == UNMATCHED and place not in taken:
            match[first + rows[i]] = lines[j]
            taken.add(place)
    return match
