"""Where a robot on a known map can be: the floor to search, and poses drawn at random."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from graphslam.geometry import Array, points_on_line, wrap
from graphslam.measurements import LandmarkMap
from graphslam.models.line import LINE

MARGIN_M = 0.5
"""How far beyond the map's own points the box around it reaches."""
SINGULAR = 1e-3
"""Sine of the angle below which two lines are not taken to cross."""


def region_of(
    known: LandmarkMap, given: tuple[float, float, float, float] | None = None
) -> tuple[Array, Array] | None:
    """Returns the lower and upper corner (2,) of the floor to search, floor frame, m.

    None where no region is given and the map spans none: parallel lines without ends.

    Args:
        known: its lines' ends, and the points where they cross, span the box where none is given.
        given: smallest and largest x, smallest and largest y, m.
    """
    if given is not None:
        return np.array(given[0::2]), np.array(given[1::2])
    rows, lines = known.of_kind(LINE.kind)
    points = [points_on_line(lines[:, None], known.extent[rows]).reshape(-1, 2)]
    crossings = [_crossing(a, b) for a, b in combinations(lines, 2)]
    points += [point[None] for point in crossings if point is not None]
    spanned = np.concatenate(points)
    spanned = spanned[np.isfinite(spanned).all(axis=1)]
    if not len(spanned) or np.ptp(spanned, axis=0).min() < SINGULAR:
        return None
    return spanned.min(axis=0) - MARGIN_M, spanned.max(axis=0) + MARGIN_M


def anywhere(region: tuple[Array, Array], count: int, rng: np.random.Generator) -> Array:
    """Returns poses (count, 3) drawn uniformly over a region of `region_of` and all headings."""
    low, high = np.append(region[0], -math.pi), np.append(region[1], math.pi)
    return rng.uniform(low, high, (count, 3))


def within(region: tuple[Array, Array], pose: Array) -> NDArray[np.bool_]:
    """Returns which poses (n, 3) lie on the floor between two corners."""
    low, high = region
    return np.asarray(np.all((pose[:, :2] >= low) & (pose[:, :2] <= high), axis=1))


def around(pose: Array, cov: Array, count: int, rng: np.random.Generator) -> Array:
    """Returns poses (count, 3) drawn around one (3,) with its covariance (3, 3), floor frame."""
    drawn = pose + rng.standard_normal((count, 3)) @ np.linalg.cholesky(cov).T
    drawn[:, 2] = wrap(drawn[:, 2])
    return np.asarray(drawn)


def _crossing(a: Array, b: Array) -> Array | None:
    normals = np.array([[np.cos(alpha), np.sin(alpha)] for alpha in (a[1], b[1])])
    if abs(np.linalg.det(normals)) < SINGULAR:
        return None
    return np.asarray(np.linalg.solve(normals, [a[0], b[0]]))
