"""Plots of a study: errors and honesty by method and level of noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from compare.consistency import band
from compare.plots_boxes import draw_box
from compare.plots_style import (
    INK,
    METHOD_DASHES,
    Columns,
    Plot,
    figure,
    legend,
    method_colour,
    to_svg,
)
from compare.study import POINTS, Study
from compare.study_answers import Honesty, honesties, limits

MOST_LEVELS = 4
"""Curves over the way are drawn for so many levels, in order."""
LEAST = 1e-3
"""What is smaller is drawn here, on logarithmic axes."""


@dataclass(frozen=True, slots=True)
class _Box:
    """One axis of boxes.

    Attributes:
        label: of the axis, with its unit.
        figure: column of runs.csv.
        scale: factor from the column to that unit.
        bound: field of `compare.bound.Bound` drawn beside it; empty for none.
    """

    label: str
    figure: str
    scale: float
    bound: str = ""


ERRORS = (
    _Box("path RMSE (mm)", "rmse_m", 1e3, "path_m"),
    _Box("last pose, error (mm)", "final_error_m", 1e3, "final_m"),
    _Box("map RMSE (mm)", "unaligned_map_rmse_m", 1e3, "map_m"),
)
HONESTY = (
    _Box("NEES of the poses / 3", "pose_nees", 1.0),
    _Box("NEES of the map / dof", "map_start_nees", 1.0),
    _Box("NIS / dof", "nis", 1.0),
)


def draw_study(result: Study) -> list[Plot]:
    """Returns the plots of a study; those that it has no data for are left out."""
    plots = [
        _boxes(
            result,
            ERRORS,
            "errors",
            "Errors by method and noise",
            "One box for each method at each level of noise, from the common start: median, "
            "quartiles and the whole range of all runs, on logarithmic axes. Black bars: the "
            "Cramér–Rao bound, the RMS error that no method undercuts on average.",
        ),
        _boxes(
            result,
            HONESTY,
            "honesty",
            "Honesty by method and noise",
            "Squared error over claimed covariance (NEES) and squared innovation over its "
            "covariance (NIS), per degree of freedom; the map in the start's frame. 1 is honest, "
            "above it overconfident. A smoother's NIS is that of its residuals, which fit the "
            "sightings they come from, and lies below 1.",
        ),
        _curves(result),
    ]
    return [plot for plot in plots if plot is not None]


def _boxes(result: Study, axes: Sequence[_Box], name: str, title: str, caption: str) -> Plot | None:
    made, [row] = figure(3.4, 1, len(axes))
    drawn: dict[str, list[object]] = {
        key: []
        for key in ("figure", "noise", "method", "min", "q1", "median", "q3", "max", "bound")
    }
    for ax, box in zip(row, axes, strict=True):
        _draw_boxes(ax, result, box, drawn)
    if not drawn["noise"]:
        return None
    handles = [
        row[0].plot([], [], color=method_colour(m), lw=5, alpha=0.6, label=m)[0]
        for m in result.methods
    ]
    legend(made, handles, list(result.methods))
    return Plot(name, title, caption, to_svg(made, name, title), drawn)


def _draw_boxes(ax: Axes, result: Study, box: _Box, drawn: dict[str, list[object]]) -> None:
    width = 0.8 / len(result.methods)
    for place, level in enumerate(result.noise):
        bound = result.column(level, f"bound.{box.bound}")
        limit = box.scale * float(np.sqrt(np.mean(bound**2))) if len(bound) else np.nan
        for k, method in enumerate(result.methods):
            values = box.scale * result.column(level, f"{method}.{box.figure}")
            values = values[np.isfinite(values)]
            if not len(values):
                continue
            low, q1, median, q3, high = np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0])
            x = place + (k + 0.5) * width - 0.4
            shown = np.maximum(values, LEAST)
            draw_box(ax, x, 0.8 * width, shown, method_colour(method), whole_range=True)
            entry = (box.figure, str(level), method, low, q1, median, q3, high, limit)
            for column, value in zip(drawn.values(), entry, strict=True):
                column.append(value)
        if np.isfinite(limit):
            ax.plot([place - 0.42, place + 0.42], [limit, limit], color=INK, lw=1.2)
    if not box.bound:
        ax.axhline(1.0, color=INK, lw=0.6, alpha=0.6)
    ax.set(yscale="log", ylabel=box.label, xlabel="noise")
    ax.set_xticks(range(len(result.noise)), [str(level) for level in result.noise])
    ax.grid(visible=False, axis="x")


def _curves(result: Study) -> Plot | None:
    levels = result.noise[:MOST_LEVELS]
    entries = [e for e in honesties(result) if e.noise in levels]
    rows = [
        drawing
        for drawing, known in (
            (_errors_along, any(e.curve is not None for e in entries)),
            (_innovations_along, any(e.innovations is not None for e in entries)),
        )
        if known
    ]
    if not rows:
        return None
    made, grid = figure(0.4 + 2.5 * len(rows), len(rows), len(levels), sharey="row")
    drawn: dict[str, Columns] = {}
    for axes, drawing in zip(grid, rows, strict=True):
        for ax, level in zip(axes, levels, strict=True):
            for entry in (e for e in entries if e.noise == level):
                drawn |= drawing(ax, entry)
            ax.axhline(1.0, color=INK, lw=0.6, alpha=0.6)
            ax.set(xlabel=f"driven (m), noise {level}", yscale="log")
            ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            ax.minorticks_off()
        label = "mean NEES of the pose / 3" if drawing is _errors_along else "NIS / dof"
        axes[0].set_ylabel(label)
    lines = [
        made.axes[0].plot([], [], label=m, **_line(m))[0]
        for m in result.methods
        if any(e.method == m and (e.curve or e.innovations) for e in entries)
    ]
    legend(made, lines, [str(line.get_label()) for line in lines])
    return Plot(
        "consistency",
        "Honesty along the way",
        "Above: squared error of the pose over its claimed covariance, per degree of freedom, mean "
        "of all runs at equal distances; the band holds 95 % of such means of honest runs. Below: "
        f"squared innovations over what each filter expects of them, in {POINTS} equal shares of "
        "the way, all runs together, those of one node taken jointly; a smoother predicts nothing. "
        "Where a curve leaves its band upwards and stays above, the method is overconfident.",
        to_svg(made, "consistency", "Mean NEES and NIS over the distance driven"),
        drawn,
    )


def _line(method: str) -> dict[str, Any]:
    return {"color": method_colour(method), "ls": METHOD_DASHES.get(method, "-")}


def _errors_along(ax: Axes, entry: Honesty) -> dict[str, Columns]:
    if entry.curve is None:
        return {}
    ax.axhspan(*limits("pose", entry.curve.runs), color=INK, alpha=0.04, lw=0)
    values = np.maximum(entry.curve.nees[:, 3], LEAST)
    ax.plot(entry.curve.distance, values, **_line(entry.method))
    name = f"{entry.noise}_{entry.method}"
    return {f"{name}_distance_m": entry.curve.distance, f"{name}_nees_per_dof": values}


def _innovations_along(ax: Axes, entry: Honesty) -> dict[str, Columns]:
    found = entry.innovations
    if found is None:
        return {}
    known = found.freedom > 0
    low, high = np.array([band(float(f)) for f in found.freedom[known]]).T
    ax.fill_between(found.distance[known], low, high, color=INK, alpha=0.04, lw=0)
    ax.plot(found.distance[known], found.nis[known], **_line(entry.method))
    name = f"{entry.noise}_{entry.method}"
    return {f"{name}_share_to_m": found.distance[known], f"{name}_nis_per_dof": found.nis[known]}
