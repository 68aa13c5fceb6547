"""The floor that a scenario describes: its lines, its texture, the light lying on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontend.simulate.mess import Layout, lay_out
from frontend.simulate.scenario import Scenario
from graphslam.geometry import Array, wrap

# cells of one period of a pattern, and cells for its shortest wavelength
TILE_CELLS = 512
CELLS_PER_WAVE = 4
# longest over shortest wavelength of a pattern
OCTAVES = 16.0


@dataclass(frozen=True, slots=True, eq=False)
class Tile:
    """One period of a random pattern that covers the floor without seams.

    Attributes:
        values: (TILE_CELLS, TILE_CELLS) mean 0 and standard deviation 1; rows along y, columns
            along x of the floor.
        cell: side of one cell on the floor, m.
    """

    values: NDArray[np.float32]
    cell: float


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """What lies on the floor.

    Attributes:
        lines: (L, 2) rho m, alpha rad, floor frame; as given, not made canonical.
        stretch: (L, 2) where each begins and ends along itself, m; infinite where endless.
        texture: pattern of the surface.
        patches: pattern of light and shade.
        mess: what lies on the floor beside the lines; None for nothing.
    """

    lines: Array
    stretch: Array
    texture: Tile
    patches: Tile
    mess: Layout | None = None


def build_world(scenario: Scenario, rng: np.random.Generator) -> World:
    """Returns the floor of a scenario; the generator decides its patterns only."""
    return World(
        floor_lines(scenario),
        floor_stretches(scenario),
        random_tile(scenario.surface.texture_scale, rng),
        random_tile(scenario.light.patch_scale, rng),
        None if scenario.mess is None else lay_out(scenario.mess, rng),
    )


def floor_lines(scenario: Scenario) -> Array:
    """Returns the lines (L, 2) of a scenario, rho m and alpha rad: single ones, then grids."""
    rows = [(line.rho, line.alpha_deg) for line in scenario.lines]
    for grid in scenario.grids:
        offsets = grid.first + np.cumsum([0.0, *grid.spacings])
        rows += [(float(rho), grid.alpha_deg) for rho in offsets]
    lines = np.array(rows, float).reshape(-1, 2)
    return np.column_stack([lines[:, 0], wrap(np.deg2rad(lines[:, 1]))])


def floor_stretches(scenario: Scenario) -> Array:
    """Returns where each of `floor_lines` begins and ends along itself (L, 2), m, or infinity."""
    endless = (-math.inf, math.inf)
    rows = [line.stretch or endless for line in scenario.lines]
    for grid in scenario.grids:
        rows += [grid.stretch or endless] * (len(grid.spacings) + 1)
    return np.array(rows, float).reshape(-1, 2)


def random_tile(scale: float, rng: np.random.Generator) -> Tile:
    """Returns a periodic random pattern with wavelengths from ``scale`` to 16 times ``scale``, m.

    Its spectrum is white noise weighted by the wavelength, as natural surfaces have it.
    """
    frequency = np.fft.fftfreq(TILE_CELLS) * CELLS_PER_WAVE  # in waves per ``scale``
    radius = np.hypot(frequency[:, None], frequency[None, : TILE_CELLS // 2 + 1])
    band = (radius <= 1.0) & (radius >= 1.0 / OCTAVES)
    weight = np.divide(1.0, radius, out=np.zeros_like(radius), where=band)
    noise = rng.standard_normal((TILE_CELLS, TILE_CELLS))
    values = np.fft.irfft2(np.fft.rfft2(noise) * weight, s=noise.shape)
    return Tile((values / values.std()).astype(np.float32), scale / CELLS_PER_WAVE)
