"""What a scenario says of the ceiling: its lamps, and the camera that looks up at them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from frontend.simulate.checks import between, imaging, not_negative, positive
from frontend.simulate.sensors import Matrix
from graphslam.errors import BadConfig
from graphslam.geometry import Array
from graphslam.measurements import LandmarkMap


@dataclass(frozen=True, slots=True)
class Lamp:
    """One lamp.

    Attributes:
        x: m, floor frame.
        y: m.
        phi_deg: direction of its long axis, degrees, default 0.
        dark: whether it is out of order: listed in landmarks.csv, never seen. Default false.
    """

    x: float
    y: float
    phi_deg: float = 0.0
    dark: bool = False


@dataclass(frozen=True, slots=True)
class UpwardCamera:
    """The camera that looks up, by its homography or by how fine it sees.

    Attributes:
        image_size: (width, height), pixels.
        rate: images per second.
        metres_per_pixel: in the plane of the lamps, straight above the robot, the top of the image
            ahead; or the homography.
        homography: (3, 3) plane of the lamps (robot frame, m) to undistorted pixel.
        matrix: (3, 3) camera matrix, pixels; only with distortion.
        distortion: OpenCV coefficients; only with matrix.
        lens: "plain" or "fisheye": which of OpenCV's models they belong to, default plain.
        delay: from an image to when what it shows is known, s, default 0.
        noise: standard deviation of a pixel, grey levels, default 3.
        blur: standard deviation of the lens's blur, pixels, default 0.7.
        exposure: amplitude of the slow change of brightness, as a share, default 0.
        exposure_period: s, default 7.
        black_rate: probability that an image is black, whatever is above, default 0.
        jpeg_quality: 1 to 100, default 90; 0 writes PNG, without loss.
    """

    image_size: tuple[int, int]
    rate: float
    metres_per_pixel: float | None = None
    homography: Matrix | None = None
    matrix: Matrix | None = None
    distortion: tuple[float, ...] | None = None
    lens: Literal["plain", "fisheye"] = "plain"
    delay: float = 0.0
    noise: float = 3.0
    blur: float = 0.7
    exposure: float = 0.0
    exposure_period: float = 7.0
    black_rate: float = 0.0
    jpeg_quality: int = 90

    def __post_init__(self) -> None:
        imaging(self)
        positive("exposure_period", self.exposure_period)
        not_negative("delay", self.delay)
        between("exposure", self.exposure, 0.0, 0.9)
        between("black_rate", self.black_rate, 0.0, 1.0)
        if (self.homography is None) == (self.metres_per_pixel is None):
            raise BadConfig("give metres_per_pixel or homography, one of them")
        if self.metres_per_pixel is not None:
            positive("metres_per_pixel", self.metres_per_pixel)


@dataclass(frozen=True, slots=True)
class LampSpec:
    """Lamps as they are seen where no images are rendered.

    Attributes:
        sigma: stated standard deviation of a lamp's place, along x and y, m, default 0.01.
        sigma_phi_deg: of its axis, degrees, default 1.
        timing: standard deviation of when an image was taken, s, default 0.005: noise that grows
            with speed.
        visible: share of a lamp that must be in view, default 0.67.
        miss_rate: probability that a lamp in view is not seen, default 0.
    """

    sigma: float = 0.01
    sigma_phi_deg: float = 1.0
    timing: float = 0.005
    visible: float = 0.67
    miss_rate: float = 0.0

    def __post_init__(self) -> None:
        for name in ("sigma", "sigma_phi_deg"):
            positive(name, getattr(self, name))
        not_negative("timing", self.timing)
        between("visible", self.visible, 0.01, 1.0)
        between("miss_rate", self.miss_rate, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Ceiling:
    """A ceiling with lamps of one size, and the camera that looks at it.

    Attributes:
        lamps: the lamps; numbered in landmarks.csv in this order.
        camera: the camera.
        size: length and width of a lamp, m, default (0.6, 0.25).
        known: whether landmarks.csv tells where the lamps are, default true.
        bright: grey level of a lamp, above 255 it is overexposed; default 300.
        dark: grey level of the ceiling, default 18.
        reflections: how many bright fringes each lamp has at its border, default 5.
        seen: how lamps are seen where no images are rendered.
    """

    lamps: tuple[Lamp, ...]
    camera: UpwardCamera
    size: tuple[float, float] = (0.6, 0.25)
    known: bool = True
    bright: float = 300.0
    dark: float = 18.0
    reflections: int = 5
    seen: LampSpec = field(default_factory=LampSpec)

    def __post_init__(self) -> None:
        if not self.lamps:
            raise BadConfig("lamps is empty: list at least one, such as { x = 1.0, y = 0.0 }")
        if not 0 < self.size[1] <= self.size[0]:
            raise BadConfig(f"size = {list(self.size)}: must be positive, the length first")
        between("dark", self.dark, 0.0, 255.0)
        between("bright", self.bright, self.dark, 10_000.0)
        between("reflections", self.reflections, 0, 1000)

    def places(self) -> Array:
        """Returns the lamps (L, 3), ``(x, y, phi)``, floor frame, m and rad."""
        rows = [(lamp.x, lamp.y, np.deg2rad(lamp.phi_deg)) for lamp in self.lamps]
        return np.array(rows, float).reshape(-1, 3)

    def lit(self) -> Array:
        """Returns the numbers of the lamps that are not out of order."""
        return np.flatnonzero([not lamp.dark for lamp in self.lamps])

    def landmarks(self) -> LandmarkMap:
        """Returns the lamps as landmarks, those out of order too: a map does not know of it."""
        count = len(self.lamps)
        return LandmarkMap(
            id=np.arange(count),
            kind=("lamp",) * count,
            params=self.places(),
            extent=np.full((count, 2), np.nan),
            sightings=np.zeros(count, np.int64),
        )
