"""Lines by the papers' Hough transform: straight edges, paired into grooves or painted lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.config import DetectorConfig
from frontend.detected import DetectedLines, detected
from frontend.hough import (
    EdgePixels,
    StraightEdge,
    along_normal,
    find_edge_pixels,
    find_straight_edges,
)
from graphslam.geometry import Array, points_on_line, position_along, wrap


def hough_lines(grey: NDArray[np.uint8], camera: Camera, config: DetectorConfig) -> DetectedLines:
    """Returns the lines of an image (H, W); as `frontend.lines.detect_lines`.

    Source: SantanaLoc section 4, SantanaSLAM section 3.4; pairing and fits are ours.
    """
    edges = find_edge_pixels(grey, camera, config)
    straight = find_straight_edges(edges, config)
    sides = _on_floor(straight, edges, camera)
    pairs = _pair(sides, config)
    rejected = {"one edge only": len(straight) - 2 * len(pairs)}
    centres = [_centre(edges, (straight[i], straight[j]), sides.line[i], config) for i, j in pairs]
    return _accept(centres, rejected, config)


@dataclass(frozen=True, slots=True)
class _Sides:
    """Straight edges on the floor, robot frame; any of them may be one side of a line.

    Attributes:
        line: (E, 2) ``(rho, alpha)``, alpha pointing from dark to bright, rho of either sign.
        ends: (E, 2, 2) first and last supporting pixel, m.
        strength: (E,) mean gradient, grey levels per pixel.
        pixel_m: (E,) floor that a pixel covers across the edge in its middle, m.
    """

    line: Array
    ends: Array
    strength: Array
    pixel_m: Array


def _on_floor(straight: list[StraightEdge], edges: EdgePixels, camera: Camera) -> _Sides:
    phi, offset = np.array([[e.phi, e.offset] for e in straight]).reshape(-1, 2).T
    a, b, c = (np.column_stack([np.cos(phi), np.sin(phi), -offset]) @ camera.homography).T
    line = np.column_stack([-c / np.hypot(a, b), np.arctan2(b, a)])
    ends, strength, pixel_m = np.zeros((len(line), 2, 2)), np.zeros(len(line)), np.zeros(len(line))
    for k, edge in enumerate(straight):
        floor = edges.floor[edge.support]
        s = position_along(line[k], floor)
        ends[k] = floor[[np.argmin(s), np.argmax(s)]]
        strength[k] = edges.strength[edge.support].mean()
        pixel_m[k] = np.median(edges.pixel_m[edge.support])
    return _Sides(line, ends, strength, pixel_m)


def _pair(sides: _Sides, config: DetectorConfig) -> list[tuple[int, int]]:
    """Returns pairs of edges that bound one line, strongest and longest first, each edge once.

    The two gradients of a pair point in opposite directions, both away from a dark line or both
    into a bright one, and where both edges are seen their distance is a line's width. Smoothing
    moves the edges of a thin line apart, by up to three times its sigma.
    """
    first, second = np.triu_indices(len(sides.line), 1)
    line_1, line_2 = sides.line[first], sides.line[second]
    along_1 = np.sort(position_along(line_1[:, None], sides.ends[first]), axis=1)
    along_2 = np.sort(position_along(line_1[:, None], sides.ends[second]), axis=1)
    low = np.maximum(along_1[:, 0], along_2[:, 0])
    high = np.minimum(along_1[:, 1], along_2[:, 1])
    turn = wrap(line_2[:, 1] - line_1[:, 1] - np.pi)
    width = line_1[:, 0] + line_2[:, 0] + turn * 0.5 * (low + high)  # dark lines: positive

    narrowest, widest = config.line_width_m
    blur = 3.0 * config.smoothing_px * np.maximum(sides.pixel_m[first], sides.pixel_m[second])
    shorter = np.minimum(np.ptp(along_1, axis=1), np.ptp(along_2, axis=1))
    fits = np.abs(turn) < np.radians(config.pair_angle_deg)
    fits &= (np.abs(width) >= narrowest) & (np.abs(width) <= widest + blur)
    fits &= (high - low) > 0.5 * shorter
    if config.polarity != "both":
        fits &= (width > 0) == (config.polarity == "dark")
    score = (high - low) * np.minimum(sides.strength[first], sides.strength[second])
    free = np.ones(len(sides.line), bool)
    pairs = []
    for k in np.argsort(np.where(fits, -score, 0.0), kind="stable")[: np.count_nonzero(fits)]:
        i, j = int(first[k]), int(second[k])
        if free[i] and free[j]:
            free[[i, j]] = False
            pairs.append((i, j))
    return pairs


@dataclass(frozen=True, slots=True)
class _Centre:
    """A centre line: ``(rho, alpha)``, covariance (2, 2), stretch, width, coverage; m and rad."""

    line: Array
    cov: Array
    extent: Array
    width: float
    quality: float


def _centre(
    edges: EdgePixels, pair: tuple[StraightEdge, StraightEdge], near: Array, config: DetectorConfig
) -> _Centre:
    """Returns the middle between two edges: one direction and one width fitted to both.

    Weighted least squares on the floor over ``n . p = rho + side * width - s * tan(turn)`` about
    the line ``near``; a pixel weighs by the floor that it covers. Both edges share the direction,
    so that the middle stays right where they are seen along different stretches.
    """
    counts = [len(edge.support) for edge in pair]
    rows = np.concatenate([edge.support for edge in pair])
    side = np.repeat([0.5, -0.5], counts)
    floor, weight = edges.floor[rows], 1.0 / edges.pixel_m[rows]
    across = along_normal(near[1], floor)
    s = position_along(near, floor)
    design = np.stack([np.ones(len(s)), side, -s]) * weight
    inverse = np.linalg.inv(np.sum(design[:, None] * design, axis=2))
    rho, width, slope = inverse @ np.sum(design * across * weight, axis=1)
    residual = (across - rho - width * side + slope * s) * weight
    turn = np.arctan(slope)
    line = np.array([rho * np.cos(turn), near[1] + turn])

    # smoothing makes about this many neighbouring pixels err alike
    alike = max(1.0, 2.0 * np.sqrt(np.pi) * config.smoothing_px)
    cov = inverse[::2, ::2] * alike * np.mean(residual**2)
    s = position_along(line, floor)
    ends = [(part.min(), part.max()) for part in np.split(s, counts[:1])]
    quality = min(_coverage(edges.point[edge.support]) for edge in pair)
    return _Centre(line, cov, np.mean(ends, axis=0), abs(width), quality)


def _coverage(points: Array) -> float:
    """Returns the share of the rows or columns along an edge that have one of its pixels (n, 2)."""
    return min(1.0, len(points) / (1.0 + float(np.ptp(points, axis=0).max())))


def _accept(
    centres: list[_Centre], rejected: dict[str, int], config: DetectorConfig
) -> DetectedLines:
    """Returns the centre lines that are long, sure and new enough, canonical, with their noise."""
    kept: list[_Centre] = []
    rejected = {**rejected, "too short": 0, "direction too vague": 0, "seen twice": 0}
    for centre in centres:
        if np.ptp(centre.extent) < config.min_length_m:
            rejected["too short"] += 1
        elif centre.cov[1, 1] > np.radians(config.vaguest_alpha_deg) ** 2:
            rejected["direction too vague"] += 1
        elif any(_overlap(centre, other, config) for other in kept):
            rejected["seen twice"] += 1
        else:
            kept.append(centre)
    z = np.array([c.line for c in kept]).reshape(-1, 2)
    extent = np.array([c.extent for c in kept]).reshape(-1, 2)
    cov = np.array([c.cov for c in kept]).reshape(-1, 2, 2)
    quality = np.array([c.quality for c in kept], float)
    return detected(z, cov, extent, quality, rejected, config)


def _overlap(centre: _Centre, other: _Centre, config: DetectorConfig) -> bool:
    """Returns whether two lines are nearly parallel and cover the same floor where one is seen."""
    middle = points_on_line(centre.line, centre.extent.mean())
    offset = along_normal(other.line[1], middle) - other.line[0]
    turn = 0.5 * wrap(2.0 * (centre.line[1] - other.line[1]))
    parallel = abs(turn) < np.radians(config.pair_angle_deg)
    return bool(parallel and abs(offset) < 0.5 * (centre.width + other.width))
