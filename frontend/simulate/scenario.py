"""What a scenario file says: a floor, a robot, its path and its camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from frontend.readers.log_toml import FORMAT as LOG_FORMAT
from frontend.readers.log_toml import LogTable
from graphslam.errors import BadConfig
from graphslam.models.odometry import DifferentialDrive

ESTIMATORS_FLOOR = DifferentialDrive(1.0, 1.0, 1.0).floor

Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]


@dataclass(frozen=True, slots=True)
class FloorLine:
    """One straight line on the floor, endless in both directions.

    Attributes:
        rho: distance from the floor's origin, m; may be negative.
        alpha_deg: direction of the line's normal, degrees.
    """

    rho: float
    alpha_deg: float


@dataclass(frozen=True, slots=True)
class LineGrid:
    """Parallel lines.

    Attributes:
        alpha_deg: direction of the lines' normal, degrees.
        first: rho of the first line, m.
        spacings: distances from each line to the next, m; one line more than spacings.
    """

    alpha_deg: float
    first: float
    spacings: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for spacing in self.spacings:
            _positive("spacings", spacing)


@dataclass(frozen=True, slots=True)
class Groove:
    """How the lines look.

    Attributes:
        width: m, default 0.007.
        contrast: grey of the line minus grey of the floor, grey levels; negative is dark, default
            -90.
        softness: standard deviation of the line's edges across it, m, default 0.001.
    """

    width: float = 0.007
    contrast: float = -90.0
    softness: float = 0.001

    def __post_init__(self) -> None:
        _positive("width", self.width)
        _between("contrast", self.contrast, -255.0, 255.0)
        _not_negative("softness", self.softness)


@dataclass(frozen=True, slots=True)
class Surface:
    """The floor between the lines.

    Attributes:
        grey: mean grey level, default 140.
        texture: standard deviation of the texture, grey levels, default 4.
        texture_scale: shortest wavelength of the texture, m, default 0.03.
    """

    grey: float = 140.0
    texture: float = 4.0
    texture_scale: float = 0.03

    def __post_init__(self) -> None:
        _between("grey", self.grey, 0.0, 255.0)
        _not_negative("texture", self.texture)
        _positive("texture_scale", self.texture_scale)


@dataclass(frozen=True, slots=True)
class Light:
    """Light on the floor and through the lens, as fractions of the mean brightness.

    Attributes:
        gradient: brightness of the right edge minus the left one's, and of the lower edge minus
            the upper one's; default (0.1, 0.1).
        vignette: darkening in the corners of the image, default 0.15.
        patches: standard deviation of light and shade lying on the floor, default 0.06.
        patch_scale: size of those patches, m, default 0.8.
        drift: amplitude of the slow change of all light over time, default 0.05.
        drift_period: s, default 25.
    """

    gradient: tuple[float, float] = (0.1, 0.1)
    vignette: float = 0.15
    patches: float = 0.06
    patch_scale: float = 0.8
    drift: float = 0.05
    drift_period: float = 25.0

    def __post_init__(self) -> None:
        for part in self.gradient:
            _between("gradient", part, -1.0, 1.0)
        for name in ("vignette", "patches", "drift"):
            _between(name, getattr(self, name), 0.0, 0.9)
        _positive("patch_scale", self.patch_scale)
        _positive("drift_period", self.drift_period)


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """The camera, by its homography or by what it sees of the floor.

    Attributes:
        image_size: (width, height), pixels.
        rate: images per second.
        homography: (3, 3) floor (robot frame, m) to undistorted pixel; or the three below.
        view_width: width of the floor in view half way between near and far, m.
        view_near: floor at the lower edge of the image, m ahead of the robot.
        view_far: floor at the upper edge of the image, m ahead of the robot.
        matrix: (3, 3) camera matrix, pixels; only with distortion.
        distortion: OpenCV coefficients; only with homography and matrix.
        noise: standard deviation of a pixel, grey levels, default 3.
        blur: standard deviation of the lens's blur of the lines, pixels, default 0.7; below 0.5
            lines thinner than a pixel flicker, as without a lens.
        jpeg_quality: 1 to 100, default 90; 0 writes PNG, without loss.
    """

    image_size: tuple[int, int]
    rate: float
    homography: Matrix | None = None
    view_width: float | None = None
    view_near: float | None = None
    view_far: float | None = None
    matrix: Matrix | None = None
    distortion: tuple[float, ...] | None = None
    noise: float = 3.0
    blur: float = 0.7
    jpeg_quality: int = 90

    def __post_init__(self) -> None:
        _positive("rate", self.rate)
        for name in ("noise", "blur"):
            _not_negative(name, getattr(self, name))
        _between("jpeg_quality", self.jpeg_quality, 0, 100)
        if any(not 1 <= n <= 10_000 for n in self.image_size):
            raise BadConfig(f"image_size = {list(self.image_size)}: must be 1 to 10000 pixels")
        view = (self.view_width, self.view_near, self.view_far)
        if self.homography is not None and any(v is not None for v in view):
            raise BadConfig("give homography or view_width, view_near, view_far, not both")
        if self.homography is None:
            if any(v is None for v in view):
                raise BadConfig("give homography, or all of view_width, view_near and view_far")
            if self.matrix is not None or self.distortion is not None:
                raise BadConfig("matrix and distortion need the homography they belong to")


@dataclass(frozen=True, slots=True)
class Encoder:
    """The wheel encoders.

    Attributes:
        rate: readings per second, default 20; choose a multiple of the camera's.
        ticks: ticks for each turn of a wheel; 0, the default, reads without steps.
    """

    rate: float = 20.0
    ticks: int = 0

    def __post_init__(self) -> None:
        _positive("rate", self.rate)
        _not_negative("ticks", self.ticks)


@dataclass(frozen=True, slots=True)
class Start:
    """Where the robot stands at first.

    Attributes:
        x: m, default 0.
        y: m, default 0.
        heading_deg: degrees, default 0.
        known: whether log.toml tells the start, exactly; false leaves [start] out of it, so that
            estimates begin at the origin. Default true.
    """

    x: float = 0.0
    y: float = 0.0
    heading_deg: float = 0.0
    known: bool = True


@dataclass(frozen=True, slots=True)
class Motion:
    """One piece of the path: exactly one of forward, turn_deg, arc_deg and pause.

    Attributes:
        forward: m; negative drives backwards.
        turn_deg: turn on the spot, degrees, counter-clockwise positive.
        arc_deg: turn while driving forwards along a circle, degrees, counter-clockwise positive.
        radius: radius of that circle, m.
        pause: s.
        speed: m/s, instead of the scenario's.
        turn_rate_deg: degrees/s, instead of the scenario's.
    """

    forward: float | None = None
    turn_deg: float | None = None
    arc_deg: float | None = None
    radius: float | None = None
    pause: float | None = None
    speed: float | None = None
    turn_rate_deg: float | None = None

    def __post_init__(self) -> None:
        kinds = ("forward", "turn_deg", "arc_deg", "pause")
        given = [name for name in kinds if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) if given else "none of them"
            raise BadConfig(f"a motion has one of {', '.join(kinds)}; found {found}")
        if (self.arc_deg is None) != (self.radius is None):
            raise BadConfig("arc_deg and radius come together")
        for name in ("radius", "pause", "speed", "turn_rate_deg"):
            if getattr(self, name) is not None:
                _positive(name, getattr(self, name))


@dataclass(frozen=True, slots=True)
class Scenario:
    """A world, a robot in it, and how it drives and sees.

    Attributes:
        format: the version of this format.
        name: name of the log.
        robot: wheels, base, noise law and slip, as in log.toml; the log's [robot].
        camera: the camera and its images.
        path: motions, one after the other.
        start: pose before the first motion.
        lines: single lines; numbered first in map.csv.
        grids: families of parallel lines, numbered after them.
        speed: m/s, default 0.3.
        turn_rate_deg: degrees/s, default 45.
        encoder: the wheel encoders.
        groove: how the lines look.
        surface: the floor between them.
        light: brightness over floor, image and time.
    """

    format: Literal["graphslam-scenario/1"]
    name: str
    robot: DifferentialDrive
    camera: CameraSpec
    path: tuple[Motion, ...]
    start: Start = field(default_factory=Start)
    lines: tuple[FloorLine, ...] = ()
    grids: tuple[LineGrid, ...] = ()
    speed: float = 0.3
    turn_rate_deg: float = 45.0
    encoder: Encoder = field(default_factory=Encoder)
    groove: Groove = field(default_factory=Groove)
    surface: Surface = field(default_factory=Surface)
    light: Light = field(default_factory=Light)

    def __post_init__(self) -> None:
        _positive("speed", self.speed)
        _positive("turn_rate_deg", self.turn_rate_deg)
        if not self.path:
            raise BadConfig("path is empty: list at least one motion, such as { forward = 1.0 }")
        if self.robot.floor != ESTIMATORS_FLOOR:
            raise BadConfig("robot.floor is the estimators' own and not simulated: remove it")
        LogTable(LOG_FORMAT, self.name)  # refuses names that no log may have


def _positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise BadConfig(f"{name} = {value}: must be above 0")


def _not_negative(name: str, value: float) -> None:
    if not (math.isfinite(value) and value >= 0):
        raise BadConfig(f"{name} = {value}: must be 0 or more")


def _between(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise BadConfig(f"{name} = {value}: must be between {low:g} and {high:g}")
