"""Straight segments of edges in an image, from OpenCV, each with its bright side known."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.config import DetectorConfig
from frontend.hough import edge_image
from graphslam.geometry import Array

HALVED = 500  # images wider or higher than this are searched at half their size
LSD_ANGLE_DEG = 22.5  # OpenCV's own tolerance of gradient directions
NOISY = 3.5  # grey levels of noise from which on an image is smoothed first
NOISE_ROWS = 7  # every how many rows the noise is looked at
SIDEWAYS = 0.5  # an edge belongs to u or v where its gradient there is more of the other one's


def lsd_segments(grey: NDArray[np.uint8], config: DetectorConfig) -> Array:
    """Returns segments (N, 2, 2), two ends (u, v) each, recorded pixels; bright on their left.

    Left as one looks at the picture along the segment. A large image is searched at half its size;
    the profiles that measure the lines are read at full size.

    Args:
        grey: (H, W).
        config: how far above noise a gradient has to be.
    """
    half = max(grey.shape) > HALVED
    if half:
        grey = _halved(grey)
    noise = grey_noise(grey)
    if noise > NOISY:  # LSD needs directions of gradients from pixel to pixel
        grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), config.smoothing_px), np.uint8)
        noise = grey_noise(grey)
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_NONE, quant=lsd_quant(noise, config))
    found = detector.detect(grey)[0]
    if found is None:
        return np.zeros((0, 2, 2))
    ends = np.asarray(found, float).reshape(-1, 2, 2)  # OpenCV 4 gives (N, 1, 4)
    return 2.0 * ends + 0.5 if half else ends


def lsd_quant(noise: float, config: DetectorConfig) -> float:
    """Returns OpenCV's ``quant`` for an image whose pixels have some noise, grey levels.

    Gradients below ``quant / sin(LSD_ANGLE_DEG)`` are not looked at.
    """
    least = max(config.edge_over_noise[0] * noise, 0.5 * config.edge_min_grey)
    return float(least * np.sin(np.radians(LSD_ANGLE_DEG)))


def grey_noise(grey: NDArray[np.uint8]) -> float:
    """Returns the standard deviation of a pixel's noise, grey levels, from second differences.

    Their median: edges are few. Quantised noise below half a level counts as half a level.
    """
    rows = grey[::NOISE_ROWS].astype(np.int16)
    second = np.abs(rows[:, 2:] + rows[:, :-2] - 2 * rows[:, 1:-1])
    counts = np.bincount(second.ravel(), minlength=2)
    share = np.cumsum(counts) / max(second.size, 1)
    k = int(np.searchsorted(share, 0.5))
    below = share[k - 1] if k else 0.0
    median = k - 0.5 + (0.5 - below) / max(share[k] - below, 1e-9) if k else 0.5 * 0.5 / share[0]
    return max(float(median) / (0.6745 * np.sqrt(6.0)), 0.2)


def hough_segments(grey: NDArray[np.uint8], config: DetectorConfig) -> Array:
    """Returns segments as `lsd_segments`, by the probabilistic Hough transform of edge pixels.

    Edge pixels are parted by where their gradient points, so that the two edges of one line do
    not melt into one segment.

    Source: the 'less time consuming variants' of SantanaLoc and SantanaSLAM, future work.
    """
    half = max(grey.shape) > HALVED
    if half:
        grey = _halved(grey)
    dx, dy, _, mask = edge_image(grey, config)
    margin = 1 + int(np.ceil(3.0 * config.smoothing_px))  # mirrored at the border, edges bend
    mask[:margin], mask[-margin:], mask[:, :margin], mask[:, -margin:] = 0, 0, 0, 0
    found = []
    for gradient, other in ((dx, dy), (dy, dx)):
        for sense in (1, -1):
            steep = sense * gradient.astype(np.float32) > SIDEWAYS * np.abs(other)
            part = np.asarray(mask & steep, np.uint8)
            lines = cv2.HoughLinesP(
                part,
                1.0,
                np.radians(config.hough_angle_deg) / 2.0,
                config.min_support,
                minLineLength=config.min_support,
                maxLineGap=config.max_gap_px,
            )
            if lines is not None:
                ends = np.asarray(lines, float).reshape(-1, 2, 2)
                found.append(_bright_on_left(ends, gradient is dx, sense))
    ends = np.concatenate([np.zeros((0, 2, 2)), *found])
    return 2.0 * ends + 0.5 if half else ends


def _halved(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns an image (H / 2, W / 2) of means of 2 x 2 pixels: (u, v) is at (2u, 2v) + 0.5."""
    height, width = grey.shape
    size = (width // 2, height // 2)
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def _bright_on_left(ends: Array, along_u: bool, sense: int) -> Array:
    """Returns segments (N, 2, 2) turned so that the bright side is on their left."""
    d = ends[:, 1] - ends[:, 0]
    left = d[:, 1] if along_u else -d[:, 0]
    return np.where((sense * left > 0)[:, None, None], ends, ends[:, ::-1])
