"""Which of several readings of a regular pattern is meant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frontend.calibrate_fit import fit_homography
from graphslam.errors import BadConfig
from graphslam.geometry import Array


def upright(pixels: Sequence[Array], floors: Sequence[Array]) -> tuple[Array, Array]:
    """Returns the pair of pixels (K, 2) and floor points (K, 2) with forward most nearly up.

    A regular pattern looks the same turned by half a turn, or by a quarter. A camera that looks
    ahead and is not mounted upside down has forward point up in its image. Readings that see the
    floor from below are left out.

    Args:
        pixels: of each reading, undistorted pixels.
        floors: of each, robot frame, m.

    Raises:
        BadConfig: none sees the floor from above.
    """
    found = [_how_upright(*pair) for pair in zip(pixels, floors, strict=True)]
    best = int(np.argmax(found))
    if found[best] == -np.inf:
        raise BadConfig("the pattern is seen as in a mirror; take the image as the camera gives it")
    return pixels[best], floors[best]


def _how_upright(pixel: Array, floor: Array) -> float:
    """Returns the cosine between forward and up in the image, amid the points; -inf from below."""
    H = fit_homography(floor, pixel).homography
    middle = H @ np.append(floor.mean(axis=0), 1.0)
    if np.linalg.det(H) * middle[2] > 0:  # as calibrate._check_side
        return -np.inf
    forward = H[:2, 0] * middle[2] - middle[:2] * H[2, 0]
    return float(-forward[1] / np.hypot(*forward))
