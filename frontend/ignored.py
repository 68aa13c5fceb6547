"""Parts of a camera's image that show the robot itself, or anything else that is no floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from graphslam.geometry import Array


def is_ignored(camera: Camera, pixels: Array) -> NDArray[np.bool_]:
    """Returns whether recorded pixels (..., 2) lie in a part that ``camera.ignore_px`` names.

    Two corners name a rectangle, its border included; more are those of a polygon.
    """
    ignored = np.zeros(pixels.shape[:-1], bool)
    for numbers in camera.ignore_px:
        corners = np.array(numbers, float).reshape(-1, 2)
        if len(corners) == 2:
            low, high = corners.min(axis=0), corners.max(axis=0)
            ignored |= ((pixels >= low) & (pixels <= high)).all(axis=-1)
        else:
            ignored |= _inside(corners, pixels)
    return ignored


def ignored_image(camera: Camera) -> NDArray[np.bool_]:
    """Returns (H, W) which pixels of the recorded image are ignored."""
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    return is_ignored(camera, pixels.astype(float))


def _inside(corners: Array, points: Array) -> NDArray[np.bool_]:
    """Returns which points (..., 2) are in a polygon (V, 2): rays to the right cross it oddly."""
    u, v = points[..., 0], points[..., 1]
    odd = np.zeros(u.shape, bool)
    for (u_0, v_0), (u_1, v_1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if v_0 != v_1:
            crosses = (v_0 > v) != (v_1 > v)
            odd ^= crosses & (u < u_0 + (v - v_0) / (v_1 - v_0) * (u_1 - u_0))
    return odd
