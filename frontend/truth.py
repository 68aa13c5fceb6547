"""Which true line a sighting is of, judged by where the robot truly was."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from frontend.log import Log
from frontend.log_parts import PoseTrack
from graphslam.geometry import (
    Array,
    interpolate_poses,
    line_to_floor,
    points_on_line,
    transform_points,
)
from graphslam.measurements import IntArray
from graphslam.models.bearing import BEARING
from graphslam.models.lamp import LAMP

LARGEST_OFFSET = 0.020
"""Largest distance from the true line at the middle of the seen stretch, m."""
LARGEST_TURN = math.radians(1.5)
"""Largest angle between a sighting and its true line, rad."""
LARGEST_ASIDE = math.radians(5.0)
"""Largest angle between the direction of a point and that of its true one, rad."""

LARGEST_LAMP_OFFSET = 0.3
"""Largest distance of a lamp from its true one, m; lamps are farther apart than that."""

CLOCK_S = 1e-6
"""Times that differ by less are equal: files print them with few decimals, s."""
BLOCK = 2**14  # pairs of a sighting and a line compared at a time: they stay in the cache


def true_lines(log: Log, t: Array, z: Array, extent: Array) -> IntArray:
    """Returns (K,) the true line of each sighting, -1 where there is none or nothing to tell it by.

    Args:
        log: with true poses and a map.
        t: (K,) times of the sightings, s.
        z: (K, 2) the sightings ``(rho, alpha)``, m and rad, robot frame.
        extent: (K, 2) stretch seen, m along the line; where NaN, the foot of the perpendicular from
            the robot stands for its middle.
    """
    truth = np.full(len(t), -1, np.int64)
    if log.truth is None or log.map is None:
        return truth
    rows, lines = log.map.of_kind("line")
    if not len(rows):
        return truth
    inside, pose = _reached(log.truth, t)
    middle = np.nan_to_num(extent[inside].mean(axis=1))
    ids = log.map.id[rows]
    size = max(1, BLOCK // len(rows))
    for first in range(0, len(inside), size):
        part = slice(first, first + size)
        nearest = nearest_line(lines, pose[part], z[inside[part]], middle[part])
        truth[inside[part]] = np.where(nearest >= 0, ids[nearest], -1)
    return truth


def nearest_line(lines: Array, pose: Array, z: Array, middle: Array) -> IntArray:
    """Returns (K,) rows of the lines nearest to sightings within the bounds above, or -1.

    Args:
        lines: (M, 2) floor frame.
        pose: (K, 3) true poses.
        z: (K, 2) sightings, robot frame.
        middle: (K,) position along each sighting where the offset is taken, m.
    """
    points = transform_points(pose, points_on_line(z, middle))
    normals = _normals(lines)
    offset = np.abs(points @ normals.T - lines[:, 0])
    # twins have opposite normals, hence the absolute value
    aligned = np.abs(_normals(line_to_floor(z, pose)) @ normals.T) >= math.cos(LARGEST_TURN)
    offset[~(aligned & (offset <= LARGEST_OFFSET))] = np.inf
    nearest = offset.argmin(axis=1)
    return np.where(np.isfinite(offset[np.arange(len(z)), nearest]), nearest, -1)


def true_points(log: Log, t: Array, bearing: Array, label: IntArray) -> IntArray:
    """Returns (K,) the true landmark of each direction, -1 where there is none or nothing tells.

    It is the one nearest in direction, of its label, within `LARGEST_ASIDE`, of landmarks.csv.

    Args:
        log: with true poses and landmarks.
        t: (K,) times of the sightings, s.
        bearing: (K,) directions, rad, robot frame.
        label: (K,) what the sensor tells points apart by; -1 for nothing.
    """

    def off(pose: Array, points: Array, of: IntArray, seen: IntArray) -> Array:
        e, _, _ = BEARING.residual(pose[:, None], points[:, :2], bearing[seen, None, None])
        own = label[seen, None]
        other = (own >= 0) & (of >= 0) & (own != of)
        return np.where(other, np.inf, np.abs(e[..., 0]))

    return _nearest_known(log, t, BEARING.kind, off, LARGEST_ASIDE)


def true_lamps(log: Log, t: Array, z: Array) -> IntArray:
    """Returns (K,) the true lamp of each sighting, -1 where there is none or nothing tells.

    It is the nearest in landmarks.csv, within `LARGEST_LAMP_OFFSET`.

    Args:
        log: with true poses and landmarks.
        t: (K,) times of the sightings, s.
        z: (K, 3) sightings ``(x, y, phi)``, robot frame, m and rad.
    """

    def off(pose: Array, lamps: Array, of: IntArray, seen: IntArray) -> Array:
        e, _, _ = LAMP.residual(pose[:, None], lamps, z[seen, None])
        return np.hypot(e[..., 0], e[..., 1])

    return _nearest_known(log, t, LAMP.kind, off, LARGEST_LAMP_OFFSET)


def _nearest_known(
    log: Log,
    t: Array,
    kind: str,
    off: Callable[[Array, Array, IntArray, IntArray], Array],
    farthest: float,
) -> IntArray:
    """Returns (K,) the id of the known landmark that each sighting is nearest to, -1 for none.

    Args:
        log: with true poses and landmarks; without, nothing is known.
        t: (K,) times of the sightings, s.
        kind: of the landmarks.
        off: returns how far (k, M) sightings are off landmarks, given the true poses (k, 3), the
            landmarks (M, 3), their labels (M,), and the rows (k,) of the sightings.
        farthest: that a sighting may be off its landmark.
    """
    truth = np.full(len(t), -1, np.int64)
    if log.truth is None or log.landmarks is None:
        return truth
    rows, params = log.landmarks.of_kind(kind)
    inside, pose = _reached(log.truth, t)
    if not len(rows) or not len(inside):
        return truth
    distance = off(pose, params, log.landmarks.label[rows], inside)
    nearest = distance.argmin(axis=1)
    near = distance[np.arange(len(inside)), nearest] <= farthest
    truth[inside] = np.where(near, log.landmarks.id[rows][nearest], -1)
    return truth


def _reached(truth: PoseTrack, t: Array) -> tuple[IntArray, Array]:
    """Returns which of the times (K,) the true poses reach (k,), and the poses then (k, 3)."""
    first, last = truth.t[[0, -1]]
    inside = np.flatnonzero((t >= first - CLOCK_S) & (t <= last + CLOCK_S))
    return inside, interpolate_poses(t[inside], truth.t, truth.pose)


def _normals(lines: Array) -> Array:
    """Returns the unit normals (K, 2) of lines (K, 2)."""
    return np.column_stack([np.cos(lines[:, 1]), np.sin(lines[:, 1])])
