"""Plots of errors, or of what methods claim of them, over time."""

from __future__ import annotations

import numpy as np

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
from graphslam.geometry import Array

QUANTITIES = (("x", "mm", 1e3), ("y", "mm", 1e3), ("heading", "°", 180.0 / np.pi))


def errors_over_time(record: Record) -> Plot:
    """Returns errors of x, y and heading with bands of 3 sigma; without truth the sigmas alone."""
    if record.has_true_pose:
        return _errors(record)
    return _sigmas(record)


def _errors(record: Record) -> Plot:
    estimates = record.estimates
    made, grid = figure(5.4, 3, len(estimates), sharex=True)
    step = stride(len(record.measurements.t))
    t = record.measurements.t[::step]
    t = t - t[0]
    limits = _error_limits(record)
    for column, (name, estimate) in enumerate(estimates.items()):
        colour = method_colour(name)
        error = record.pose_error(name)[::step]
        sigma = _sigma(estimate)[::step]
        for row, (quantity, unit, scale) in enumerate(QUANTITIES):
            ax = grid[row][column]
            band = 3.0 * scale * sigma[:, row]
            ax.fill_between(t, -band, band, color=colour, alpha=0.18, lw=0)
            ax.plot(t, scale * error[:, row], color=colour, lw=1.1)
            ax.axhline(0.0, color=INK, lw=0.5, alpha=0.5)
            limit = limits[name == "odometry"][row]
            ax.set_ylim(-limit, limit)
            if column == 0 or (column == 1 and "odometry" in list(estimates)[:1]):
                ax.set_ylabel(f"{quantity} ({unit})")
        grid[0][column].set_title(name, loc="left", color=colour, weight="bold")
        grid[-1][column].set_xlabel("time (s)")
    shaded = shade_ways([ax for row in grid for ax in row], record)
    scales = (
        " Odometry has a scale of its own."
        if "odometry" in estimates and len(estimates) > 1
        else ""
    )
    return Plot(
        "errors",
        "Errors over time",
        "Estimate minus truth in the floor frame, not aligned: truth is moved so that its first "
        "pose is the start. x and y in millimetres, heading in degrees. Bands: plus and minus "
        f"three sigma (99.7 % of a Gaussian). Time from the first node.{scales}{shaded}",
        to_svg(made, "errors", "Errors of x, y and heading over time"),
        {"t_s": t, **_columns(record, step, errors=True)},
    )


def _columns(record: Record, step: int, errors: bool) -> dict[str, Columns]:
    """Returns each method's errors, if wanted, and standard deviations, as columns of a file."""
    found: dict[str, Columns] = {}
    for name, estimate in record.estimates.items():
        parts = {"error": record.pose_error(name)} if errors else {}
        for what, values in (parts | {"sigma": _sigma(estimate)}).items():
            for column, (quantity, _, scale) in enumerate(QUANTITIES):
                unit = "deg" if quantity == "heading" else "mm"
                found[f"{name}_{what}_{quantity}_{unit}"] = scale * values[::step, column]
    return found


def _error_limits(record: Record) -> dict[bool, list[float]]:
    """Returns half heights of the axes of x, y and heading, for odometry (True) and the others."""
    limits: dict[bool, list[float]] = {}
    for alone in (True, False):
        reach = [np.full(3, 1e-6)]
        for name in (n for n in record.estimates if (n == "odometry") == alone):
            reach.append(np.nanmax(np.abs(record.pose_error(name)), axis=0, initial=0.0))
            reach.append(3.0 * np.quantile(_sigma(record.estimates[name]), 0.98, axis=0))
        scales = [scale for _, _, scale in QUANTITIES]
        limits[alone] = list(1.08 * np.max(reach, axis=0) * scales)
    return limits


def _sigmas(record: Record) -> Plot:
    made, grid = figure(2.6, 1, 3, sharex=True)
    step = stride(len(record.measurements.t))
    t = record.measurements.t[::step]
    for column, (quantity, unit, scale) in enumerate(QUANTITIES):
        ax = grid[0][column]
        for name, estimate in record.estimates.items():
            sigma = scale * _sigma(estimate)[::step, column]
            ax.plot(
                t - t[0],
                sigma,
                color=method_colour(name),
                ls=METHOD_DASHES.get(name, "-"),
                label=name,
            )
        usual = [np.quantile(_sigma(e)[:, column], 0.05) for e in record.estimates.values()]
        ax.set(xlabel="time (s)", ylabel=f"sigma of {quantity} ({unit})", yscale="log")
        ax.set_ylim(bottom=0.5 * scale * min(usual))  # the start may be known to the micrometre
    shaded = shade_ways(grid[0], record)
    legend(made, *grid[0][0].get_legend_handles_labels())
    return Plot(
        "errors",
        "Uncertainty over time",
        "The log has no true path, so only what the methods claim: one standard deviation in the "
        "floor frame, x and y in millimetres, heading in degrees. Time from the first node."
        f"{shaded}",
        to_svg(made, "errors", "Standard deviations of x, y and heading over time"),
        {"t_s": t - t[0], **_columns(record, step, errors=False)},
    )


def _sigma(estimate: Estimate) -> Array:
    return np.sqrt(np.diagonal(estimate.cov_floor, axis1=1, axis2=2))
