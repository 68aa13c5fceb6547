"""Every frame of a log with the lines seen in it: in the image, and on the floor."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.config import ExtractConfig
from frontend.images import read_grey, undistorted
from frontend.log import Log
from frontend.overlay import COLOURS, Picture, caption, draw_lines, write_picture
from frontend.strokes import KINDS
from graphslam.errors import BadConfig
from graphslam.geometry import Array, points_on_line
from graphslam.measurements import IntArray, Measurements

HEIGHT = 480  # pixels of a frame's picture, and of the floor's beside it
GRID_M = 0.1  # distance of the thin lines on the floor, m
FARTHEST_M = 3.0  # floor beyond this is not drawn, m ahead or aside
QUALITY = 90


def check_overlays(log: Log, out: Path) -> None:
    """Raises BadConfig where no images were searched, or the folder for pictures holds something.

    Args:
        log: to draw lines on.
        out: folder to write to; it may be absent.
    """
    if log.sightings is not None and not len(_searched(log)):
        raise BadConfig(
            f"{log.name}: its lines are those of sightings.csv, not of its images, so there is "
            "nothing to draw; leave --overlay out, or sightings.csv"
        )
    if not len(_searched(log)):
        raise BadConfig(f"{log.name}: has no images that are searched; leave --overlay out")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BadConfig(f"{out}: is not an empty folder; choose another for the pictures")


def write_overlays(
    log: Log,
    measurements: Measurements,
    out: Path,
    progress: Callable[[int, int], None] | None = None,
    config: ExtractConfig | None = None,
) -> int:
    """Writes a picture ``<number>.jpg`` of each image that was searched; returns how many.

    On the left the frame, without lens distortion, with its lines along the stretches where they
    were seen. On the right the floor in view from above, x up and y to the left, robot frame. Of
    the ceiling the frame as it was recorded, with centre and axis of its lamps; of other cameras
    the frame with what `graphslam play` shows of it.

    Args:
        log: with images.
        measurements: what was extracted from it.
        out: folder to write to; it is made, and must be empty.
        progress: called with (pictures done, pictures in all).
        config: how it was extracted; None for the defaults.

    Raises:
        BadConfig: as `check_overlays`.
    """
    check_overlays(log, out)
    assert log.images is not None, "checked above"
    out.mkdir(parents=True, exist_ok=True)
    numbers = _searched(log)
    numbers = numbers[np.isin(log.images.t[numbers], measurements.t)]
    for done, number in enumerate(numbers.tolist(), start=1):
        image, t = log.images.file[number], float(log.images.t[number])
        grey = read_grey(image)
        if grey is not None:
            text = f"t = {t:.2f} s   {Path(image.name).name}"
            picture = _picture(log, measurements, number, grey, text, config)
            write_picture(out / f"{number:06d}.jpg", picture)
        if progress is not None:
            progress(done, len(numbers))
    return len(numbers)


def _searched(log: Log) -> IntArray:
    """Returns the numbers of the images that are opened: not of the floor where lines are given."""
    numbers = log.searched_images()
    return numbers if log.sightings is None else np.setdiff1d(numbers, log.images_of("floor"))


def _picture(
    log: Log,
    measurements: Measurements,
    number: int,
    grey: Picture,
    text: str,
    config: ExtractConfig | None,
) -> Picture:
    """Returns the picture of one image."""
    assert log.images is not None, "it is one of them"
    camera = log.cameras[log.images.camera[number]]
    if camera.looks_at not in ("floor", "ceiling"):
        return _marked(log, measurements, number, text, config or ExtractConfig())
    table = measurements.sightings[KINDS[camera.looks_at]]
    rows = table.source == number
    if camera.looks_at == "ceiling":
        from frontend.lamp_pictures import lamp_picture

        text += f"   lamps: {np.count_nonzero(rows)}"
        return lamp_picture(grey, camera, table.z[rows], text)
    text += f"   lines: {np.count_nonzero(rows)}"
    return frame_picture(grey, camera, table.z[rows], table.extent[rows], text)


def _marked(
    log: Log, measurements: Measurements, number: int, text: str, config: ExtractConfig
) -> Picture:
    """Returns an image as it was recorded, with what was seen in it."""
    from frontend.marks import picture_of, shot_of
    from frontend.screen import draw_marks

    recorded = picture_of(log, number)
    assert recorded is not None, "it was read before"
    scale = HEIGHT / recorded.shape[0]
    picture = np.asarray(cv2.resize(recorded, None, fx=scale, fy=scale), np.uint8)
    shot = shot_of(log, measurements, number, config)
    draw_marks(picture, shot.marks, scale)
    return caption(picture, f"{text}   {shot.note}")


def frame_picture(grey: Picture, camera: Camera, z: Array, extent: Array, text: str) -> Picture:
    """Returns a picture (H, W, 3), BGR: a frame and the floor, with lines (K, 2) and stretches."""
    flat = undistorted(grey, camera)
    scale = HEIGHT / flat.shape[0]
    left: Any = cv2.cvtColor(cv2.resize(flat, None, fx=scale, fy=scale), cv2.COLOR_GRAY2BGR)
    draw_lines(left, camera, z, extent, scale)
    right = _floor_picture(grey, camera, z, extent, left.shape[0])
    both = np.concatenate([left, right], axis=1)
    return caption(both, text + f"   floor: {GRID_M:g} m grid, robot frame, x up")


@lru_cache(maxsize=4)
def _pixels_of_floor(
    camera: Camera, top: float, left: float, right: float, rows: int, per_m: float
) -> NDArray[np.float32]:
    """Returns the recorded pixels (rows, columns, 2) that a picture of the floor shows.

    Args:
        camera: that took the frame, with its lens.
        top, left, right: borders of the picture on the floor: x, y and y, m, robot frame.
        rows: of the picture.
        per_m: pixels of the picture for a metre.
    """
    columns = max(1, round(per_m * (left - right)))
    x, y = top - np.arange(rows) / per_m, left - np.arange(columns) / per_m
    floor = np.stack(np.broadcast_arrays(x[:, None], y), axis=-1)
    pixels = camera.distort(camera.floor_to_pixel(floor))
    return np.nan_to_num(pixels, nan=-1e4).clip(-1e4, 1e4).astype(np.float32)


def _floor_picture(grey: Picture, camera: Camera, z: Array, extent: Array, rows: int) -> Picture:
    """Returns the floor in view from above, ``rows`` pixels high, with lines and a grid."""
    corners = np.clip(camera.view(), -FARTHEST_M, FARTHEST_M)
    low, high = corners.min(axis=0) - 0.02, corners.max(axis=0) + 0.02
    per_m = rows / (high[0] - low[0])
    pixels = _pixels_of_floor(camera, float(high[0]), float(high[1]), float(low[1]), rows, per_m)
    seen = cv2.remap(grey, pixels, None, cv2.INTER_LINEAR)
    picture: Any = cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR)

    def to_picture(points: Array) -> list[list[int]]:
        x, y = points[..., 0], points[..., 1]
        at = np.stack([per_m * (high[1] - y), per_m * (high[0] - x)], axis=-1)
        return list(np.round(at).astype(int).tolist())

    for axis in (0, 1):
        for value in np.arange(np.ceil(low[axis] / GRID_M), high[axis] / GRID_M) * GRID_M:
            ends = np.array([low, high])
            ends[:, axis] = value
            cv2.line(picture, *to_picture(ends), (90, 90, 90), 1)
    for number, (line, stretch) in enumerate(zip(z, extent, strict=True)):
        ends = points_on_line(line, stretch)
        if np.isfinite(ends).all():
            colour = COLOURS[number % len(COLOURS)]
            cv2.line(picture, *to_picture(ends), colour, 1, cv2.LINE_AA)
    return np.asarray(picture, np.uint8)
