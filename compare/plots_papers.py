"""Plots of the papers' report: their figures once more, from our runs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from compare.plots_boxes import draw_box
from compare.plots_style import (
    INK,
    METHOD_DASHES,
    Columns,
    Plot,
    figure,
    legend,
    method_colour,
    stride,
    style,
    to_svg,
)
from compare.plots_uncertainty import line_variance, variances
from compare.printed import printed_paper
from compare.record import Record
from frontend.config import DetectorConfig
from frontend.lines import line_covariance
from graphslam.geometry import points_on_line
from graphslam.models.line import LINE

if TYPE_CHECKING:
    from compare.papers import MonteCarlo, Papers

COLOURS = {"geometric": "#b0649a", "particle": "#937400"}
"""Methods that have no colour of their own elsewhere; contrast above 3 on white and near-black."""
PRINTED_METHODS = ("odometry", "geometric", "ekf")
NOISE_ANGLES_DEG = (0.0, 30.0, 60.0, 90.0)
BOX = 0.5
PLAN_MARGIN_M = 0.8
HIGHEST = 5.2
"""Height of a plan, inches."""


def draw_papers(papers: Papers) -> dict[str, Plot]:
    """Returns all plots of the report by name."""
    with style():
        plots = [noise_law(), final_errors(papers)]
        for key in ("experiment-1", "experiment-2"):
            plots.append(trajectories(papers.filmed[key], key))
        record = papers.filmed["slam"]
        plots += [trajectories(record, "slam"), lines_per_step(record), identified(record)]
        for plot in (line_variance(record), variances(record)):
            if plot is not None:
                plots.append(_renamed(plot, f"slam-{plot.name}"))
    return {plot.name: plot for plot in plots}


def colour_of(method: str) -> str:
    """Returns the colour of a method in this report."""
    return COLOURS.get(method, method_colour(method))


def noise_law() -> Plot:
    """Returns the papers' noise of rho over the distance, for a few directions.

    Source: SantanaLoc Fig. 8, of its noise '(22)'.
    """
    made, [[ax]] = figure(2.6)
    printed = printed_paper("SantanaLoc")
    law = DetectorConfig(
        sigma_rho_a_m=printed.value("noise_a"),
        sigma_rho_b_m=printed.value("noise_b"),
        sigma_rho_c_m=printed.value("noise_c"),
    )
    rho = np.linspace(0.0, 2.0, 81)
    drawn: dict[str, Columns] = {"rho_m": rho}
    for angle, dash in zip(NOISE_ANGLES_DEG, ("-", "--", "-.", ":"), strict=True):
        z = np.column_stack([rho, np.full(len(rho), np.radians(angle) - 0.5 * np.pi)])
        sigma = 1e3 * np.sqrt(line_covariance(z, law)[:, 0, 0])
        drawn[f"sigma_rho_at_{angle:.0f}_deg_mm"] = sigma
        ax.plot(rho, sigma, color=INK, ls=dash, label=f"α = {angle:.0f}°")
    ax.set(xlabel="ρ (m)", ylabel="σ of ρ (mm)", ylim=(0.0, None), xlim=(0.0, 2.0))
    legend(made)
    return Plot(
        "noise-law",
        "The papers' noise of ρ",
        "SantanaLoc Fig. 8, with the absolute value that its print lacks: one standard deviation "
        "of ρ over ρ; α in the papers' frame M (90°: a line across the robot's way).",
        to_svg(made, "noise-law", "Standard deviation of rho over rho"),
        drawn,
    )


def final_errors(papers: Papers) -> Plot:
    """Returns the final errors of both localisation experiments, ours and the printed ones."""
    made, [axes] = figure(3.4, 1, 2, sharey=True)
    drawn: dict[str, Columns] = {"experiment": [], "method": [], "run": [], "final_error_m": []}
    for ax, key in zip(axes, ("experiment-1", "experiment-2"), strict=True):
        study, record = papers.study(key), papers.filmed[key]
        for place, method in enumerate(study.methods):
            _final_error(ax, place, method, study, record)
            values = [float(r.values[f"{method}.final_error_m"]) for r in study.runs if r.values]
            for name, column in zip(
                drawn,
                ([key] * len(values), [method] * len(values), range(len(values)), values),
                strict=True,
            ):
                drawn[name] = [*drawn[name], *column]
        ax.set_xlabel(study.experiment.title)
        ax.set_yscale("log")
        ax.minorticks_off()
        ax.set_xticks(range(len(study.methods)), study.methods)
        ax.grid(visible=False, axis="x")
    axes[0].set_ylabel("final error (m)")
    legend(
        made,
        handles=[
            Line2D([], [], color=INK, lw=2.4, label="printed"),
            Line2D([], [], color=INK, marker="o", ls="", mfc="none", ms=4, label="one seed"),
            Line2D([], [], color=INK, marker="D", ls="", ms=5, label="through images"),
        ],
    )
    return Plot(
        "final-errors",
        "Final errors",
        "Distance from the true end, metres, on a logarithmic axis. Circles: one run each without "
        "images; box: their middle half, bar: median. Diamond: the run through images. Thick "
        "black bar: as printed.",
        to_svg(made, "final-errors", "Final errors of both localisation experiments"),
        drawn,
    )


def _final_error(ax: Axes, place: int, method: str, study: MonteCarlo, record: Record) -> None:
    colour = colour_of(method)
    values = study.values(f"{method}.final_error_m")
    draw_box(ax, place, BOX, values, colour, points=True)
    path = record.metrics["methods"].get(method, {}).get("trajectory")
    if path:
        ax.plot(place + 0.38, path["final_error_m"], "D", ms=5, color=colour)
    printed = study.experiment.printed.values.get(f"{study.experiment.prefix}final_error_{method}")
    if printed is not None:
        ax.plot([place - 0.42, place + 0.42], [printed.value] * 2, color=INK, lw=2.4)


def trajectories(record: Record, key: str) -> Plot:
    """Returns the paths of the paper's methods over the lines.

    Source: SantanaLoc Figs. 9, 11 and 12, SantanaSLAM Fig. 8.
    """
    true = record.true_pose
    low, high = true[:, :2].min(axis=0) - PLAN_MARGIN_M, true[:, :2].max(axis=0) + PLAN_MARGIN_M
    height = float(np.clip(8.7 * (high[1] - low[1]) / (high[0] - low[0]) + 0.8, 2.2, HIGHEST))
    made, [[ax]] = figure(height)
    ax.set_aspect("equal", adjustable="box")
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x (m)", ylabel="y (m)")
    reach = 2.0 * np.array([-1.0, 1.0]) * np.abs(np.concatenate([low, high])).max()
    for ends in points_on_line(record.true_lines[:, None], reach):
        ax.plot(*ends.T, color=INK, lw=0.8, alpha=0.3, dashes=(5, 3), zorder=1)
    step = stride(len(true))
    drawn: dict[str, Columns] = {
        "t_s": record.measurements.t[::step],
        "true_x_m": true[::step, 0],
        "true_y_m": true[::step, 1],
    }
    ax.plot(true[::step, 0], true[::step, 1], color=INK, lw=2.6, alpha=0.35, label="truth")
    for name in (n for n in PRINTED_METHODS if n in record.estimates):
        path = record.estimates[name].pose[::step]
        drawn |= {f"{name}_x_m": path[:, 0], f"{name}_y_m": path[:, 1]}
        dashes = METHOD_DASHES.get(name, "-")
        ax.plot(path[:, 0], path[:, 1], color=colour_of(name), ls=dashes, lw=1.3, label=name)
        ax.plot(path[-1, 0], path[-1, 1], "s", ms=4, color=colour_of(name))
    legend(made)
    name = f"{key}-trajectories"
    return Plot(
        name,
        "Trajectories",
        "The run through images; floor frame, metres, not aligned: all begin where the robot "
        "does. Dashed: the lines; squares: where each method believes that the robot ended.",
        to_svg(made, name, "Paths of the methods over the lines"),
        drawn,
    )


def line_names(record: Record) -> dict[int, int]:
    """Returns the papers' names of the true lines: 1 for the one identified first, and so on."""
    seen = record.measurements.sightings[LINE.kind].truth
    return {line: i for i, line in enumerate(dict.fromkeys(seen[seen >= 0].tolist()), start=1)}


