"""Lines on the floor in one image: straight edges, paired into grooves or painted lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.config import DetectorConfig
from frontend.hough import (
    EdgePixels,
    StraightEdge,
    along_normal,
    find_edge_pixels,
    find_straight_edges,
)
from graphslam.errors import BadLog
from graphslam.geometry import Array, is_canonical, points_on_line, position_along, twin, wrap

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class DetectedLines:
    """Lines seen in one image, robot frame.

    Attributes:
        z: (K, 2) centre lines ``(rho, alpha)``, m and rad, canonical.
        cov: (K, 2, 2) their covariances, m^2, m rad, rad^2.
        extent: (K, 2) stretch that supporting pixels cover, smallest and largest position along
            the line, m.
        quality: (K,) how many edge pixels support the line.
        rejected: how many straight edges or lines were left out, by reason.
    """

    z: Array
    cov: Array
    extent: Array
    quality: Array
    rejected: Mapping[str, int]

    def __len__(self) -> int:
        return len(self.z)


def detect_lines(grey: NDArray[np.uint8], camera: Camera, config: DetectorConfig) -> DetectedLines:
    """Returns the grooves and painted lines that an image shows.

    Args:
        grey: (H, W) image as recorded, lens distortion and all.
        camera: homography and lens.
        config: thresholds, width of a line, noise.

    Raises:
        BadLog: the image does not have the size that the camera states.

    Source: SantanaLoc section 4, SantanaSLAM section 3.4; pairing and fits are ours.
    """
    if grey.shape[::-1] != camera.image_size:
        raise BadLog(
            f"the image has shape {grey.shape}; camera {camera.name!r} has image_size = "
            f"{list(camera.image_size)}: give a grey image of that size, or correct the camera"
        )
    edges = find_edge_pixels(grey, camera, config)
    straight = find_straight_edges(edges, config)
    sides = _on_floor(straight, edges, camera)
    pairs = _pair(sides, config)
    rejected = {"one edge only": len(straight) - 2 * len(pairs)}
    centres = [_centre(edges, (straight[i], straight[j]), sides.line[i], config) for i, j in pairs]
    return _accept(centres, rejected, config)


def line_covariance(z: Array, config: DetectorConfig) -> Array:
    """Returns covariances (K, 2, 2) of lines (K, 2) seen by a camera at the origin, robot frame.

    ``sigma_rho = a + b |sin alpha_M| (exp(rho / c) - 1)`` with ``alpha_M = alpha + pi/2``, rho in
    metres; rho and alpha are independent.

    Source: SantanaLoc noise '(22)'. Printed without the absolute value, which makes it negative for
    alpha_M = -90 degrees beyond rho = 0.6 m; called both variance and sigma there, used as sigma
    here; it gives no sigma of alpha.
    """
    z = np.asarray(z, float)
    growth = np.abs(np.cos(z[..., 1])) * np.expm1(np.abs(z[..., 0]) / config.sigma_rho_c_m)
    cov = np.zeros((*z.shape, 2))
    cov[..., 0, 0] = (config.sigma_rho_a_m + config.sigma_rho_b_m * growth) ** 2
    cov[..., 1, 1] = np.radians(config.sigma_alpha_deg) ** 2
    return cov


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
    """A centre line: ``(rho, alpha)``, stretch, width, support and sigma of alpha; m and rad."""

    line: Array
    extent: Array
    width: float
    support: int
    sigma_alpha: float


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
    variance = inverse[2, 2] * alike * np.mean(residual**2)
    s = position_along(line, floor)
    ends = [(part.min(), part.max()) for part in np.split(s, counts[:1])]
    return _Centre(line, np.mean(ends, axis=0), abs(width), len(s), float(np.sqrt(variance)))


def _accept(
    centres: list[_Centre], rejected: dict[str, int], config: DetectorConfig
) -> DetectedLines:
    """Returns the centre lines that are long, sure and new enough, canonical, with their noise."""
    kept: list[_Centre] = []
    rejected = {**rejected, "too short": 0, "direction too vague": 0, "seen twice": 0}
    for centre in centres:
        if np.ptp(centre.extent) < config.min_length_m:
            rejected["too short"] += 1
        elif centre.sigma_alpha > np.radians(config.vaguest_alpha_deg):
            rejected["direction too vague"] += 1
        elif any(_overlap(centre, other, config) for other in kept):
            rejected["seen twice"] += 1
        else:
            kept.append(centre)
    z = np.array([c.line for c in kept]).reshape(-1, 2)
    extent = np.array([c.extent for c in kept]).reshape(-1, 2)
    z[:, 1] = wrap(z[:, 1])
    flip = ~is_canonical(z)
    z[flip], extent[flip] = twin(z[flip]), -extent[flip][:, ::-1]
    support = np.array([c.support for c in kept], float)
    return DetectedLines(z, line_covariance(z, config), extent, support, MappingProxyType(rejected))


def _overlap(centre: _Centre, other: _Centre, config: DetectorConfig) -> bool:
    """Returns whether two lines are nearly parallel and cover the same floor where one is seen."""
    middle = points_on_line(centre.line, centre.extent.mean())
    offset = along_normal(other.line[1], middle) - other.line[0]
    turn = 0.5 * wrap(2.0 * (centre.line[1] - other.line[1]))
    parallel = abs(turn) < np.radians(config.pair_angle_deg)
    return bool(parallel and abs(offset) < 0.5 * (centre.width + other.width))
