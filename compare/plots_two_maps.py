"""Plots of two maps held against each other."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from compare.plots_style import (
    INK,
    METHOD_COLOURS,
    MOST_TICKS,
    WIDTH,
    Plot,
    figure,
    legend,
    stride,
    to_svg,
)
from compare.two_maps import MapPair
from compare.two_maps_tables import line_columns
from graphslam.geometry import Array, compose, points_on_line, transform_points
from graphslam.line_maps.line_map import LineMap

WIDTHS = (3.2, 1.2)
"""Line widths of the first and the second map, points: the second, on top, hides nothing."""
PATH_WIDTHS = (2.2, 0.9)
MARGIN = 0.04
"""Free space around a plan, part of its size."""
ROOM = 1.12
"""Half the height of a plot of differences over the largest of them."""
QUANTITIES = (("x", "mm", 1e3), ("y", "mm", 1e3), ("heading", "°", 180.0 / np.pi))


def colours(pair: MapPair) -> tuple[str, str]:
    """Returns the colours of the first and the second: their methods' own where those differ."""
    methods = [s.estimate.method if s.estimate is not None else "" for s in (pair.a, pair.b)]
    if methods[0] != methods[1] and all(method in METHOD_COLOURS for method in methods):
        return METHOD_COLOURS[methods[0]], METHOD_COLOURS[methods[1]]
    return METHOD_COLOURS["ekf"], METHOD_COLOURS["odometry"]


def plan(pair: MapPair, name: str) -> Plot:
    """Returns both maps and paths over each other, in the first's frame."""
    ends = _ends(pair.a.map), transform_points(pair.motion, _ends(pair.b.map))
    paths = pair.a.pose[:, :2], compose(pair.motion, pair.b.pose)[:, :2]
    every = np.concatenate([part.reshape(-1, 2) for part in (*ends, *paths)])
    low, high = every.min(axis=0), every.max(axis=0)
    room = np.maximum(high - low, 0.1 * (high - low).max())
    low, high = low - MARGIN * room, high + MARGIN * room
    height = float(np.clip(WIDTH * 0.86 * room[1] / room[0] + 0.7, 3.2, 7.2))
    made, [[ax]] = figure(height)
    ax.set_aspect("equal", adjustable="box")
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x (m)", ylabel="y (m)")
    alone = pair.only_a, pair.only_b
    for k, (source, colour) in enumerate(zip((pair.a, pair.b), colours(pair), strict=True)):
        _segments(ax, ends[k], alone[k], source.label, colour, WIDTHS[k])
        path = paths[k][:: stride(max(len(paths[k]), 1))]
        ax.plot(path[:, 0], path[:, 1], color=colour, lw=PATH_WIDTHS[k], alpha=0.6, zorder=4 + k)
    legend(made, handlelength=2.2, columnspacing=1.6)
    where = [("first", pair.a, ends[0]), ("second", pair.b, ends[1])]
    return Plot(
        name,
        "One over the other",
        f"Frame of {pair.a.label}, metres. Bars: lines over the stretch that was seen, or as far "
        "as the map reaches where that is not known; dashed: lines that the other map has not. "
        "Thin curves: paths.",
        to_svg(made, name, "Both maps over each other"),
        {
            "map": [what for what, s, _ in where for _ in range(len(s.map))],
            "line": [int(i) for _, s, _ in where for i in s.line_id],
            **{
                f"{axis}_{end}_m": np.concatenate([e[:, k, c] for _, _, e in where])
                for k, end in enumerate(("from", "to"))
                for c, axis in enumerate("xy")
            },
        },
    )


def _ends(lines: LineMap) -> Array:
    return points_on_line(lines.lines[:, None], lines.stretches())


def _segments(ax: Axes, ends: Array, alone: Array, label: str, colour: str, width: float) -> None:
    style = {
        "color": colour,
        "lw": width,
        "solid_capstyle": "butt",
        "zorder": 2 if width > 2 else 3,
    }
    for row, pair in enumerate(ends):
        dashes = (0.0, (4.0, 2.0)) if row in alone else "-"
        ax.plot(pair[:, 0], pair[:, 1], ls=dashes, alpha=0.45 if width > 2 else 1.0, **style)
    ax.plot([], [], label=label, alpha=0.45 if width > 2 else 1.0, **style)


