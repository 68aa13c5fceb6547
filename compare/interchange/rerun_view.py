"""A run as a Rerun recording: images, detections, paths, covariances and maps on one timeline.

Rerun (https://rerun.io) is an extra: ``pip install 'floorline-slam[view]'`` (about 500 MB).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from compare.record import Record
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.geometry import Array, points_on_line, transform_points
from graphslam.plan import ELLIPSE_PROBABILITY, covariance_ellipse, line_segments

TIMELINE = "time"
"""The log's clock, s."""
MOST_MOMENTS = 2000
"""Poses of each method that are written with time, spread evenly over the run."""
HEADING_M = 0.25
"""Length of the arrow that shows the heading."""
COLOURS = {"odometry": 0x999999FF, "ekf": 0xD55E00FF, "smoother": 0x0072B2FF, "truth": 0x009E73FF}
OTHER_COLOUR, SEEN_COLOUR = 0xCC79A7FF, 0xF0E442FF
ELLIPSE = f"ellipse_{100 * ELLIPSE_PROBABILITY:g}_percent"


def write_rerun(record: Record, out: Path) -> None:
    """Writes a run as an .rrd file, to be opened by ``rerun FILE``.

    ``floor/METHOD/path`` and ``map`` are there from the beginning; ``pose``,
    ``ellipse_95_percent``, the sigmas and the lines seen move with time, as do ``camera/image`` and
    the lines in it.

    Args:
        record: the run.
        out: the file.

    Raises:
        BadConfig: Rerun is not installed.
    """
    try:
        import rerun as rr
    except ImportError:
        raise BadConfig(
            "a Rerun recording needs the extra `view`, which is not installed (about 500 MB): pip "
            "install 'floorline-slam[view]'"
        ) from None
    stream = rr.RecordingStream("graphslam", recording_id=str(record.info["log"]["digest"]))
    stream.save(out)
    stream.log("floor", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    _truth(rr, stream, record)
    for name, estimate in record.estimates.items():
        _method(rr, stream, name, estimate)
    if record.estimates:
        _seen(rr, stream, record, list(record.estimates)[-1])
    _images(rr, stream, record)
    stream.flush()
    stream.disconnect()


def _colours(colour: int, count: int) -> Any:
    """Returns one colour, 0xRRGGBBAA, for each of several things."""
    return np.full(count, colour, np.uint32)


def _strips(rr: Any, lines: list[Array], colour: int, labels: list[str] | None = None) -> Any:
    """Returns polylines of the floor, drawn in space."""
    flat = [np.column_stack([line, np.zeros(len(line))]) for line in lines]
    return rr.LineStrips3D(
        flat, colors=_colours(colour, len(flat)), labels=labels, show_labels=False
    )


def _truth(rr: Any, stream: Any, record: Record) -> None:
    colour = COLOURS["truth"]
    known = record.true_pose[np.isfinite(record.true_pose[:, 2])]
    if len(known):
        stream.log("floor/truth/path", _strips(rr, [known[:, :2]], colour), static=True)
    lines = record.true_lines
    if len(lines):
        reach = np.concatenate([e.pose[:, :2] for e in record.estimates.values()] or [known[:, :2]])
        half = float(np.ptp(reach, axis=0).max()) if len(reach) else 1.0
        middle = reach.mean(axis=0) if len(reach) else np.zeros(2)
        s = -middle[0] * np.sin(lines[:, 1]) + middle[1] * np.cos(lines[:, 1])
        ends = points_on_line(lines[:, None], s[:, None] + np.array([-half, half]))
        stream.log("floor/truth/map", _strips(rr, list(ends), colour), static=True)


def _method(rr: Any, stream: Any, name: str, estimate: Estimate) -> None:
    colour, root = COLOURS.get(name, OTHER_COLOUR), f"floor/{name}"
    path = estimate.pose[:, :2]
    stream.log(f"{root}/path", _strips(rr, [path], colour), static=True)
    low, high = path.min(axis=0) - 1.0, path.max(axis=0) + 1.0
    segments = list(line_segments(estimate.map, low, high))
    if segments:
        rows, _ = estimate.map.of_kind("line")
        labels = [str(number) for number in estimate.map.id[rows]]
        stream.log(f"{root}/map", _strips(rr, segments, colour, labels), static=True)
    for node in _moments(len(path)):
        stream.set_time(TIMELINE, duration=float(estimate.t[node]))
        x, y, theta = estimate.pose[node]
        arrow = HEADING_M * np.array([np.cos(theta), np.sin(theta), 0.0])
        stream.log(
            f"{root}/pose",
            rr.Arrows3D(origins=[[x, y, 0.0]], vectors=[arrow], colors=_colours(colour, 1)),
        )
        cov = estimate.cov_floor[node]
        ellipse = covariance_ellipse(path[node], cov[:2, :2])
        stream.log(f"{root}/{ELLIPSE}", _strips(rr, [ellipse], colour))
        sigma = np.sqrt(np.maximum(np.diag(cov), 0.0))
        stream.log(f"sigma_x_m/{name}", rr.Scalars([sigma[0]]))
        stream.log(f"sigma_y_m/{name}", rr.Scalars([sigma[1]]))
        stream.log(f"sigma_heading_deg/{name}", rr.Scalars([np.degrees(sigma[2])]))
    stream.reset_time()


def _seen(rr: Any, stream: Any, record: Record, method: str) -> None:
    """Writes the lines seen at each moment, put on the floor from a method's poses."""
    table = record.measurements.sightings.get("line")
    if table is None or not len(table):
        return
    estimate = record.estimates[method]
    for node in _moments(len(estimate.t)):
        here = (table.node == node) & np.isfinite(table.extent).all(axis=1)
        ends = points_on_line(table.z[here][:, None], table.extent[here])
        stream.set_time(TIMELINE, duration=float(estimate.t[node]))
        lines = [transform_points(estimate.pose[node], pair) for pair in ends]
        stream.log(f"floor/lines_seen_from_{method}", _strips(rr, lines, SEEN_COLOUR))
    stream.reset_time()


def _images(rr: Any, stream: Any, record: Record) -> None:
    frames = record.frames
    if frames is None:
        return
    for row, node in enumerate(frames.node.tolist()):
        stream.set_time(TIMELINE, duration=float(record.measurements.t[node]))
        image = rr.EncodedImage(contents=frames.jpeg[row], media_type="image/jpeg")
        stream.log("camera/image", image)
        ends = frames.ends[frames.frame == row]
        stream.log(
            "camera/image/lines",
            rr.LineStrips2D(list(ends), colors=_colours(SEEN_COLOUR, len(ends))),
        )
    stream.reset_time()


def _moments(count: int) -> list[int]:
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_MOMENTS)).round().astype(int))
    return [int(node) for node in chosen]
