"""The view of the floor that SantanaLoc prints, read in the right direction."""

from __future__ import annotations

import numpy as np

from graphslam.geometry import Array

PRINTED_A = (
    (0.1417, 0.0009, -49.2065),
    (0.0073, -0.0761, 98.6323),
    (0.0001, 0.0029, 1.0),
)
"""The homography of SantanaLoc, section 5, second equation numbered (23), as printed.

Equation (31) and the text call it floor to pixel. It is pixel to floor, in centimetres, in the
mobile frame M with x to the right and y forward: the middle of the image, (320, 240), goes to
(-2.1, 47.9), and the lower edge of the image lies nearest.
"""
PRINTED_IMAGE_SIZE = (640, 480)
"""(width, height) of its images, pixels (SantanaLoc, section 5)."""


def homography_from_printed(A: Array) -> Array:
    """Returns the homography (3, 3), floor (robot frame, m) to pixel, of a printed one.

    The only place that turns frame M and centimetres into ours: a point ``(x_M, y_M)`` cm is
    ``(y_M, -x_M) / 100`` m in the robot frame, so that ``alpha_M = alpha_robot + pi/2``.

    Args:
        A: (3, 3) pixel (u, v) to floor, cm, mobile frame M.

    Source: SantanaLoc eq. (31), inverted, and the matrix printed as '(23)'.
    """
    robot_T_M = np.array([[0.0, 0.01, 0.0], [-0.01, 0.0, 0.0], [0.0, 0.0, 1.0]])
    homography = np.linalg.inv(robot_T_M @ np.asarray(A, float))
    return homography / homography[2, 2]


def santana_loc_homography() -> Array:
    """Returns SantanaLoc's homography (3, 3), floor (robot frame, m) to pixel of 640x480.

    It shows 0.26 to 0.99 m of floor ahead. Its four printed decimals fix it to 3 cm only.
    """
    return homography_from_printed(np.array(PRINTED_A))
