"""Plots of a study: errors and honesty by method and level of noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

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
from compare.study import Study
from compare.study_answers import honesties, limits

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
            stats = {"whislo": low, "q1": q1, "med": median, "q3": q3, "whishi": high}
            stats = {key: max(float(value), LEAST) for key, value in stats.items()}
            _draw_box(ax, stats, x, 0.8 * width, method_colour(method))
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


def _draw_box(ax: Axes, stats: dict[str, float], x: float, width: float, colour: str) -> None:
    line = {"color": colour, "lw": 1.0}
    ax.bxp(
        [{**stats, "fliers": []}],
        positions=[x],
        widths=width,
        patch_artist=True,
        manage_ticks=False,
        showfliers=False,
        boxprops={"facecolor": colour, "edgecolor": colour, "alpha": 0.45},
        medianprops={"color": colour, "lw": 2.0},
        whiskerprops=line,
        capprops=line,
    )


def _curves(result: Study) -> Plot | None:
    levels = result.noise[:MOST_LEVELS]
    entries = [e for e in honesties(result) if e.curve is not None and e.noise in levels]
    if not entries:
        return None
    made, [row] = figure(3.0, 1, len(levels), sharey=True)
    drawn: dict[str, Columns] = {}
    for ax, level in zip(row, levels, strict=True):
        for entry in (e for e in entries if e.noise == level):
            assert entry.curve is not None
            low, high = limits("pose", entry.curve.runs)
            values = np.maximum(entry.curve.nees[:, 3], LEAST)
            drawn[f"{level}_{entry.method}_distance_m"] = entry.curve.distance
            drawn[f"{level}_{entry.method}_nees_per_dof"] = values
            style = {
                "color": method_colour(entry.method),
                "ls": METHOD_DASHES.get(entry.method, "-"),
            }
            ax.plot(entry.curve.distance, values, label=entry.method, **style)
            ax.axhspan(low, high, color=INK, alpha=0.04, lw=0)
        ax.axhline(1.0, color=INK, lw=0.6, alpha=0.6)
        ax.set(xlabel=f"driven (m), noise {level}", yscale="log")
        ax.minorticks_off()
    row[0].set_ylabel("mean NEES of the pose / 3")
    legend(made, *row[0].get_legend_handles_labels())
    return Plot(
        "consistency",
        "Honesty along the way",
        "Squared error of the pose over its claimed covariance, per degree of freedom, mean of all "
        "runs at equal distances; the band holds 95 % of such means of honest runs. A curve that "
        "leaves it upwards and stays above is overconfident from there on.",
        to_svg(made, "consistency", "Mean NEES of the pose over the distance driven"),
        drawn,
    )
