"""Pictures of frames with the lines that were seen in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.images import read_grey, undistorted
from frontend.log import Log
from graphslam.geometry import Array, points_on_line

if TYPE_CHECKING:
    from frontend.sample import Frame

Picture = NDArray[np.uint8]

SHOWN = 6
"""Frames on a contact sheet at most."""
COLUMNS = 2
WIDTH = 640  # pixels of each frame on the sheet
CAPTION = 26  # pixels of height below each
COLOURS = ((0, 114, 255), (255, 158, 0), (60, 200, 60), (220, 90, 220), (0, 220, 255))  # BGR
MARGIN_PX = 1e5  # farther outside an image nothing is drawn


def contact_sheet(log: Log, frames: Sequence[Frame]) -> Picture | None:
    """Returns a picture (H, W, 3), BGR, of at most `SHOWN` frames with their lines; None without.

    Each line is drawn along the stretch where it was seen. The image is undistorted first, where
    the camera has a lens.

    Args:
        log: with the images of the frames.
        frames: of its images; those without a readable image are left out.
    """
    usable = [frame for frame in frames if frame.readable and frame.image >= 0]
    rows = np.unique(np.linspace(0, len(usable) - 1, SHOWN).round().astype(int)) if usable else []
    tiles = [tile for row in rows if (tile := _tile(log, usable[row])) is not None]
    if not tiles:
        return None
    height = max(len(tile) for tile in tiles)
    tiles = [_below(tile, height - len(tile)) for tile in tiles]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % min(COLUMNS, len(tiles)))
    across = min(COLUMNS, len(tiles))
    return np.vstack([np.hstack(tiles[i : i + across]) for i in range(0, len(tiles), across)])


def write_picture(path: Path, picture: Picture) -> None:
    """Writes a picture (H, W, 3), BGR, in the format that the ending of ``path`` names."""
    path.write_bytes(cv2.imencode(path.suffix, picture)[1].tobytes())


def draw_lines(picture: Picture, camera: Camera, z: Array, extent: Array, scale: float) -> None:
    """Draws lines (K, 2) of the robot frame along their stretches (K, 2), m, into a picture.

    Args:
        picture: (H, W, 3), changed; undistorted.
        camera: that took it.
        z: ``(rho, alpha)``, m and rad.
        extent: smallest and largest position along each line, m; NaN draws it through the view.
        scale: picture pixels for one of the camera's.
    """
    unknown = ~np.isfinite(extent).all(axis=1, keepdims=True)
    extent = np.where(unknown, camera.visible_stretch(z), extent)
    ends = camera.floor_to_pixel(points_on_line(z[:, None, :], extent))
    ends = scale * (ends + 0.5) - 0.5
    for number, line in enumerate(ends):
        if not (np.abs(line) < MARGIN_PX).all():  # NaN too
            continue
        colour, (first, last) = COLOURS[number % len(COLOURS)], np.round(line).astype(int).tolist()
        cv2.line(picture, first, last, colour, 1, cv2.LINE_AA)
        for end in (first, last):
            cv2.circle(picture, end, 4, colour, 1, cv2.LINE_AA)


def _tile(log: Log, frame: Frame) -> Picture | None:
    assert log.images is not None
    camera, path = log.cameras[log.images.camera[frame.image]], log.images.file[frame.image]
    grey: Any = read_grey(path)
    if grey is None:
        return None
    grey = undistorted(grey, camera)
    scale = WIDTH / grey.shape[1]
    size = (WIDTH, max(1, round(scale * grey.shape[0])))
    tile: Any = cv2.cvtColor(cv2.resize(grey, size), cv2.COLOR_GRAY2BGR)
    draw_lines(tile, camera, frame.z, frame.extent, scale)
    return caption(tile, f"t = {frame.t:.2f} s   {Path(path.name).name}   lines: {len(frame.z)}")


def caption(picture: Picture, text: str) -> Picture:
    """Returns a picture (H, W, 3) with a line of text below."""
    tile: Any = _below(picture, CAPTION)
    at, white = (8, len(tile) - 8), (255, 255, 255)
    cv2.putText(tile, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, white, 1, cv2.LINE_AA)
    return np.asarray(tile, np.uint8)


def _below(tile: Picture, rows: int) -> Picture:
    """Returns a picture with black rows added below."""
    return np.concatenate([tile, np.zeros((rows, *tile.shape[1:]), np.uint8)])
