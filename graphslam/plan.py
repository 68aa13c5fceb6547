"""The plan of the floor as polylines in metres, and as a small SVG; needs no plotting library."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from graphslam.estimate import Estimate
from graphslam.geometry import Array, points_on_line, position_along
from graphslam.measurements import LandmarkMap

ELLIPSE_PROBABILITY = 0.95
MARGIN = 0.05
"""Of the plan's longer side, left free around everything."""
SMALLEST = 0.1
"""Shortest side of a plan, m."""
LINE_COLOUR, PATH_COLOUR = "#0072b2", "#d55e00"
"""Of the palette of Okabe and Ito."""


@dataclass(frozen=True, slots=True)
class Layer:
    """What belongs together on a plan, drawn in one colour.

    Attributes:
        name: what it shows.
        polylines: (k, 2) points of each, floor frame, m.
        labels: a short text at the middle of each polyline, "" for none.
        colour: as SVG writes it.
    """

    name: str
    polylines: tuple[Array, ...]
    labels: tuple[str, ...]
    colour: str


def estimate_layers(estimate: Estimate, name: str = "") -> tuple[Layer, ...]:
    """Returns the lines, the path, and the ellipse of the last position, of one estimate.

    Args:
        estimate: its lines are drawn over the stretch where they were seen, or right across the
            plan where that is not known.
        name: put before the names of the layers.
    """
    prefix = f"{name} " if name else ""
    rows, _ = estimate.map.of_kind("line")
    path = estimate.pose[:, :2]
    labels = tuple(str(number) for number in estimate.map.id[rows])
    segments = line_segments(estimate.map, *plan_box([path, *_known_ends(estimate.map)]))
    ellipse = covariance_ellipse(path[-1], estimate.cov_floor[-1, :2, :2])
    return (
        Layer(f"{prefix}lines", tuple(segments), labels, LINE_COLOUR),
        Layer(f"{prefix}path", (path,), ("",), PATH_COLOUR),
        Layer(f"{prefix}last position 95 %", (ellipse,), ("",), PATH_COLOUR),
    )


def line_segments(landmarks: LandmarkMap, low: Array, high: Array) -> Array:
    """Returns the ends (m, 2, 2) of a map's lines, floor frame, m.

    Args:
        landmarks: the map.
        low: (2,) lower left corner of the plan, m.
        high: (2,) its upper right corner: lines of unknown stretch go as far as the plan is wide,
            about the point that is nearest to its middle.
    """
    rows, lines = landmarks.of_kind("line")
    if not len(rows):
        return np.zeros((0, 2, 2))
    half = 0.5 * float(np.linalg.norm(high - low))
    across = position_along(lines, 0.5 * (low + high))[:, None] + np.array([-half, half])
    extent = landmarks.extent[rows]
    return points_on_line(lines[:, None], np.where(np.isnan(extent), across, extent))


def covariance_ellipse(centre: Array, cov: Array, corners: int = 48) -> Array:
    """Returns a closed polyline (corners + 1, 2) that holds `ELLIPSE_PROBABILITY` of a Gaussian.

    Args:
        centre: (2,) its mean, m.
        cov: (2, 2) its covariance, same frame, m².
        corners: of the polyline.
    """
    variances, axes = np.linalg.eigh(cov)
    scale = math.sqrt(-2.0 * math.log(1.0 - ELLIPSE_PROBABILITY))
    turn = np.linspace(0.0, 2.0 * np.pi, corners + 1)
    circle = np.stack([np.cos(turn), np.sin(turn)], -1)
    return np.asarray(centre + scale * circle * np.sqrt(np.maximum(variances, 0.0)) @ axes.T)


