"""Dirt, shadows and things on the rendered floor: where they lie, and what they do to a picture.

The pieces lie in a square of `PERIOD` metres that repeats over the whole floor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from frontend.simulate.floor import Mess
from graphslam.geometry import Array, between, transform_points

if TYPE_CHECKING:
    from frontend.simulate.render import PixelGrid

Image = NDArray[np.float32]

PERIOD = 5.0  # m
REACH = 3.0  # a piece is drawn out to this many standard deviations of its soft border
LEG_HEIGHT = 0.6  # a leg hides floor as far behind it as this many times its distance


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Pieces of each sort, one a row: x, y, direction (rad), half length, half width, softness (m).

    Attributes:
        dirt: (D, 6) specks, stains and strokes.
        dirt_grey: (D,) what each adds to the grey of the floor, grey levels.
        round: (D,) whether it is an ellipse; else a rectangle.
        shadows: (S, 6) rectangles.
        shadow: (S,) share of the light that each takes away.
        legs: (L, 6) where things stand; the half width counts.
        leg_grey: (L,) their grey levels.
    """

    dirt: Array
    dirt_grey: Array
    round: NDArray[np.bool_]
    shadows: Array
    shadow: Array
    legs: Array
    leg_grey: Array


def lay_out(mess: Mess, rng: np.random.Generator) -> Layout:
    """Returns where everything lies; the generator decides."""

    def pieces(density: float, length: tuple[float, float], slim: tuple[float, float]) -> Array:
        """Rows with half lengths within ``length`` and half widths ``slim`` times as large."""
        count = int(rng.poisson(density * PERIOD**2))
        place = rng.uniform(0.0, PERIOD, (count, 2))
        half = rng.uniform(*length, count)
        turn = rng.uniform(-math.pi, math.pi, count)
        return np.column_stack(
            [place, turn, half, half * rng.uniform(*slim, count), np.zeros(count)]
        )

    def either_sign(count: int, low: float, high: float) -> Array:
        return rng.uniform(low, high, count) * rng.choice([-1.0, 1.0], count)

    specks = pieces(mess.specks, (0.001, 0.006), (0.4, 1.0))
    stains = pieces(mess.stains, (0.015, 0.1), (0.4, 1.0))
    strokes = pieces(mess.strokes, (0.005, 0.035), (1.0, 1.0))
    shadows = pieces(mess.shadows, (0.3, 1.0), (1.0, 1.0))
    legs = pieces(mess.legs, (0.015, 0.04), (1.0, 1.0))
    specks[:, 5], stains[:, 5], strokes[:, 5] = 0.0005, 0.3 * stains[:, 4], 0.0003
    strokes[:, 4] = rng.uniform(0.0005, 0.002, len(strokes))
    shadows[:, 4], shadows[:, 5] = rng.uniform(0.04, 0.25, len(shadows)), 0.0
    shadows[:, 5] = rng.uniform(0.001, 0.015, len(shadows))
    grey = [either_sign(len(specks), 20.0, 90.0), either_sign(len(stains), 5.0, 25.0)]
    grey.append(either_sign(len(strokes), 20.0, 90.0))
    return Layout(
        dirt=np.concatenate([specks, stains, strokes]),
        dirt_grey=np.concatenate(grey),
        round=np.arange(len(specks) + len(stains) + len(strokes)) < len(specks) + len(stains),
        shadows=shadows,
        shadow=rng.uniform(0.2, 0.5, len(shadows)),
        legs=legs,
        leg_grey=rng.uniform(20.0, 230.0, len(legs)),
    )


def add_dirt(grey: Image, mess: Layout, pose: Array, grid: PixelGrid, blur: float) -> None:
    """Adds specks, stains and strokes to an image (H, W) taken from a pose."""
    for row, piece in _near(mess.dirt, pose, grid):
        for part, along, across, spread in _around(piece, grid, blur):
            if mess.round[row]:
                radius = np.hypot(along / piece[3], across / piece[4])
                mean = math.sqrt(piece[3] * piece[4])
                cover = _beyond((radius - 1.0) * mean, spread)
            else:
                cover = _strip(along, piece[3], spread) * _strip(across, piece[4], spread)
            grey[part] += (mess.dirt_grey[row] * cover).astype(np.float32)


def add_shadows(grey: Image, mess: Layout, pose: Array, grid: PixelGrid, blur: float) -> None:
    """Darkens an image (H, W) taken from a pose where shadows lie."""
    for row, piece in _near(mess.shadows, pose, grid):
        for part, along, across, spread in _around(piece, grid, blur):
            cover = _strip(along, piece[3], spread) * _strip(across, piece[4], spread)
            grey[part] *= (1.0 - mess.shadow[row] * cover).astype(np.float32)


