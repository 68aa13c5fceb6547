"""Bright spots in an image of the ceiling: what may be a lamp, before its shape is looked at."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.lamp_config import LampConfig
from graphslam.geometry import Array

Mask = NDArray[np.bool_]

BRIGHT_PX = 5
"""The brightest spot is that of the image smoothed over a square of this side, pixels: a single
pixel or a spark does not set the threshold."""
FINER = 4
"""How many times finer than the pixels borders are followed."""


@dataclass(frozen=True, slots=True)
class Levels:
    """Grey levels of an image.

    Attributes:
        ceiling: of what is dark.
        bright: of the brightest spot.
        border: where a lamp ends.
    """

    ceiling: float
    bright: float
    border: float


@dataclass(frozen=True, slots=True, eq=False)
class Spot:
    """One bright spot.

    Attributes:
        outline: (V, 2) its border, recorded pixels (u, v), finer than a pixel.
        cut: (V,) which of it lie at the image's border, or at that of what is usable.
    """

    outline: Array
    cut: Mask

    @property
    def is_cut(self) -> bool:
        """Whether the spot goes on where the image does not."""
        return bool(self.cut.any())


def levels(grey: NDArray[np.uint8], usable: Mask, config: LampConfig) -> Levels | None:
    """Returns the grey levels of an image, or None where it is black: no lamp is in view.

    The border lies at a share of the way from the ceiling (the median) to the brightest spot, so
    that it follows exposure where Bellini's fixed threshold does not.
    """
    seen = grey[usable]
    if not len(seen):
        return None
    ceiling = float(np.median(seen))
    smooth = cv2.blur(np.where(usable, grey, np.uint8(ceiling)), (BRIGHT_PX, BRIGHT_PX))
    bright = float(smooth.max())
    if bright - ceiling < config.contrast_grey:
        return None
    return Levels(ceiling, bright, ceiling + config.threshold * (bright - ceiling))


def spots(
    grey: NDArray[np.uint8],
    usable: Mask,
    border: float,
    clean_px: int,
    worth: Callable[[NDArray[np.int32], int], Mask],
) -> Iterator[Spot | None]:
    """Yields the connected parts of an image that are brighter than ``border``, top to bottom.

    Erosion and dilation take off fringes and close the gaps of grids first. The border is then
    followed in the grey levels, to a fraction of a pixel.

    Args:
        grey: (H, W) recorded image.
        usable: (H, W) pixels that count.
        border: grey level.
        clean_px: radius of erosion and dilation, pixels.
        worth: takes the parts' numbers (H, W), 0 for none, and how many numbers there are; returns
            which are worth a closer look. For the others None is yielded.

    Source: Bellini section 3.2.
    """
    bright: Any = ((grey > border) & usable).astype(np.uint8)
    if clean_px:
        side = 2 * clean_px + 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        for step in (cv2.MORPH_OPEN, cv2.MORPH_CLOSE):
            bright = cv2.morphologyEx(bright, step, disc, borderType=cv2.BORDER_REPLICATE)
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(bright, connectivity=8)
    looked_at = worth(labels, count)
    for label in range(1, count):
        if not looked_at[label]:
            yield None
            continue
        left, top, width, height, _ = boxes[label].tolist()
        rows = slice(max(0, top - 2), top + height + 2)
        columns = slice(max(0, left - 2), left + width + 2)
        own = labels[rows, columns] == label
        foreign = (labels[rows, columns] != 0) & ~own
        outline = _outline(grey[rows, columns], own, foreign, border)
        if outline is None:
            yield None
        else:
            outline += np.array([columns.start, rows.start])
            yield Spot(outline, _is_cut(outline, usable))


def _outline(grey: NDArray[np.uint8], own: Mask, foreign: Mask, border: float) -> Array | None:
    """Returns the border (V, 2) of the spot ``own`` in a cut-out of the image, its pixels (u, v).

    In an image `FINER` times finer; not farther than a pixel from the cleaned spot.
    """
    near = cv2.dilate(own.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool) & ~foreign
    kept = np.where(near, grey, 0).astype(np.float32)
    kept[own] = np.maximum(kept[own], np.float32(border + 1.0))  # gaps that were closed
    size = (grey.shape[1] * FINER, grey.shape[0] * FINER)
    fine: Any = cv2.resize(kept, size, interpolation=cv2.INTER_LINEAR) > border
    contours, _ = cv2.findContours(fine.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return None
    longest: Any = max(contours, key=len)[:, 0, :]
    if len(longest) < 3 * FINER:
        return None
    return _widened((longest + 0.5) / FINER - 0.5, 0.5 / FINER)


def _widened(outline: Array, by: float) -> Array:
    """Returns an outline (V, 2) moved outwards: it ran through the centres of the parts inside."""
    along = np.roll(outline, -2, axis=0) - np.roll(outline, 2, axis=0)
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    following = np.roll(outline, -1, axis=0)
    twice = np.sum(outline[:, 0] * following[:, 1] - following[:, 0] * outline[:, 1])
    length = np.maximum(np.hypot(*normal.T), 1e-12)[:, None]
    return np.asarray(outline + np.sign(twice) * by * normal / length)


def _is_cut(outline: Array, usable: Mask) -> Mask:
    """Returns which points of an outline have nothing usable beside them."""
    height, width = usable.shape
    around = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
    beside = np.rint(outline[:, None] + around).astype(int)
    outside = ((beside < 0) | (beside >= [width, height])).any(axis=-1)
    u, v = np.clip(beside[..., 0], 0, width - 1), np.clip(beside[..., 1], 0, height - 1)
    return np.asarray((outside | ~usable[v, u]).any(axis=1))
