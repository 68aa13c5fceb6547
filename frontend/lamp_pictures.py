"""Pictures of the ceiling with the lamps that were seen in it."""

from __future__ import annotations

import cv2
import numpy as np

from frontend.camera import Camera
from frontend.overlay import COLOURS, MARGIN_PX, Picture
from graphslam.geometry import Array

AXIS, CENTRE = COLOURS[0], COLOURS[1]


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
