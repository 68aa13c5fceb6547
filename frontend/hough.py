"""Straight edges in an image: Canny, a Hough transform that knows directions, and fits.

Each edge pixel votes only for lines across its own gradient, and a line keeps the sense of its
gradient, from dark to bright. The two edges of one groove, a pixel or two apart, are therefore half
a turn apart in the accumulator and cannot melt into one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.config import DetectorConfig
from frontend.ignored import ignored_image
from graphslam.geometry import TAU, Array

IntArray = NDArray[np.int64]

GREY_STEPS = 16  # sub-steps of a grey level that smoothing keeps
SOBEL_GAIN = 8 * GREY_STEPS  # what cv2.Sobel returns for one grey level per pixel
NOISE_QUANTILE = 0.4  # of all gradients: the image may be full of edges
RAYLEIGH = np.sqrt(-2.0 * np.log(1.0 - NOISE_QUANTILE))  # its gradient over the noise of dx


@dataclass(frozen=True, slots=True)
class EdgePixels:
    """Edge pixels of one image.

    Attributes:
        point: (N, 2) positions (u, v), undistorted pixels, finer than a pixel.
        normal: (N, 2) unit vectors along the gradient, from dark to bright, in (u, v).
        strength: (N,) gradient, grey levels per pixel.
        floor: (N, 2) positions on the floor, m, robot frame.
        pixel_m: (N,) floor that one pixel covers across the edge, m.
    """

    point: Array
    normal: Array
    strength: Array
    floor: Array
    pixel_m: Array

    def __len__(self) -> int:
        return len(self.strength)

    def select(self, keep: NDArray[np.bool_] | IntArray) -> EdgePixels:
        """Returns the pixels that ``keep`` names."""
        return EdgePixels(*(getattr(self, f.name)[keep] for f in fields(self)))


@dataclass(frozen=True, slots=True)
class StraightEdge:
    """One straight edge: ``u cos(phi) + v sin(phi) = offset``, phi from dark to bright.

    Attributes:
        phi: direction of its normal, rad.
        offset: distance from pixel (0, 0) along the normal, undistorted pixels.
        support: (n,) rows of the supporting `EdgePixels`.
    """

    phi: float
    offset: float
    support: IntArray


def along_normal(phi: float, points: Array) -> Array:
    """Returns ``u cos(phi) + v sin(phi)`` (...) of points or vectors (..., 2), pixels or metres.

    Elementwise and without BLAS, whose rounding depends on how it shares work among threads.

    Source: SantanaSLAM eq. (18).
    """
    return np.asarray(points[..., 0] * math.cos(phi) + points[..., 1] * math.sin(phi))


def find_edge_pixels(grey: NDArray[np.uint8], camera: Camera, config: DetectorConfig) -> EdgePixels:
    """Returns the edge pixels of an image (H, W) that show floor.

    Source: SantanaLoc section 4.1, SantanaSLAM section 3.4.
    """
    dx, dy, magnitude, mask = edge_image(grey, config)
    if camera.ignore_px:
        mask &= ~ignored_image(camera)
    margin = 1 + int(np.ceil(3.0 * config.smoothing_px))  # mirrored at the border, edges bend
    v, u = np.nonzero(mask[margin:-margin, margin:-margin])
    u, v = u + margin, v + margin
    strength = magnitude[v, u]
    normal = np.column_stack([dx[v, u], dy[v, u]]) / strength[:, None]
    raw = _at_ridge(magnitude, np.column_stack([u, v]).astype(float), normal)
    point = camera.undistort(raw)
    if camera.distortion is not None:
        normal = _undistorted_normal(raw, normal, camera)
    floor, pixel_m = camera.pixel_to_floor(point), camera.pixel_size(point, normal)
    edges = EdgePixels(point, normal, strength / SOBEL_GAIN, floor, pixel_m)
    # a lens model used beyond its range throws pixels far out
    inside = np.abs(point).max(axis=1, initial=0.0) < 4.0 * max(camera.image_size)
    return edges.select(inside & (pixel_m < config.coarsest_pixel_m))


def edge_image(
    grey: NDArray[np.uint8], config: DetectorConfig
) -> tuple[NDArray[np.int16], NDArray[np.int16], NDArray[np.float32], NDArray[np.bool_]]:
    """Returns gradients along u and v, their magnitude (`SOBEL_GAIN`), and which pixels are edges.

    Canny's thresholds are multiples of the image's own gradient noise, so they follow light,
    contrast and gain. A global threshold does not: its edges are where dark touches bright.

    Source: SantanaLoc section 4.1 (edges by Canny), SantanaSLAM section 3.4 (a threshold level).
    """
    scaled = np.multiply(grey, GREY_STEPS, dtype=np.int16)
    smooth = cv2.GaussianBlur(scaled, (0, 0), config.smoothing_px)
    dx, dy = cv2.Sobel(smooth, cv2.CV_16S, 1, 0), cv2.Sobel(smooth, cv2.CV_16S, 0, 1)
    # cv2.magnitude rounds differently with the address of its arrays
    magnitude = np.sqrt(np.square(dx, dtype=np.float32) + np.square(dy, dtype=np.float32))
    noise = float(np.quantile(magnitude[::2, ::2], NOISE_QUANTILE)) / RAYLEIGH
    low, high = config.edge_over_noise
    threshold = max(high * noise, config.edge_min_grey * SOBEL_GAIN)
    if config.binarise == "global":
        return dx, dy, magnitude, _border_of_dark(smooth, config.binary_grey) & (magnitude > 0)
    mask = cv2.Canny(dx, dy, threshold * low / high, threshold, L2gradient=True)
    return dx, dy, magnitude, mask > 0


def _border_of_dark(smooth: NDArray[np.int16], level: float) -> NDArray[np.bool_]:
    """Returns the dark pixels that touch bright ones; ``level`` in grey levels, 0 for Otsu's."""
    grey = (smooth // GREY_STEPS).astype(np.uint8)
    otsu = cv2.THRESH_OTSU if level == 0.0 else 0
    _, bright = cv2.threshold(grey, level, 255, cv2.THRESH_BINARY | otsu)
    near_bright = cv2.dilate(bright, np.ones((3, 3), np.uint8))
    return (np.asarray(bright) == 0) & (np.asarray(near_bright) > 0)


def _at_ridge(magnitude: NDArray[np.float32], pixel: Array, normal: Array) -> Array:
    """Returns pixels (N, 2) moved along their gradients to where the gradient is largest.

    By a parabola through the magnitude there and one pixel before and behind; by at most a pixel.
    """
    behind, here, ahead = (_bilinear(magnitude, pixel + step * normal) for step in (-1.0, 0.0, 1.0))
    curvature = np.minimum(behind - 2.0 * here + ahead, -1e-6 * here)
    shift = np.clip(0.5 * (behind - ahead) / curvature, -1.0, 1.0)
    return pixel + shift[:, None] * normal


def _bilinear(image: NDArray[np.float32], points: Array) -> Array:
    corner = np.floor(points).astype(np.intp)
    (u, v), (a, b) = corner.T, (points - corner).T
    top = (1.0 - a) * image[v, u] + a * image[v, u + 1]
    bottom = (1.0 - a) * image[v + 1, u] + a * image[v + 1, u + 1]
    return np.asarray((1.0 - b) * top + b * bottom)


def _undistorted_normal(raw: Array, normal: Array, camera: Camera) -> Array:
    """Returns gradient directions (N, 2) after the lens: across the undistorted tangent."""
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    t = camera.undistort(raw + 0.5 * tangent) - camera.undistort(raw - 0.5 * tangent)
    return np.column_stack([t[:, 1], -t[:, 0]]) / np.linalg.norm(t, axis=1)[:, None]


def find_straight_edges(edges: EdgePixels, config: DetectorConfig) -> list[StraightEdge]:
    """Returns straight edges, best supported first; no pixel supports two of them.

    The highest peak of the accumulator is refined by fits to its pixels, whose votes are then
    withdrawn, and so on until no peak has enough votes.

    Source: SantanaLoc section 4.1, SantanaSLAM section 3.4 (Hough transform of eq. (18)).
    """
    if len(edges) < config.min_support:
        return []
    centre = edges.point.mean(axis=0)
    free = _Free(np.arange(len(edges)), edges.point - centre, edges.normal)
    votes, angles, offsets = _vote(free, config)
    accumulator = np.bincount(votes.ravel(), minlength=len(angles) * len(offsets))
    found: list[StraightEdge] = []
    while accumulator[peak := int(np.argmax(accumulator))] >= config.min_support:
        row, column = divmod(peak, len(offsets))
        phi, offset, support = _refine(free, angles[row], offsets[column], config)
        if len(support) < config.min_support:
            # a chance alignment: its pixels stay free, its neighbours lead to the same one
            cells = accumulator.reshape(len(angles), len(offsets))
            cells[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2] = -len(edges)
            continue
        offset_in_image = offset + float(along_normal(phi, centre))
        found.append(StraightEdge(phi, offset_in_image, free.row[support]))
        done = _supports(free, phi, offset, 2.0 * config.support_px, config)
        accumulator -= np.bincount(votes[done].ravel(), minlength=len(accumulator))
        free, votes = free.select(~done), votes[~done]
    return found


@dataclass(frozen=True, slots=True)
class _Free:
    """Edge pixels that support no line yet: rows in `EdgePixels`, centred points, normals."""

    row: IntArray
    point: Array
    normal: Array

    def select(self, keep: NDArray[np.bool_]) -> _Free:
        return _Free(self.row[keep], self.point[keep], self.normal[keep])


def _vote(free: _Free, config: DetectorConfig) -> tuple[IntArray, Array, Array]:
    """Returns accumulator cells (N, votes) of each pixel, and the angles and offsets of cells."""
    rows = round(360.0 / config.hough_angle_deg)
    angles = np.arange(rows) * (TAU / rows)
    reach = int(config.direction_tolerance_deg / config.hough_angle_deg)
    own = np.rint(np.arctan2(free.normal[:, 1], free.normal[:, 0]) * (rows / TAU))
    row = (own.astype(np.int64)[:, None] + np.arange(-reach, reach + 1)) % rows
    u, v = free.point[:, :1], free.point[:, 1:]
    offset = u * np.cos(angles)[row] + v * np.sin(angles)[row]
    column = np.rint(offset / config.hough_offset_px).astype(np.int64)
    first, last = int(column.min()), int(column.max())
    offsets = np.arange(first, last + 1) * config.hough_offset_px
    return row * len(offsets) + (column - first), angles, offsets


def _supports(
    free: _Free, phi: float, offset: float, reach_px: float, config: DetectorConfig
) -> NDArray[np.bool_]:
    """Returns which pixels lie within ``reach_px`` of a line and look its way."""
    near = np.abs(along_normal(phi, free.point) - offset) < reach_px
    alike = along_normal(phi, free.normal) > math.cos(math.radians(config.direction_tolerance_deg))
    return near & alike


def _refine(
    free: _Free, phi: float, offset: float, config: DetectorConfig
) -> tuple[float, float, IntArray]:
    """Returns phi, offset and support (rows of ``free``) after fits with a closing reach."""
    for widening in (2.0, 1.0):
        support = _supports(free, phi, offset, widening * config.support_px, config)
        if np.count_nonzero(support) < config.min_support:
            return phi, offset, np.empty(0, np.int64)
        phi, offset = _total_least_squares(free.point[support], phi)
    support = _supports(free, phi, offset, config.support_px, config)
    runs = _in_runs(free, phi, np.flatnonzero(support), config)
    dense = _coverage(free, phi, runs) >= config.min_coverage
    return phi, offset, runs if dense else np.empty(0, np.int64)


def _in_runs(free: _Free, phi: float, support: IntArray, config: DetectorConfig) -> IntArray:
    """Returns the support that lies in unbroken runs, in order along the line.

    Crossings leave gaps between runs; pixels that are in line by chance make only short runs.
    """
    along = along_normal(phi + 0.5 * np.pi, free.point[support])
    order = np.argsort(along, kind="stable")
    run = np.cumsum(np.diff(along[order], prepend=along[order[:1]]) > config.max_gap_px)
    long_enough = np.bincount(run, minlength=1) >= config.min_run
    return support[order[long_enough[run]]]


def _coverage(free: _Free, phi: float, support: IntArray) -> float:
    """Returns the share of a line's stretch that its support, in order along it, covers.

    An unbroken edge has one pixel for each row or column that it crosses.
    """
    if not len(support):
        return 0.0
    steps = np.abs(free.point[support[-1]] - free.point[support[0]])
    return len(support) / (1.0 + float(steps.max()))


def _total_least_squares(points: Array, phi: float) -> tuple[float, float]:
    """Returns the line nearest to ``points`` (n, 2), its normal within a quarter turn of phi."""
    mean = np.sum(points, axis=0) / len(points)
    du, dv = np.ascontiguousarray((points - mean).T)
    uu, uv, vv = np.sum(du * du), np.sum(du * dv), np.sum(dv * dv)
    fitted = 0.5 * math.atan2(2.0 * uv, uu - vv) + 0.5 * math.pi
    phi = fitted + math.pi * round((phi - fitted) / math.pi)
    return phi, float(along_normal(phi, mean))
