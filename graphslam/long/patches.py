"""Patches: what a stretch of the path saw, as directed lines, and how sure its place is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graphslam.geometry import Array, points_on_line, position_along, transform_points
from graphslam.measurements import IntArray
from graphslam.models.line import LINE
from graphslam.rematch.fitted import Fitted, table_of
from graphslam.rematch.found import travelled

LENGTH_M, STEP_M = 10.0, 5.0
"""Length of a patch along the path, and from the begin of one to the next, m."""
FEWEST = 3
"""Sightings of a line that make it part of a patch."""
OFFSET_SIGMA, TURN_SIGMA, LONGEST = 0.03, 0.02, 4.0
"""How lines are weighted where a patch moves as a whole: sigma of a metre of line, m and rad."""
LOOSE = np.diag([1.0, 1.0, 10.0])
"""Information that keeps the place of a patch with one direction of lines finite."""


@dataclass(frozen=True, slots=True)
class Patch:
    """What a stretch of the path saw.

    Attributes:
        first: first node.
        last: node after the last.
        landmark: (M,) landmark of each line, ascending.
        lines: (M, 4) rho, alpha, low, high, floor frame, with the robot on the side of smaller rho.
        sign: (M,) 1 where a line has the direction of its landmark, else -1.
    """

    first: int
    last: int
    landmark: IntArray
    lines: Array
    sign: Array

    @property
    def middle(self) -> int:
        """The node in its middle."""
        return (self.first + self.last) // 2


def patches_of(fitted: Fitted) -> tuple[Patch, ...]:
    """Returns the patches of a path, each overlapping half of the next."""
    problem = fitted.problem
    offset, table = table_of(problem, LINE.kind)
    ends = points_on_line(table.z[:, None, :], table.extent)
    ends = transform_points(problem.pose[table.node][:, None, :], ends)
    way = travelled(problem.pose)
    match = problem.match[offset : offset + len(table)]
    made = []
    for begin in np.arange(0.0, max(way[-1] - STEP_M, 1e-9), STEP_M):
        first, last = np.searchsorted(way, [begin, begin + LENGTH_M]).tolist()
        rows = np.arange(*np.searchsorted(table.node, [first, last]))
        rows = rows[match[rows] >= 0]
        landmark, count = np.unique(match[rows], return_counts=True)
        landmark = landmark[count >= FEWEST]
        lines, sign = np.zeros((len(landmark), 4)), np.ones(len(landmark))
        for n, m in enumerate(landmark.tolist()):
            own = rows[match[rows] == m]
            seen_from = problem.pose[table.node[own], :2]
            lines[n], sign[n] = _directed(problem.params[m, :2], seen_from, ends[own])
        made.append(Patch(first, last, landmark, lines, sign))
    return tuple(made)


def in_frame(lines: Array, pose: Array) -> Array:
    """Returns directed lines (M, 4) of the floor as seen from ``pose`` (3,)."""
    c, s = np.cos(lines[:, 1]), np.sin(lines[:, 1])
    along = -pose[0] * s + pose[1] * c
    return np.column_stack(
        [
            lines[:, 0] - pose[0] * c - pose[1] * s,
            lines[:, 1] - pose[2],
            lines[:, 2] - along,
            lines[:, 3] - along,
        ]
    )


def covariance_between(fitted: Fitted, a: Patch, b: Patch, pose: Array) -> Array:
    """Returns how uncertain b's place is as seen from a: covariance (3, 3) in the frame of a pose.

    It follows from the joint covariance of both patches' landmarks: loops that are closed already,
    and what connects the patches, all count.
    """
    D = np.concatenate([-_shift_of(a, pose), _shift_of(b, pose)], axis=1)
    landmark = np.concatenate([a.landmark, b.landmark])
    at = (fitted.offsets[landmark][:, None] + np.arange(2)).ravel()
    return np.asarray(D @ fitted.cov_joint[np.ix_(at, at)] @ D.T)


def _directed(line: Array, seen_from: Array, ends: Array) -> tuple[Array, float]:
    """Returns rho, alpha, low, high with all viewers on one side, and -1 if it was turned."""
    along = position_along(line, ends.reshape(-1, 2))
    low, high = float(along.min()), float(along.max())
    normal = np.array([np.cos(line[1]), np.sin(line[1])])
    if np.median(seen_from @ normal) > line[0]:
        return np.array([-line[0], line[1] + np.pi, -high, -low]), -1.0
    return np.array([line[0], line[1], low, high]), 1.0


def _shift_of(patch: Patch, pose: Array) -> Array:
    """Returns how a patch moves as a whole (3, 2 M) when its landmarks' parameters change."""
    lines = in_frame(patch.lines, pose)
    count = len(lines)
    middle = 0.5 * (lines[:, 2] + lines[:, 3])
    on_floor = patch.sign * 0.5 * (patch.lines[:, 2] + patch.lines[:, 3])
    length = np.minimum(lines[:, 3] - lines[:, 2], LONGEST)
    J, M, w = np.zeros((2 * count, 3)), np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
    even = 2 * np.arange(count)
    J[even, 0], J[even, 1], J[even, 2] = np.cos(lines[:, 1]), np.sin(lines[:, 1]), -middle
    J[even + 1, 2] = 1.0
    M[even, even], M[even, even + 1] = patch.sign, -patch.sign * on_floor
    M[even + 1, even + 1] = 1.0
    w[even], w[even + 1] = length / OFFSET_SIGMA**2, length / TURN_SIGMA**2
    return np.asarray(np.linalg.solve(J.T @ (w[:, None] * J) + LOOSE, J.T * w) @ M)
