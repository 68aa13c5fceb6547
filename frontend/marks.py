"""What was seen in an image, as strokes and words to draw into it, whatever its camera looks at."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frontend.config import ExtractConfig
from frontend.image_tags import look
from frontend.images import read_bgr, undistorted
from frontend.log import Log
from frontend.overhead import OverheadCamera
from frontend.plausible import CONTRADICTED
from frontend.strokes import KINDS, shown, strokes
from graphslam.geometry import Array, transform_points
from graphslam.measurements import Measurements
from graphslam.models import MODELS

RING_PX = 7.0
"""Radius of the circle around a point that was found, pixels."""
NOSE = 2.2
"""How far beyond the front tag the arrow of a heading points, times the tags' distance."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A stroke in an image.

    Attributes:
        points: (k, 2) pixels of the picture, k >= 2; one point is a circle around it.
        used: whether an estimate rests on it; else it was passed over.
        text: a few characters beside its first point; may be empty.
    """

    points: Array
    used: bool
    text: str = ""


@dataclass(frozen=True, slots=True)
class Shot:
    """One image with what was seen in it.

    Attributes:
        t: s.
        number: row in the log's images.
        camera: its name.
        name: of the image, as messages say it.
        marks: to draw.
        note: one line below: how much was seen, or why nothing.
    """

    t: float
    number: int
    camera: str
    name: str
    marks: tuple[Mark, ...] = field(default_factory=tuple)
    note: str = ""


def picture_of(log: Log, number: int) -> NDArray[np.uint8] | None:
    """Returns an image (H, W, 3), BGR, as marks are drawn into it; None where it is unreadable.

    Of a camera that looks at the floor without the distortion of its lens, else as recorded.
    """
    assert log.images is not None, "only logs with images have pictures"
    bgr = read_bgr(log.images.file[number])
    camera = log.looking_at("floor").get(log.images.camera[number])
    return bgr if bgr is None or camera is None else undistorted(bgr, camera)


def shot_of(log: Log, measurements: Measurements, number: int, config: ExtractConfig) -> Shot:
    """Returns what was seen in an image of a log.

    Args:
        log: the recording.
        measurements: what was extracted from it.
        number: row in the log's images, at a node.
        config: how it was extracted.
    """
    assert log.images is not None, "only logs with images have shots"
    name, t = log.images.camera[number], float(log.images.t[number])
    marks, note = [], "not searched"
    if name in log.cameras:
        looker = LOOKERS[log.cameras[name].looks_at]
        marks, note = looker(log, measurements, number, config)
    return Shot(t, number, name, log.images.name(number, log.folder), tuple(marks), note)


def _strokes(
    log: Log, measurements: Measurements, number: int, config: ExtractConfig
) -> tuple[list[Mark], str]:
    """Returns a stroke for each line, lamp or direction; lamps with their middle."""
    assert log.images is not None
    camera = log.cameras[log.images.camera[number]]
    table = measurements.sightings.get(KINDS[camera.looks_at])
    several = MODELS[KINDS[camera.looks_at]].noun[1]
    if table is None:
        return [], f"{several}: 0"
    rows, ends = strokes(camera, table, shown(log, measurements, table, number))
    marks = [Mark(pair, True) for pair in ends]
    if camera.looks_at == "ceiling":
        middle = camera.distort(camera.floor_to_pixel(table.z[rows, :2]))
        marks += [Mark(point[None], True) for point in middle]
    return marks, f"{several}: {len(rows)}"


def _tags(
    log: Log, measurements: Measurements, number: int, config: ExtractConfig
) -> tuple[list[Mark], str]:
    assert log.images is not None
    eye = log.cameras[log.images.camera[number]]
    table = measurements.sightings.get("pose_fix")
    fixes = [] if table is None else [*table.z[shown(log, measurements, table, number)]]
    if log.pose_fixes is not None:  # measured by someone else: show where they put the tags
        return [mark for pose in fixes for mark in _robot(eye, pose, True)], f"poses: {len(fixes)}"
    seen = look(log, number, config)
    if seen is None:
        return [], "cannot be read"
    marks = [Mark(point[None], False, "?") for point in seen.beside]
    if seen.pose is None:
        return marks, seen.refused
    marks += _robot(eye, seen.pose, bool(fixes))
    degrees = np.degrees(seen.pose[2])
    said = f"x {seen.pose[0]:.3f} m, y {seen.pose[1]:.3f} m, heading {degrees:.1f} deg"
    return marks, said if fixes else f"{CONTRADICTED}: {said}"


def _robot(eye: OverheadCamera, pose: Array, used: bool) -> list[Mark]:
    """Returns both tags and the direction from one to the other."""
    on_robot = eye.tags.points()
    tip = on_robot[0] + NOSE * (on_robot[1] - on_robot[0])
    pixels = eye.to_pixels(transform_points(pose, np.vstack([on_robot, tip])))
    if not np.isfinite(pixels).all():
        return []
    stroke = Mark(pixels[[0, 2]], used)
    return [Mark(pixels[:1], used), Mark(pixels[1:2], used), stroke]


LOOKERS = {"floor": _strokes, "overhead": _tags, "ceiling": _strokes, "omni": _strokes}
"""By where a camera looks: what tells the marks of its images."""
