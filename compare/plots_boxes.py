"""Boxes of many runs' figures: the one way in which all pages draw them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes

from graphslam.geometry import Array

BOX_ALPHA = 0.4


def draw_box(
    ax: Axes,
    at: float,
    width: float,
    values: Sequence[float] | Array,
    colour: str,
    *,
    whole_range: bool = False,
    points: bool = False,
) -> None:
    """Draws quartiles and median of values at a place of the x axis.

    Args:
        ax: where to draw.
        at: place of the box.
        width: of the box, in the unit of the axis.
        values: finite numbers, at least one.
        colour: of all parts.
        whole_range: whiskers reach the smallest and the largest value; else the farthest within one
            and a half box heights, and what lies beyond is a circle of its own.
        points: every value is a circle.
    """
    line: dict[str, Any] = {"color": colour, "lw": 1.1}
    ax.boxplot(
        [values],
        positions=[at],
        widths=width,
        whis=(0.0, 100.0) if whole_range else 1.5,
        manage_ticks=False,
        patch_artist=True,
        showfliers=not points,
        boxprops={"facecolor": colour, "edgecolor": colour, "alpha": BOX_ALPHA, "lw": 1.0},
        medianprops=line | {"lw": 2.0},
        whiskerprops=line,
        capprops=line,
        flierprops={"markeredgecolor": colour, "markersize": 3.0},
    )
    if points:
        ax.plot([at] * len(values), values, "o", ms=2.6, mfc="none", mec=colour, mew=0.7)
