"""A sample of a log's frames with the lines in them, and what they say of turning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from frontend.config import DetectorConfig, ExtractConfig
from frontend.image_lines import lines_in_images
from frontend.log import Log
from frontend.moves import Moves
from frontend.search import Progress, in_order
from frontend.turning import TurnCheck, check_turns
from graphslam.geometry import Array
from graphslam.measurements import IntArray

SAMPLE = 24
"""Frames of the sample, evenly spaced over the log."""
TURN_FRAMES = 160  # frames near turns that are searched for the sake of the clocks
TURN_WINDOW_S = 4.0  # turning within this time about a frame makes it one of them
TURN_STEP_S = 0.2  # frames are thinned to about this for it: a line has to turn by degrees


@dataclass(frozen=True, slots=True)
class Frame:
    """The lines of one image, or of one moment of sightings.csv.

    Attributes:
        t: s.
        image: row in ``images.csv``, or -1 where there is none of a camera that log.toml describes.
        readable: whether the image could be read; True where none was opened.
        z: (K, 2) lines ``(rho, alpha)``, robot frame, m and rad.
        extent: (K, 2) stretch seen, m along each line; NaN where unknown.
    """

    t: float
    image: int
    readable: bool
    z: Array
    extent: Array


def sample_frames(
    log: Log, moves: Moves, detector: DetectorConfig, progress: Progress | None
) -> tuple[tuple[Frame, ...], TurnCheck | None]:
    """Returns `SAMPLE` frames, evenly spaced, and how wheels and lines turn; None where unclear.

    Args:
        log: the recording.
        moves: its odometry.
        detector: how to look for lines.
        progress: called with (images searched, images in all).
    """
    t, rows = _moments(log)
    sampled = np.unique(np.linspace(0, len(t) - 1, SAMPLE).round().astype(int)) if len(t) else rows
    turning = _near_turns(t, moves)
    look = partial(_look, log, ExtractConfig(detector, workers=1), t, rows)
    found = _in_parallel(look, np.union1d(sampled, turning), progress)
    sample = tuple(found[i] for i in sampled.tolist())
    alphas = [found[i].z[:, 1] for i in turning.tolist()]
    turns = check_turns(moves.t, moves.heading, t[turning], alphas, _sigma_alpha(log, detector))
    return sample, turns


def _moments(log: Log) -> tuple[Array, IntArray]:
    """Returns times (F,) that lines may be seen at, and the first row of each: image or sighting.

    Images are those of the floor camera with the most of them, so that no two share a time.
    """
    if log.sightings is not None:
        return np.unique(log.sightings.t, return_index=True)
    numbers = log.images_of("floor")
    if log.images is None or not len(numbers):
        return np.zeros(0), np.zeros(0, np.int64)
    names = np.array(log.images.camera)[numbers]
    kinds, counts = np.unique(names, return_counts=True)
    numbers = numbers[names == kinds[counts.argmax()]]
    return log.images.t[numbers], numbers


def _near_turns(t: Array, moves: Moves) -> IntArray:
    """Returns the rows (T,) of the moments (F,) about which the robot turns most, in order."""
    if len(t) < 2:
        return np.zeros(0, np.int64)
    rows = np.arange(0, len(t), max(1, round(TURN_STEP_S / float(np.median(np.diff(t))))))
    half = 0.5 * TURN_WINDOW_S
    turn = np.abs(moves.heading_at(t[rows] + half) - moves.heading_at(t[rows] - half))
    return np.sort(rows[np.argsort(-turn, kind="stable")[:TURN_FRAMES]])


def _look(log: Log, config: ExtractConfig, t: Array, rows: IntArray, moment: int) -> Frame:
    """Returns the lines of a moment, read from the log or found in its image."""
    if log.sightings is not None:
        last = rows[moment + 1] if moment + 1 < len(rows) else len(log.sightings.t)
        part = slice(rows[moment], last)
        z, extent = log.sightings.z[part], log.sightings.extent[part]
        return Frame(float(t[moment]), _image_at(log, float(t[moment])), True, z, extent)
    number = int(rows[moment])
    found = lines_in_images(log, np.array([number]), config)
    return Frame(float(t[moment]), number, not found.unreadable, found.seen.z, found.seen.extent)


def _sigma_alpha(log: Log, detector: DetectorConfig) -> float:
    """Returns the standard deviation of a line's direction, rad."""
    if log.sightings is not None and len(log.sightings.t):
        return float(np.sqrt(np.median(log.sightings.cov[:, 1, 1])))
    return float(np.radians(detector.sigma_alpha_deg))


def _image_at(log: Log, t: float) -> int:
    if log.images is None:
        return -1
    rows = np.flatnonzero(log.images.t == t).tolist()
    floor = log.looking_at("floor")
    return next((row for row in rows if log.images.camera[row] in floor), -1)


def _in_parallel(
    look: Callable[[int], Frame], moments: IntArray, progress: Progress | None
) -> dict[int, Frame]:
    """Returns the frames of moments."""
    found: dict[int, Frame] = {}
    for moment, frame in zip(moments.tolist(), in_order(look, moments, None), strict=True):
        found[moment] = frame
        if progress is not None:
            progress(len(found), len(moments))
    return found
