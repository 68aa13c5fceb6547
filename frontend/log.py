"""What was recorded: `Log`, and `open_log`, which picks the reader by what it finds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from frontend.camera import LOOKS_AT, Camera
from frontend.columns import read_only
from frontend.log_parts import (
    BearingSightings,
    ImageList,
    LampSightings,
    LineSightings,
    PoseFixes,
    PoseTrack,
    Wheels,
)
from frontend.omni import BearingCorrection, OmniCamera
from frontend.overhead import OverheadCamera
from frontend.recorded import ScanList
from graphslam.errors import BadLog
from graphslam.geometry import Array
from graphslam.measurements import IntArray, LandmarkMap
from graphslam.models.wheels import DifferentialDrive

Progress = Callable[[int, int], None]
"""Called with (bytes read, bytes in all) while a recording is opened."""

DEFAULT_CAMERA = "floor"
"""The camera of images that name none."""

AnyCamera = Camera | OverheadCamera | OmniCamera
"""Each has `name`, `looks_at`, `image_size` and `delay_s`."""

FOUND_ALREADY = MappingProxyType(
    {
        "floor": "sightings",
        "ceiling": "lamps",
        "overhead": "pose_fixes",
        "omni": "bearings",
    }
)
"""By where a camera looks: the field of `Log` with what others found in images of that sort."""

UNKNOWN_WHEELS = DifferentialDrive(1.0, 1.0, wheel_base=0.2, noise_left=0.0, noise_right=0.0)
"""Stands for the drive of odometry from unknown wheels: only slip acts, and turning by one radian
counts as driving 0.1 m."""


@dataclass(frozen=True, slots=True)
class Log:
    """A recording, checked, whatever its format.

    Attributes:
        name: short name; usable as the name of a folder.
        folder: where it lies.
        robot: geometry and noise of the wheels; None where only foreign odometry is known.
        cameras: cameras by name, wherever each of them `looks_at`.
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
        bearing_correction: what is to be added to the directions of ``bearings``.
    """

    name: str
    folder: Path
    robot: DifferentialDrive | None
    cameras: Mapping[str, AnyCamera]
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
    bearing_correction: BearingCorrection = field(default_factory=BearingCorrection)

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", MappingProxyType(dict(self.cameras)))
        object.__setattr__(self, "labels", MappingProxyType({**FILES, **self.labels}))
        for name in ("start_pose", "start_sigma"):
            object.__setattr__(self, name, read_only(name, getattr(self, name), (3,)))
        if self.wheels is None and self.odometry is None:
            raise BadLog(f"{self.name}: has neither wheel readings nor odometry poses; record one")
        if self.wheels is not None and self.robot is None:
            raise BadLog(f"{self.name}: wheel readings need the robot's wheel radii and base")

    def looking_at(self, where: str) -> dict[str, Any]:
        """Returns the cameras that look at "floor", "ceiling", "overhead" or "omni", by name."""
        return {name: eye for name, eye in self.cameras.items() if eye.looks_at == where}

    def images_of(self, where: str) -> IntArray:
        """Returns the numbers (row in `images`) of the images that are searched for one thing.

        They are those of the cameras that look at "floor", "ceiling", "overhead" or "omni". Beside
        what was already found there (`FOUND_ALREADY`) there are none, but of the floor: there
        images say when there were images, and "floor" needs no description.
        """
        found = getattr(self, FOUND_ALREADY[where]) is not None
        if self.images is None or (found and where != "floor"):
            return np.zeros(0, np.int64)
        names = {*self.looking_at(where)} | ({DEFAULT_CAMERA} if found else set())
        return np.flatnonzero([name in names for name in self.images.camera])

    def searched_images(self) -> IntArray:
        """Returns the numbers of all images that are searched for anything, in order."""
        return np.unique(np.concatenate([self.images_of(where) for where in LOOKS_AT]))

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
