"""Configuration of the wall detector. Field docstrings are the command line's help."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from graphslam.errors import BadConfig


@dataclass(frozen=True, slots=True)
class WallConfig:
    """The wall detector: straight pieces of a laser's scans, fit, noise."""

    range_sigma_m: float = 0.01
    """Standard deviation of one distance, m: what a laser's data sheet calls statistical error,
    with the rounding of the log."""
    beam_sigma_deg: float = 0.1
    """Standard deviation of a beam's direction, degrees."""
    range_bias_m: float = 0.01
    """Standard deviation of what all distances to one wall have in common, m (a data sheet's
    systematic error); with the next a floor of a wall's noise that no number of beams lowers."""
    direction_floor_deg: float = 0.2
    """Standard deviation of a wall's direction that no number of beams lowers, degrees."""
    straightness_m: float = 0.005
    """How far points of a real wall lie off a straight line (mouldings, frames), m."""
    min_points: int = 6
    """Fewest beams on a piece."""
    min_length_m: float = 0.4
    """Shortest piece, m."""
    grazing_deg: float = 8.0
    """Smallest angle between beams and wall, degrees."""
    split_m: float = 0.04
    """A piece is split where a point lies farther from its chord than this and than four standard
    deviations, m."""
    curved: float = 2.0
    """Largest root mean square of a piece's residuals, in standard deviations; beyond it is
    curved."""
    vaguest_alpha_deg: float = 2.0
    """Pieces are left out whose own fit leaves their direction more uncertain than this (one
    standard deviation), degrees."""
    max_break_m: float = 1.5
    """Longest break in a wall (a door, a person) over which pieces of one scan are joined, m."""
    max_range_m: float = 30.0
    """Distances beyond this are left out, m."""

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            zero = f.name in ("beam_sigma_deg", "range_bias_m", "direction_floor_deg")
            zero = zero or f.name in ("straightness_m", "max_break_m")
            if not (math.isfinite(value) and (value > 0 or (zero and value == 0))):
                raise BadConfig(f"walls.{f.name} = {value}: must be finite and positive")
        if self.min_points < 3:
            raise BadConfig(f"walls.min_points = {self.min_points}: a fit needs 3 or more")
        if not self.grazing_deg < 90:
            raise BadConfig(f"walls.grazing_deg = {self.grazing_deg}: must be below 90")
