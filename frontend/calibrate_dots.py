"""Round marks on the floor, found in an image to a fraction of a pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.calibrate_fit import fit_homography, project
from graphslam.geometry import Array

SMALLEST_PX2 = 12
"""Area of a dot at least, square pixels: below it the centroid is noise."""
LARGEST_SHARE = 0.02
"""Area of a dot at most, as a share of the image."""
ROUND = 0.15
"""A dot's area differs from that of the ellipse with its second moments by at most this share."""
FLATTEST = 0.12
"""Shortest over longest axis of a dot in the image, at least."""
NEIGHBOURHOOD = 0.3
"""Side of the square whose median is a pixel's background, as a share of the image's width."""
LARGEST_SIDE = 255
"""And at most, pixels: OpenCV's median takes no larger one."""
ROUNDS = 3
"""Passes of the correction for the dots' size."""


@dataclass(frozen=True, slots=True, eq=False)
class Dots:
    """Dots of one image.

    Attributes:
        pixel: (D, 2) centroids, weighted by contrast, pixels.
        area: (D,) square pixels.
    """

    pixel: Array
    area: Array


def find_dots(grey: NDArray[np.uint8]) -> Dots:
    """Returns round spots (H, W), all darker or all brighter than what is around them.

    Of dark and bright spots those are taken that are more. A spot counts where its outline is an
    ellipse; each centroid is weighted by the difference from the background, so that the pixels of
    the soft border count by their share.
    """
    size = 2 * int(0.5 * NEIGHBOURHOOD * grey.shape[1]) + 1
    background = cv2.medianBlur(grey, min(size, LARGEST_SIDE))
    difference = background.astype(np.float32) - grey
    dark, bright = _spots(difference), _spots(-difference)
    return dark if len(dark.area) >= len(bright.area) else bright


def without_bias(pixel: Array, area: Array, floor: Array) -> Array:
    """Returns where (K, 2) the centres of round dots are whose centroids (K, 2) were seen.

    Seen askew, the middle of an ellipse is not the image of the circle's centre: a dot of 4 cm at
    half a metre is off by 0.4 px in SantanaLoc's view. Each dot's radius follows from its area.

    Args:
        pixel: centroids, undistorted pixels.
        area: (K,) square pixels.
        floor: (K, 2) centres, robot frame, m.
    """
    centre, point = pixel, np.column_stack([floor, np.ones(len(floor))])
    for _ in range(ROUNDS):
        H = fit_homography(floor, centre).homography
        scale = np.abs(np.linalg.det(H) / (point @ H[2]) ** 3)  # square pixels of a square metre
        radius2 = area / (math.pi * scale)
        dual = point[:, :, None] * point[:, None, :]
        dual[:, 0, 0] -= radius2
        dual[:, 1, 1] -= radius2
        conic = H @ dual @ H.T
        middle = conic[:, :2, 2] / conic[:, 2:, 2]
        centre = pixel - (middle - project(H, floor))
    return centre


def _spots(difference: NDArray[np.float32]) -> Dots:
    """Returns round spots of positive ``difference`` (H, W), grey levels."""
    levels = np.clip(difference, 0, 255).astype(np.uint8)
    threshold, mask = cv2.threshold(levels, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    count, label, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    height, width = difference.shape
    pixel, area = [], []
    for spot in range(1, count):
        left, top, wide, high, size = stats[spot]
        edge = left == 0 or top == 0 or left + wide == width or top + high == height
        if edge or not SMALLEST_PX2 <= size <= LARGEST_SHARE * width * height:
            continue
        rows, columns = slice(top - 1, top + high + 1), slice(left - 1, left + wide + 1)
        found = _round_spot(difference[rows, columns], label[rows, columns], spot, threshold)
        if found is not None:
            pixel.append(found[0] + [left - 1, top - 1])
            area.append(found[1])
    return Dots(np.array(pixel, float).reshape(-1, 2), np.array(area, float))


def _round_spot(
    difference: NDArray[np.float32], label: NDArray[np.int32], spot: int, threshold: float
) -> tuple[Array, float] | None:
    """Returns centroid and area of one spot, or None where its outline is no ellipse."""
    inside = label == spot
    v, u = np.nonzero(inside)
    cov = np.cov(np.stack([u, v])) + np.eye(2) / 12.0
    smallest, largest = np.linalg.eigvalsh(cov)
    if abs(len(u) / (4.0 * math.pi * math.sqrt(smallest * largest)) - 1.0) > ROUND:
        return None
    if smallest < FLATTEST**2 * largest:
        return None
    near = cv2.dilate(inside.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    near &= inside | (label == 0)
    v, u = np.nonzero(near)
    full = np.median(difference[inside])
    weight = np.clip(difference[near] / full, 0.0, 1.0).astype(float)
    return np.array([u @ weight, v @ weight]) / weight.sum(), float(weight.sum())
