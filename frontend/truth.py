"""Which true line a sighting is of, judged by where the robot truly was."""

from __future__ import annotations

import math

import numpy as np

from frontend.log import Log
from graphslam.geometry import (
    Array,
    interpolate_poses,
    line_to_floor,
    points_on_line,
    transform_points,
)
from graphslam.measurements import IntArray

LARGEST_OFFSET = 0.020
"""Largest distance from the true line at the middle of the seen stretch, m."""
LARGEST_TURN = math.radians(1.5)
"""Largest angle between a sighting and its true line, rad."""

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
    first, last = log.truth.t[[0, -1]]
    inside = np.flatnonzero((t >= first - CLOCK_S) & (t <= last + CLOCK_S))
    pose = interpolate_poses(t[inside], log.truth.t, log.truth.pose)
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


def _normals(lines: Array) -> Array:
    """Returns the unit normals (K, 2) of lines (K, 2)."""
    return np.column_stack([np.cos(lines[:, 1]), np.sin(lines[:, 1])])
