"""Configuration of the search for coloured landmarks. Field docstrings are the help text."""

from __future__ import annotations

import math
from dataclasses import dataclass

from graphslam.errors import BadConfig


@dataclass(frozen=True, slots=True)
class OmniConfig:
    """Directions of coloured landmarks in images of an omnidirectional camera."""

    open_px: int = 3
    """Specks of colour narrower than this are removed, pixels; 0 and 1 remove none."""
    close_px: int = 3
    """Holes and gaps in a colour narrower than this are closed, pixels; 0 and 1 close none."""
    min_area_px: int = 6
    """Smallest blob that counts, pixels, its base left out."""
    base_share: float = 0.6
    """Share of a blob, from its end nearest to the mirror's centre, that is left out: the base of a
    cone is square, and moves the centroid as the robot goes around it. 0 where bases are covered,
    or there are none."""
    widest_deg: float = 60.0
    """Widest blob that counts, degrees around the mirror's centre."""
    centre_px: float = 0.1
    """Standard deviation of the mirror's centre, pixels; near landmarks feel it most."""
    deformation_deg: float = 0.05
    """Standard deviation of what lens and mirror do to a direction after calibration, degrees."""

    def __post_init__(self) -> None:
        for name in ("open_px", "close_px", "centre_px", "deformation_deg"):
            if not 0 <= getattr(self, name) < math.inf:
                raise BadConfig(f"{name} = {getattr(self, name)}: must be finite and not negative")
        if self.min_area_px < 1:
            raise BadConfig(f"min_area_px = {self.min_area_px}: must be 1 or more")
        if not 0 <= self.base_share < 1:
            raise BadConfig(f"base_share = {self.base_share}: must be from 0 to below 1")
        if not 0 < self.widest_deg <= 180:
            raise BadConfig(f"widest_deg = {self.widest_deg}: must be above 0 and at most 180")
