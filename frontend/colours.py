"""Coloured blobs in an image: a mask by colour, opened and closed, its parts and their middles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.colour_range import LARGEST_HSV, Hsv
from graphslam.geometry import Array

Mask = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Blobs:
    """Connected parts of a mask, largest first.

    Attributes:
        centre: (K, 2) centroids, pixels (u, v), with fractions.
        area: (K,) pixels.
        box: (K, 4) smallest u, smallest v, largest u, largest v of their pixels.
        at_border: (K,) whether they touch the border of the image, so that part may be missing.
        sigma_px: (K,) standard deviation of each centroid along u and along v, pixels, of what
            whole pixels do to the border of a round blob; see `centroid_sigma`.
    """

    centre: Array
    area: Array
    box: NDArray[np.int64]
    at_border: NDArray[np.bool_]
    sigma_px: Array

    def __len__(self) -> int:
        return len(self.centre)


def to_hsv(bgr: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns an image (H, W, 3) in hue, saturation and value, as `Hsv` counts them."""
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV), np.uint8)


def colour_mask(hsv: NDArray[np.uint8], low: Hsv, high: Hsv) -> Mask:
    """Returns 255 where hue *and* saturation *and* value lie within their limits, else 0.

    Where the hue's low limit is above its high one, the range goes over the end of the circle:
    (170, ...) to (10, ...) is red.

    Source: Kato's colour masks, with 'and' where a logical sum is printed: 'or' lets 86 % of random
    pixels pass, 'and' 3.5 %.
    """
    if low[0] <= high[0]:
        return np.asarray(cv2.inRange(hsv, np.array(low), np.array(high)), np.uint8)
    upper = cv2.inRange(hsv, np.array(low), np.array((LARGEST_HSV[0], *high[1:])))
    lower = cv2.inRange(hsv, np.array((0, *low[1:])), np.array(high))
    return np.asarray(upper | lower, np.uint8)


def cleaned(mask: Mask, open_px: int, close_px: int) -> Mask:
    """Returns a mask without specks narrower than ``open_px``, holes below ``close_px`` closed.

    Both elements are discs, of that diameter in pixels; 0 and 1 do nothing.
    """
    for size, operation in ((open_px, cv2.MORPH_OPEN), (close_px, cv2.MORPH_CLOSE)):
        if size > 1:
            disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
            # outside the image counts as part of neither operation
            mask = np.asarray(cv2.morphologyEx(mask, operation, disc), np.uint8)
    return mask


def find_blobs(mask: Mask, min_area_px: float = 1.0) -> Blobs:
    """Returns the parts of a mask (8 neighbours) of at least ``min_area_px`` pixels, largest first.

    Blobs of one size come in the order of their first pixel, row by row.
    """
    _, _, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=8)
    stats, centroids = np.asarray(stats[1:], np.int64), np.asarray(centroids[1:], float)
    area = stats[:, cv2.CC_STAT_AREA].astype(float)
    order = np.argsort(-area, kind="stable")
    order = order[area[order] >= min_area_px]
    left, top, width, height = stats[order, :4].T
    box = np.column_stack([left, top, left + width - 1, top + height - 1])
    rows, columns = mask.shape
    low, high = (box[:, :2] <= 0).any(axis=1), (box[:, 2:] >= [columns - 1, rows - 1]).any(axis=1)
    return Blobs(centroids[order], area[order], box, low | high, centroid_sigma(area[order]))


def blob_pixels(mask: Mask) -> Iterator[Array]:
    """Yields the pixels (n, 2), (u, v), of each part of a mask (8 neighbours), largest first.

    For what counts only part of a blob; else `find_blobs` is quicker.
    """
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    stats = np.asarray(stats, np.int64)
    for part in 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable"):
        left, top, width, height = stats[part, :4].tolist()
        v, u = np.nonzero(labels[top : top + height, left : left + width] == part)
        yield np.column_stack([u + left, v + top]).astype(float)


def centroid_sigma(area: Array) -> Array:
    """Returns the standard deviation (K,), pixels, that whole pixels give centroids of round blobs.

    Each pixel of the border is in or out, an error of the area with variance 1/12 (uniform over one
    pixel); there are ``2 pi r`` of them, at ``r cos`` from the middle along an axis, so that the
    centroid's variance is ``2 pi r (r^2 / 2) / 12 / area^2 = 1 / (12 pi r)``.

    Args:
        area: (K,) pixels.
    """
    radius = np.sqrt(np.asarray(area, float) / np.pi)
    return np.asarray(1.0 / np.sqrt(12.0 * np.pi * radius))
