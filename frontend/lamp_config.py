"""Configuration of the detector of ceiling lamps. Field docstrings are the command line's help."""

from __future__ import annotations

import math
from dataclasses import dataclass

from graphslam.errors import BadConfig


@dataclass(frozen=True, slots=True)
class LampConfig:
    """The detector of ceiling lamps, in the images of cameras with looks_at = "ceiling"."""

    size_m: tuple[float, float] | None = None
    """Length and width of a lamp, m, in the plane of the lamps. With it lamps that the border of
    the image cuts are completed from their edges, and what is much smaller or larger than a lamp
    is none; absent: cut lamps are left out."""
    area_m2: tuple[float, float] = (0.02, 1.5)
    """Smallest and largest area of a lamp, m^2, where its size is not given."""
    least_share: float = 0.6
    """Smallest area of a bright spot, as a share of a lamp's, that counts as a whole lamp; the
    inverse is the largest. Needs size_m."""
    least_visible: float = 0.67
    """Share of a cut lamp that must be visible to complete it (Bellini: 4000 of 6000 pixels)."""
    least_elongation: float = 1.4
    """Shortest lamp, as its length over its width, whose axis is taken."""
    least_fill: float = 0.75
    """Smallest share of its own rectangle that a lamp fills; below it, it is no lamp."""
    contrast_grey: float = 30.0
    """An image whose brightest spot is less than this above the ceiling, grey levels, is black: no
    lamp is in view."""
    threshold: float = 0.5
    """Where between ceiling (0) and brightest spot (1) of an image the border of a lamp is; so it
    follows exposure."""
    clean_px: int = 1
    """Radius of erosion and dilation, pixels: what is narrower than twice this goes (fringes,
    grids), gaps narrower than that close; 0 leaves all as it is."""
    edge_px: float = 0.15
    """Standard deviation of where a whole edge of a lamp appears, pixels (blur, fringes)."""
    calibration_px: float = 0.1
    """Standard deviation of the calibration, pixels: how far off homography and lens put a spot."""
    cut_end_m: float = 0.01
    """Standard deviation of the one visible end of a cut lamp, along the lamp, m: a reflection may
    be taken for it."""
    timing_s: float = 0.005
    """Standard deviation of when within its exposure an image was taken, s: noise that grows with
    the robot's speed, as Bellini's does."""
    coarsest_pixel_m: float = 0.05
    """Pixels that cover more of the ceiling than this are ignored, m."""

    def __post_init__(self) -> None:
        pairs = {"size_m": self.size_m and self.size_m[::-1], "area_m2": self.area_m2}
        for name, pair in pairs.items():
            if pair is not None and not 0 < pair[0] <= pair[1] < math.inf:
                raise BadConfig(
                    f"lamps.{name} = {getattr(self, name)}: needs two positive numbers, "
                    + ("the length first" if name == "size_m" else "the smaller one first")
                )
        for name in ("least_share", "least_visible", "least_fill", "threshold"):
            if not 0 < getattr(self, name) < 1:
                raise BadConfig(f"lamps.{name} = {getattr(self, name)}: must be between 0 and 1")
        for name in ("contrast_grey", "edge_px", "coarsest_pixel_m"):
            if not 0 < getattr(self, name) < math.inf:
                raise BadConfig(f"lamps.{name} = {getattr(self, name)}: must be positive")
        for name in ("calibration_px", "cut_end_m", "timing_s"):
            if not 0 <= getattr(self, name) < math.inf:
                raise BadConfig(f"lamps.{name} = {getattr(self, name)}: must be 0 or more")
        if not 0 <= self.clean_px <= 50:
            raise BadConfig(f"lamps.clean_px = {self.clean_px}: must be from 0 to 50")
        if not self.least_elongation >= 1:
            raise BadConfig(f"lamps.least_elongation = {self.least_elongation}: must be 1 or more")
