"""Pictures of the ceiling with the lamps that were seen in it."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from frontend.camera import Camera
from frontend.overlay import COLOURS, MARGIN_PX, Picture, caption
from graphslam.geometry import Array

AXIS, CENTRE = COLOURS[0], COLOURS[1]
HEIGHT = 480  # pixels of a frame's picture
AXIS_M = 0.5
"""Length that axes are drawn with where the lamps' is not known, m."""


def lamp_picture(grey: Picture, camera: Camera, z: Array, text: str) -> Picture:
    """Returns a picture (H, W, 3), BGR, of a frame with centre and axis of its lamps (K, 3)."""
    scale = HEIGHT / grey.shape[0]
    picture: Any = cv2.cvtColor(cv2.resize(grey, None, fx=scale, fy=scale), cv2.COLOR_GRAY2BGR)
    draw_lamps(picture, camera, z, np.full((len(z), 2), AXIS_M), scale)
    return caption(picture, text)


def draw_lamps(picture: Picture, camera: Camera, z: Array, size: Array, scale: float) -> None:
    """Draws centre and axis of lamps into a picture as it was recorded, lens distortion and all.

    Args:
        picture: (H, W, 3), changed.
        camera: that took it.
        z: (K, 3) ``(x, y, phi)`` in the lamps' plane, robot frame, m and rad.
        size: (K, 2) length and width of each, m; the axis is drawn over the length.
        scale: picture pixels for one of the camera's.
    """
    for (x, y, phi), (length, _) in zip(z, size, strict=True):
        along = np.linspace(-0.5, 0.5, 9)[:, None] * length * np.array([np.cos(phi), np.sin(phi)])
        points = camera.distort(camera.floor_to_pixel(np.array([x, y]) + along))
        points = scale * (points + 0.5) - 0.5
        if not (np.abs(points) < MARGIN_PX).all():  # NaN too
            continue
        pixels = np.rint(points).astype(np.int32)
        cv2.polylines(picture, [pixels[:, None]], False, AXIS, 2, cv2.LINE_AA)
        cv2.circle(picture, pixels[4].tolist(), 4, CENTRE, -1, cv2.LINE_AA)
