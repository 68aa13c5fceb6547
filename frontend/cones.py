"""Directions of coloured landmarks in one image of an omnidirectional camera."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontend.colours import blob_pixels, centroid_sigma, cleaned, colour_mask, to_hsv
from frontend.omni import OmniCamera
from frontend.omni_config import OmniConfig
from graphslam.geometry import Array, wrap
from graphslam.measurements import IntArray

TOO_SMALL = "coloured blob below min_area_px"
TOO_WIDE = "coloured blob wider than widest_deg"
AT_BORDER = "coloured blob at the border of the image"
AROUND_CENTRE = "coloured blob around the mirror's centre"


@dataclass(frozen=True, slots=True)
class DetectedBearings:
    """Landmarks seen in one image, robot frame.

    Attributes:
        z: (K, 1) directions, rad.
        cov: (K, 1, 1) their variances, rad².
        label: (K,) colour of each.
        pixel: (K, 2) the centroids that they were read from, (u, v).
        area: (K,) pixels that count, the base left out.
        rejected: how many blobs were left out, by reason.
    """

    z: Array
    cov: Array
    label: IntArray
    pixel: Array
    area: Array
    rejected: Mapping[str, int]

    def __len__(self) -> int:
        return len(self.z)


NO_BEARINGS = DetectedBearings(
    np.zeros((0, 1)), np.zeros((0, 1, 1)), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), {}
)
"""What an image without a landmark shows."""


def detect_bearings(
    bgr: NDArray[np.uint8], camera: OmniCamera, config: OmniConfig
) -> DetectedBearings:
    """Returns the directions of all landmarks of the camera's colours, by colour, then by size.

    For each colour: mask, opened and closed, its connected parts, of each the centroid without the
    base, the direction of that from the mirror's centre.

    Args:
        bgr: (H, W, 3) image, as recorded.
        camera: where its mirror's centre is, and what to look for.
        config: thresholds and noise.

    Source: Kato section III, with 'and' where it prints a logical sum, and eq. (1) with atan2.
    """
    rejected: Counter[str] = Counter()
    ring, hsv = _ring(camera), to_hsv(bgr)
    found: list[tuple[int, Array, int]] = []
    for colour in camera.colours:
        mask = colour_mask(hsv, colour.low, colour.high)
        if ring is not None:
            mask = mask & ring
        mask = cleaned(mask, config.open_px, config.close_px)
        for pixels in blob_pixels(mask):
            kept = _without_base(pixels, camera, config.base_share)
            reason = _why_not(pixels, kept, camera, config)
            if reason:
                rejected[reason] += 1
                continue
            found.append((colour.label, kept.mean(axis=0), len(kept)))
    label = np.array([entry[0] for entry in found], np.int64)
    pixel = np.array([entry[1] for entry in found], float).reshape(-1, 2)
    area = np.array([entry[2] for entry in found], float)
    sigma = bearing_sigma(camera, pixel, area, config)
    z = camera.bearing(pixel)[:, None]
    return DetectedBearings(z, np.square(sigma)[:, None, None], label, pixel, area, rejected)


def bearing_sigma(camera: OmniCamera, pixel: Array, area: Array, config: OmniConfig) -> Array:
    """Returns the standard deviations (K,), rad, of directions read from centroids.

    Across the direction, at a distance r from the mirror's centre, the centroid's own error and
    that of the mirror's centre count as much as an angle of 1 / r; what is left of lens and mirror
    after calibration comes on top.

    Args:
        camera: its centre counts.
        pixel: (K, 2) centroids.
        area: (K,) pixels of each.
        config: the noise.
    """
    off = np.asarray(pixel, float) - np.array(camera.centre)
    r = np.maximum(np.hypot(off[:, 0], off[:, 1]), 1.0)
    across = np.hypot(centroid_sigma(area), config.centre_px)
    return np.asarray(np.hypot(across / r, np.radians(config.deformation_deg)))


def _without_base(pixels: Array, camera: OmniCamera, base_share: float) -> Array:
    """Returns the pixels (k, 2) but those nearest to the mirror's centre, which show the base."""
    r = np.hypot(*(pixels - np.array(camera.centre)).T)
    inner, outer = r.min(), r.max()
    return pixels[r >= inner + base_share * (outer - inner)]


def _why_not(pixels: Array, kept: Array, camera: OmniCamera, config: OmniConfig) -> str:
    """Returns why a blob counts as no landmark; empty where it does."""
    if len(kept) < config.min_area_px:
        return TOO_SMALL
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    if (low <= 0).any() or (high >= np.array(camera.image_size) - 1).any():
        return AT_BORDER
    if np.hypot(*(pixels - np.array(camera.centre)).T).min() < 1.0:
        return AROUND_CENTRE
    turned = wrap(camera.measured(kept) - camera.measured(kept.mean(axis=0)))
    return TOO_WIDE if np.ptp(turned) > np.radians(config.widest_deg) else ""


def _ring(camera: OmniCamera) -> NDArray[np.uint8] | None:
    """Returns 255 where the image shows the surroundings, else 0; None where all of it does."""
    if camera.ring_px is None:
        return None
    width, height = camera.image_size
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    r = np.hypot(u - camera.centre[0], v - camera.centre[1])
    inner, outer = camera.ring_px
    return np.where((r >= inner) & (r <= outer), np.uint8(255), np.uint8(0))
