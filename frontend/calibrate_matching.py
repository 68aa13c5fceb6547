"""Which dot of an image is which point of the floor."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import ConvexHull, QhullError

from frontend.calibrate_dots import Dots
from frontend.calibrate_fit import FEWEST_POINTS, fit_homography, project
from frontend.calibrate_upright import upright
from graphslam.errors import BadConfig, UnderConstrained
from graphslam.geometry import Array

MOST_CORNERS = 12
"""Corners of the outline of all dots that are tried at most."""
NEAR = 0.04
"""A dot may belong to a point that four others put this near, as a share of the image's width:
places measured to a centimetre or two still find their dots."""
ROUGHLY = 0.03
"""And to a point whose pixel is roughly given, likewise."""
AS_GOOD = (2.0, 0.5)
"""One way to match points and dots is as good as another up to this factor on its root mean square
error, and this many pixels more."""


def dots_of_points(dots: Dots, floor: Array, width: int, source: str) -> Array:
    """Returns the pixels (K, 2) of dots whose places on the floor (K, 2), m, are known.

    Four points that span the most floor are tried against the corners of the outline of all dots;
    what fits all points decides. Where a regular pattern fits in several ways, forward is up in
    the image. Spots that are no dots do no harm inside the outline.

    Args:
        dots: of the image.
        floor: points, robot frame, m.
        width: of the image, pixels.
        source: of the points, for messages.

    Raises:
        BadConfig: the dots do not fit the points in any way.
    """
    if len(floor) < FEWEST_POINTS:
        raise BadConfig(f"{source}: {len(floor)} points; dots need at least {FEWEST_POINTS}")
    cure = (
        "light the floor evenly, cover what else is round, and check the points; or write where "
        "each dot is, in columns u,v beside x,y"
    )
    if len(dots.area) < len(floor):
        raise BadConfig(f"{source}: {len(floor)} points, but {len(dots.area)} dots seen; {cure}")
    ways = _distinct(_guesses(dots, floor, NEAR * width))
    if not ways:
        raise BadConfig(f"{source}: the {len(dots.area)} dots seen do not fit the points; {cure}")
    errors = [_rms(floor, pixel) for pixel in ways]
    worst = AS_GOOD[0] * min(errors) + AS_GOOD[1]
    ways = [pixel for pixel, error in zip(ways, errors, strict=True) if error <= worst]
    return upright(ways, [floor] * len(ways))[0]


def nearest_dots(dots: Dots, near: Array, width: int, source: str) -> Array:
    """Returns the pixels (K, 2) of the dots nearest to rough ones (K, 2).

    Raises:
        BadConfig: there is no dot near one of them, or one dot is nearest to two.
    """
    reach = ROUGHLY * width
    apart = np.linalg.norm(near[:, None] - dots.pixel, axis=2)
    chosen = apart.argmin(axis=1) if len(dots.area) else np.zeros(len(near), int)
    for k, (u, v) in enumerate(near):
        if not len(dots.area) or apart[k, chosen[k]] > reach or (chosen[:k] == chosen[k]).any():
            raise BadConfig(
                f"{source}: no dot of its own within {reach:.0f} pixels of ({u:g}, {v:g}), point "
                f"{k + 1}; correct u,v, or remove the point"
            )
    return dots.pixel[chosen]


def _guesses(dots: Dots, floor: Array, near: float) -> list[Array]:
    """Returns pixels (K, 2) of all points, one array for each way in which dots fit them."""
    corners = _sharpest(dots.pixel, _corners(dots.pixel))[::-1]  # v points down
    quad = _widest_four(floor)
    if quad is None:
        return []
    found = []
    for four in combinations(corners, FEWEST_POINTS):
        for turn in range(FEWEST_POINTS):
            pixel = _fitting(dots.pixel, dots.pixel[np.roll(four, turn)], floor, quad, near)
            if pixel is not None:
                found.append(pixel)
    return found


def _fitting(
    seen: Array, four: Array, floor: Array, quad: NDArray[np.int64], near: float
) -> Array | None:
    """Returns the pixels (K, 2) of all points, where four of them are ``four``; None if none."""
    try:
        homography = fit_homography(floor[quad], four).homography
    except UnderConstrained:
        return None
    apart = np.linalg.norm(project(homography, floor)[:, None] - seen, axis=2)
    if apart.min(axis=1).max() > near:
        return None
    point, dot = linear_sum_assignment(apart)
    return seen[dot[np.argsort(point)]] if apart[point, dot].max() <= near else None


def _distinct(ways: list[Array]) -> list[Array]:
    """Returns each way to match points and dots once."""
    return list({pixel.tobytes(): pixel for pixel in ways}.values())


def _rms(floor: Array, pixel: Array) -> float:
    """Returns the root mean square error of points (K, 2) under their own homography, pixels."""
    image = (
        np.column_stack([floor, np.ones(len(floor))]) @ fit_homography(floor, pixel).homography.T
    )
    return float(np.sqrt(np.mean(np.sum((image[:, :2] / image[:, 2:] - pixel) ** 2, axis=1))))


def _corners(points: Array) -> NDArray[np.int64]:
    """Returns which points (P, 2) are corners of their outline, anticlockwise in their axes."""
    try:
        return np.asarray(ConvexHull(points).vertices, np.int64)
    except QhullError:
        return np.zeros(0, np.int64)


def _sharpest(points: Array, corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns at most `MOST_CORNERS` corners; those go first that cut off least of the outline."""
    while len(corners) > MOST_CORNERS:
        before, after = points[np.roll(corners, 1)], points[np.roll(corners, -1)]
        (ax, ay), (bx, by) = (before - points[corners]).T, (after - points[corners]).T
        corners = np.delete(corners, np.argmin(np.abs(ax * by - ay * bx)))
    return corners


def _widest_four(floor: Array) -> NDArray[np.int64] | None:
    """Returns the four points that span the largest area, anticlockwise; None where all are in
    line or three corners hold all."""
    corners = _corners(floor)
    fours = [corners[list(four)] for four in combinations(range(len(corners)), FEWEST_POINTS)]
    if not fours:
        return None

    def area(four: NDArray[np.int64]) -> float:
        (ax, ay), (bx, by) = floor[four[2]] - floor[four[0]], floor[four[3]] - floor[four[1]]
        return float(ax * by - ay * bx)

    return max(fours, key=area)
