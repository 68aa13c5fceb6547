"""Moving a stretch of the path, and what that promises before anything is optimised."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graphslam.association import labels_agree, mahalanobis
from graphslam.config import RematchConfig
from graphslam.geometry import Array, compose, line_to_floor, position_along
from graphslam.measurements import IntArray
from graphslam.models.line import LINE
from graphslam.rematch.candidates import CHUNK
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
        motion: (3,) of the stretch, floor frame.
        own: (M,) which landmarks moved along.
        rows: (k,) rows of the lines' table that moved.
        row: (P,) row of the lines' table for each pair of a sighting that moved and a line.
        landmark: (P,) the line.
        distance: (P,) squared Mahalanobis distance between both, lines known within `SLACK_M`.
    """

    problem: Problem
    motion: Array
    own: NDArray[np.bool_]
    rows: IntArray
    row: IntArray
    landmark: IntArray
    distance: Array


def near_lines(fitted: Fitted, reach: float, config: RematchConfig) -> tuple[IntArray, IntArray]:
    """Returns rows (P,) of the lines' table and lines (P,) that a shift may lay on each other.

    Args:
        fitted: path, map and matches.
        reach: largest shift, m.
        config: gate, and how far along a line a sighting may lie.
    """
    problem, lines = fitted.problem, fitted.of_kind(LINE.kind)
    table = table_of(problem, LINE.kind)[1]
    row, column = close_pairs(fitted, LINE, table, lines, config)
    kept = [np.zeros(0, np.int64)]
    for begin in range(0, len(row), CHUNK):
        part = slice(begin, begin + CHUNK)
        node, line = table.node[row[part]], problem.params[lines[column[part]], :2]
        e, _, _ = LINE.residual(problem.pose[node], line, table.z[row[part]])
        S = table.cov[row[part]]
        most = reach + np.sqrt(config.gate * (S[:, 0, 0] + SLACK_M**2))
        near = (np.abs(e[:, 0]) <= most) & (e[:, 1] ** 2 <= config.gate * S[:, 1, 1])
        kept.append(begin + np.flatnonzero(near))
    pairs = np.concatenate(kept)
    row, landmark = row[pairs], lines[column[pairs]]
    alike = labels_agree(table.label[row], fitted.label[landmark])
    return row[alike], landmark[alike]


def moved(
    fitted: Fitted, move: Move, near: tuple[IntArray, IntArray], config: RematchConfig
) -> Moved:
    """Returns the problem with a stretch moved; lines that only the stretch saw move with it.

    Args:
        fitted: path, map and matches.
        move: what moves.
        near: `near_lines` for shifts that far, or farther.
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
    params[own, :2] = line_to_floor(params[own, :2], move.motion)
    extent[own] += position_along(params[own, :2], move.motion[:2])[:, None]
    problem = replace(problem, pose=pose, params=params)
    first, table = table_of(problem, LINE.kind)
    if move.motion[2]:
        near = near_lines(replace(fitted, problem=problem, extent=extent), 0.0, config)
    row, landmark = near
    there = inside[first + row]
    row, landmark = row[there], landmark[there]
    e, _, _ = LINE.residual(pose[table.node[row]], params[landmark, :2], table.z[row])
    S = table.cov[row] + np.diag([SLACK_M**2, 0.0])
    rows = np.flatnonzero(inside[first : first + len(table)])
    return Moved(problem, move.motion, own, rows, row, landmark, mahalanobis(e, S))


def matched(after: Moved, fitted: Fitted, config: RematchConfig) -> Problem:
    """Returns the problem whose moved sightings take the nearest line, one a node.

    Lines that moved along and lie on one that stays are no longer there. What the stretch saw of a
    line that stays, and finds no line any more, becomes a line of its own.
    """
    problem = after.problem
    first, table = table_of(problem, LINE.kind)
    match = problem.match.copy()
    rows = after.rows
    match[first + rows] = UNMATCHED
    taken: set[tuple[int, int]] = set()
    there = ~_absorbed(after, config)[after.landmark]
    near = np.flatnonzero((after.distance <= config.gate) & there)
    for p in near[np.argsort(after.distance[near], kind="stable")].tolist():
        sighting, landmark = first + int(after.row[p]), int(after.landmark[p])
        place = (int(table.node[after.row[p]]), landmark)
        if match[sighting] == UNMATCHED and place not in taken:
            match[sighting] = landmark
            taken.add(place)
    moved_rows = np.zeros(len(match), bool)
    moved_rows[first + rows] = True
    left = np.where((match == UNMATCHED) & moved_rows, problem.match, UNMATCHED)
    seen = np.bincount(left[left >= 0], minlength=len(problem.kinds))
    new = np.flatnonzero((seen >= config.min_sightings) & ~after.own)
    params = np.vstack([problem.params, problem.params[new]])
    params[len(problem.kinds) :, :2] = line_to_floor(problem.params[new, :2], after.motion)
    for number, landmark in enumerate(new.tolist()):
        match[left == landmark] = len(problem.kinds) + number
    return replace(
        problem,
        match=match,
        kinds=problem.kinds + (LINE.kind,) * len(new),
        fixed=np.append(problem.fixed, np.zeros(len(new), bool)),
        params=params,
    )


def promise(after: Moved, fitted: Fitted, move: Move, config: RematchConfig) -> float:
    """Returns about by how much a move would lower the objective, before anything is optimised.

    What odometry gains; less what sightings lose that no longer lie on a line, for each line up to
    what it costs to begin it anew; and a line less for each that comes to lie on another.
    """
    count = len(fitted.problem.kinds)
    first, table = table_of(fitted.problem, LINE.kind)
    nearest = np.full(len(table), config.gate)
    np.minimum.at(nearest, after.row, after.distance)
    rows = after.rows
    was = fitted.problem.match[first + rows]
    free = was < 0
    own = was[~free]
    pose, params = fitted.problem.pose[table.node[rows[~free]]], fitted.problem.params[own, :2]
    e, _, _ = LINE.residual(pose, params, table.z[rows[~free]])
    S = table.cov[rows[~free]] + np.diag([SLACK_M**2, 0.0])
    before = np.minimum(mahalanobis(e, S), config.gate)
    loss = 0.5 * np.bincount(own, nearest[rows[~free]] - before, minlength=count)
    revived = 0.5 * float(np.sum(config.gate - nearest[rows[free]]))
    lost = float(np.minimum(loss, NEW_LINE).sum())
    return move.gain - lost + revived + NEW_LINE * int(_absorbed(after, config).sum())


def _absorbed(after: Moved, config: RematchConfig) -> NDArray[np.bool_]:
    """Returns (M,) which lines that moved along lie on one that stays, by their sightings."""
    count = len(after.own)
    first, table = table_of(after.problem, LINE.kind)
    nearest = np.full(len(table), config.gate)
    stays = ~after.own[after.landmark]
    np.minimum.at(nearest, after.row[stays], after.distance[stays])
    match = after.problem.match[first : first + len(table)]
    used = match >= 0
    seen = np.bincount(match[used], minlength=count)
    mean = np.bincount(match[used], nearest[used], minlength=count) / np.maximum(seen, 1)
    return np.asarray(after.own & (seen > 0) & (mean < SAME * config.gate))
