"""Plot of how well beacons fix the pose over a field, and where one more would help."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse

from compare.beacon_map import PROBABILITY, SCALE, Advice, BeaconMap
from compare.plots_style import INK, MARGINS, WIDTH, Plot, figure, style, to_svg
from graphslam.geometry import Array

COLOURS = "YlGnBu"
ELLIPSES = 12
"""Ellipses drawn along the longer side."""
SEEN, LARGEST = 0.02, 0.35
"""Half axis that a usual ellipse is drawn with, about, and the largest axis that is drawn, as
shares of the field's longer side."""
MARK = "#d55e00"
STEPS = (1.0, 2.0, 5.0)


def beacon_plot(drawn: BeaconMap, advice: Advice) -> Plot:
    """Returns the half axes over the field with ellipses, and what one more beacon would do."""
    unit, name = _unit(drawn)
    half = unit * drawn.half_axes()
    levels = _levels(half, unit * advice.worst)
    x, y = drawn.x, drawn.y
    high = 0.42 * WIDTH * np.ptp(y) / np.ptp(x) + 0.9
    times = _magnified(drawn)
    with style():
        made, [[left, right]] = figure(float(np.clip(high, 3.0, 7.0)), 1, 2, gap=(0.65, 0.15))
        made.subplots_adjust(right=0.9)
        filled = _filled(left, x, y, half, levels)
        _filled(right, advice.x, advice.y, unit * advice.worst, levels)
        _ellipses(left, drawn, times)
        for ax in (left, right):
            ax.set_aspect("equal", adjustable="box")
            ax.set_xlabel("x (m)")
            _beacons(ax, drawn)
            _field(ax, drawn)
            ax.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
        left.set_ylabel("y (m)")
        left.set_title(f"half axis of the {PROBABILITY:.0%} ellipse ({name})", loc="left")
        right.set_title(f"95 % of the field stays below, one more there ({name})", loc="left")
        right.plot(*advice.place, "*", ms=13, color=MARK, mec=INK, mew=0.6, zorder=6)
        _bar(made, filled, levels)
        svg = to_svg(made, "beacons", "How well beacons fix the pose")
    return Plot(
        "beacons",
        "How well beacons fix the pose",
        f"Bound on the error from bearings of {math.degrees(drawn.sigma):g}° (one sigma), every "
        f"beacon seen from everywhere. Left: longer half axis of the {PROBABILITY:.0%} ellipse of "
        f"the position ({SCALE:.2f} sigma), with the ellipses themselves, drawn {times:g} times as "
        "large as they are; rectangle: the field; triangles: beacons; dashed: the circle on which "
        "three beacons fix nothing. Right: the half axis that 95 % of the field stays below if one "
        "more beacon stood there; star: the best place.",
        svg,
        _data(drawn),
    )


def _data(drawn: BeaconMap) -> dict[str, Array]:
    across, up = np.meshgrid(drawn.x, drawn.y)
    return {
        "x_m": across.ravel(),
        "y_m": up.ravel(),
        "half_axis_95_m": drawn.half_axes().ravel(),
        "sigma_x_m": np.sqrt(drawn.cov[..., 0, 0]).ravel(),
        "sigma_y_m": np.sqrt(drawn.cov[..., 1, 1]).ravel(),
        "sigma_heading_deg": drawn.heading_sigma_deg().ravel(),
    }


def _unit(drawn: BeaconMap) -> tuple[float, str]:
    half = drawn.half_axes()[drawn.inside()]
    usual = float(np.median(half[np.isfinite(half)])) if np.isfinite(half).any() else 1.0
    return (1e3, "mm") if usual < 0.5 else (1.0, "m")


def _levels(*values: Array) -> Array:
    """Returns 1-2-5 steps that hold most of the values."""
    every = np.concatenate([v[np.isfinite(v)] for v in values])
    low, high = np.quantile(every, [0.0, 0.97])
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    steps = np.array([s * 10.0**k for k in range(first, last + 1) for s in STEPS])
    kept = steps[(steps >= 0.4 * low) & (steps <= 2.5 * high)]
    return kept if len(kept) > 2 else steps


def _filled(ax: Axes, x: Array, y: Array, values: Array, levels: Array) -> QuadContourSet:
    shown = np.minimum(np.where(np.isfinite(values), values, 10.0 * levels[-1]), 10.0 * levels[-1])
    norm = BoundaryNorm(levels, 256, extend="both")
    return ax.contourf(x, y, shown, levels, cmap=COLOURS, norm=norm, extend="both", zorder=0)


def _magnified(drawn: BeaconMap) -> float:
    """Returns the power of ten by which ellipses are drawn larger, to be seen."""
    half = drawn.half_axes()[drawn.inside()]
    usual = float(np.median(half[np.isfinite(half)])) if np.isfinite(half).any() else 1.0
    return 10.0 ** max(0, round(math.log10(SEEN * drawn.field.size / usual)))


def _ellipses(ax: Axes, drawn: BeaconMap, times: float) -> None:
    every = max(1, max(len(drawn.x), len(drawn.y)) // ELLIPSES)
    for row in range(every // 2, len(drawn.y), every):
        for column in range(every // 2, len(drawn.x), every):
            cov = drawn.cov[row, column, :2, :2]
            if not np.isfinite(cov).all():
                continue
            values, vectors = np.linalg.eigh(cov)
            size = 2.0 * times * SCALE * np.sqrt(values)
            if size[1] > LARGEST * drawn.field.size:
                continue
            turn = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
            place = (drawn.x[column], drawn.y[row])
            shape = Ellipse(place, size[1], size[0], angle=turn, fc="none", ec=INK, lw=0.8)
            ax.add_patch(shape)


def _field(ax: Axes, drawn: BeaconMap) -> None:
    (x0, y0), (x1, y1) = drawn.field.low, drawn.field.high
    ax.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=INK, lw=0.9, zorder=3)


def _beacons(ax: Axes, drawn: BeaconMap) -> None:
    ax.plot(*drawn.beacons.T, "^", ms=8, mfc=MARK, mec=INK, mew=0.8, zorder=5, clip_on=False)
    for centre, radius in drawn.circles():
        if math.isfinite(radius):
            ring = {"fc": "none", "ec": MARK, "lw": 1.4, "ls": "--", "zorder": 4}
            ax.add_patch(Circle((float(centre[0]), float(centre[1])), radius, **ring))
        else:
            first, last = drawn.beacons[0], drawn.beacons[-1]
            ax.axline((first[0], first[1]), (last[0], last[1]), color=MARK, lw=1.4, ls="--")


def _bar(made: Figure, filled: QuadContourSet, levels: Array) -> None:
    height = made.get_figheight()
    low, span = MARGINS[2] / height, 1.0 - (MARGINS[2] + MARGINS[3]) / height
    ax = made.add_axes((0.925, low, 0.014, span))
    bar = made.colorbar(filled, cax=ax)
    bar.set_ticks(levels.tolist(), labels=[f"{level:g}" for level in levels])