def add_legs(grey: Image, mess: Layout, pose: Array, grid: PixelGrid, blur: float) -> None:
    """Draws upright things into an image (H, W) taken from a pose.

    What stands upright hides the floor behind it, seen from where the camera stands, which is taken
    to be above the origin of the robot frame: a wedge that widens with the distance.
    """
    for row, (x, y, _, _, half, _) in _near(mess.legs, pose, grid):
        distance = math.hypot(x, y)
        if distance < 2.0 * half:
            continue
        length = 0.5 * LEG_HEIGHT * distance
        direction = math.atan2(y, x)
        middle = (1.0 + length / distance) * np.array([x, y])
        widest = half * (1.0 + 2.0 * length / distance)
        piece = np.array([*middle, direction, length, widest, 0.0])
        for part, along, across, spread in _around(piece, grid, blur):
            width = half * (distance + along + length) / distance
            cover = _strip(along, length, spread) * _strip(across, width, spread)
            grey[part] += ((mess.leg_grey[row] - grey[part]) * cover).astype(np.float32)


def _near(pieces: Array, pose: Array, grid: PixelGrid) -> Iterator[tuple[int, Array]]:
    """Yields number and row, in the robot frame, of the pieces near the floor in view."""
    low, high = grid.corners.min(axis=0), grid.corners.max(axis=0)
    middle, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    centre = transform_points(pose, middle)
    place = pieces[:, :2] - PERIOD * np.round((pieces[:, :2] - centre) / PERIOD)
    seen = between(pose, np.column_stack([place, pieces[:, 2]]))
    reach = radius + np.hypot(pieces[:, 3], pieces[:, 4])
    for row in np.flatnonzero(np.linalg.norm(seen[:, :2] - middle, axis=1) < reach).tolist():
        yield row, np.concatenate([seen[row], pieces[row, 3:]])


def _around(
    piece: Array, grid: PixelGrid, blur: float
) -> Iterator[tuple[tuple[slice, slice], Array, Array, Array]]:
    """Yields the part of the image that a piece may touch, with its own coordinates there.

    These are the position along and across it, m, and the standard deviation of its border as it
    is seen there. Yields nothing where it is out of view.
    """
    height, width = grid.off_floor.shape
    axes = np.array(
        [[math.cos(piece[2]), math.sin(piece[2])], [-math.sin(piece[2]), math.cos(piece[2])]]
    )
    soft = REACH * (piece[5] + (blur + 0.3) * 0.004)
    part = np.linspace(-1.0, 1.0, 9)
    outline = np.concatenate([np.column_stack([part, s + 0 * part]) for s in (-1.0, 1.0)])
    outline = np.concatenate([outline, outline[:, ::-1]]) * (piece[3:5] + soft)
    pixels = grid.camera.distort(grid.camera.floor_to_pixel(piece[:2] + outline @ axes))
    if not np.isfinite(pixels).all():
        pixels = np.array([[0.0, 0.0], [width, height]])
    margin = 2.0 + REACH * blur
    (u0, v0), (u1, v1) = pixels.min(axis=0) - margin, pixels.max(axis=0) + margin
    rows = slice(max(int(v0), 0), min(int(v1) + 1, height))
    columns = slice(max(int(u0), 0), min(int(u1) + 1, width))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return
    box = (rows, columns)
    off = grid.floor[box] - piece[:2]
    spread = np.hypot(math.sqrt(0.5 * (blur**2 + 1.0 / 12.0)) * grid.footprint[box], piece[5])
    spread = np.where(grid.off_floor[box], np.inf, np.maximum(spread, 1e-9))
    yield box, off @ axes[0], off @ axes[1], spread


def _beyond(distance: Array, spread: Array) -> Array:
    """Returns how far (0 to 1) a soft border covers what is ``distance`` outside of it, m."""
    return np.where(np.isinf(spread), 0.0, 0.5 * (1.0 - erf(distance / (math.sqrt(2.0) * spread))))


def _strip(distance: Array, half: Array | float, spread: Array) -> Array:
    """Returns how far (0 to 1) a soft strip of half width ``half`` covers a place, m."""
    scale = math.sqrt(2.0) * spread
    cover = 0.5 * (erf((distance + half) / scale) - erf((distance - half) / scale))
    return np.where(np.isinf(spread), 0.0, cover)