def lines_per_step(record: Record) -> Plot:
    """Returns how many lines each step identifies. Source: SantanaSLAM Fig. 10."""
    counts = np.bincount(
        record.measurements.sightings[LINE.kind].node, minlength=len(record.measurements.t)
    )
    made, [[ax]] = figure(1.9)
    ax.step(np.arange(len(counts)), counts, where="mid", color=method_colour("ekf"), lw=1.1)
    ax.set(xlabel="step", ylabel="lines", yticks=range(int(counts.max()) + 1))
    return Plot(
        "slam-lines-per-step",
        "Lines at each step",
        "SantanaSLAM Fig. 10: how many lines the detector found in each image.",
        to_svg(made, "slam-lines-per-step", "Number of lines found at each step"),
        {"step": np.arange(len(counts)), "lines": counts},
    )


def identified(record: Record) -> Plot:
    """Returns which line each step identifies. Source: SantanaSLAM Fig. 11."""
    table, estimate = record.measurements.sightings[LINE.kind], record.estimates["ekf"]
    names = line_names(record)
    name = np.array([names.get(line, 0) for line in table.truth.tolist()])
    made, [[ax]] = figure(2.2)
    for used, marker, text in ((True, "o", "used"), (False, "x", "dropped")):
        rows = estimate.used == used
        ax.plot(table.node[rows], name[rows], marker, ms=3, color=method_colour("ekf"), label=text)
    ax.set(xlabel="step", ylabel="line", yticks=range(len(names) + 1))
    ax.set_yticklabels(["none", *map(str, range(1, len(names) + 1))])
    legend(made)
    return Plot(
        "slam-identified",
        "Which line at each step",
        "SantanaSLAM Fig. 11: the true line of each sighting, named, as in the paper, in the order "
        "in which the robot identified them; none: a sighting that is of no line.",
        to_svg(made, "slam-identified", "True line of each sighting over the steps"),
        {"step": table.node, "line": name, "used": estimate.used.astype(int)},
    )


def _renamed(plot: Plot, name: str) -> Plot:
    """Returns a plot under another name, its ids too."""
    svg = plot.svg
    for before in ('id="', 'href="#', "url(#"):
        svg = svg.replace(f"{before}{plot.name}-", f"{before}{name}-")
    return replace(plot, name=name, svg=svg)
