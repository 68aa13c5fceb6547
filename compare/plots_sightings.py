"""Plots of the sightings: how many, how surprising, and which line they went to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator
from scipy.stats import chi2

from compare.consistency import SHARES, Innovations, band, innovations
from compare.plots_style import (
    INK,
    MOST_TICKS,
    Columns,
    Plot,
    figure,
    legend,
    method_colour,
    stride,
    to_svg,
)
from compare.record import Record
from compare.words import landmark_kinds, noun
from graphslam.arrays import AnyArray
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.measurements import IntArray

MOST_BINS = 240
NIS_PROBABILITY = 0.95
SMALLEST_NIS = 1e-3
"""What is smaller is drawn here, on the logarithmic axis."""


def sightings_per_node(record: Record) -> Plot:
    """Returns how many sightings each node has, over time, and how many the methods use."""
    measurements = record.measurements
    made, [[ax]] = figure(2.3)
    count = len(measurements.t)
    step = stride(count, MOST_BINS)
    edges = np.append(measurements.t[::step], measurements.t[-1]) - measurements.t[0]
    if count == 1:
        edges = np.array([0.0, 1.0])
    nodes = [table.node for _, table in measurements.tables()]
    seen = _mean_per_bin(np.concatenate([np.zeros(0, int), *nodes]), count, step)
    ax.stairs(seen, edges, color=INK, alpha=0.16, fill=True, lw=0, label="seen")
    drawn: dict[str, Columns] = {"seen_per_node": seen}
    for name, estimate in record.estimates.items():
        if estimate.used.any():
            used = np.concatenate(
                [t.node[estimate.used[f : f + len(t)]] for f, t in measurements.tables()]
            )
            drawn[f"{name}_used_per_node"] = values = _mean_per_bin(used, count, step)
            ax.stairs(values, edges, color=method_colour(name), lw=1.1, label=f"used by {name}")
    ax.set(
        xlabel="time (s)", ylabel="sightings per node", ylim=(0.0, None), xlim=(edges[0], edges[-1])
    )
    legend(made)
    mean = f", mean over {step} nodes" if step > 1 else ""
    return Plot(
        "sightings",
        "Sightings over time",
        f"Sightings of all kinds at each node{mean}: what the front-end saw, and what each method "
        "used. Time from the first node, seconds.",
        to_svg(made, "sightings", "Sightings per node over time"),
        {"from_s": edges[:-1], "to_s": edges[1:], **drawn},
    )


def _mean_per_bin(node: Array, count: int, step: int) -> Array:
    per_node = np.bincount(node.astype(int), minlength=count).astype(float)
    starts = np.arange(0, count, step)
    return np.add.reduceat(per_node, starts) / np.diff(np.append(starts, count))


def innovations_over_time(record: Record) -> Plot | None:
    """Returns the normalised innovations squared over time; None where no method has any."""
    names = [n for n, e in record.estimates.items() if np.isfinite(e.nis).any()]
    if not names:
        return None
    tables = [(f, t) for f, t in record.measurements.tables() if len(t)]
    shared: dict[str, Any] = {"sharex": True, "sharey": "row", "gap": (0.3, 0.15)}
    made, grid = figure(2.5 * len(tables) + 0.2, len(tables), len(names), **shared)
    for row, (first, table) in enumerate(tables):
        t = record.measurements.t[table.node] - record.measurements.t[0]
        for ax, name in zip(grid[row], names, strict=True):
            nis = record.estimates[name].nis[first : first + len(table)]
            _innovation_panel(ax, name, t, nis, table.z.shape[1])
        grid[row][0].set_ylabel(f"NIS, {table.kind.replace('_', ' ')}")
    for ax in grid[-1]:
        ax.set_xlabel("time (s)")
    return Plot(
        "nis",
        "Normalised innovations",
        "Squared error of each used sighting over its expected variance, without unit; the band "
        f"holds {NIS_PROBABILITY:.0%} if the noise is as stated (chi-square). The filter's is a "
        "prediction before the update; the smoother's is a residual after it, over the sighting's "
        "own noise, so it runs smaller. More above the band: noise stated too small, or wrong "
        "matches.",
        to_svg(made, "nis", "Normalised innovations squared over time"),
        _nis_data(record, names),
    )


def innovations_along_the_way(record: Record) -> Plot | None:
    """Returns the joint NIS of equal shares of the way with bands; None where none is predicted."""
    driven = record.measurements.driven()
    found = {name: innovations(e, driven, SHARES) for name, e in record.estimates.items()}
    curves = {name: curve for name, curve in found.items() if curve is not None}
    if not curves:
        return None
    made, [row] = figure(2.5, 1, len(curves), sharey=True, gap=(0.0, 0.15))
    drawn: dict[str, Columns] = {}
    for ax, (name, curve) in zip(row, curves.items(), strict=True):
        drawn |= draw_innovations(ax, name, curve)
        ax.set_title(name, loc="left", color=method_colour(name), weight="bold")
        ax.set_xlabel("driven (m)")
    row[0].set_ylabel("NIS / dof")
    return Plot(
        "nis-along-the-way",
        "Innovations along the way",
        f"Squared innovations over what the method expects of them, in {SHARES} equal shares of "
        "the way, those of one node taken jointly, per degree of freedom; a smoother predicts "
        f"nothing and has none. Bands hold {NIS_PROBABILITY:.0%} of an honest filter's "
        "(chi-square of the share's degrees of freedom, independent from share to share). Shares "
        "above it: surer than it should be there, or matched wrongly.",
        to_svg(made, "nis-along-the-way", "Normalised innovations over the distance driven"),
        drawn,
    )


def draw_innovations(ax: Axes, name: str, curve: Innovations) -> dict[str, Columns]:
    """Draws one method's innovations along the way, with bands; returns the numbers drawn."""
    edges = np.concatenate([[0.0], curve.distance])
    limits = np.array([band(f) if f > 0 else (np.nan, np.nan) for f in curve.freedom])
    for left, right, (low, high) in zip(edges[:-1], edges[1:], limits, strict=True):
        ax.fill_between([left, right], low, high, color=INK, alpha=0.08, lw=0)
    values = np.maximum(curve.nis, SMALLEST_NIS)
    ax.stairs(values, edges, baseline=None, color=method_colour(name), lw=1.4)
    ax.axhline(1.0, color=INK, lw=0.5, alpha=0.5)
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.minorticks_off()
    return {
        f"{name}_to_m": curve.distance,
        f"{name}_per_dof_nis": curve.nis,
        f"{name}_dof": curve.freedom,
        f"{name}_band_low_nis": limits[:, 0],
        f"{name}_band_high_nis": limits[:, 1],
    }


