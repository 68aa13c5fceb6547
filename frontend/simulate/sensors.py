"""What a scenario says of the camera, the encoders, and of sightings without images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from frontend.simulate.checks import between, imaging, not_negative, positive
from frontend.simulate.printed_view import PRINTED_IMAGE_SIZE
from graphslam.errors import BadConfig

Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """The camera, by its homography, by what it sees of the floor, or by a paper's print.

    Attributes:
        image_size: (width, height), pixels.
        rate: images per second.
        homography: (3, 3) floor (robot frame, m) to undistorted pixel; or the others below.
        view_width: width of the floor in view half way between near and far, m.
        view_near: floor at the lower edge of the image, m ahead of the robot.
        view_far: floor at the upper edge of the image, m ahead of the robot.
        printed: instead of all these "santana-loc", the view of the homography printed there, in
            pixels of 640x480.
        matrix: (3, 3) camera matrix, pixels; only with distortion.
        distortion: OpenCV coefficients; only with homography and matrix.
        lens: "plain" or "fisheye": which of OpenCV's models they belong to, default plain.
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
    printed: Literal["santana-loc"] | None = None
    matrix: Matrix | None = None
    distortion: tuple[float, ...] | None = None
    lens: Literal["plain", "fisheye"] = "plain"
    noise: float = 3.0
    blur: float = 0.7
    jpeg_quality: int = 90

    def __post_init__(self) -> None:
        imaging(self)
        self._check_view()

    def _check_view(self) -> None:
        """Raises BadConfig unless the view is given in exactly one way."""
        view = (self.view_width, self.view_near, self.view_far)
        ways = {
            "printed": self.printed is not None,
            "homography": self.homography is not None,
            "view_width, view_near, view_far": any(v is not None for v in view),
        }
        given = [name for name, there in ways.items() if there]
        if len(given) > 1:
            raise BadConfig(f"give {' or '.join(given)}, not both")
        if not given or (ways["view_width, view_near, view_far"] and None in view):
            raise BadConfig("give homography, or all of view_width, view_near and view_far")
        if self.printed is not None and self.image_size != PRINTED_IMAGE_SIZE:
            width, height = PRINTED_IMAGE_SIZE
            raise BadConfig(
                f"image_size = {list(self.image_size)}: the printed view is in pixels of "
                f"[{width}, {height}]; write that"
            )
        if self.homography is None and not (self.matrix is None and self.distortion is None):
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
        positive("rate", self.rate)
        not_negative("ticks", self.ticks)


@dataclass(frozen=True, slots=True)
class SightingSpec:
    """Lines as they are seen where no images are rendered.

    Attributes:
        sigma_rho: stated standard deviation of rho, m; None: SantanaLoc's formula.
        sigma_alpha_deg: stated standard deviation of alpha, degrees; None: 0.5.
        factor: on the stated standard deviations of both, default 1.
        scale: standard deviation of the noise that is drawn, as a multiple of the stated one,
            default 1.
        min_stretch: a line is seen where at least this much of it is in view, m, default 0.2.
        miss_rate: probability that a line in view is not seen, default 0.
        false_rate: mean number of sightings for each frame that are of no line, default 0.
        reach: instead of the camera's view: all floor within this distance of the robot is in
            view, m.
        rate: frames per second where there is no camera; only with reach.
    """

    sigma_rho: float | None = None
    sigma_alpha_deg: float | None = None
    factor: float = 1.0
    scale: float = 1.0
    min_stretch: float = 0.2
    miss_rate: float = 0.0
    false_rate: float = 0.0
    reach: float | None = None
    rate: float | None = None

    def __post_init__(self) -> None:
        for name in ("sigma_rho", "sigma_alpha_deg", "factor", "reach", "rate"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name))
        for name in ("scale", "min_stretch"):
            not_negative(name, getattr(self, name))
        between("miss_rate", self.miss_rate, 0.0, 1.0)
        between("false_rate", self.false_rate, 0.0, 100.0)
