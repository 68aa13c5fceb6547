"""The camera of a scenario, also where only its view of the floor is given."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from frontend.camera import Camera
from frontend.simulate.printed_view import santana_loc_homography
from frontend.simulate.sensors import CameraSpec
from graphslam.errors import BadConfig
from graphslam.geometry import Array


def camera_of(spec: CameraSpec) -> Camera:
    """Returns the camera that a scenario describes.

    Raises:
        BadConfig: its homography or its view is none that a camera can have.
    """
    if spec.printed is not None:
        homography = santana_loc_homography()
    elif spec.homography is None:
        view = (spec.view_width, spec.view_near, spec.view_far)
        homography = homography_of_view(spec.image_size, *view)
    else:
        homography = np.array(spec.homography)
    matrix = None if spec.matrix is None else np.array(spec.matrix)
    distortion = None if spec.distortion is None else np.array(spec.distortion)
    return Camera("floor", "floor", spec.image_size, homography, matrix, distortion, spec.lens)


def homography_of_view(image_size: tuple[int, int], width: float, near: float, far: float) -> Array:
    """Returns the homography (3, 3), floor (robot frame, m) to pixel, of a tilted pinhole camera.

    The camera stands above the middle of the wheels and looks ahead and down, with square pixels
    and its axis through the middle of the image. Its height is the one that gives the width.

    Args:
        image_size: (width, height), pixels, centres at integers.
        width: floor in view across the image at the distance (near + far) / 2, m.
        near: floor at the lower edge of the image, in its middle column, m ahead.
        far: floor at the upper edge, m ahead.

    Raises:
        BadConfig: the view needs a camera higher than ``far`` or lower than a tenth of ``near``.
    """
    if not 0 < near < far:
        raise BadConfig(f"view_near = {near}, view_far = {far}: need 0 < view_near < view_far")

    def excess(height: float) -> float:
        focal, tilt = _focal_and_tilt(image_size[1], near, far, height)
        depth = 0.5 * (near + far) * math.cos(tilt) + height * math.sin(tilt)
        return image_size[0] * depth / focal - width

    lowest, highest = 0.1 * near, far
    if excess(lowest) > 0 or excess(highest) < 0:
        raise BadConfig(
            f"view_width = {width}: images of this shape that see {near} to {far} m ahead can be "
            f"{excess(lowest) + width:.2f} to {excess(highest) + width:.2f} m wide half way; "
            "change view_width, view_near, view_far or image_size"
        )
    height = brentq(excess, lowest, highest, xtol=1e-12)
    focal, tilt = _focal_and_tilt(image_size[1], near, far, height)
    c, s = math.cos(tilt), math.sin(tilt)
    camera_T_floor = np.array([[0.0, -1.0, 0.0], [-s, 0.0, height * c], [c, 0.0, height * s]])
    u_centre, v_centre = 0.5 * (image_size[0] - 1), 0.5 * (image_size[1] - 1)
    matrix = np.array([[focal, 0.0, u_centre], [0.0, focal, v_centre], [0.0, 0.0, 1.0]])
    homography = matrix @ camera_T_floor
    return homography / homography[2, 2]


def _focal_and_tilt(rows: int, near: float, far: float, height: float) -> tuple[float, float]:
    """Returns the focal length, pixels, and the tilt below the horizon, rad, at a given height."""
    down_near, down_far = math.atan2(height, near), math.atan2(height, far)
    return 0.5 * rows / math.tan(0.5 * (down_near - down_far)), 0.5 * (down_near + down_far)
