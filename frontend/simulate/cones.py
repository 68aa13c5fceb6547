"""What a scenario says of cones on the floor, and of the camera that sees them all around."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from frontend.colour_range import Hsv
from frontend.omni import Colour, OmniCamera
from frontend.simulate.checks import between, imaging, positive
from graphslam.errors import BadConfig
from graphslam.measurements import LandmarkMap
from graphslam.models.bearing import BEARING

OMNI = "omni"
"""Name of the camera in simulated logs."""
ConeColour = Literal["blue", "red", "green", "yellow"]
COLOURS: dict[str, tuple[tuple[float, float, float], Hsv, Hsv]] = {
    "blue": ((0.80, 0.25, 0.10), (105, 110, 40), (130, 255, 255)),
    "red": ((0.10, 0.12, 0.85), (172, 110, 40), (8, 255, 255)),
    "green": ((0.20, 0.65, 0.15), (45, 110, 40), (75, 255, 255)),
    "yellow": ((0.10, 0.75, 0.85), (20, 110, 40), (35, 255, 255)),
}
"""Of each colour, in the order of their labels: what it reflects (BGR, shares), and the range of
hue, saturation and value that log.toml gives for it."""


@dataclass(frozen=True, slots=True)
class Cone:
    """One cone; its number in landmarks.csv is its place in the scenario.

    Attributes:
        x: m, floor frame.
        y: m, floor frame.
        colour: "blue", "red", "green" or "yellow".
        height: m, default 0.15.
        radius: of its lower end, m, default 0.03.
        base: its square base, 2.6 radii wide: "masked", the default, is covered with grey paper,
            "bare" is of the cone's colour, "none" is not there.
        base_turn_deg: direction of the base's sides, degrees.
    """

    x: float
    y: float
    colour: ConeColour = "red"
    height: float = 0.15
    radius: float = 0.03
    base: Literal["masked", "bare", "none"] = "masked"
    base_turn_deg: float = 0.0

    def __post_init__(self) -> None:
        positive("height", self.height)
        positive("radius", self.radius)


@dataclass(frozen=True, slots=True)
class OmniSpec:
    """A camera that looks up at a mirror, half a ball, above the middle of the wheels.

    Its images show the robot's front up and its left on the right, and log.toml says so. What they
    show differently from what log.toml says is under `centre_off_px`, `turned_deg` and `oval`.

    Attributes:
        image_size: (width, height), pixels.
        rate: images per second.
        mirror_height: of the middle of the ball above the floor, m, default 0.25.
        mirror_radius: of the ball, m, default 0.03.
        mirror_distance: from the camera up to the middle of the ball, m, default 0.12.
        noise: standard deviation of a pixel, grey levels, default 3.
        blur: standard deviation of the lens's blur, pixels, default 0.6.
        jpeg_quality: 1 to 100; 0, the default, writes PNG, without loss.
        centre_off_px: where the mirror's axis is in the images, less where log.toml says, pixels.
        turned_deg: how far the camera is turned to the left, degrees.
        oval: how much wider than high the mirror is, as a share.
        sigma_deg: without images: standard deviation of a direction, degrees, default 0.2.
        reach: without images: cones beyond are not seen, m; absent: all are.
        miss_rate: without images: probability that a cone is not seen, default 0.
    """

    image_size: tuple[int, int]
    rate: float
    mirror_height: float = 0.25
    mirror_radius: float = 0.03
    mirror_distance: float = 0.12
    noise: float = 3.0
    blur: float = 0.6
    jpeg_quality: int = 0
    centre_off_px: tuple[float, float] = (0.0, 0.0)
    turned_deg: float = 0.0
    oval: float = 0.0
    sigma_deg: float = 0.2
    reach: float | None = None
    miss_rate: float = 0.0

    def __post_init__(self) -> None:
        imaging(self, fewest_px=16)
        for name in ("mirror_height", "mirror_radius", "sigma_deg"):
            positive(name, getattr(self, name))
        if self.reach is not None:
            positive("reach", self.reach)
        between("oval", self.oval, -0.2, 0.2)
        between("miss_rate", self.miss_rate, 0.0, 1.0)
        if not self.mirror_distance > 1.5 * self.mirror_radius:
            raise BadConfig(
                f"mirror_distance = {self.mirror_distance}: the camera must stand clear of the "
                "mirror, at least one and a half radii below its middle"
            )

    def focal(self) -> float:
        """Returns the focal length, pixels, that lets the mirror fill the image."""
        rim = math.asin(self.mirror_radius / self.mirror_distance)
        return 0.48 * min(self.image_size) / math.tan(rim)

    def rim_px(self) -> float:
        """Returns the radius of the mirror's rim in the image, pixels."""
        return 0.48 * min(self.image_size)


def omni_camera(spec: OmniSpec, cones: tuple[Cone, ...]) -> OmniCamera:
    """Returns the camera as log.toml describes it: without what is wrong with it."""
    width, height = spec.image_size
    used = {cone.colour for cone in cones}
    colours = tuple(
        Colour(label, low, high, name)
        for label, (name, (_, low, high)) in enumerate(COLOURS.items())
        if name in used
    )
    centre = (0.5 * (width - 1), 0.5 * (height - 1))
    ring = (round(0.08 * spec.rim_px()), round(0.97 * spec.rim_px()))
    return OmniCamera(OMNI, spec.image_size, centre, colours, mirrored=True, ring_px=ring)


def cone_landmarks(cones: tuple[Cone, ...]) -> LandmarkMap:
    """Returns where the cones stand."""
    count, labels = len(cones), list(COLOURS)
    return LandmarkMap(
        id=np.arange(count),
        kind=(BEARING.kind,) * count,
        params=np.array([(cone.x, cone.y) for cone in cones], float).reshape(-1, 2),
        extent=np.full((count, 2), np.nan),
        sightings=np.zeros(count, np.int64),
        label=np.array([labels.index(cone.colour) for cone in cones], np.int64),
    )
