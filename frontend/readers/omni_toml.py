"""Cameras of ``log.toml`` that see all around: ``looks_at = "omni"``."""

from __future__ import annotations

from dataclasses import dataclass

from frontend.colour_range import Hsv
from frontend.omni import BearingCorrection, Colour, OmniCamera

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class ColourTable:
    """An entry of ``[[cameras.NAME.colours]]``; see `Colour`."""

    label: int
    low: Hsv
    high: Hsv
    name: str = ""


@dataclass(frozen=True, slots=True)
class OmniTable:
    """``[cameras.NAME]`` with ``looks_at = "omni"``; see `OmniCamera`."""

    image_size: tuple[int, int]
    colours: tuple[ColourTable, ...]
    looks_at: str = "omni"
    centre: Pair | None = None
    heading_deg: float = 90.0
    mirrored: bool = False
    ring_px: Pair | None = None
    offset_deg: float = 0.0
    harmonics_deg: tuple[Pair, ...] = ()
    delay: float = 0.0

    def camera(self, name: str) -> OmniCamera:
        """Returns the camera; raises BadConfig where its numbers make none."""
        width, height = self.image_size
        middle = (0.5 * (width - 1), 0.5 * (height - 1))
        return OmniCamera(
            name,
            self.image_size,
            middle if self.centre is None else self.centre,
            tuple(Colour(c.label, c.low, c.high, c.name) for c in self.colours),
            self.heading_deg,
            self.mirrored,
            self.ring_px,
            BearingCorrection(self.offset_deg, self.harmonics_deg),
            self.delay,
        )
