"""The floor plan of a building: walls as far as they were seen, and the way through them."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection

from compare.plots_style import INK, WIDTH, Plot, figure, method_colour, stride, to_svg
from compare.record import Record
from compare.walls import FEWEST, OPENING_M, has_walls, wall_parts


def walls(record: Record) -> Plot | None:
    """Returns the plan of the last method's walls; None where no scan was searched for any."""
    methods = [name for name, e in record.estimates.items() if e.used.any()]
    if not methods or not has_walls(record):
        return None
    name = methods[-1]
    estimate = record.estimates[name]
    parts, _ = wall_parts(record.measurements, estimate)
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
