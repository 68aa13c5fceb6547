"""Plots of a batch: how each method's figures are spread over the logs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from compare.batch_table import BATCH_FIGURES
from compare.plots_boxes import draw_box
from compare.plots_style import (
    INK,
    Columns,
    Plot,
    figure,
    legend,
    method_colour,
    style,
    to_svg,
)
from compare.study import Figure

if TYPE_CHECKING:
    from compare.batch import Batch

JUDGED = ("aligned_rmse_m", "aligned_final_error_m", "map_rmse_m", "alpha_rmse_deg", "pose_nees")
CLAIMED = ("position_sigma_m", "last_position_sigma_m", "heading_sigma_deg", "nis")
ACROSS = 2
"""Plots beside each other."""
ROW_HEIGHT = 2.2
"""Height of a row of plots, inches."""
GROUP = 0.76
"""Share of a group's room that its boxes take."""
MOST_SHOWN = 60
"""Logs up to which each has a point beside the box."""
WIDE_RANGE = 20.0
"""Largest over smallest value from which on an axis is logarithmic."""
HONEST = ("pose_nees", "map_nees", "nis")
"""Figures that are 1 where the covariance is honest."""


def box_plots(batch: Batch) -> Plot | None:
    """Returns one box for each method (and each point of a sweep) in each main figure.

    With truth in any log, errors and consistency; without, what the methods claim. None where no
    log gave a result.
    """
    figures = [f for f in BATCH_FIGURES if f.name in JUDGED and _known(batch, f)]
    figures = figures or [f for f in BATCH_FIGURES if f.name in CLAIMED and _known(batch, f)]
    if not figures:
        return None
    count = -(-len(figures) // ACROSS)
    with style():
        made, grid = figure(0.5 + ROW_HEIGHT * count, count, ACROSS, gap=(0.85, 0.42))
        axes = [ax for row in grid for ax in row]
        for ax, drawn in zip(axes, figures, strict=False):
            _draw(ax, batch, drawn)
        for ax in axes[len(figures) :]:
            ax.remove()
        handles = [
            axes[0].plot([], [], color=method_colour(m), lw=5, label=m)[0] for m in batch.methods
        ]
        legend(made, handles, batch.methods)
        svg = to_svg(made, "boxes", "Spread of each method's figures over the logs")
    points = " One point a log." if len(batch.logs) <= MOST_SHOWN else ""
    return Plot(
        "boxes",
        "Spread over the logs",
        "Box: the middle half of the logs; bar: median; whiskers: to the farthest log within one "
        f"and a half box heights; circles: logs beyond.{points} Path and final error after one "
        "rigid motion, map errors after one of their own. Axes whose values differ "
        f"{WIDE_RANGE:.0f}-fold are logarithmic. Dashed: 1, where covariances are honest.",
        svg,
        _columns(batch, figures),
    )


def _known(batch: Batch, drawn: Figure) -> bool:
    return any(not math.isnan(row.values[drawn.name]) for row in batch.rows)


def _values(batch: Batch, drawn: Figure, point: int, method: str) -> list[float]:
    found = [
        drawn.scale * row.values[drawn.name]
        for row in batch.rows
        if (row.point, row.method) == (point, method)
    ]
    return [value for value in found if not math.isnan(value)]


def _draw(ax: Axes, batch: Batch, drawn: Figure) -> None:
    width = GROUP / len(batch.methods)
    shown: list[float] = []
    for column, method in enumerate(batch.methods):
        for point in range(len(batch.points)):
            values = _values(batch, drawn, point, method)
            if values:
                at = point + (column - 0.5 * (len(batch.methods) - 1)) * width
                few = len(values) <= MOST_SHOWN
                draw_box(ax, at, 0.8 * width, values, method_colour(method), points=few)
            shown += values
    if min(shown) > 0 and max(shown) > WIDE_RANGE * min(shown):
        ax.set_yscale("log")
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,g}"))
        ax.yaxis.set_minor_formatter(NullFormatter())
    else:
        ax.set_ylim(bottom=0.0)
    if drawn.name in HONEST:
        ax.axhline(1.0, color=INK, lw=0.8, ls=(0, (4, 3)), alpha=0.6)
    unit = f" ({drawn.unit})" if drawn.unit else ""
    ax.set_ylabel(f"{drawn.label}{unit}")
    ax.set_xlim(-0.5, len(batch.points) - 0.5)
    swept = [point.short_label for point in batch.points if point.values]
    ax.set_xticks(range(len(swept)), swept)
    ax.grid(visible=False, axis="x")


def _columns(batch: Batch, figures: Sequence[Figure]) -> dict[str, Columns]:
    """Returns the rows behind the boxes, in the units of batch.csv."""
    columns: dict[str, Columns] = {
        "log": [row.log for row in batch.rows],
        "method": [row.method for row in batch.rows],
    }
    for drawn in figures:
        columns[drawn.name] = [row.values[drawn.name] for row in batch.rows]
    return columns