def _nis_data(record: Record, names: Sequence[str]) -> dict[str, Columns]:
    """Returns the NIS of all sightings that any method drew, with the node's time and the band."""
    t = record.measurements.t - record.measurements.t[0]
    columns: dict[str, list[AnyArray]] = {}
    for first, table in record.measurements.tables():
        nis = {n: record.estimates[n].nis[first : first + len(table)] for n in names}
        known = [np.flatnonzero(np.isfinite(values)) for values in nis.values()]
        rows = np.unique(np.concatenate([k[:: stride(len(k))] for k in known]))
        low, high = _band(table.z.shape[1])
        parts = {"t_s": t[table.node[rows]], "kind": np.full(len(rows), table.kind)}
        parts |= {"sighting": rows} | {f"{n}_nis": values[rows] for n, values in nis.items()}
        parts |= {"band_low": np.full(len(rows), low), "band_high": np.full(len(rows), high)}
        for name, values in parts.items():
            columns.setdefault(name, []).append(values)
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def _band(dim: int) -> tuple[float, float]:
    """Returns the limits of the central `NIS_PROBABILITY` of chi-square."""
    outside = 0.5 * (1.0 - NIS_PROBABILITY)
    low, high = chi2.ppf([outside, 1.0 - outside], dim)
    return float(low), float(high)


def _innovation_panel(ax: Axes, name: str, t: Array, nis: Array, dim: int) -> None:
    low, high = _band(dim)
    known = np.flatnonzero(np.isfinite(nis))
    inside = (nis[known] >= low) & (nis[known] <= high)
    share = f": {inside.mean():.0%} inside" if len(known) else ""
    ax.set_title(f"{name}{share}", loc="left", color=method_colour(name), weight="bold")
    ax.axhspan(low, high, color=INK, alpha=0.08, lw=0)
    chosen = known[:: stride(len(known))]
    style: dict[str, Any] = {"ms": 3.2, "mew": 0, "alpha": 0.7, "color": method_colour(name)}
    ax.plot(t[chosen], np.maximum(nis[chosen], SMALLEST_NIS), ".", **style)
    ax.set_yscale("log")
    ax.minorticks_off()


def matches_per_landmark(record: Record) -> Plot | None:
    """Returns right, wrong and unjudged matches of every landmark; None without a map."""
    estimates = {n: e for n, e in record.estimates.items() if len(e.map)}
    if not estimates:
        return None
    made, grid = figure(1.75 * len(estimates) + 0.5, len(estimates), gap=(0.0, 0.55))
    for [ax], (name, estimate) in zip(grid, estimates.items(), strict=True):
        _match_bars(ax, record.match_counts(name), method_colour(name))
        _landmark_axis(ax, estimate)
        ax.set_title(name, loc="left", color=method_colour(name), weight="bold")
    counts = np.concatenate([record.match_counts(name) for name in estimates])
    one, _ = noun(landmark_kinds(record.measurements))
    grid[-1][0].set_xlabel("landmark (number in the method's map.csv)")
    return Plot(
        "matches",
        f"Matches per {one}",
        "Sightings that each method gave to each of its landmarks. Right: the sighting's true "
        f"{one} is the one that most of the landmark's sightings are of; wrong: it is another; not "
        "judged: it is not known.",
        to_svg(made, "matches", "Right and wrong matches of every landmark"),
        {
            "method": [name for name, estimate in estimates.items() for _ in estimate.map.id],
            "landmark": np.concatenate([estimate.map.id for estimate in estimates.values()]),
            **dict(zip(("right_count", "wrong_count", "not_judged_count"), counts.T, strict=True)),
        },
    )


def _match_bars(ax: Axes, counts: IntArray, colour: str) -> None:
    right, wrong, unknown = counts.T
    at, bad = np.arange(len(counts)), wrong > 0
    below = right + unknown
    hatched: dict[str, Any] = {"fc": "none", "ec": INK, "hatch": "////", "lw": 0.6}
    ax.bar(at, right, 0.72, color=colour)
    ax.bar(at, unknown, 0.72, bottom=right, color=colour, alpha=0.35)
    ax.bar(at[bad], wrong[bad], 0.72, bottom=below[bad], **hatched)
    ax.set_ylabel("matches")
    handles = [
        Patch(color=colour, label="right"),
        Patch(color=colour, alpha=0.35, label="not judged"),
        Patch(label="wrong", **hatched),
    ]
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
    ax.legend(handles=handles, ncols=3, borderaxespad=0.1, **place)


def _landmark_axis(ax: Axes, estimate: Estimate) -> None:
    count = len(estimate.map)
    every = stride(count, MOST_TICKS)
    ax.set_xticks(np.arange(0, count, every), [str(i) for i in estimate.map.id[::every]])
    ax.set_xlim(-0.6, count - 0.4)
    ax.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    ax.grid(False, axis="x")
