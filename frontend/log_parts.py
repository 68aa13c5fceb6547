"""The parts of a `Log`: what each sensor, each detector and the truth recorded, as columns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from frontend.columns import freeze
from frontend.recorded import RecordedImage
from graphslam.errors import BadLog
from graphslam.geometry import Array
from graphslam.measurements import IntArray


@dataclass(frozen=True, slots=True)
class Wheels:
    """Readings of the wheels.

    Attributes:
        t: (W,) times, s, increasing.
        angle: (W, 2) cumulative angles of the left and right wheel, rad, forward positive.
    """

    t: Array
    angle: Array

    def __post_init__(self) -> None:
        freeze(self, t=(), angle=(2,))


@dataclass(frozen=True, slots=True)
class PoseTrack:
    """Poses over time: someone else's odometry, or ground truth.

    Attributes:
        t: (K,) times, s, increasing.
        pose: (K, 3) poses, m and rad, floor frame, or the odometry's own.
    """

    t: Array
    pose: Array

    def __post_init__(self) -> None:
        freeze(self, t=(), pose=(3,))


@dataclass(frozen=True, slots=True)
class ImageList:
    """Images of all cameras, in the order of the log: row number = number of the image.

    Attributes:
        t: (I,) times, s, not decreasing.
        file: (I,) where each is: the path of a file inside the log's folder, resolved, or a place
            in a bag or a video; `frontend.images` reads both.
        camera: (I,) name of the camera of each.
    """

    t: Array
    file: tuple[Path | RecordedImage, ...]
    camera: tuple[str, ...]

    def __post_init__(self) -> None:
        freeze(self, t=())
        if not len(self.t) == len(self.file) == len(self.camera):
            raise BadLog("images: t, file and camera must have one entry each for every image")

    def name(self, number: int, folder: Path) -> str:
        """Returns how messages call an image of the log that lies in ``folder``."""
        image = self.file[number]
        if isinstance(image, Path):
            return image.relative_to(folder.resolve()).as_posix()
        return image.name


@dataclass(frozen=True, slots=True)
class LineSightings:
    """Lines that someone already detected.

    Attributes:
        t: (K,) times, s, not decreasing.
        z: (K, 2) lines ``(rho, alpha)``, m and rad, robot frame at t.
        cov: (K, 2, 2) their covariances, robot frame.
        extent: (K, 2) stretch seen, m along the line; NaN where unknown.
        truth: (K,) true line of each, -1 for none or unknown; for judging only.
        t_received: (K,) when each became available, s, not before t.
    """

    t: Array
    z: Array
    cov: Array
    extent: Array
    truth: IntArray
    t_received: Array

    def __post_init__(self) -> None:
        freeze(self, t=(), z=(2,), cov=(2, 2), extent=(2,), truth=(), t_received=())


@dataclass(frozen=True, slots=True)
class PoseFixes:
    """Poses that a sensor read directly, for example a camera overhead.

    Attributes:
        t: (K,) times, s, not decreasing.
        z: (K, 3) poses, m and rad, floor frame.
        cov: (K, 3, 3) their covariances, floor frame.
        t_received: (K,) when each became available, s, not before t.
    """

    t: Array
    z: Array
    cov: Array
    t_received: Array

    def __post_init__(self) -> None:
        freeze(self, t=(), z=(3,), cov=(3, 3), t_received=())


@dataclass(frozen=True, slots=True)
class BearingSightings:
    """Directions of points that someone already measured.

    Attributes:
        t: (K,) times, s, not decreasing.
        z: (K, 1) directions, rad, robot frame at t.
        cov: (K, 1, 1) their variances, rad².
        label: (K,) what the sensor tells points apart by (a colour), as a number; -1 for none.
        truth: (K,) true landmark of each, -1 for none or unknown; for judging only.
        t_received: (K,) when each became available, s, not before t.
    """

    t: Array
    z: Array
    cov: Array
    label: IntArray
    truth: IntArray
    t_received: Array

    def __post_init__(self) -> None:
        freeze(self, t=(), z=(1,), cov=(1, 1), label=(), truth=(), t_received=())


@dataclass(frozen=True, slots=True)
class LampSightings:
    """Lamps, or other marks with an axis, that someone already detected.

    Attributes:
        t: (K,) times, s, not decreasing.
        z: (K, 3) place and axis ``(x, y, phi)``, m and rad, robot frame at t; phi modulo pi.
        cov: (K, 3, 3) their covariances, robot frame.
        truth: (K,) true landmark of each, -1 for none or unknown; for judging only.
        t_received: (K,) when each became available, s, not before t.
    """

    t: Array
    z: Array
    cov: Array
    truth: IntArray
    t_received: Array

    def __post_init__(self) -> None:
        freeze(self, t=(), z=(3,), cov=(3, 3), truth=(), t_received=())
