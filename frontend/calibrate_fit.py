"""The homography that known points fix, alone or together with one coefficient of the lens."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from graphslam.errors import UnderConstrained
from graphslam.geometry import Array

FEWEST_POINTS = 4
"""Points that fix the 8 elements of a homography (SantanaLoc, section 4.2)."""
FEWEST_FOR_LENS = 6
"""Points for a homography and one coefficient of the lens, with some left to judge by."""
WEAKEST = 1e-6
"""Second smallest singular value of the normalised linear system, as a share of the largest, below
which nothing but rounding tells the points from a line."""
TIGHT = {"method": "lm", "xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """What a set of points says.

    Attributes:
        homography: (3, 3) floor (robot frame, m) to undistorted pixel.
        k1: first radial coefficient of the lens beside `nominal_matrix`; 0 where it was not asked
            for.
    """

    homography: Array
    k1: float = 0.0


def nominal_matrix(image_size: tuple[int, int]) -> Array:
    """Returns the camera matrix (3, 3) that `Fit.k1` refers to.

    Its axis goes through the middle of the image and its focal length is the image's width: one
    picture of a plane tells neither, and the homography makes up for any other focal length.
    """
    width, height = image_size
    u, v = 0.5 * (width - 1), 0.5 * (height - 1)
    return np.array([[width, 0.0, u], [0.0, width, v], [0.0, 0.0, 1.0]])


def project(homography: Array, points: Array) -> Array:
    """Returns where a homography (3, 3) takes points (K, 2), whatever their depth's sign."""
    image = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(image[:, :2] / image[:, 2:])


def fit_homography(floor: Array, pixel: Array) -> Fit:
    """Returns the homography with the least sum of squared distances in the image.

    Args:
        floor: (K, 2) points, robot frame, m.
        pixel: (K, 2) where they are in the image, undistorted pixels.

    Raises:
        UnderConstrained: fewer than four points, or all but one on a line.

    Source: SantanaLoc eq. (31), SantanaSLAM eq. (28).
    """
    system = _LinearSystem(floor, pixel)
    if len(floor) == FEWEST_POINTS:
        return Fit(system.homography(np.zeros(8)))

    def error(step: Array) -> Array:
        return np.asarray(system.project(step) - pixel).ravel()

    return Fit(system.homography(least_squares(error, np.zeros(8), **TIGHT).x))


def fit_with_lens(floor: Array, raw: Array, image_size: tuple[int, int]) -> Fit:
    """Returns homography and k1 with the least sum of squared distances in the raw image.

    Args:
        floor: (K, 2) points, robot frame, m.
        raw: (K, 2) where they are in the image as it was taken, pixels.
        image_size: (width, height), pixels.

    Raises:
        UnderConstrained: fewer than six points, or all but one on a line.
    """
    if len(floor) < FEWEST_FOR_LENS:
        raise UnderConstrained(
            f"{len(floor)} points cannot tell a bent lens from a wrong point; give at least "
            f"{FEWEST_FOR_LENS}, better 20 or more over the whole image, or do not fit distortion"
        )
    system, matrix = _LinearSystem(floor, raw), nominal_matrix(image_size)
    focal, middle = matrix[0, 0], matrix[:2, 2]

    def error(unknown: Array) -> Array:
        offset = system.project(unknown[:8]) - middle
        bent = offset * (1.0 + unknown[8] * np.sum((offset / focal) ** 2, axis=1)[:, None])
        return np.asarray(bent + middle - raw).ravel()

    found = least_squares(error, np.zeros(9), **TIGHT).x
    return Fit(system.homography(found[:8]), float(found[8]))


class _LinearSystem:
    """The linear equations of a homography, both sides moved and scaled to about 1.

    Its solution is where steps in eight coordinates across it begin.
    """

    def __init__(self, floor: Array, pixel: Array) -> None:
        if len(floor) < FEWEST_POINTS:
            raise UnderConstrained(
                f"{len(floor)} points do not fix a homography; give at least {FEWEST_POINTS}, no "
                "three of them on a line, better 6 or more over the whole image"
            )
        self.robot_T_unit, unit = _about_one(floor)
        self.image_T_unit, seen = _about_one(pixel)
        self.floor, source = floor, np.column_stack([unit, np.ones(len(unit))])
        u, v, zero = seen[:, :1], seen[:, 1:], np.zeros_like(source)
        rows = np.vstack(
            [np.hstack([source, zero, -u * source]), np.hstack([zero, source, -v * source])]
        )
        _, singular, directions = np.linalg.svd(rows)
        if singular[7] < WEAKEST * singular[0]:
            raise UnderConstrained(
                "all points but one lie on a line, which fixes no homography; spread them over the "
                "image, no three of four in a row"
            )
        self.begin, self.across = directions[8], directions[:8].T

    def homography(self, step: Array) -> Array:
        """Returns (3, 3), floor m to pixel, a step (8,) from the linear solution."""
        unit = (self.begin + self.across @ step).reshape(3, 3)
        homography = self.image_T_unit @ unit @ np.linalg.inv(self.robot_T_unit)
        return np.asarray(homography / np.linalg.norm(homography[2]))

    def project(self, step: Array) -> Array:
        """Returns where (K, 2) the points then are in the image, pixels."""
        return project(self.homography(step), self.floor)


def _about_one(points: Array) -> tuple[Array, Array]:
    """Returns (3, 3) that takes moved and scaled points to ``points``, and those (K, 2)."""
    middle = points.mean(axis=0)
    scale = math.sqrt(np.mean(np.sum((points - middle) ** 2, axis=1)) / 2.0) or 1.0
    back = np.array([[scale, 0.0, middle[0]], [0.0, scale, middle[1]], [0.0, 0.0, 1.0]])
    return back, (points - middle) / scale
