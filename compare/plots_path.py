"""Plots of the path: the floor plan, and its errors over time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from compare.plots_points import (
    ELLIPSE_PROBABILITY,
    ELLIPSE_SCALE,
    draw_points,
    draw_true_points,
    ellipses,
)
from compare.plots_style import (
    INK,
    METHOD_DASHES,
    METHOD_WIDTHS,
    WIDTH,
    Columns,
    Plot,
    figure,
    legend,
    method_colour,
    stride,
    to_svg,
)
from compare.points import point_rows
from compare.record import Record
from compare.words import metres
from graphslam.estimate import Estimate, Unobserved
from graphslam.geometry import Array, points_on_line

PLAN_MARGIN = 0.04
QUANTITIES = (("x", "mm", 1e3), ("y", "mm", 1e3), ("heading", "°", 180.0 / np.pi))


def floor_plan(record: Record) -> Plot:
    """Returns the plan of the floor: paths, lines, and the uncertainty of the last poses."""
    low, high = plan_bounds(record)
    span = high - low
    height = float(np.clip(WIDTH * 0.86 * span[1] / span[0] + 0.7, 3.2, 7.8))
    made, [[ax]] = figure(height)
    ax.set_aspect("equal", adjustable="box")
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x (m)", ylabel="y (m)")
    style = {"color": INK, "lw": 0.8, "alpha": 0.4, "dashes": (5, 3), "zorder": 1}
    _endless(ax, record.true_lines, low, high, **style)
    draw_true_points(ax, record)
    step = stride(len(record.measurements.t))
    if record.has_true_pose:
        truth = record.true_pose[::step]
        ax.plot(truth[:, 0], truth[:, 1], color=INK, lw=2.4, alpha=0.35, label="truth")
    for name, estimate in record.estimates.items():
        rows, lines = estimate.map.of_kind("line")
        unknown = np.isnan(estimate.map.extent[rows, 0])
        style = {"color": method_colour(name), "lw": 0.8, "alpha": 0.5, "zorder": 2}
        _endless(ax, lines[unknown], low, high, **style)
        _method(ax, name, estimate, step)
        draw_points(ax, name, estimate)
        _open_directions(ax, name, estimate, 0.09 * span.max())
    gaps = _draw_ways(ax, record)
    _start(ax, record.measurements.start_pose, 0.035 * span.max())
    legend(made, handlelength=2.2, columnspacing=1.6)
    drawn = "" if step == 1 else f" Every {_ordinal(step)} node is drawn."
    lines = " Dashed: true lines." if len(record.true_lines) else ""
    of_points = ""
    if any(len(point_rows(e.map)) for e in record.estimates.values()):
        lines, of_points = f"{lines} Dots: estimated points.", ", and points that are not known,"
    lines += " Triangles: true points." if len(record.true_points) else ""
    if any(u.direction != (0.0, 0.0) for e in record.estimates.values() for u in e.unobserved):
        drawn += " Double arrows: directions of the last position that no sighting fixes."
    if gaps:
        drawn += (
            " Grey bands: ways without a sighting that counts, with their length and what odometry "
            "drifts by on them (one sigma)."
        )
    return Plot(
        "floor-plan",
        "Floor plan",
        "Floor frame, metres. Coloured lines: estimated lines, over the stretch where they were "
        "seen, or right across where that is not known."
        f"{lines} Ellipses: the last pose{of_points} with {ELLIPSE_PROBABILITY:.0%} probability "
        f"({ELLIPSE_SCALE:.2f} sigma).{drawn}",
        to_svg(made, "floor-plan", "Floor plan of paths and lines"),
        _plan_data(record, step),
    )


def _plan_data(record: Record, step: int) -> dict[str, Columns]:
    """Returns the points of all curves of the plan, one a row: whose, what, which, and where."""
    rows: list[tuple[str, str, int, float, float]] = []

    def add(method: str, what: str, number: int, points: Array) -> None:
        rows.extend((method, what, number, float(x), float(y)) for x, y in points)

    if record.has_true_pose:
        add("truth", "path", 0, record.true_pose[::step, :2])
    if len(record.true_lines):
        across = _reach(*plan_bounds(record)) * np.array([-1.0, 1.0])
        ends = points_on_line(record.true_lines[:, None], across)
        for number, pair in zip(record.truth.line_id.tolist(), ends, strict=True):
            add("truth", "line", number, pair)
    for number, point in zip(record.truth.point_id.tolist(), record.true_points, strict=True):
        add("truth", "point", number, point[None])
    for name, estimate in record.estimates.items():
        add(name, "path", 0, estimate.pose[::step, :2])
        numbers, _ = estimate.map.of_kind("line")
        for number, pair in zip(
            estimate.map.id[numbers].tolist(), stretches(estimate), strict=True
        ):
            add(name, "line", number, pair)
        for row in point_rows(estimate.map).tolist():
            add(name, "point", int(estimate.map.id[row]), estimate.map.params[row : row + 1, :2])
    columns = list(zip(*rows, strict=True))
    return dict(zip(("method", "what", "number", "x_m", "y_m"), columns, strict=True))


def _start(ax: Axes, pose: Array, size: float) -> None:
    x, y, theta = pose
    ax.plot(x, y, "o", ms=6, mfc="none", mec=INK, mew=1.2, label="start", zorder=6)
    tip = (x + size * np.cos(theta), y + size * np.sin(theta))
    arrow = {"arrowstyle": "->", "color": INK, "lw": 1.2}
    ax.annotate("", xy=tip, xytext=(x, y), arrowprops=arrow)


def plan_bounds(record: Record) -> tuple[Array, Array]:
    """Returns the lower left and upper right corner (2,) of a plan that shows everything, m."""
    points = [estimate.pose[:, :2] for estimate in record.estimates.values()]
    if record.has_true_pose:
        points.append(record.true_pose[:, :2])
    points.append(record.true_points)
    for estimate in record.estimates.values():
        points.extend(stretches(estimate))
        points.append(estimate.map.params[point_rows(estimate.map), :2])
    every = np.concatenate(points)
    every = every[np.isfinite(every).all(axis=1)]
    low, high = every.min(axis=0), every.max(axis=0)
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    half = np.maximum(half + PLAN_MARGIN * half.max(), 0.15 * half.max() + 0.05)
    return centre - half, centre + half


def stretches(estimate: Estimate) -> Array:
    """Returns the ends (m, 2, 2) of the stretches of an estimate's lines; NaN where unknown."""
    rows, lines = estimate.map.of_kind("line")
    if not len(rows):
        return np.zeros((0, 2, 2))
    return points_on_line(lines[:, None, :], estimate.map.extent[rows])


