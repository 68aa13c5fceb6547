"""Moving a stretch of the path, and what that promises before anything is optimised."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graphslam.association import labels_agree, mahalanobis
from graphslam.config import RematchConfig
from graphslam.geometry import Array, compose
from graphslam.measurements import IntArray
from graphslam.models.line import LINE
from graphslam.rematch.fitted import UNMATCHED, Fitted, table_of
from graphslam.rematch.reach import close_pairs
from graphslam.smoother.problem import Problem

SLACK_M = 0.05
"""Standard deviation of lines after a move that is not exact, m."""
NEW_LINE = 10.0
"""About what a line more costs, in units of the objective."""
SAME = 0.3
"""Part of the gate within which sightings of a moved line are of one that is there already."""


@dataclass(frozen=True, slots=True)
class Move:
    """A stretch of the path that may lie elsewhere.

    Attributes:
        first: first node that moves.
        last: node after the last that moves.
        motion: (3,) rigid motion of the stretch, floor frame.
        gain: by how much odometry alone would like it, in units of the cost.
    """

    first: int
    last: int
    motion: Array
    gain: float


@dataclass(frozen=True, slots=True)
class Moved:
    """A problem with a stretch moved, before its sightings are matched there.

    Attributes:
        problem: path and map moved, matches as they were.
        own: (M,) which landmarks moved along.
        row: (P,) row of the lines' table for each pair of a sighting that moved and a line.
        landmark: (P,) the line.
        distance: (P,) squared Mahalanobis distance between both, lines known within `SLACK_M`.
    """

    problem: Problem
    own: NDArray[np.bool_]
    row: IntArray
    landmark: IntArray
    distance: Array


def near_lines(fitted: Fitted, config: RematchConfig) -> tuple[IntArray, IntArray]:
    """Returns rows (P,) of the lines' table and lines (P,) near enough to be one."""
    lines = fitted.of_kind(LINE.kind)
    row, column = close_pairs(fitted, LINE, table_of(fitted.problem, LINE.kind)[1], lines, config)
    return row, lines[column]


def moved(
    fitted: Fitted, move: Move, near: tuple[IntArray, IntArray], config: RematchConfig
) -> Moved:
    """Returns the problem with a stretch moved; lines that only the stretch saw move with it.

    Args:
        fitted: path, map and matches.
        move: what moves.
        near: `near_lines` where they are now, which is near enough for a shift.
        config: how far along a line a sighting may lie.
    """
    problem = fitted.problem
    moves = np.zeros(len(problem.pose), bool)
    moves[move.first : move.last] = True
    pose, params, extent = problem.pose.copy(), problem.params.copy(), fitted.extent.copy()
    pose[moves] = compose(move.motion, pose[moves])
    inside = moves[fitted.node]
    matched = problem.match >= 0
    outside = np.bincount(problem.match[matched & ~inside], minlength=len(problem.kinds))
    lines = fitted.of_kind(LINE.kind)
    own = np.zeros(len(problem.kinds), bool)
    own[lines] = (outside[lines] == 0) & ~problem.fixed[lines]
    params[own, 1] += move.motion[2]
    c, s = np.cos(params[own, 1]), np.sin(params[own, 1])
    params[own, 0] += c * move.motion[0] + s * move.motion[1]
    extent[own] += (c * move.motion[1] - s * move.motion[0])[:, None]
    problem = replace(problem, pose=pose, params=params)
    first, table = table_of(problem, LINE.kind)
    if move.motion[2]:
        near = near_lines(replace(fitted, problem=problem, extent=extent), config)
    row, landmark = near
    alike = inside[first + row] & labels_agree(table.label[row], fitted.label[landmark])
    row, landmark = row[alike], landmark[alike]
    e, _, _ = LINE.residual(pose[table.node[row]], params[landmark, :2], table.z[row])
    S = table.cov[row] + np.diag([SLACK_M**2, 0.0])
    return Moved(problem, own, row, landmark, mahalanobis(e, S))


def matched(after: Moved, fitted: Fitted, config: RematchConfig) -> Problem:
    """Returns the problem whose moved sightings take the nearest line, one a node."""
    problem = after.problem
    first, table = table_of(problem, LINE.kind)
    match = problem.match.copy()
    rows = np.unique(after.row)
    match[first + rows] = UNMATCHED
    taken: set[tuple[int, int]] = set()
    near = np.flatnonzero(after.distance <= config.gate)
    for p in near[np.argsort(after.distance[near], kind="stable")].tolist():
        sighting, landmark = first + int(after.row[p]), int(after.landmark[p])
        place = (int(table.node[after.row[p]]), landmark)
        if match[sighting] == UNMATCHED and place not in taken:
            match[sighting] = landmark
            taken.add(place)
    return replace(problem, match=match)


def promise(after: Moved, fitted: Fitted, move: Move, config: RematchConfig) -> float:
    """Returns about by how much a move would lower the objective, before anything is optimised.

    What odometry gains; less what sightings lose that no longer lie on a line, for each line up to
    what it costs to begin it anew; and a line less for each that comes to lie on another.
    """
    count = len(fitted.problem.kinds)
    first, table = table_of(fitted.problem, LINE.kind)
    nearest = np.full(len(table), config.gate)
    np.minimum.at(nearest, after.row, after.distance)
    other = np.full(len(table), config.gate)
    stays = ~after.own[after.landmark]
    np.minimum.at(other, after.row[stays], after.distance[stays])
    rows = np.unique(after.row)
    was = fitted.problem.match[first + rows]
    free = was < 0
    own = was[~free]
    pose, params = fitted.problem.pose[table.node[rows[~free]]], fitted.problem.params[own, :2]
    e, _, _ = LINE.residual(pose, params, table.z[rows[~free]])
    S = table.cov[rows[~free]] + np.diag([SLACK_M**2, 0.0])
    before = np.minimum(mahalanobis(e, S), config.gate)
    loss = 0.5 * np.bincount(own, nearest[rows[~free]] - before, minlength=count)
    seen = np.bincount(own, minlength=count)
    on_other = np.bincount(own, other[rows[~free]], minlength=count) / np.maximum(seen, 1)
    merged = int(np.sum(after.own & (seen > 0) & (on_other < SAME * config.gate)))
    revived = 0.5 * float(np.sum(config.gate - nearest[rows[free]]))
    lost = float(np.minimum(loss, NEW_LINE).sum())
    return move.gain - lost + revived + NEW_LINE * merged
