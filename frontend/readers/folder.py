"""Reader of log folders, format ``graphslam-log/1`` (docs/log-format.md)."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from frontend.log import DEFAULT_CAMERA, FOUND_ALREADY, Log, with_camera_offset
from frontend.log_parts import ImageList
from frontend.readers import folder_tables as tables
from frontend.readers import point_tables as points
from frontend.readers.log_toml import LogTable, RobotTable, every_camera, read_log_toml
from frontend.readers.scans_npz import read_scans
from frontend.readers.video import VideoImage, read_video
from graphslam.errors import BadConfig, BadLog
from graphslam.models.wheels import DifferentialDrive

T = TypeVar("T")

USED = (
    "log.toml",
    "wheels.csv",
    "odometry.csv",
    "images.csv",
    "sightings.csv",
    "tags.csv",
    "bearings.csv",
    "lamps.csv",
    "landmarks.csv",
    "groundtruth.tum",
    "map.csv",
    "scans.npz",
    "video.csv",
)
"""Files of the format that this version reads, in the order of the digest."""


NOT_SEARCHED = {
    "omni": "bearings.csv: images are not searched for landmarks, because bearings already "
    "measured are there",
    "overhead": "tags.csv: images of overhead cameras are not searched for tags, because poses "
    "already measured are there",
    "ceiling": "lamps.csv: images are not searched for lamps, because lamps already detected are "
    "there",
}
"""What the user should know, by where cameras look whose images need not be searched."""


def read_folder(folder: Path) -> Log:
    """Returns the log in a folder.

    Raises:
        BadLog: anything contradicts the format; the message names file, line and cure.
    """
    settings_path = folder / "log.toml"
    settings = read_log_toml(settings_path)
    cameras = every_camera(settings_path, settings)
    wheels = _optional(folder / "wheels.csv", tables.read_wheels)
    odometry = _optional(folder / "odometry.csv", tables.read_odometry)
    if wheels is None and odometry is None:
        raise BadLog(f"{folder}: has neither wheels.csv nor odometry.csv; add one of them")
    landmarks = _optional(folder / "map.csv", tables.read_map)
    sightings = _optional(
        folder / "sightings.csv", lambda path: tables.read_sightings(path, landmarks)
    )
    others = _optional(folder / "landmarks.csv", points.read_landmarks)
    seen, notes = _images(folder, settings, settings_path)
    # images beside sightings only say when there were images: no camera has to be described
    names = {*cameras} or ({DEFAULT_CAMERA} if sightings is not None else set())
    log = Log(
        name=settings.name or folder.resolve().name or "log",
        folder=folder,
        robot=_robot(settings_path, settings.robot, wheels is not None),
        cameras=cameras,
        start_pose=np.array(settings.start.pose if settings.start else (0.0, 0.0, 0.0)),
        start_sigma=np.array(settings.start.sigma if settings.start else (0.0, 0.0, 0.0)),
        start_given=settings.start is not None,
        wheels=wheels,
        odometry=odometry,
        images=seen
        or _optional(folder / "images.csv", lambda path: tables.read_images(path, names)),
        sightings=sightings,
        pose_fixes=_optional(folder / "tags.csv", tables.read_tags),
        truth=_optional(folder / "groundtruth.tum", tables.read_truth),
        map=landmarks,
        warnings=(),
        digest="",
        scans=_optional(folder / "scans.npz", read_scans),
        bearings=_optional(
            folder / "bearings.csv", lambda path: points.read_bearings(path, others)
        ),
        lamps=_optional(folder / "lamps.csv", lambda path: points.read_lamps(path, others)),
        landmarks=others,
        bearing_correction=settings.bearings,
    )
    warnings = (*notes, *_doubtful(log))
    log = replace(log, warnings=warnings, digest=_digest(log))
    return replace(with_camera_offset(log, settings.time.camera_offset), offset_s=0.0)


def _images(
    folder: Path, settings: LogTable, path: Path
) -> tuple[ImageList | None, tuple[str, ...]]:
    """Returns the frames of the log's video, if it has one, and what the user should know."""
    if settings.video is None:
        if _is_there(folder / "video.csv"):
            raise BadLog(
                f'{folder / "video.csv"}: belongs to a video; name it in log.toml: video = "x.mp4"'
            )
        return None, ()
    if _is_there(folder / "images.csv"):
        raise BadLog(f"{path}: names a video, and images.csv is there too; keep one of them")
    video = folder / settings.video
    try:
        inside = video.resolve().is_relative_to(folder.resolve()) and video.is_file()
    except (OSError, RuntimeError, ValueError):
        inside = False
    if not inside:
        raise BadLog(
            f"{path}: video = {settings.video[:80]!r} is no file in the log folder; put it there"
        )
    return read_video(video, folder / "video.csv")


def _is_there(path: Path) -> bool:
    return path.exists() or path.is_symlink()


def _optional(path: Path, read: Callable[[Path], T]) -> T | None:
    return read(path) if _is_there(path) else None


def _robot(path: Path, table: RobotTable | None, has_wheels: bool) -> DifferentialDrive | None:
    if table is None:
        if has_wheels:
            raise BadLog(
                f"{path}: [robot] is missing; wheels.csv needs its wheel_radius_left, "
                "wheel_radius_right and wheel_base in metres"
            )
        return None
    try:
        return table.drive(geometry_needed=has_wheels)
    except BadConfig as refused:
        raise BadLog(f"{path}: [robot] {refused}") from None


def _doubtful(log: Log) -> Iterator[str]:
    """Yields warnings about what is usable, but hardly meant."""
    if log.wheels is not None and log.odometry is not None:
        yield "odometry.csv: not used, because wheels.csv is there"
    if log.images is not None and log.sightings is not None:
        yield (
            "sightings.csv: images are not searched for lines, because lines already detected are "
            "there; images only say when there were images"
        )
    if log.scans is not None and not log.has_walls():
        yield "scans.npz: not searched for walls, because there are images or sightings.csv"
    for where, text in NOT_SEARCHED.items():
        found = getattr(log, FOUND_ALREADY[where])
        if log.images is not None and log.looking_at(where) and found is not None:
            yield text
    given = (log.sightings, log.pose_fixes, log.bearings, log.lamps)
    if not len(log.searched_images()) and all(part is None for part in given):
        yield (
            "no images that are searched, sightings.csv, bearings.csv, lamps.csv or tags.csv: "
            "there is only odometry to estimate from"
        )


def _digest(log: Log) -> str:
    """Returns the SHA-256, hexadecimal, of all files used: names, sizes, content, fixed order."""
    paths = [path for name in USED if _is_there(path := log.folder / name)]
    named = [(path.name, path) for path in paths]
    numbers = log.searched_images()
    if log.sightings is not None:  # then no image of the floor is opened
        numbers = np.setdiff1d(numbers, log.images_of("floor"))
    if log.images is not None and len(numbers):
        root = log.folder.resolve()
        files = [log.images.file[i] for i in numbers.tolist()]
        paths = [file for file in files if isinstance(file, Path)]
        named += [(path.relative_to(root).as_posix(), path) for path in paths]
    total = hashlib.sha256()
    if log.images is not None and isinstance(log.images.file[0], VideoImage):
        total.update(log.images.file[0].video.digest.encode())
    for name, path in named:
        try:
            with path.open("rb") as stream:
                content = hashlib.file_digest(stream, "sha256").hexdigest()
            total.update(f"{name}\0{path.stat().st_size}\0{content}\n".encode())
        except OSError as reason:
            raise BadLog(f"{path}: cannot be read ({reason.strerror}); check it") from None
    return total.hexdigest()
