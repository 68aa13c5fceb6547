"""How two line maps are laid on each other. Field docstrings are the command line's help."""

from __future__ import annotations

import math
from dataclasses import dataclass

from graphslam.errors import BadConfig


@dataclass(frozen=True, slots=True)
class AlignmentConfig:
    """Laying one line map on another."""

    offset_m: float = 0.05
    """Lines agree when they lie within this of each other, across, at the middle of the stretch
    that both maps have, m; or within three sigma where that is more."""
    far_m: float = 0.2
    """Lines never agree beyond this offset, m, however uncertain they are."""
    angle_deg: float = 3.0
    """Lines agree within this angle, degrees; or within three sigma where that is more."""
    overlap_m: float = 0.1
    """Shortest common stretch of two lines that counts, m; half the shorter line where that is
    less."""
    cell_m: float = 0.05
    """Cell of the votes for a shift, m; coarser where maps are very large."""
    hypotheses: int = 150
    """How many motions that got most votes are tried in full."""
    most: int = 60
    """Largest number of alignments that are returned."""
    least: int = 1
    """Fewest lines that must agree for a motion to be followed."""
    equal_consistency: float = 0.9
    """An alignment fits as well as the best when the share of what both maps should have, and
    have in agreement, is at least this part of the best one's,"""
    equal_score: float = 0.5
    """and its score at least this part of the best one's."""

    def __post_init__(self) -> None:
        for name in ("offset_m", "overlap_m", "cell_m"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise BadConfig(f"alignment.{name} = {value}: must be positive")
        if not self.offset_m <= self.far_m < math.inf:
            raise BadConfig(f"alignment.far_m = {self.far_m}: must be at least offset_m")
        if not 0 < self.angle_deg <= 20:
            raise BadConfig(f"alignment.angle_deg = {self.angle_deg}: must be above 0, at most 20")
        for name in ("hypotheses", "most", "least"):
            if getattr(self, name) < 1:
                raise BadConfig(f"alignment.{name} = {getattr(self, name)}: must be 1 or more")
        for name in ("equal_consistency", "equal_score"):
            if not 0 < getattr(self, name) <= 1:
                raise BadConfig(
                    f"alignment.{name} = {getattr(self, name)}: must be above 0, at most 1"
                )
