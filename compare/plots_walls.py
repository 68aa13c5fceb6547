"""The floor plan of a building: walls as far as they were seen, and the way through them."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection

from compare.plots_style import INK, WIDTH, Plot, figure, method_colour, stride, to_svg
from compare.record import Record
from graphslam.estimate import Estimate
from graphslam.geometry import Array, points_on_line
from graphslam.measurements import Measurements
from graphslam.models.line import LINE

OPENING_M = 0.4
"""Gaps in what was seen of a wall that are drawn as openings, at least so wide, m."""
FEWEST = 2
"""Sightings that must overlap for a part of a wall to be drawn."""


def walls(record: Record) -> Plot | None:
    """Returns the plan of the last method's walls; None where no scan was searched for any."""
    lines = record.measurements.sightings.get("line")
    methods = [name for name, e in record.estimates.items() if e.used.any()]
    if lines is None or not methods or "loops" not in record.estimates:
        return None
    name = methods[-1]
    estimate = record.estimates[name]
    parts = wall_parts(record.measurements, estimate)
    if not len(parts):
        return None
    corners = parts.reshape(-1, 2)
    low, high = np.quantile(corners, 0.002, axis=0) - 1.0, np.quantile(corners, 0.998, axis=0) + 1.0
    span = high - low
    made, [[ax]] = figure(float(np.clip(WIDTH * 0.86 * span[1] / span[0] + 0.7, 3.2, 9.6)))
    ax.set_aspect("equal", adjustable="box")
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x (m)", ylabel="y (m)")
    ax.grid(visible=False)
    ax.add_collection(LineCollection(list(parts), colors=INK, linewidths=1.1))
    path = estimate.pose[:: stride(len(estimate.pose))]
    ax.plot(path[:, 0], path[:, 1], color=method_colour(name), lw=0.6, alpha=0.7)
    return Plot(
        "walls",
        "Walls",
        f"Floor frame, metres, by {name}. Walls as far as {FEWEST} scans or more saw them; gaps of "
        f"{OPENING_M:.1f} m and more stay open. Thin: the robot's path.",
        to_svg(made, "walls", "Floor plan of the walls"),
        {
            "x1_m": parts[:, 0, 0],
            "y1_m": parts[:, 0, 1],
            "x2_m": parts[:, 1, 0],
            "y2_m": parts[:, 1, 1],
        },
    )


def wall_parts(measurements: Measurements, estimate: Estimate) -> Array:
    """Returns the ends (k, 2, 2) of all parts of lines that were seen, floor frame, m."""
    found = [np.zeros((0, 2, 2))]
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
    return np.concatenate(found)


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