def plan_svg(layers: Sequence[Layer], size: int = 640, most_points: int | None = None) -> str:
    """Returns the layers as one <svg> element, 1 user unit = 1 m.

    The floor's x is the picture's x; its y points up, so the picture's y is minus the floor's. A
    scale bar says how long a round number of metres is. Equal layers give equal bytes.

    Args:
        layers: drawn in this order.
        size: of the longer side on the screen, pixels.
        most_points: of a longer polyline every k-th point is drawn; None draws all.
    """
    low, high = plan_box([line for layer in layers for line in layer.polylines])
    span = high - low
    unit = float(max(span[0], 0.6 * span[1]))  # a wide pen on a long, thin plan
    groups = [_group(layer, unit, most_points) for layer in layers if layer.polylines]
    view = f"{low[0]:.4f} {-high[1]:.4f} {span[0]:.4f} {span[1]:.4f}"
    width, height = np.maximum(1, np.round(size * span / span.max())).astype(int)
    names = escape(", ".join(layer.name for layer in layers), quote=True)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{view}" width="{width}" '
        f'height="{height}" role="img" '
        f'aria-label="Floor plan: {names}" fill="none" stroke-linecap="round" '
        f'stroke-linejoin="round" font-family="sans-serif">\n'
        + "\n".join([*groups, _scale_bar(low, span, unit)])
        + "\n</svg>"
    )


def _group(layer: Layer, unit: float, most_points: int | None) -> str:
    parts = []
    for points, label in zip(layer.polylines, layer.labels, strict=True):
        step = 1 if most_points is None else max(1, -(-len(points) // most_points))
        text = " ".join(f"{x:.4f},{-y:.4f}" for x, y in points[::step].tolist())
        parts.append(f'<polyline points="{text}"/>')
        if label:
            x, y = points.mean(axis=0) if len(points) == 2 else points[len(points) // 2]
            parts.append(
                f'<text x="{x:.4f}" y="{-y:.4f}" font-size="{0.022 * unit:.4f}" '
                f'fill="{layer.colour}" stroke="none">{escape(label)}</text>'
            )
    style = f'stroke="{layer.colour}" stroke-width="{0.003 * unit:.4f}"'
    title = f"<title>{escape(layer.name)}</title>"
    return f'<g id="{_identifier(layer.name)}" {style}>{title}\n' + "\n".join(parts) + "\n</g>"


def _scale_bar(low: Array, span: Array, unit: float) -> str:
    """Returns a bar of 1, 2 or 5 times a power of ten metres, about a fifth of the plan."""
    decade = 10.0 ** math.floor(math.log10(0.25 * span[0]))
    length = max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= 0.25 * span[0])
    x, y = low[0] + 0.02 * unit, -low[1] - 0.02 * unit
    return (
        f'<g stroke="currentColor" stroke-width="{0.004 * unit:.4f}">'
        f'<polyline points="{x:.4f},{y:.4f} {x + length:.4f},{y:.4f}"/>'
        f'<text x="{x:.4f}" y="{y - 0.01 * unit:.4f}" font-size="{0.025 * unit:.4f}" '
        f'fill="currentColor" stroke="none">{length:g} m</text></g>'
    )


def _identifier(name: str) -> str:
    return "".join(c if c.isascii() and c.isalnum() else "-" for c in name)


def _known_ends(landmarks: LandmarkMap) -> list[Array]:
    """Returns the ends (2, 2) of the lines whose stretch is known."""
    rows, lines = landmarks.of_kind("line")
    known = np.isfinite(landmarks.extent[rows]).all(axis=1)
    if not known.any():
        return []
    return list(points_on_line(lines[known][:, None], landmarks.extent[rows][known]))


def plan_box(polylines: Iterable[Array]) -> tuple[Array, Array]:
    """Returns the lower left and upper right corner (2,) of a plan that shows all points, m."""
    points = np.concatenate([np.zeros((0, 2)), *polylines])
    if not len(points):
        points = np.zeros((1, 2))
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.5 * (high - low)
    half = np.maximum(half + MARGIN * half.max(), 0.5 * SMALLEST)
    centre = 0.5 * (low + high)
    return centre - half, centre + half
