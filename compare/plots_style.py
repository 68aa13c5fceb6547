"""How every plot looks, and its way to SVG with the same bytes each time."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import matplotlib.colors
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from graphslam.arrays import AnyArray

WIDTH = 9.6
"""Width of every figure, inches."""
INK = "#010203"
"""Text, axes and truth: `currentColor` in the SVG, so that it reads on light and dark pages."""
METHOD_COLOURS = {
    "odometry": "#d55e00",
    "ekf": "#0072b2",
    "ekf-naive": "#7d7d7d",
    "ekf-fej": "#a0780a",
    "ekf-robot": "#8b6fc4",
    "isam2": "#4a9bb5",
    "fixed-lag": "#6b8e23",
    "triangulation": "#c2557e",
    "fixes": "#9c6a3c",
    "smoother": "#009e73",
    "ekf-window": "#3f6fd0",
    "loops": "#b5478a",
}
"""From the palette of Okabe and Ito, or near it: contrast of 3 or more on white and near-black."""
OTHER_COLOUR = "#b0649a"
METHOD_DASHES: Mapping[str, str | tuple[float, tuple[float, ...]]] = {
    "odometry": (0.0, (1.2, 1.2)),
    "ekf": (0.0, (4.5, 1.5)),
}
METHOD_WIDTHS = {"odometry": 1.4, "ekf": 2.8}
"""Line widths, points, on the plan: methods drawn first are wider, so that the last hides none."""
MARGINS = (0.78, 0.12, 0.46, 0.34)
"""Left, right, below and above the axes of a figure, inches."""
MOST_STEPS = 5
"""Intervals between the numbers along an axis; every number takes milliseconds to draw."""
MOST_TICKS = 24
"""Numbers along an axis of lines; of more lines every k-th."""
MOST_POINTS = 1500
"""Points drawn of one curve; of a longer one every k-th."""

Columns = Sequence[Any] | AnyArray
"""One column of the file beside a plot."""

_STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "graphslam",
    "font.family": ["sans-serif"],
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 8.5,
    "axes.linewidth": 0.6,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.facecolor": "none",
    "axes.unicode_minus": True,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "grid.color": INK,
    "grid.alpha": 0.12,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "legend.borderaxespad": 0.2,
    "legend.fontsize": 8.5,
    "legend.labelcolor": INK,
    "lines.linewidth": 1.2,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "hatch.linewidth": 0.6,
    "path.simplify": True,
}


@dataclass(frozen=True, slots=True)
class Plot:
    """One finished plot.

    Attributes:
        name: its file name in `plots/`, without the ending.
        title: a few words.
        caption: what is drawn: frame, unit, probability.
        svg: the image as an <svg> element, without an XML declaration.
        data: the numbers that are drawn, by column; names end with the unit.
    """

    name: str
    title: str
    caption: str
    svg: str
    data: Mapping[str, Columns]

    def inline(self) -> str:
        """Returns the image for our pages, which give each method a colour for light and dark."""
        return themed(self.svg)

    def standalone(self) -> str:
        """Returns the image as a file of its own, readable on light and dark pages."""
        style = (
            "<style>svg{color:#1c2126}"
            "@media (prefers-color-scheme:dark){svg{color:#e4e7ea}}</style>"
        )
        head, rest = self.svg.split(">", 1)
        return f'<?xml version="1.0" encoding="utf-8"?>\n{head}>{style}{rest}\n'


def style() -> matplotlib.RcParams:
    """Returns a context in which figures are made and drawn in our style."""
    return matplotlib.rc_context(_STYLE)


def figure(
    height: float,
    rows: int = 1,
    columns: int = 1,
    gap: tuple[float, float] = (0.75, 0.15),
    **axes: object,
) -> tuple[Figure, list[list[Axes]]]:
    """Returns a figure of the common width and ``height`` inches with a grid of axes.

    The margins are fixed: measuring every text to lay a figure out takes as long as drawing it.

    Args:
        height: of the whole, inches.
        rows: of axes.
        columns: of axes.
        gap: between columns and between rows, inches.
        axes: what `Figure.subplots` takes.
    """
    left, right, bottom, top = MARGINS
    made = Figure(figsize=(WIDTH, height))
    grid = made.subplots(rows, columns, squeeze=False, **axes)
    each = (WIDTH - left - right - (columns - 1) * gap[0]) / columns
    high = (height - bottom - top - (rows - 1) * gap[1]) / rows
    made.subplots_adjust(
        left=left / WIDTH,
        right=1.0 - right / WIDTH,
        bottom=bottom / height,
        top=1.0 - top / height,
        wspace=gap[0] / each,
        hspace=gap[1] / high,
    )
    for ax in made.axes:
        ax.locator_params(nbins=MOST_STEPS)
    return made, [list(row) for row in grid]


def legend(made: Figure, *entries: Sequence[Any], **style: Any) -> None:
    """Puts a legend in one row above a figure's axes."""
    place = (MARGINS[0] / WIDTH, 1.0)
    made.legend(*entries, loc="upper left", bbox_to_anchor=place, ncols=8, **style)


def method_colour(method: str) -> str:
    """Returns the colour that stands for a method everywhere."""
    return METHOD_COLOURS.get(method, OTHER_COLOUR)


def themed(text: str) -> str:
    """Returns ``text`` with the methods' colours as CSS variables of our pages."""
    for method, colour in METHOD_COLOURS.items():
        text = text.replace(colour, f"var(--{method})")
    return text


def stride(count: int, most: int = MOST_POINTS) -> int:
    """Returns k such that every k-th of ``count`` points are at most ``most``."""
    return max(1, -(-count // most))


def to_svg(made: Figure, name: str, title: str) -> str:
    """Returns a figure as one <svg> element; equal figures give equal bytes.

    Args:
        made: the figure.
        name: makes ids unique among the plots of one page.
        title: what a screen reader says.
    """
    stream = io.StringIO()
    FigureCanvasSVG(made).print_svg(
        stream, metadata={"Date": None, "Creator": None, "Format": None, "Type": None}
    )
    svg = stream.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<!--.*?-->\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', svg)
    svg = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', svg)
    svg = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", svg)
    svg = svg.replace(INK, "currentColor")
    svg = re.sub(r"font: (\S+) [^;\"]*", r"font: \1 system-ui, sans-serif", svg)
    head, rest = svg.split(">", 1)
    return f'{head} role="img" aria-label="{title}">{rest}'.strip()
