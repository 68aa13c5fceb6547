"""Walls as far as they were seen: a plan draws neither doors shut nor gaps between two rooms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from compare.record import Record
from graphslam.estimate import Estimate
from graphslam.geometry import Array, points_on_line
from graphslam.measurements import IntArray, Measurements
from graphslam.models.line import LINE
from graphslam.plan import Layer, estimate_layers

OPENING_M = 0.4
"""Gaps in what was seen of a wall that are drawn as openings, at least so wide, m."""
FEWEST = 2
"""Sightings that must overlap for a part of a wall to be drawn."""


def has_walls(record: Record) -> bool:
    """Returns whether a run's lines are walls that scans saw."""
    return "line" in record.measurements.sightings and "loops" in record.estimates


def plan_layers(record: Record, method: str, numbered: bool = True) -> tuple[Layer, ...]:
    """Returns the layers of a plan of one method's map: walls only where they were seen.

    Other lines are drawn over all of their stretch.

    Args:
        record: the run.
        method: one of its methods.
        numbered: whether walls have their number, at the longest part; a building has hundreds.
    """
    estimate = record.estimates[method]
    lines, *others = estimate_layers(estimate, method)
    if has_walls(record):
        parts, landmark = wall_parts(record.measurements, estimate)
        labels = [""] * len(parts)
        length = np.hypot(*(parts[:, 1] - parts[:, 0]).T)
        longest = {int(landmark[k]): int(k) for k in np.argsort(length, kind="stable")}
        for m, k in longest.items():
            labels[k] = str(estimate.map.id[m]) if numbered else ""
        lines = replace(lines, polylines=tuple(parts), labels=tuple(labels))
    return (lines, *others)


def wall_parts(measurements: Measurements, estimate: Estimate) -> tuple[Array, IntArray]:
    """Returns the ends (k, 2, 2) of all parts of lines that were seen, floor frame, m, and whose.

    The second is (k,) rows of the estimate's map.
    """
    found, whose = [np.zeros((0, 2, 2))], [np.zeros(0, np.int64)]
    for first, table in measurements.tables():
        if table.kind != LINE.kind:
            continue
        match = estimate.match[first : first + len(table)]
        for landmark in np.unique(match[match >= 0]).tolist():
            rows = np.flatnonzero(match == landmark)
            line = np.broadcast_to(estimate.map.params[landmark, :2], (len(rows), 2))
            pose = estimate.pose[table.node[rows]]
            seen = LINE.extent_on_landmark(pose, line, table.z[rows], table.extent[rows])
            parts = _covered(seen[np.isfinite(seen).all(axis=1)])
            found.append(points_on_line(line[:1], parts) if len(parts) else found[0])
            whose.append(np.full(len(parts), landmark))
    return np.concatenate(found), np.concatenate(whose)


def _covered(seen: Array) -> Array:
    """Returns intervals (k, 2) that at least `FEWEST` of the intervals (n, 2) cover."""
    at = np.concatenate([seen[:, 0], seen[:, 1]])
    step = np.repeat([1, -1], len(seen))
    order = np.lexsort((-step, at))
    depth = np.cumsum(step[order])
    inside = depth >= FEWEST
    begins = np.flatnonzero(inside & ~np.concatenate([[False], inside[:-1]]))
    ends = np.flatnonzero(~inside & np.concatenate([[False], inside[:-1]]))
    parts = np.column_stack([at[order][begins], at[order][ends]])
    joined: list[list[float]] = []
    for low, high in parts.tolist():
        if joined and low - joined[-1][1] < OPENING_M:
            joined[-1][1] = high
        else:
            joined.append([low, high])
    return np.array(joined).reshape(-1, 2)
