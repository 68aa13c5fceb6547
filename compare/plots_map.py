"""Plot of the map's errors, line by line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from compare.plots_style import INK, MOST_TICKS, Plot, figure, legend, method_colour, stride, to_svg
from compare.record import Record
from graphslam.geometry import Array

PARTS = (
    ("offset (mm)", "offset_m", "sigma_offset_m", 1e3),
    ("angle (°)", "d_alpha_deg", "sigma_alpha_deg", 1.0),
)


def map_errors(record: Record) -> Plot | None:
    """Returns offset and angle errors of all lines that the truth has; None without such lines."""
    rows = {name: _true_rows(record, name) for name in record.estimates}
    rows = {name: found for name, found in rows.items() if found}
    if not rows:
        return None
    ids = sorted({row["true_line"] for found in rows.values() for row in found})
    place = {line: i for i, line in enumerate(ids)}
    made, grid = figure(3.6, 2, 1, sharex=True)
    for i, (name, found) in enumerate(rows.items()):
        shift = 0.28 * (i - 0.5 * (len(rows) - 1))
        at = np.array([place[row["true_line"]] + shift for row in found])
        for [ax], (_, key, sigma, scale) in zip(grid, PARTS, strict=True):
            value = scale * np.array([row[key] for row in found])
            spread = 3.0 * scale * np.array([row[sigma] for row in found])
            style = {"fmt": "o", "ms": 3.5, "lw": 0.9, "mew": 0, "color": method_colour(name)}
            ax.errorbar(at, value, spread, label=name, **style)
    every = stride(len(ids), MOST_TICKS)
    for [ax], (label, *_) in zip(grid, PARTS, strict=True):
        ax.axhline(0.0, color=INK, lw=0.6, alpha=0.5)
        ax.set_ylabel(label)
        ax.set_xticks(np.arange(0, len(ids), every), [str(line) for line in ids[::every]])
        ax.set_xlim(-0.7, len(ids) - 0.3)
        ax.grid(False, axis="x")
    grid[-1][0].set_xlabel("true line (number in the log's map.csv)")
    legend(made, *grid[0][0].get_legend_handles_labels())
    return Plot(
        "map-errors",
        "Map errors per line",
        "Estimate minus truth of every map line that is a true one, after the map's own rigid "
        "motion: the offset across the line at the middle of the stretch that was seen, in "
        "millimetres, and the angle, in degrees. Bars: plus and minus three sigma of the estimate "
        "(99.7 % of a Gaussian), without the uncertainty of the motion.",
        to_svg(made, "map-errors", "Errors of every line of the maps"),
        {
            "method": [name for name, found in rows.items() for _ in found],
            "true_line": [row["true_line"] for found in rows.values() for row in found],
            "offset_mm": _column(rows, "offset_m", 1e3),
            "sigma_offset_mm": _column(rows, "sigma_offset_m", 1e3),
            "angle_deg": _column(rows, "d_alpha_deg", 1.0),
            "sigma_angle_deg": _column(rows, "sigma_alpha_deg", 1.0),
        },
    )


def _column(rows: Mapping[str, list[dict[str, Any]]], key: str, scale: float) -> Array:
    values = [row[key] for found in rows.values() for row in found]
    return scale * np.array(values, float)


def _true_rows(record: Record, method: str) -> list[dict[str, Any]]:
    figures = record.metrics["methods"][method]["map"]
    return [row for row in figures["lines"] if row["true_line"] is not None] if figures else []
