"""Pictures of calibration targets whose every pixel is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from frontend.calibrate_target import Chessboard
from frontend.camera import Camera
from frontend.simulate.printed_view import santana_loc_homography
from graphslam.geometry import Array

FINE = 4
"""Samples along each side of a pixel."""
HALVED = np.array([[0.5, 0.0, -0.25], [0.0, 0.5, -0.25], [0.0, 0.0, 1.0]])
CAMERA = Camera("floor", "floor", (320, 240), HALVED @ santana_loc_homography())
"""SantanaLoc's view at half its size."""


def photograph(
    camera: Camera, paint: Callable[[Array], Array], noise: float = 2.0, seed: int = 0
) -> NDArray[np.uint8]:
    """Returns a grey image (H, W) of a floor; every pixel is the mean over its own area."""
    width, height = camera.image_size
    inside = (np.arange(FINE) + 0.5) / FINE - 0.5
    u = (np.arange(width)[:, None] + inside).ravel()
    v = (np.arange(height)[:, None] + inside).ravel()
    pixels = np.stack(np.meshgrid(u, v), -1)
    floor = camera.pixel_to_floor(camera.undistort(pixels))
    grey = paint(floor).reshape(height, FINE, width, FINE).mean((1, 3))
    grey += noise * np.random.default_rng(seed).standard_normal(grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def chessboard_paint(board: Chessboard) -> Callable[[Array], Array]:
    """Returns the grey of floor points: the board with a white border, on a grey floor."""
    corners = board.corners()
    origin = corners[0, 0]
    across, along = corners[0, 1] - origin, corners[1, 0] - origin

    def paint(floor: Array) -> Array:
        offset = (floor - origin) / board.square**2
        i, j = offset @ along, offset @ across
        on_board = (i > -1) & (i < board.rows) & (j > -1) & (j < board.columns)
        on_sheet = (i > -1.6) & (i < board.rows + 0.6) & (j > -1.6) & (j < board.columns + 0.6)
        dark = (np.floor(i) + np.floor(j)) % 2 == 0
        return np.where(on_board & dark, 40.0, np.where(on_sheet, 215.0, 140.0))

    return paint


def dots_paint(centres: Array, radius: float) -> Callable[[Array], Array]:
    """Returns the grey of floor points: dark round dots on a floor that is lit unevenly."""

    def paint(floor: Array) -> Array:
        grey = 150.0 + 60.0 * np.nan_to_num(floor[..., 1])
        for centre in centres:
            grey[np.hypot(*np.moveaxis(floor - centre, -1, 0)) < radius] *= 0.3
        return grey

    return paint
