"""What was recorded: `Log`, and `open_log`, which picks the reader by what it finds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from graphslam.errors import BadLog
from graphslam.geometry import Array
from graphslam.measurements import IntArray, LandmarkMap
from graphslam.models.odometry import DifferentialDrive

DEFAULT_CAMERA = "floor"
"""The camera of images that name none."""

UNKNOWN_WHEELS = DifferentialDrive(1.0, 1.0, wheel_base=0.2, noise_left=0.0, noise_right=0.0)
"""Stands for the drive of odometry from unknown wheels: only slip acts, and turning by one radian
counts as driving 0.1 m."""


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
        _freeze(self, t=(), angle=(2,))


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
        _freeze(self, t=(), pose=(3,))


@dataclass(frozen=True, slots=True)
class ImageList:
    """Images of all cameras, in the order of the log: row number = number of the image.

    Attributes:
        t: (I,) times, s, not decreasing.
        file: (I,) paths of the image files, resolved, inside the log's folder.
        camera: (I,) name of the camera of each.
    """

    t: Array
    file: tuple[Path, ...]
    camera: tuple[str, ...]

    def __post_init__(self) -> None:
        _freeze(self, t=())
        if not len(self.t) == len(self.file) == len(self.camera):
            raise BadLog("images: t, file and camera must have one entry each for every image")


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
        _freeze(self, t=(), z=(2,), cov=(2, 2), extent=(2,), truth=(), t_received=())


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
        _freeze(self, t=(), z=(3,), cov=(3, 3), t_received=())


@dataclass(frozen=True, slots=True)
class Log:
    """A recording, checked, whatever its format.

    Attributes:
        name: short name; usable as the name of a folder.
        folder: where it lies.
        robot: geometry and noise of the wheels; None where only foreign odometry is known.
        cameras: cameras that look at the floor, by name.
        start_pose: (3,) pose at the first node, floor frame, m and rad.
        start_sigma: (3,) its standard deviations, m and rad, as given.
        start_given: whether the log says where it starts; otherwise the origin, known.
        wheels: wheel readings, or None.
        odometry: poses of someone else's odometry, or None; used where there are no wheels.
        images: images of all cameras, or None.
        sightings: lines already detected, or None; then images are not searched for lines.
        pose_fixes: poses read directly, or None.
        truth: true poses, floor frame, or None; for judging only.
        map: true lines, floor frame, or None; for judging only.
        warnings: what the user should know; the log is usable all the same.
        digest: SHA-256 of everything used, hexadecimal.
    """

    name: str
    folder: Path
    robot: DifferentialDrive | None
    cameras: Mapping[str, Camera]
    start_pose: Array
    start_sigma: Array
    start_given: bool
    wheels: Wheels | None
    odometry: PoseTrack | None
    images: ImageList | None
    sightings: LineSightings | None
    pose_fixes: PoseFixes | None
    truth: PoseTrack | None
    map: LandmarkMap | None
    warnings: tuple[str, ...]
    digest: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", MappingProxyType(dict(self.cameras)))
        for name in ("start_pose", "start_sigma"):
            object.__setattr__(self, name, _read_only(name, getattr(self, name), (3,)))
        if self.wheels is None and self.odometry is None:
            raise BadLog(f"{self.name}: has neither wheel readings nor odometry poses; record one")
        if self.wheels is not None and self.robot is None:
            raise BadLog(f"{self.name}: wheel readings need the robot's wheel radii and base")

    def floor_images(self) -> IntArray:
        """Returns the numbers (row in `images`) of the images of floor cameras.

        Beside sightings, images only say when there were images: "floor" needs no description.
        """
        if self.images is None:
            return np.zeros(0, np.int64)
        names = {*self.cameras} | ({DEFAULT_CAMERA} if self.sightings is not None else set())
        return np.flatnonzero([name in names for name in self.images.camera])


def open_log(path: Path | str) -> Log:
    """Returns the log at ``path``, whatever its format; the reader is picked by content.

    Args:
        path: a log folder (`docs/log-format.md`): a folder with a ``log.toml``.

    Raises:
        BadLog: there is no log, or it contradicts its format; the message names file, line, cure.
    """
    path = Path(path)
    try:
        found = _what_is(path)
    except OSError as reason:
        raise BadLog(f"{path}: cannot be looked at ({reason.strerror}); check the path") from None
    if found == "folder":
        from frontend.readers.folder import read_folder

        return read_folder(path)
    raise BadLog(f"{path}: {found}; give a folder with a log.toml in it (docs/log-format.md)")


def _what_is(path: Path) -> str:
    """Returns the name of the format, or what else is at ``path``."""
    if (path / "log.toml").exists():
        return "folder"
    if path.name == "log.toml" and path.is_file():
        return f"is a file of the log {path.parent}"
    if path.is_dir():
        return "this folder has no log.toml"
    return "is not a log" if path.exists() else "does not exist"


def _freeze(instance: Any, **shapes: tuple[int, ...]) -> None:
    """Makes columns read-only after checking that they have one row for each entry of ``t``."""
    count = len(instance.t)
    for name, rest in shapes.items():
        label = f"{type(instance).__name__}.{name}"
        column = _read_only(label, getattr(instance, name), (count, *rest), name == "extent")
        object.__setattr__(instance, name, column)


def _read_only(
    label: str, value: Any, shape: tuple[int, ...], may_be_nan: bool = False
) -> NDArray[Any]:
    array: NDArray[Any] = np.array(value, np.int64 if label.endswith(".truth") else float)
    if array.shape != shape:
        raise BadLog(f"{label} has shape {array.shape}; expected {shape}")
    if not may_be_nan and not np.isfinite(array).all():
        raise BadLog(f"{label} holds NaN or infinity; leave those rows out")
    array.flags.writeable = False
    return array
