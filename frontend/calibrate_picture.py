"""A picture of a calibration: the points, how far off they are, and the floor's grid."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.calibrate import CameraCalibration
from frontend.camera import Camera
from frontend.images import undistorted
from graphslam.errors import BadConfig
from graphslam.geometry import Array

Picture = NDArray[np.uint8]

LEAST_WIDTH = 960  # pixels of the picture
CAPTION = 58  # pixels of height below it
EMPTY = 70  # grey of a picture without an image
GRID_M = 0.1  # between lines of the floor's grid
GRID_LINES = 60  # on each side of the robot's axes, at most
MAGNIFIED = (1, 2, 5, 10, 20, 50, 100, 200)  # lengths of errors in the picture, times their own
ARROW = 30.0  # pixels of the picture that the mean error may be drawn long
RING = 64  # corners of a circle on the floor
NEAR_PX = 1e4  # farther outside the picture nothing is drawn
WHITE, GRID, POINT, ERROR, CIRCLE = (
    (255, 255, 255),
    (150, 150, 150),
    (0, 220, 255),
    (0, 114, 255),
    (255, 158, 0),
)  # BGR


def calibration_picture(found: CameraCalibration, grey: NDArray[np.uint8] | None) -> Picture:
    """Returns a picture (H, W, 3), BGR, of the points of a calibration in their image.

    A circle of the mean error's radius lies on the floor around each point, as in SantanaLoc
    fig. 7; a line, a round number of times as long as the error, leads from where the point was
    seen towards where the camera puts it. The floor's grid has 0.1 m. Lens distortion is taken out.

    Args:
        found: the calibration.
        grey: (H, W) the image; None draws on a blank one.
    """
    camera = found.camera
    width, height = camera.image_size
    blank = np.full((height, width), EMPTY, np.uint8)
    grey = blank if grey is None else undistorted(grey, camera)
    scale = max(1.0, LEAST_WIDTH / width)
    size = (round(scale * width), round(scale * height))
    resized = cv2.resize(grey, size, interpolation=cv2.INTER_LINEAR)
    picture: Picture = np.asarray(cv2.cvtColor(resized, cv2.COLOR_GRAY2BGR), np.uint8)
    _draw_grid(picture, camera, scale)
    _draw_points(picture, found, scale)
    return _with_caption(picture, found, scale)


def encoded(picture: Picture, path: Path) -> bytes:
    """Returns the bytes of a picture in the format that the ending of ``path`` names.

    Raises:
        BadConfig: the ending is not .png, .jpg or .jpeg.
    """
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise BadConfig(f"{path}: a picture's name ends in .png or .jpg; change it")
    return cv2.imencode(path.suffix.lower(), picture)[1].tobytes()


def _draw_grid(picture: Picture, camera: Camera, scale: float) -> None:
    """Draws lines of constant x and of constant y, 0.1 m apart, where the image shows floor."""
    corners = camera.view()
    low = np.maximum(np.floor(corners.min(0) / GRID_M), -GRID_LINES).astype(int)
    high = np.minimum(np.ceil(corners.max(0) / GRID_M), GRID_LINES).astype(int)
    along = [np.linspace(low[i], high[i], 200) * GRID_M for i in (0, 1)]
    for i, name in enumerate("xy"):
        for step in range(low[i], high[i] + 1):
            line = np.empty((200, 2))
            line[:, i], line[:, 1 - i] = step * GRID_M, along[1 - i]
            image = _in_picture(camera.floor_to_pixel(line), scale)
            _draw_path(picture, image, GRID, 1)
            _label(picture, image, name, f"{name} {step * GRID_M:.1f}")


def _draw_points(picture: Picture, found: CameraCalibration, scale: float) -> None:
    camera = found.camera
    seen = camera.undistort(found.points.pixel)
    angle = np.linspace(0.0, 2.0 * np.pi, RING + 1)
    ring = found.mean_error_m * np.column_stack([np.cos(angle), np.sin(angle)])
    tip = seen + _magnified(found, scale) * found.error_px
    for k, (point, end) in enumerate(zip(seen, tip, strict=True)):
        circle = camera.floor_to_pixel(found.points.floor[k] + ring)
        _draw_path(picture, _in_picture(circle, scale), CIRCLE, 2)
        _draw_path(picture, _in_picture(np.stack([point, end]), scale), ERROR, 2)
        x, y = np.rint(_in_picture(point, scale)).astype(int).tolist()
        cv2.circle(picture, (x, y), 3, POINT, 1, cv2.LINE_AA)
        if len(seen) <= 30:
            _write(picture, str(k + 1), (x + 8, y - 8), 0.5)


def _with_caption(picture: Picture, found: CameraCalibration, scale: float) -> Picture:
    below = np.zeros((CAPTION, picture.shape[1], 3), np.uint8)
    pixels = np.linalg.norm(found.error_px, axis=1).mean()
    first = (
        f"{len(found.points.floor)} points, mean error {1e2 * found.mean_error_m:.2g} cm on the "
        f"floor (circles), {pixels:.2g} px"
    )
    times = _magnified(found, scale)
    second = f"lines: errors in the image, {times} times; grid {GRID_M:g} m, robot frame"
    _write(below, first, (12, 23), 0.55)
    _write(below, second, (12, 46), 0.55)
    return np.concatenate([picture, below])


def _magnified(found: CameraCalibration, scale: float) -> int:
    """Returns how many times their own length errors are drawn."""
    mean = scale * float(np.linalg.norm(found.error_px, axis=1).mean())
    return max([times for times in MAGNIFIED if times * mean <= ARROW], default=MAGNIFIED[0])


def _in_picture(pixel: Array, scale: float) -> Array:
    return scale * (pixel + 0.5) - 0.5


def _draw_path(picture: Picture, path: Array, colour: tuple[int, int, int], width: int) -> None:
    """Draws a path (P, 2) in picture pixels, leaving out what is far outside it, or nowhere."""
    drawn = np.abs(np.nan_to_num(path, nan=np.inf)).max(axis=1) < NEAR_PX
    for a, b in zip(
        path[:-1][drawn[:-1] & drawn[1:]], path[1:][drawn[:-1] & drawn[1:]], strict=True
    ):
        first, last = np.rint(a).astype(int).tolist(), np.rint(b).astype(int).tolist()
        cv2.line(picture, first, last, colour, width, cv2.LINE_AA)


def _label(picture: Picture, path: Array, axis: str, text: str) -> None:
    """Writes a text beside a line: of constant x in the middle column, else where it enters."""
    height, width = picture.shape[:2]
    inside = (path > 4).all(axis=1) & (path < [width - 50, height - 8]).all(axis=1)
    if inside.any():
        beside = path[inside]
        at = int(np.abs(beside[:, 0] - 0.5 * width).argmin()) if axis == "x" else 0
        u, v = np.rint(beside[at]).astype(int).tolist()
        _write(picture, text, (u + 3, max(v - 3, 12)), 0.4)


def _write(picture: Picture, text: str, at: tuple[int, int], size: float) -> None:
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(picture, text, at, font, size, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(picture, text, at, font, size, WHITE, 1, cv2.LINE_AA)
