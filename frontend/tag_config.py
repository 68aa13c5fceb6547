"""Configuration of the detector of coloured tags. Field docstrings are the command line's help."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from frontend.colour_range import Hsv, check_range
from graphslam.errors import BadConfig

SigmaLaw = Literal["measured", "paper"]


@dataclass(frozen=True, slots=True)
class TagConfig:
    """The coloured tags of a robot in images of an overhead camera."""

    centre_low: Hsv = (100, 90, 30)
    """Colour of the tag in the robot's centre (blue): smallest hue (0 to 179, two degrees each),
    saturation and value (0 to 255). A hue above that of the largest goes over the end of the
    circle, as red does."""
    centre_high: Hsv = (130, 255, 255)
    """The largest."""
    front_low: Hsv = (40, 70, 30)
    """Colour of the tag at its front (green): smallest hue, saturation and value."""
    front_high: Hsv = (85, 255, 255)
    """The largest."""
    open_px: int = 3
    """Specks of colour narrower than this are removed, pixels; 0 and 1 remove none."""
    close_px: int = 3
    """Holes narrower than this are closed, pixels; 0 and 1 close none."""
    min_area_px: float = 12.0
    """Smallest blob that is looked at, pixels."""
    size_ratio: tuple[float, float] = (0.5, 2.5)
    """Smallest and largest area of a tag over the stated one; beyond it is partly hidden, or merged
    with something else. Only where log.toml gives the diameter."""
    distance_tolerance_m: float = 0.015
    """Largest difference between the distance of the tags as seen and as log.toml has it, m."""
    sigma_law: SigmaLaw = "measured"
    """Noise of a pose. measured: from the noise of pixels, the size of the tags and their distance.
    paper: Atali's, the same for all."""
    sigma_px: float = 0.1
    """Standard deviation of what calibration, lens and light do to the middle of a tag, pixels
    along u and along v, beside what whole pixels do to its border."""
    sigma_m: float = 0.002
    """Standard deviation of where a tag is on the robot, m along x and along y: the robot tilts,
    the tag comes loose."""
    paper_sigma_m: float = 0.1
    """n_m of Atali's R, m."""
    paper_sigma_deg: float = 2.0
    """Floor of the angle in Atali's R, degrees; the paper prints 0."""
    check: bool = True
    """Leave poses out that odometry contradicts, those of tags.csv too."""

    def __post_init__(self) -> None:
        for low, high in (("centre_low", "centre_high"), ("front_low", "front_high")):
            check_range(getattr(self, low), getattr(self, high), (low, high))
        smallest, largest = self.size_ratio
        if not 0 < smallest < largest < math.inf:
            raise BadConfig(f"size_ratio = {self.size_ratio}: needs 0 < first < second")
        if self.sigma_law not in get_args(SigmaLaw):
            raise BadConfig(f"sigma_law = {self.sigma_law!r}: must be measured or paper")
        for name in ("open_px", "close_px", "sigma_px", "sigma_m"):
            if not 0 <= getattr(self, name) < math.inf:
                raise BadConfig(f"{name} = {getattr(self, name)}: must be finite, not negative")
        for name in ("min_area_px", "distance_tolerance_m", "paper_sigma_m", "paper_sigma_deg"):
            if not 0 < getattr(self, name) < math.inf:
                raise BadConfig(f"{name} = {getattr(self, name)}: must be finite and positive")
