"""Patches: what a stretch of the path saw, as directed lines, and how sure its place is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from graphslam.geometry import Array, points_on_line, transform_points
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
LOOSE = (1.0, 1.0, 10.0)
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
    viewer, params = problem.pose[table.node, :2], np.ascontiguousarray(problem.params[:, :2])
    place = np.full(len(params), -1)
    made = []
    for begin in np.arange(0.0, max(way[-1] - STEP_M, 1e-9), STEP_M):
        first, last = np.searchsorted(way, [begin, begin + LENGTH_M]).tolist()
        rows = slice(*np.searchsorted(table.node, [first, last]).tolist())
        own = match[rows]
        landmark, count = np.unique(own[own >= 0], return_counts=True)
        landmark = landmark[count >= FEWEST]
        lines, sign = np.zeros((len(landmark), 4)), np.ones(len(landmark))
        _direct(own, viewer[rows], ends[rows], params, landmark, place, lines, sign)
        made.append(Patch(first, last, landmark, lines, sign))
    return tuple(made)


def in_frame(lines: Array, pose: Array) -> Array:
    """Returns directed lines (M, 4) of the floor as seen from ``pose`` (3,)."""
    return np.asarray(_in_frame(lines, pose))


def covariance_between(fitted: Fitted, a: Patch, b: Patch, pose: Array) -> Array:
    """Returns how uncertain b's place is as seen from a: covariance (3, 3) in the frame of a pose.

    It follows from the joint covariance of both patches' landmarks: loops that are closed already,
    and what connects the patches, all count.
    """
    D = np.concatenate(
        [-_shift_of(a.lines, a.sign, pose), _shift_of(b.lines, b.sign, pose)], axis=1
    )
    at = np.concatenate([fitted.offsets[a.landmark], fitted.offsets[b.landmark]])
    return np.asarray(_carried(D, fitted.cov_joint, at))


@njit(cache=True)
def _direct(match, viewer, ends, params, landmark, place, lines, sign):  # type: ignore[no-untyped-def]
    """Fills rho, alpha, low, high with most viewers on one side, and -1 where a line was turned.

    Args:
        match: (k,) landmark of each sighting, -1 for none.
        viewer: (k, 2) where it was seen from, floor frame.
        ends: (k, 2, 2) ends of the stretch seen, floor frame.
        params: (M, 2) of all landmarks.
        landmark: (m,) those that are wanted.
        place: (M,) room, all -1, as it is left.
        lines: (m, 4) filled.
        sign: (m,) of ones, filled.
    """
    beyond = np.zeros(len(landmark))
    for n in range(len(landmark)):
        place[landmark[n]] = n
        lines[n, :2] = params[landmark[n]]
        lines[n, 2], lines[n, 3] = math.inf, -math.inf
    for k in range(len(match)):
        n = place[match[k]] if match[k] >= 0 else -1
        if n < 0:
            continue
        c, s = math.cos(lines[n, 1]), math.sin(lines[n, 1])
        for end in range(2):
            along = -ends[k, end, 0] * s + ends[k, end, 1] * c
            lines[n, 2], lines[n, 3] = min(lines[n, 2], along), max(lines[n, 3], along)
        beyond[n] += 1.0 if viewer[k, 0] * c + viewer[k, 1] * s > lines[n, 0] else -1.0
    for n in range(len(landmark)):
        place[landmark[n]] = -1
        if beyond[n] > 0.0:
            low, high = lines[n, 2], lines[n, 3]
            lines[n, 0], lines[n, 1] = -lines[n, 0], lines[n, 1] + math.pi
            lines[n, 2], lines[n, 3] = -high, -low
            sign[n] = -1.0


@njit(cache=True)
def _in_frame(lines, pose):  # type: ignore[no-untyped-def]
    """Returns directed lines (M, 4) as seen from a pose."""
    out = np.empty_like(lines)
    for n in range(len(lines)):
        c, s = math.cos(lines[n, 1]), math.sin(lines[n, 1])
        along = -pose[0] * s + pose[1] * c
        out[n, 0] = lines[n, 0] - pose[0] * c - pose[1] * s
        out[n, 1] = lines[n, 1] - pose[2]
        out[n, 2], out[n, 3] = lines[n, 2] - along, lines[n, 3] - along
    return out


@njit(cache=True)
def _shift_of(lines, sign, pose):  # type: ignore[no-untyped-def]
    """Returns how a patch moves as a whole (3, 2 M) when its landmarks' parameters change."""
    count, seen = len(lines), _in_frame(lines, pose)
    H, y = np.diag(np.array(LOOSE)), np.zeros((3, 2 * count))
    J = np.zeros(3)
    for n in range(count):
        length = min(seen[n, 3] - seen[n, 2], LONGEST)
        w, w_turn = length / OFFSET_SIGMA**2, length / TURN_SIGMA**2
        J[0], J[1] = math.cos(seen[n, 1]), math.sin(seen[n, 1])
        J[2] = -0.5 * (seen[n, 2] + seen[n, 3])
        lever = 0.5 * (lines[n, 2] + lines[n, 3])
        for p in range(3):
            for q in range(3):
                H[p, q] += w * J[p] * J[q]
            y[p, 2 * n], y[p, 2 * n + 1] = w * J[p] * sign[n], -w * J[p] * lever
        H[2, 2] += w_turn
        y[2, 2 * n + 1] += w_turn
    return np.linalg.solve(H, y)


@njit(cache=True)
def _carried(D, cov, at):  # type: ignore[no-untyped-def]
    """Returns ``D C D'`` (3, 3), C (2 M, 2 M) being ``cov`` from places ``at`` (M,) on, by twos."""
    out, half = np.zeros((3, 3)), np.zeros(3)
    for i in range(D.shape[1]):
        half[:] = 0.0
        row = at[i // 2] + i % 2
        for j in range(D.shape[1]):
            entry = cov[row, at[j // 2] + j % 2]
            for p in range(3):
                half[p] += D[p, j] * entry
        for p in range(3):
            for q in range(3):
                out[p, q] += D[p, i] * half[q]
    return out
