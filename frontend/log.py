"""What was recorded: `Log`, and `open_log`, which picks the reader by what it finds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from frontend.camera import Camera
from frontend.columns import freeze, read_only
from frontend.omni import BearingCorrection, OmniCamera
from frontend.overhead import OverheadCamera
from frontend.recorded import RecordedImage, ScanList
from graphslam.errors import BadLog
from graphslam.geometry import Array
from graphslam.measurements import IntArray, LandmarkMap
from graphslam.models.odometry import DifferentialDrive

Progress = Callable[[int, int], None]
"""Called with (bytes read, bytes in all) while a recording is opened."""

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
        scans: scans of a laser, or None. In a log without floor images or sightings.csv walls are
            looked for in them, and their times are the nodes.
        labels: what messages call a part of the log, by the name of its field: "wheels" is a file
            of a log folder, or a topic of a bag.
        described: what messages call the file that describes robot and cameras.
        offset_s: what was added to the times of images and sightings by `with_camera_offset`, s.
        bearings: directions of points, or None.
        lamps: lamps already detected, or None.
        landmarks: landmarks of any kind but lines that are known beforehand, or None.
        omni: cameras that see all around, by name.
        bearing_correction: what is to be added to the directions of ``bearings``.
        overhead: cameras that watch the robot from above, by name.
        ceiling: cameras that look at the ceiling, by name.
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
    scans: ScanList | None = None
    labels: Mapping[str, str] = field(default_factory=dict)
    described: str = "log.toml"
    offset_s: float = 0.0
    bearings: BearingSightings | None = None
    lamps: LampSightings | None = None
    landmarks: LandmarkMap | None = None
    omni: Mapping[str, OmniCamera] = field(default_factory=dict)
    bearing_correction: BearingCorrection = field(default_factory=BearingCorrection)
    overhead: Mapping[str, OverheadCamera] = field(default_factory=dict)
    ceiling: Mapping[str, Camera] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("cameras", "omni", "overhead", "ceiling"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        object.__setattr__(self, "labels", MappingProxyType({**FILES, **self.labels}))
        for name in ("start_pose", "start_sigma"):
            object.__setattr__(self, name, read_only(name, getattr(self, name), (3,)))
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

    def omni_images(self) -> IntArray:
        """Returns the numbers (row in `images`) of the images that are searched for landmarks.

        Beside bearings that were already measured there are none.
        """
        return self._images_of(self.omni, found_already=self.bearings)

    def overhead_images(self) -> IntArray:
        """Returns the numbers (row in `images`) of the images that are searched for tags.

        Beside pose fixes that were already measured there are none.
        """
        return self._images_of(self.overhead, found_already=self.pose_fixes)

    def searched_images(self) -> IntArray:
        """Returns the numbers of all images that are searched for anything, in order."""
        kinds = (
            self.floor_images(),
            self.omni_images(),
            self.overhead_images(),
            self.ceiling_images(),
        )
        return np.unique(np.concatenate(kinds))

    def ceiling_images(self) -> IntArray:
        """Returns the numbers (row in `images`) of the images that are searched for lamps.

        Beside lamps that were already detected there are none.
        """
        return self._images_of(self.ceiling, found_already=self.lamps)

    def _images_of(self, cameras: Mapping[str, object], found_already: object) -> IntArray:
        if self.images is None or found_already is not None:
            return np.zeros(0, np.int64)
        return np.flatnonzero([name in cameras for name in self.images.camera])

    def has_walls(self) -> bool:
        """Returns whether the lines of the log are walls in a laser's scans."""
        return self.scans is not None and self.sightings is None and not len(self.searched_images())

    def where(self, part: str) -> str:
        """Returns where a part of the log is, as messages say it: a file, or a topic of a file."""
        label = self.labels[part]
        return f"{self.folder / label}" if label == FILES[part] else f"{self.folder}: {label}"


FILES = {
    "wheels": "wheels.csv",
    "odometry": "odometry.csv",
    "images": "images.csv",
    "sightings": "sightings.csv",
    "pose_fixes": "tags.csv",
    "bearings": "bearings.csv",
    "lamps": "lamps.csv",
    "scans": "scans.npz",
    "truth": "groundtruth.tum",
    "map": "map.csv",
}
"""The parts of a log, by the names of their fields, as files of a log folder."""


def with_camera_offset(log: Log, offset_s: float) -> Log:
    """Returns a log with ``offset_s`` added to the recorded times of images and sightings, s.

    The offset counts from the log as it was opened: given twice, it is added once.
    """
    if offset_s == log.offset_s:
        return log
    shift = offset_s - log.offset_s
    images, sightings = log.images, log.sightings
    if images is not None:
        images = replace(images, t=images.t + shift)
    if sightings is not None:
        received = sightings.t_received + shift
        sightings = replace(sightings, t=sightings.t + shift, t_received=received)
    return replace(log, images=images, sightings=sightings, offset_s=offset_s)


def open_log(
    path: Path | str, robot: Path | str | None = None, progress: Progress | None = None
) -> Log:
    """Returns the log at ``path``, whatever its format; the reader is picked by content.

    Args:
        path: a log folder (`docs/log-format.md`): a folder with a ``log.toml``; or a bag
            (`docs/bags.md`): a ROS 1 bag, a ROS 2 bag (its folder or its file) or an MCAP file; or
            a CARMEN log (`docs/walls.md`).
        robot: a robot file, which says what a bag does not: geometry, cameras, topics. None: what
            can be told from the bag alone.
        progress: told how much of a bag is read.

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

        if robot is not None:
            raise BadLog(
                f"{path}: is a log folder, whose log.toml describes the robot; a robot file goes "
                "with bags: leave --robot out"
            )
        return read_folder(path)
    if found == "bag":
        from frontend.readers.bag import read_bag

        return read_bag(path, None if robot is None else Path(robot), progress)
    if found == "carmen":
        from frontend.readers.carmen import read_carmen

        if robot is not None:
            raise BadLog(
                f"{path}: is a CARMEN log, whose PARAM lines describe the laser; a robot file goes "
                "with bags: leave --robot out"
            )
        return read_carmen(path)
    raise BadLog(
        f"{path}: {found}; give a folder with a log.toml in it (docs/log-format.md), a bag "
        "(docs/bags.md), or a CARMEN log (docs/walls.md)"
    )


def is_log_folder(path: Path) -> bool:
    """Returns whether there is a log folder, which describes its robot itself, at ``path``."""
    return (path / "log.toml").exists()


def _what_is(path: Path) -> str:
    """Returns the name of the format, or what else is at ``path``."""
    from frontend.readers.bag_files import is_bag
    from frontend.readers.carmen import is_carmen

    if is_log_folder(path):
        return "folder"
    if is_bag(path):
        return "bag"
    if is_carmen(path):
        return "carmen"
    if path.name == "log.toml" and path.is_file():
        return f"is a file of the log {path.parent}"
    if path.is_dir():
        return "this folder has no log.toml"
    return "is not a log" if path.exists() else "does not exist"
