"""Plot of the floor: paths, lines, points, and where the last pose may be."""

from __future__ import annotations

from collections.abc import Sequence
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
from compare.plots_ways import draw_ways
from compare.points import point_rows
from compare.record import Record
from compare.walls import has_walls, wall_parts
from graphslam.estimate import Estimate
from graphslam.geometry import Array, points_on_line

PLAN_MARGIN = 0.04
ROOM = 1.5
"""How much larger a path that no sighting held may make the plan before it leaves it."""


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
        _method(ax, name, estimate, step, _drawn(record, estimate)[1])
        draw_points(ax, name, estimate)
        _open_directions(ax, name, estimate, 0.09 * span.max())
    gaps = draw_ways(ax, record)
    _start(ax, record.measurements.start_pose, 0.035 * span.max())
    legend(made, handlelength=2.2, columnspacing=1.6)
    drawn = "" if step == 1 else f" Every {_ordinal(step)} node is drawn."
    lines = ""
    if any(len(e.map.of_kind("line")[0]) for e in record.estimates.values()):
        lines = (
            " Coloured lines: estimated lines, over the stretch where they were seen, or right "
            "across where that is not known."
        )
    lines += " Dashed: true lines." if len(record.true_lines) else ""
    of_points = ""
    if any(len(point_rows(e.map)) for e in record.estimates.values()):
        lines, of_points = f"{lines} Dots: estimated points.", ", and points that are not known,"
    lines += " Triangles: true points." if len(record.true_points) else ""
    if any(u.direction != (0.0, 0.0) for e in record.estimates.values() for u in e.unobserved):
        drawn += " Double arrows: directions of the last position that no sighting fixes."
    if away := leaving(record):
        drawn += f" The path of {' and '.join(away)} drifts off the plan."
    if gaps:
        drawn += (
            " Grey bands: ways without a sighting that counts, with their length and what odometry "
            "drifts by on them (one sigma)."
        )
    return Plot(
        "floor-plan",
        "Floor plan",
        f"Floor frame, metres.{lines} Ellipses: the last pose{of_points} with "
        f"{ELLIPSE_PROBABILITY:.0%} probability ({ELLIPSE_SCALE:.2f} sigma).{drawn}",
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
        for number, pair in zip(*_drawn(record, estimate), strict=True):
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
    """Returns the lower left and upper right corner (2,) of a plan that shows everything, m.

    Paths that no sighting held are no reason to draw all else small: where they would make the plan
    more than `ROOM` times as large, they leave it (see `leaving`).
    """
    held = [name for name in record.estimates if name not in leaving(record)]
    return _box(_shown(record, held))


def leaving(record: Record) -> list[str]:
    """Returns the methods whose path leaves the plan, because no sighting holds it."""
    free = [name for name, estimate in record.estimates.items() if not estimate.used.any()]
    held = [name for name in record.estimates if name not in free]
    if not held:
        return []
    low, high = _box(_shown(record, held))
    out = []
    for name in free:
        lowest, highest = _box(_shown(record, [*held, name]))
        if (highest - lowest).max() > ROOM * (high - low).max():
            out.append(name)
    return out


def _shown(record: Record, names: Sequence[str]) -> Array:
    """Returns all points (k, 2) that a plan of some methods shows, floor frame, m."""
    points = [record.true_points]
    if record.has_true_pose:
        points.append(record.true_pose[:, :2])
    for estimate in (record.estimates[name] for name in names):
        points.append(estimate.pose[:, :2])
        points.extend(stretches(estimate))
        points.append(estimate.map.params[point_rows(estimate.map), :2])
    every = np.concatenate(points)
    return np.asarray(every[np.isfinite(every).all(axis=1)])


def _box(points: Array) -> tuple[Array, Array]:
    """Returns the corners (2,) of a box around points, with a margin."""
    low, high = points.min(axis=0), points.max(axis=0)
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


def _drawn(record: Record, estimate: Estimate) -> tuple[list[int], Array]:
    """Returns number and ends (m, 2, 2) of what is drawn of lines: of walls, what was seen."""
    if has_walls(record):
        parts, rows = wall_parts(record.measurements, estimate)
        return estimate.map.id[rows].tolist(), parts
    rows, _ = estimate.map.of_kind("line")
    return estimate.map.id[rows].tolist(), stretches(estimate)


def _method(ax: Axes, name: str, estimate: Estimate, step: int, lines: Array) -> None:
    colour, width = method_colour(name), METHOD_WIDTHS.get(name, 1.2)
    for ends in lines:
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


def _ordinal(number: int) -> str:
    suffix = (
        "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    )
    return f"{number}{suffix}"
