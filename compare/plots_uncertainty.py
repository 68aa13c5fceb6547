"""Plots of what the methods claim to know: variances over time, and whether errors fit them."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator
from scipy.stats import chi2

from compare.plots_style import (
    INK,
    METHOD_DASHES,
    Columns,
    Plot,
    figure,
    legend,
    method_colour,
    stride,
    to_svg,
)
from compare.plots_ways import shade_ways
from compare.record import Record
from graphslam.estimate import Estimate
from graphslam.geometry import TAU, Array

NEES_PROBABILITY = 0.95
NEES_DIM = 3
SMALLEST_NEES = 1e-2
"""What is smaller is drawn here, on the logarithmic axis."""
QUANTITIES = (("x", "m", 1.0), ("y", "m", 1.0), ("heading", "deg", 360.0 / TAU))
SYMBOLS = {"m": "m", "deg": "°"}
LINE_QUANTITIES = (("rho", "mm", 1e3), ("alpha", "deg", 360.0 / TAU))


def variances(record: Record) -> Plot:
    """Returns x, y and heading over time, and below each its variance, for every method.

    Source: SantanaSLAM Fig. 13.
    """
    made, grid = figure(4.2, 2, 3, sharex=True)
    step = stride(len(record.measurements.t))
    t = record.measurements.t[::step] - record.measurements.t[0]
    drawn: dict[str, Columns] = {"t_s": t}
    for column, (quantity, unit, scale) in enumerate(QUANTITIES):
        above, below = grid[0][column], grid[1][column]
        symbol = SYMBOLS[unit]
        if record.has_true_pose:
            true = scale * _steady(record.true_pose[:, column], unit)[::step]
            drawn[f"true_{quantity}_{unit}"] = true
            above.plot(t, true, color=INK, lw=2.4, alpha=0.35, label="truth")
        for name, estimate in record.estimates.items():
            values = scale * _steady(estimate.pose[:, column], unit)[::step]
            variance = scale**2 * estimate.cov_floor[::step, column, column]
            drawn[f"{name}_{quantity}_{unit}"] = values
            drawn[f"{name}_variance_{quantity}_{unit}2"] = variance
            style = {"color": method_colour(name), "ls": METHOD_DASHES.get(name, "-")}
            above.plot(t, values, label=name, **style)
            below.plot(t, variance, label=name, **style)
        usual = [
            np.quantile(e.cov_floor[:, column, column], 0.05) for e in record.estimates.values()
        ]
        above.set_ylabel(f"{quantity} ({symbol})")
        below.set(xlabel="time (s)", ylabel=f"variance of {quantity} ({symbol}²)", yscale="log")
        below.set_ylim(bottom=0.3 * scale**2 * min(usual))  # the start may be known to the um
        below.minorticks_off()
    shaded = shade_ways(grid[1], record)
    legend(made, *grid[0][0].get_legend_handles_labels())
    return Plot(
        "variance",
        "Pose and its variance over time",
        "Above: x and y in metres and heading in degrees, floor frame, not aligned; below: the "
        "variance that each method claims, in square metres and square degrees, on a logarithmic "
        "axis. A filter's variance falls when something is seen again; a smoother's is low "
        f"throughout, as every pose uses the whole run. Time from the first node.{shaded}",
        to_svg(made, "variance", "Pose and variance over time"),
        drawn,
    )


def line_variance(record: Record) -> Plot | None:
    """Returns the variances of the most seen line over time, as the methods knew them.

    None where no method estimates a line: lines of a known map have no variance.

    Source: SantanaSLAM Fig. 12.
    """
    t = record.measurements.t - record.measurements.t[0]
    step = stride(len(t))
    drawn: dict[str, Columns] = {"t_s": t[::step]}
    made, grid = figure(2.6, 1, 2, sharex=True)
    for name, estimate in record.estimates.items():
        line = estimate.map.most_seen("line")
        if line is None or not estimate.landmark_cov(line).any():
            continue  # nothing seen, or known exactly
        style = {"color": method_colour(name), "ls": METHOD_DASHES.get(name, "-")}
        for axis, (symbol, unit, scale) in enumerate(LINE_QUANTITIES):
            values = _variance_of(estimate, line, axis)
            drawn[f"{name}_variance_{symbol}_{unit}2"] = values = scale**2 * values[::step]
            grid[0][axis].plot(
                t[::step], values, label=f"{name}, its line {estimate.map.id[line]}", **style
            )
    if len(drawn) == 1:
        return None
    for ax, (symbol, unit, _) in zip(grid[0], LINE_QUANTITIES, strict=True):
        unit = SYMBOLS.get(unit, unit)
        ax.set(xlabel="time (s)", ylabel=f"variance of {symbol} ({unit}²)", yscale="log")
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.minorticks_off()
    legend(made, *grid[0][0].get_legend_handles_labels())
    return Plot(
        "line-variance",
        "Variance of the line seen most",
        "The variance of ρ, in square millimetres, and of α, in square degrees, of the line that "
        "each method has most sightings of, floor frame, on logarithmic axes. The filter's is what "
        "it knew at each time and falls whenever this or a correlated line is seen; the smoother's "
        "uses the whole run and does not change. Time from the first node.",
        to_svg(made, "line-variance", "Variance of the line seen most over time"),
        drawn,
    )


def _variance_of(estimate: Estimate, landmark: int, axis: int) -> Array:
    """Returns the variance (N,) of one landmark parameter over time; constant without history."""
    column = int(estimate.map.offsets()[landmark]) - 3 + axis
    if estimate.map_variance is not None:
        return estimate.map_variance[:, column]
    return np.full(len(estimate.t), estimate.landmark_cov(landmark)[axis, axis])


def _steady(values: Array, unit: str) -> Array:
    """Returns angles without jumps of a turn; NaN stay, and lengths stay as they are."""
    values, known = values.copy(), np.isfinite(values)
    if unit == "deg":
        values[known] = np.unwrap(values[known], period=TAU)
    return values


def pose_consistency(record: Record) -> Plot | None:
    """Returns the NEES of the poses over time; None where errors are not known to be errors.

    Where the start is uncertain, or the true path does not begin there, `compare.metrics.pose_nees`
    is not defined and neither is this.
    """
    judged = record.metrics["methods"]
    names = [name for name in record.estimates if judged[name]["pose_nees"] is not None]
    if not names:
        return None
    made, [[ax]] = figure(2.9)
    step = stride(len(record.measurements.t))
    t = record.measurements.t[::step] - record.measurements.t[0]
    low, high = nees_band()
    ax.axhspan(low, high, color=INK, alpha=0.08, lw=0)
    ax.axhline(1.0, color=INK, lw=0.5, alpha=0.5)
    drawn: dict[str, Columns] = {"t_s": t}
    for name in names:
        drawn[f"{name}_nees_per_dof"] = values = record.pose_nees(name)[::step]
        style = {"color": method_colour(name), "ls": METHOD_DASHES.get(name, "-")}
        ax.plot(t, np.maximum(values, SMALLEST_NEES), label=name, **style)
    ax.set(xlabel="time (s)", ylabel="NEES of the pose / 3", yscale="log")
    ax.minorticks_off()
    legend(made)
    return Plot(
        "nees",
        "Error over claimed covariance",
        "Squared error of the pose over its claimed covariance, per degree of freedom (three: x, "
        f"y, heading), without unit. The band holds {NEES_PROBABILITY:.0%} of honest poses; above "
        "it the method is surer than it should be, below it less sure. Neighbouring nodes share "
        "their errors, so the curve wanders slowly. Time from the first node.",
        to_svg(made, "nees", "Normalised estimation error squared over time"),
        drawn,
    )


def nees_band() -> tuple[float, float]:
    """Returns the limits of the central `NEES_PROBABILITY` of an honest pose's NEES per dof."""
    outside = 0.5 * (1.0 - NEES_PROBABILITY)
    low, high = chi2.ppf([outside, 1.0 - outside], NEES_DIM) / NEES_DIM
    return float(low), float(high)