def differences(pair: MapPair, name: str) -> Plot | None:
    """Returns offset and angle of all common lines; None where there are none."""
    if pair.test is None:
        return None
    columns = line_columns(pair)
    count = len(columns["line_first"])
    made, grid = figure(3.4, 2, 1, sharex=True)
    at = np.arange(count)
    parts = (
        ("offset (mm)", "offset_mm", "sigma_offset_mm"),
        ("angle (°)", "d_alpha_deg", "sigma_alpha_deg"),
    )
    for [ax], (label, key, sigma) in zip(grid, parts, strict=True):
        spread = 3.0 * np.nan_to_num(columns[sigma])
        ax.bar(at, 2.0 * spread, 0.5, -spread, color=colours(pair)[1], alpha=0.22, lw=0)
        ax.plot(at, columns[key], "o", ms=4.0, mew=0, color=colours(pair)[1])
        ax.axhline(0.0, color=INK, lw=0.6, alpha=0.5)
        most = np.maximum(spread, np.abs(columns[key])).max()
        ax.set(ylabel=label, ylim=(-ROOM * most, ROOM * most) if most > 0 else None)
        every = stride(count, MOST_TICKS)
        ax.set_xticks(at[::every], [str(i) for i in columns["line_first"][::every]])
        ax.set_xlim(-0.7, count - 0.3)
        ax.grid(False, axis="x")
    grid[-1][0].set_xlabel(f"line (number in {pair.a.label})")
    independent = pair.relation.independent
    boxes = (
        "three sigma of the difference by both maps’ covariances (99.7 % of a Gaussian), the "
        "frame’s share taken out"
        if independent
        else "three sigma of the surer map’s own covariance, the frame’s share taken out; the "
        "maps’ errors are correlated, so no probability belongs to it"
    )
    return Plot(
        name,
        "Differences, line by line",
        f"{pair.b.label} minus {pair.a.label}, after the rigid motion that fits best: the offset "
        "across the line at the middle of the stretch that both saw, in millimetres, and the "
        f"angle, in degrees. Boxes: {boxes}.",
        to_svg(made, name, "Differences of every common line"),
        columns,
    )


def path_differences(pair: MapPair, name: str) -> Plot | None:
    """Returns the difference of the paths over time; None where they are not compared."""
    path = pair.path
    if path is None:
        return None
    step = stride(len(path.t))
    t = path.t[::step] - path.t[0]
    made, grid = figure(2.7, 1, 3, sharex=True)
    data = {"t_s": t}
    sides = zip((path.sigma, path.sigma_second), colours(pair), ("first", "second"), strict=True)
    bands = [side for side in sides if np.isfinite(side[0]).any()]
    for column, (quantity, unit, scale) in enumerate(QUANTITIES):
        ax = grid[0][column]
        for sigma, colour, who in bands:
            band = 3.0 * scale * sigma[::step, column]
            ax.fill_between(t, -band, band, color=colour, alpha=0.16, lw=0)
            data[f"sigma_{who}_{quantity}_{unit.replace('°', 'deg')}"] = band / 3.0
        values = scale * path.difference[::step, column]
        ax.plot(t, values, color=INK, lw=1.1)
        ax.axhline(0.0, color=INK, lw=0.5, alpha=0.5)
        ax.set(xlabel="time (s)", ylabel=f"{quantity} ({unit})")
        data[f"{quantity}_{unit.replace('°', 'deg')}"] = values
    shown = (
        " Bands: three sigma (99.7 % of a Gaussian) of each path, in its colour." if bands else ""
    )
    return Plot(
        name,
        "Paths at common times",
        f"{pair.b.label} minus {pair.a.label}, frame of {pair.a.label}: x and y in millimetres, "
        f"heading in degrees. Time from the first common one.{shown}",
        to_svg(made, name, "Differences of the paths over time"),
        data,
    )
