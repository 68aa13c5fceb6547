"""How every plot looks, and its way to SVG with the same bytes each time."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass

import matplotlib
import matplotlib.colors
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

WIDTH = 9.6
"""Width of every figure, inches."""
INK = "#010203"
"""Text, axes and truth: `currentColor` in the SVG, so that it reads on light and dark pages."""
METHOD_COLOURS = {"odometry": "#d55e00", "ekf": "#0072b2", "smoother": "#009e73"}
"""From the palette of Okabe and Ito: contrast of 3 or more on white and on near-black."""
OTHER_COLOUR = "#b0649a"
METHOD_DASHES: Mapping[str, str | tuple[float, tuple[float, ...]]] = {
    "odometry": (0.0, (1.2, 1.2)),
    "ekf": (0.0, (4.5, 1.5)),
}
METHOD_WIDTHS = {"odometry": 1.4, "ekf": 2.8}
"""Line widths, points, on the plan: methods drawn first are wider, so that the last hides none."""
MOST_POINTS = 1500
"""Points drawn of one curve; of a longer one every k-th."""

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
    """

    name: str
    title: str
    caption: str
    svg: str

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
    height: float, rows: int = 1, columns: int = 1, **axes: object
) -> tuple[Figure, list[list[Axes]]]:
    """Returns a figure of the common width and ``height`` inches with a grid of axes."""
    made = Figure(figsize=(WIDTH, height), layout="constrained")
    grid = made.subplots(rows, columns, squeeze=False, **axes)
    return made, [list(row) for row in grid]


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
