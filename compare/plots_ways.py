"""Ways on which no sighting counts, drawn into plans and along time."""

from __future__ import annotations

from collections.abc import Iterable

from matplotlib.axes import Axes

from compare.plots_style import (
    INK,
    stride,
)
from compare.record import Record
from compare.words import metres
from graphslam.estimate import Unobserved


def ways_without_sightings(record: Record) -> list[tuple[str, Unobserved]]:
    """Returns the ways on which no sighting counts, by the last method that has each."""
    found: dict[tuple[float, float], tuple[str, Unobserved]] = {}
    for name, estimate in record.estimates.items():
        for entry in estimate.unobserved:
            if entry.stretch is not None:
                found[entry.stretch.from_s, entry.stretch.to_s] = name, entry
    return [found[ends] for ends in sorted(found)]


def draw_ways(ax: Axes, record: Record) -> bool:
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
