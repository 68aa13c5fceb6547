"""The two coloured tags of a robot in one image of an overhead camera, and the pose they give."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontend.colours import Blobs, cleaned, colour_mask, find_blobs, to_hsv
from frontend.overhead import (
    AMBIGUOUS,
    APART,
    AT_BORDER,
    NEITHER,
    NO_CENTRE,
    NO_FRONT,
    OTHER_SIZE,
    OverheadCamera,
    pose_of_tags,
)
from frontend.tag_config import TagConfig
from graphslam.geometry import Array


@dataclass(frozen=True, slots=True)
class SeenTags:
    """What one overhead image shows.

    Attributes:
        pose: (3,) floor frame, m and rad; None where it shows none.
        cov: (3, 3) its covariance, floor frame; None likewise.
        pixels: (2, 2) the tags that gave the pose, the centre one first, pixels of the recorded
            image; None likewise.
        refused: why there is no pose; empty where there is one.
        beside: (B, 2) other objects of the tags' colours, pixels.
    """

    pose: Array | None
    cov: Array | None
    pixels: Array | None
    refused: str
    beside: Array


@dataclass(frozen=True, slots=True)
class _Tags:
    """Blobs of one colour that may be a tag, on the floor."""

    pixels: Array
    floor: Array
    cov: Array


def detect_tags(bgr: NDArray[np.uint8], eye: OverheadCamera, config: TagConfig) -> SeenTags:
    """Returns the pose that the tags in an image give, or why they give none.

    One of each colour has to be whole, of the stated size, and as far from the other as stated; of
    several such pairs none is taken.

    Args:
        bgr: (H, W, 3) image as recorded.
        eye: the camera, and where the tags are on the robot.
        config: colours, cleaning, tolerances, noise.
    """
    hsv = to_hsv(bgr)
    limits = ((config.centre_low, config.centre_high), (config.front_low, config.front_high))
    seen = [_blobs(hsv, *limit, config) for limit in limits]
    everything = np.concatenate([blobs.centre for blobs in seen])

    def none(reason: str) -> SeenTags:
        return SeenTags(None, None, None, reason, everything)

    missing = [not len(blobs) for blobs in seen]
    if any(missing):
        return none(NEITHER if all(missing) else NO_CENTRE if missing[0] else NO_FRONT)
    possible = []
    for blobs in seen:
        tags, reason = _possible(blobs, eye, config)
        if reason:
            return none(reason)
        possible.append(tags)
    centre, front = possible
    gap = np.linalg.norm(front.floor[None] - centre.floor[:, None], axis=2)
    pairs = np.argwhere(np.abs(gap - eye.tags.distance) <= config.distance_tolerance_m)
    if len(pairs) != 1:
        return none(AMBIGUOUS if len(pairs) else APART)
    i, j = pairs[0]
    floor = np.stack([centre.floor[i], front.floor[j]])
    pose, cov = pose_of_tags(floor, np.stack([centre.cov[i], front.cov[j]]), eye.tags)
    pixels = np.stack([centre.pixels[i], front.pixels[j]])
    others = ~np.isin(everything, pixels).all(axis=1)
    return SeenTags(pose, cov, pixels, "", everything[others])


def tag_covariance(cov: Array, config: TagConfig) -> Array:
    """Returns the covariances (K, 3, 3) to state of poses, floor frame, for measured ones.

    Source: Atali section 4, R = diag(n_m^2, n_m^2, 0) with n_m = 0.1 m; the printed 0 of the angle
    says that it is exact, and makes R singular, so that the angle has a floor here.
    """
    if config.sigma_law == "measured":
        return cov
    angle = math.radians(config.paper_sigma_deg)
    paper = np.diag([config.paper_sigma_m**2, config.paper_sigma_m**2, angle**2])
    return np.broadcast_to(paper, cov.shape).copy()


def _blobs(
    hsv: NDArray[np.uint8], low: tuple[int, ...], high: tuple[int, ...], config: TagConfig
) -> Blobs:
    mask = cleaned(colour_mask(hsv, low, high), config.open_px, config.close_px)  # type: ignore[arg-type]
    return find_blobs(mask, config.min_area_px)


def _possible(blobs: Blobs, eye: OverheadCamera, config: TagConfig) -> tuple[_Tags, str]:
    """Returns the blobs that may be a tag; where there is none, why."""
    floor, J = eye.to_floor(blobs.centre)
    usable = np.isfinite(floor).all(axis=1) & ~blobs.at_border
    if not usable.any():
        return _none(), AT_BORDER
    if eye.tags.diameter is not None:
        pixel_m2 = np.abs(np.linalg.det(np.where(np.isfinite(J), J, 0.0)))
        ratio = blobs.area * pixel_m2 / (0.25 * math.pi * eye.tags.diameter**2)
        smallest, largest = config.size_ratio
        usable &= (ratio >= smallest) & (ratio <= largest)
        if not usable.any():
            return _none(), OTHER_SIZE
    pixel_variance = blobs.sigma_px[usable] ** 2 + config.sigma_px**2
    J, floor = J[usable], floor[usable]
    cov = pixel_variance[:, None, None] * (J @ np.swapaxes(J, 1, 2))
    return _Tags(blobs.centre[usable], floor, cov + config.sigma_m**2 * np.eye(2)), ""


def _none() -> _Tags:
    return _Tags(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2)))