def _endless(ax: Axes, lines: Array, low: Array, high: Array, **style: Any) -> None:
    reach = _reach(low, high)
    for ends in points_on_line(lines[:, None, :], np.array([[-reach, reach]])):
        ax.plot(ends[:, 0], ends[:, 1], **style)


def _reach(low: Array, high: Array) -> float:
    """Returns how far along a line, from the origin's foot, a plan can go, m."""
    return float(np.linalg.norm(high - low) + np.linalg.norm(np.maximum(abs(low), abs(high))))


def _method(ax: Axes, name: str, estimate: Estimate, step: int) -> None:
    colour, width = method_colour(name), METHOD_WIDTHS.get(name, 1.2)
    for ends in stretches(estimate):
        ax.plot(ends[:, 0], ends[:, 1], color=colour, lw=0.7 * width, alpha=0.8, zorder=2)
    path = estimate.pose[::step]
    dashes = METHOD_DASHES.get(name, "-")
    ax.plot(path[:, 0], path[:, 1], color=colour, lw=width, ls=dashes, label=name, zorder=4)
    last = estimate.pose[-1]
    half, angle = ellipses(estimate.cov_floor[-1:])
    place = {"width": 2.0 * half[0, 0], "height": 2.0 * half[0, 1], "angle": np.degrees(angle[0])}
    shape = Ellipse(last[:2], **place, fc="none", ec=colour, lw=1.3, zorder=5)
    ax.add_patch(shape)
    ax.plot(last[0], last[1], "s", ms=3.5, color=colour, zorder=5)


def _open_directions(ax: Axes, name: str, estimate: Estimate, size: float) -> None:
    """Draws the directions of the last position that no sighting fixes."""
    for entry in estimate.unobserved:
        if entry.direction != (0.0, 0.0):
            reach = size * np.array(entry.direction)
            last = estimate.pose[-1, :2]
            arrow = {"arrowstyle": "<->", "color": method_colour(name), "lw": 1.6}
            ax.annotate("", xy=last + reach, xytext=last - reach, arrowprops=arrow, zorder=6)


def ways_without_sightings(record: Record) -> list[tuple[str, Unobserved]]:
    """Returns the ways on which no sighting counts, by the last method that has each."""
    found: dict[tuple[float, float], tuple[str, Unobserved]] = {}
    for name, estimate in record.estimates.items():
        for entry in estimate.unobserved:
            if entry.stretch is not None:
                found[entry.stretch.from_s, entry.stretch.to_s] = name, entry
    return [found[ends] for ends in sorted(found)]


def _draw_ways(ax: Axes, record: Record) -> bool:
    """Draws ways without a sighting into a plan; returns whether there are any."""
    ways = ways_without_sightings(record)
    t = record.measurements.t - record.measurements.t[0]
    for name, entry in ways:
        assert entry.stretch is not None
        on = (t >= entry.stretch.from_s) & (t <= entry.stretch.to_s)
        path = record.estimates[name].pose[on, :2]
        path = path[:: stride(len(path))]
        ax.plot(*path.T, color=INK, lw=9.0, alpha=0.16, solid_capstyle="butt", zorder=1)
        text = f"{metres(entry.stretch.length_m)}, ±{metres(entry.sigma_odometry)}"
        place = {"textcoords": "offset points", "xytext": (7, 7), "zorder": 7}
        ax.annotate(text, path[len(path) // 2], color=INK, fontsize="small", **place)
    return bool(ways)


def shade_ways(axes: Iterable[Axes], record: Record) -> str:
    """Shades the times without a sighting that counts; returns what a caption says of it."""
    ways = [entry.stretch for _, entry in ways_without_sightings(record)]
    for ax in axes:
        for way in ways:
            assert way is not None
            ax.axvspan(way.from_s, way.to_s, color=INK, alpha=0.09, lw=0, zorder=0)
    return " Grey: no sighting counted; the position is odometry's there." if ways else ""


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


def _ordinal(number: int) -> str:
    suffix = (
        "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    )
    return f"{number}{suffix}"
