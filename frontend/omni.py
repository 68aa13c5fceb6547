"""A camera under a mirror that sees all around: pixels to directions in the robot frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from frontend.camera import check_delay
from frontend.colour_range import Hsv, check_range
from graphslam.errors import BadConfig
from graphslam.geometry import Array, wrap

MOST_HARMONICS = 4
LARGEST_HARMONIC_DEG = 30.0
"""Beyond it a correction is no correction; directions would come in another order."""


@dataclass(frozen=True, slots=True)
class BearingCorrection:
    """What is added to a direction as it was measured: a constant, and waves around the robot.

    The waves stand for what lens and mirror do to directions: once around where the axes are off or
    the mirror leans, twice around where it is oval.

    Attributes:
        offset_deg: added to every direction, degrees.
        harmonics_deg: (c_1, s_1), (c_2, s_2), ...: ``c_k cos(k b) + s_k sin(k b)`` is added to a
            direction measured as b, degrees.

    Source: Kato section V, which puts its bias down to 'deformation of the camera lens or the
    mirrors' and asks for 'tuning appropriate offset'.
    """

    offset_deg: float = 0.0
    harmonics_deg: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if not abs(self.offset_deg) <= 360.0:
            raise BadConfig(f"offset_deg = {self.offset_deg}: is no angle within one turn")
        largest = max((abs(v) for pair in self.harmonics_deg for v in pair), default=0.0)
        if len(self.harmonics_deg) > MOST_HARMONICS or not largest <= LARGEST_HARMONIC_DEG:
            raise BadConfig(
                f"harmonics_deg = {[list(pair) for pair in self.harmonics_deg]}: at most "
                f"{MOST_HARMONICS} pairs of at most {LARGEST_HARMONIC_DEG:g} degrees"
            )

    def of(self, bearing: Array) -> Array:
        """Returns the directions (...), rad, wrapped, for directions as measured (...), rad."""
        bearing = np.asarray(bearing, float)
        numbers = [math.radians(v) for v in self.numbers()]
        return wrap(bearing + correction_terms(bearing, len(self.harmonics_deg)) @ numbers)

    def numbers(self) -> list[float]:
        """Returns offset and harmonics in the order of `correction_terms`, degrees."""
        return [self.offset_deg, *(v for pair in self.harmonics_deg for v in pair)]


def correction_terms(bearing: Array, harmonics: int) -> Array:
    """Returns (..., 1 + 2 h): 1, cos b, sin b, cos 2b, ... of directions as measured (...), rad."""
    bearing = np.asarray(bearing, float)
    order = np.arange(1, harmonics + 1)
    angle = bearing[..., None] * order
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(*bearing.shape, 2 * harmonics)
    return np.concatenate([np.ones((*bearing.shape, 1)), waves], axis=-1)


@dataclass(frozen=True, slots=True)
class Colour:
    """A colour that landmarks have.

    Attributes:
        label: number that sightings of this colour carry, as `label` in landmarks.csv; 0 or more.
        low: smallest hue (0 to 179), saturation and value (0 to 255), as OpenCV has them; a hue
            above that of `high` goes over the end of the circle, as red does.
        high: the largest.
        name: what reports call it.
    """

    label: int
    low: Hsv
    high: Hsv
    name: str = ""

    def __post_init__(self) -> None:
        if self.label < 0:
            raise BadConfig(f"label = {self.label}: must be 0 or more")
        check_range(self.low, self.high)


@dataclass(frozen=True, slots=True)
class OmniCamera:
    """A camera whose image shows the directions all around the robot, around one point.

    It stands above the middle of the robot's wheels, its axis upright. Pixel centres are at
    integers. A pixel's direction is its angle about `centre`, counter-clockwise from the image's
    right, less `heading_deg`; clockwise where `mirrored`; then corrected.

    Attributes:
        name: name of the camera in the log.
        image_size: (width, height), pixels.
        centre: (u, v) of the mirror's axis, pixels.
        colours: what to look for.
        heading_deg: where in the image the front of the robot is, degrees counter-clockwise from
            its right; 90 is up.
        mirrored: whether what is left of the robot comes clockwise in the image: as an unturned
            picture of a mirror above the camera shows it.
        ring_px: smallest and largest distance from `centre` that shows the surroundings, pixels:
            inside is the robot itself, outside nothing. None: all of the image.
        correction: added to directions.
        delay_s: how long after an image was taken what it shows is known, s.

    Source: Kato eq. (1) with atan2; its image has v to the left and u up, from the mirror's centre.
    """

    name: str
    image_size: tuple[int, int]
    centre: tuple[float, float]
    colours: tuple[Colour, ...]
    heading_deg: float = 90.0
    mirrored: bool = False
    ring_px: tuple[float, float] | None = None
    correction: BearingCorrection = BearingCorrection()
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        check_delay(self.name, self.delay_s)
        if any(n <= 0 for n in self.image_size):
            raise self._bad(f"image_size = {list(self.image_size)}: both must be positive")
        width, height = self.image_size
        u, v = self.centre
        if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
            raise self._bad(f"centre = {list(self.centre)}: is outside the image")
        if not abs(self.heading_deg) <= 360.0:
            raise self._bad(f"heading_deg = {self.heading_deg}: is no angle within one turn")
        if self.ring_px is not None and not 0 <= self.ring_px[0] < self.ring_px[1]:
            raise self._bad(f"ring_px = {list(self.ring_px)}: needs 0 <= first < second")
        if not self.colours:
            raise self._bad("colours is empty: say what to look for")
        labels = [colour.label for colour in self.colours]
        if len(set(labels)) < len(labels):
            raise self._bad(f"colours: a label is there twice in {labels}")

    @property
    def looks_at(self) -> str:
        """All around: "omni"."""
        return "omni"

    def _bad(self, text: str) -> BadConfig:
        return BadConfig(f"camera {self.name!r}: {text}")

    def bearing(self, pixels: Array) -> Array:
        """Returns the directions (...), rad, robot frame, of pixels (..., 2)."""
        return self.correction.of(self.measured(pixels))

    def measured(self, pixels: Array) -> Array:
        """Returns the same without the correction."""
        off = np.asarray(pixels, float) - np.array(self.centre)
        angle = np.arctan2(-off[..., 1], off[..., 0]) - math.radians(self.heading_deg)
        return wrap(-angle if self.mirrored else angle)

    def pixels(self, bearing: Array, distance_px: Array) -> Array:
        """Returns pixels (..., 2) so far from the centre in directions (...), rad, robot frame.

        For drawing: of the correction only the constant counts.
        """
        angle = np.asarray(bearing, float) - math.radians(self.correction.offset_deg)
        angle = (-angle if self.mirrored else angle) + math.radians(self.heading_deg)
        way = np.stack([np.cos(angle), -np.sin(angle)], axis=-1)
        return np.array(self.centre) + np.asarray(distance_px, float)[..., None] * way
