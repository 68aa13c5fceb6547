"""What a scenario says of a camera overhead: its view, the tags, what else is in the work space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from frontend.camera import Camera
from frontend.overhead import OverheadCamera, TagMount
from frontend.simulate.checks import between, imaging, not_negative, positive
from graphslam.errors import BadConfig

Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]

NAME = "overhead"
"""Name of the camera in the log."""


@dataclass(frozen=True, slots=True)
class ColouredObject:
    """A disc of a tag's colour that lies in the work space and is no tag.

    Attributes:
        x: m, floor frame.
        y: m, floor frame.
        colour: "centre" or "front": which tag's.
        diameter: m.
        from_s: when it is put there, s, default 0.
        to_s: when it is taken away, s; None: never.
    """

    x: float
    y: float
    colour: Literal["centre", "front"]
    diameter: float
    from_s: float = 0.0
    to_s: float | None = None

    def __post_init__(self) -> None:
        positive("diameter", self.diameter)


@dataclass(frozen=True, slots=True)
class OverheadSpec:
    """A camera above the work space and the two tags on the robot.

    Attributes:
        tags: front, centre, diameter, height; as in log.toml. The diameter is needed for images.
        rate: images per second.
        area: smallest x, smallest y, largest x, largest y of the floor in view, m: the camera looks
            straight down at its middle. Or the homography below.
        image_size: (width, height), pixels, default 640x480.
        homography: (3, 3) floor frame, m, to pixel, instead of ``area``.
        position: (x, y, z) of the camera, m; needed where the tags have a height.
        tag_noise: standard deviation of where each tag is in each image, m along x and along y,
            default 0.002: what the middle of a tag errs by, whatever the cause.
        sigma_px: stated and drawn standard deviation of a tag's middle, pixels, where no images are
            rendered; default 0.1.
        miss_rate: share of the images in which something hides the tags, default 0.
        hidden: times, from and to, s, in which it always does.
        exchanged_from: from when on the tags have each other's colour, s; None: never.
        objects: what lies about in the tags' colours.
        centre_bgr: colour of the centre tag, blue, green, red, 0 to 255.
        front_bgr: colour of the front tag.
        body: radius of the robot's dark body, m, default 0.12.
        body_grey: its grey level, default 45.
        shadow: share of the light that the robot's shadow takes away, default 0.35.
        shadow_offset: where that shadow lies from the robot, m, default (0.05, -0.03).
        noise: standard deviation of each colour of a pixel, grey levels, default 4.
        blur: standard deviation of the lens's blur, pixels, default 0.7.
        jpeg_quality: 1 to 100, default 92; 0 writes PNG, without loss.
    """

    tags: TagMount
    rate: float
    area: tuple[float, float, float, float] | None = None
    image_size: tuple[int, int] = (640, 480)
    homography: Matrix | None = None
    position: Row | None = None
    tag_noise: float = 0.002
    sigma_px: float = 0.1
    miss_rate: float = 0.0
    hidden: tuple[tuple[float, float], ...] = ()
    exchanged_from: float | None = None
    objects: tuple[ColouredObject, ...] = ()
    centre_bgr: tuple[int, int, int] = (215, 95, 25)
    front_bgr: tuple[int, int, int] = (75, 190, 60)
    body: float = 0.12
    body_grey: float = 45.0
    shadow: float = 0.35
    shadow_offset: tuple[float, float] = (0.05, -0.03)
    noise: float = 4.0
    blur: float = 0.7
    jpeg_quality: int = 92

    def __post_init__(self) -> None:
        imaging(self)
        for name in ("tag_noise", "sigma_px", "body"):
            not_negative(name, getattr(self, name))
        between("miss_rate", self.miss_rate, 0.0, 1.0)
        between("shadow", self.shadow, 0.0, 0.9)
        between("body_grey", self.body_grey, 0.0, 255.0)
        for level in (*self.centre_bgr, *self.front_bgr):
            between("centre_bgr or front_bgr", level, 0, 255)
        if (self.area is None) == (self.homography is None):
            raise BadConfig("overhead: give area or homography, one of them")
        if self.area is not None and not (
            self.area[0] < self.area[2] and self.area[1] < self.area[3]
        ):
            raise BadConfig(
                f"area = {list(self.area)}: smallest x, smallest y, largest x, largest y, m"
            )
        for begin, end in self.hidden:
            if not begin < end:
                raise BadConfig(f"hidden = {[begin, end]}: needs its beginning before its end, s")
        if self.tag_noise == self.sigma_px == 0.0:
            raise BadConfig("tag_noise and sigma_px are both 0: a pose needs some noise to state")

    def is_hidden(self, t: float) -> bool:
        """Returns whether the tags are hidden at a time, whatever ``miss_rate`` says."""
        return any(begin <= t < end for begin, end in self.hidden)

    def is_exchanged(self, t: float) -> bool:
        """Returns whether the tags have each other's colour at a time."""
        return self.exchanged_from is not None and t >= self.exchanged_from


def overhead_camera(spec: OverheadSpec) -> OverheadCamera:
    """Returns the camera that a scenario describes.

    Raises:
        BadConfig: it is none that there can be.
    """
    width, height = spec.image_size
    if spec.homography is not None:
        homography = np.array(spec.homography)
    else:
        assert spec.area is not None, "checked on entry"
        x0, y0, x1, y1 = spec.area
        scale = min(width / (x1 - x0), height / (y1 - y0))  # pixels for a metre
        u = 0.5 * (width - 1) - scale * 0.5 * (x0 + x1)
        v = 0.5 * (height - 1) + scale * 0.5 * (y0 + y1)
        homography = np.array([[scale, 0.0, u], [0.0, -scale, v], [0.0, 0.0, 1.0]])
    camera = Camera(NAME, "overhead", spec.image_size, homography)
    return OverheadCamera(camera, spec.tags, spec.position)
