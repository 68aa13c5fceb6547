"""What the replay of the report shows at each moment: compact numbers for the page's script."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np

from compare.plots_plan import plan_bounds, stretches
from compare.plots_points import ELLIPSE_SCALE, ellipses
from compare.plots_style import method_colour, stride, themed
from compare.points import point_rows
from compare.record import Record
from compare.replay import Frames, sighting_nodes
from compare.words import landmark_kinds, noun
from graphslam.estimate import Estimate
from graphslam.geometry import TAU, Array
from graphslam.measurements import IntArray

MOST_MOMENTS = 2000
"""Nodes shown, beside those with an image; of a longer run every k-th."""
NORMAL_95 = 1.959964
"""Half width of the interval that holds 95 % of a Gaussian, standard deviations."""
DEGREES = 360.0 / TAU
REPLAY_NOTE = (
    f"Ellipses hold 95 % of a plane Gaussian ({ELLIPSE_SCALE:.2f} sigma), the heading’s limits "
    f"95 % too ({NORMAL_95:.2f} sigma); floor frame. Of long runs some nodes and frames are left "
    "out: the frame shown is the last one before the moment."
)


def replay_json(record: Record) -> str:
    """Returns the replay's data as JSON that may stand inside a <script> element.

    Lengths are metres, angles degrees, times seconds from the first node. Angles of ellipses are
    those of their first half axis. Landmarks come with the node that saw them first.
    """
    content = _content(record)
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _content(record: Record) -> dict[str, Any]:
    t = record.measurements.t
    shown = record.frames.node if record.frames is not None else np.zeros(0, np.int64)
    moments = np.unique(
        np.concatenate([np.arange(0, len(t), stride(len(t), MOST_MOMENTS)), shown, [len(t) - 1]])
    )
    low, high = plan_bounds(record)
    return {
        "nodes": len(t),
        "node": moments.tolist(),
        "t": rounded(t[moments] - t[0], 2),
        "box": rounded(np.concatenate([low, high]), 3),
        "truth": _poses(record.true_pose[moments]) if record.has_true_pose else None,
        "true_lines": _true_lines(record, low, high),
        "true_points": rounded(record.true_points, 3),
        "several": noun(landmark_kinds(record.measurements))[1],
        "methods": [
            _method(record, name, estimate, moments) for name, estimate in record.estimates.items()
        ],
        "frames": [] if record.frames is None else _frames(record, record.frames, moments),
    }


def _poses(pose: Array) -> dict[str, Any]:
    x, y, theta = pose.T
    return {"x": rounded(x, 4), "y": rounded(y, 4), "theta": rounded(DEGREES * theta, 2)}


def _method(record: Record, name: str, estimate: Estimate, moments: IntArray) -> dict[str, Any]:
    cov = estimate.cov_floor[moments]
    half, angle = ellipses(cov)
    return {
        "name": name,
        "colour": themed(method_colour(name)),
        "causal": estimate.causal,
        **_poses(estimate.pose[moments]),
        "half": [rounded(half[:, 1], 5), rounded(half[:, 0], 5)],
        "angle": rounded(DEGREES * angle + 90.0, 1),
        "heading95": rounded(DEGREES * NORMAL_95 * np.sqrt(cov[:, 2, 2]), 3),
        **_landmarks(record, estimate),
    }


def _landmarks(record: Record, estimate: Estimate) -> dict[str, list[list[Any]]]:
    """Returns number, first node and ends (x, y, x, y) of every line with a known stretch.

    And number, first node and place (x, y) of every point.
    """
    used = np.flatnonzero((estimate.match >= 0) & estimate.used)
    first = np.full(len(estimate.map), len(estimate.t))
    np.minimum.at(first, estimate.match[used], sighting_nodes(record.measurements)[used])
    rows, _ = estimate.map.of_kind("line")
    places = [*zip(rows.tolist(), stretches(estimate).reshape(-1, 4), strict=True)]
    points = point_rows(estimate.map).tolist()

    def told(row: int, place: Array) -> list[Any]:
        return [int(estimate.map.id[row]), int(first[row]), *rounded(place, 3)]

    return {
        "lines": [told(row, ends) for row, ends in places if np.isfinite(ends).all()],
        "points": [told(row, estimate.map.params[row, :2]) for row in points],
    }


def _true_lines(record: Record, low: Array, high: Array) -> list[list[float | None]]:
    """Returns rho, m, and alpha, degrees, of the true lines that cross the plan."""
    lines = record.true_lines
    normal = np.stack([np.cos(lines[:, 1]), np.sin(lines[:, 1])], axis=-1)
    gap = np.abs(normal @ (0.5 * (low + high)) - lines[:, 0])
    near = gap <= np.abs(normal) @ (0.5 * (high - low))
    return [rounded([rho, DEGREES * alpha], 3) for rho, alpha in lines[near].tolist()]


def _frames(record: Record, frames: Frames, moments: IntArray) -> list[dict[str, Any]]:
    """Returns thumbnails with moment, file, size and lines; each line with its ends and, by
    method, the landmark that it was taken for: -1 where the method did not use it."""
    at = np.searchsorted(moments, frames.node)
    landmark = [taken_for(estimate) for estimate in record.estimates.values()]
    found = []
    for i, name in enumerate(frames.name):
        here = np.flatnonzero(frames.frame == i)
        found.append(
            {
                "at": int(at[i]),
                "name": name,
                "size": frames.size[i].tolist(),
                "jpeg": jpeg_text(frames, i),
                "lines": [
                    [
                        *rounded(frames.ends[k].ravel(), 1),
                        *(int(ids[frames.sighting[k]]) for ids in landmark),
                    ]
                    for k in here.tolist()
                ],
            }
        )
    return found


def jpeg_text(frames: Frames, number: int) -> str:
    """Returns a thumbnail's bytes in base 64."""
    return base64.b64encode(frames.jpeg[number]).decode("ascii")


def taken_for(estimate: Estimate) -> IntArray:
    """Returns the identity (K,) of the landmark each sighting was taken for, -1 where not used."""
    ids = np.append(estimate.map.id, -1)
    return np.where(estimate.used, ids[estimate.match], -1)


def rounded(values: Any, digits: int) -> list[Any]:
    """Returns numbers with so many decimals, None for NaN, whole ones without a point."""
    out: list[Any] = []
    for value in np.round(np.asarray(values, float), digits).tolist():
        if isinstance(value, list):
            out.append(rounded(value, digits))
            continue
        whole = np.isfinite(value) and value == int(value)
        out.append(int(value) if whole else value if np.isfinite(value) else None)
    return out
