"""The file ``log.toml`` of a log folder: robot, cameras and start."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Protocol, TypeVar

import numpy as np

from frontend.camera import LOOKS_AT, Camera
from frontend.log import DEFAULT_CAMERA, UNKNOWN_WHEELS, AnyCamera
from frontend.omni import BearingCorrection
from frontend.readers.omni_toml import OmniTable
from frontend.readers.overhead_toml import OverheadTable
from frontend.strict import from_dict, load_toml, nearest
from graphslam.errors import BadConfig, BadLog
from graphslam.models.wheels import DifferentialDrive

FORMAT = "graphslam-log/1"

T = TypeVar("T")

GEOMETRY = ("wheel_radius_left", "wheel_radius_right", "wheel_base")
LARGEST_START_M = 1e3  # sigma of the start: beyond it double precision loses the lines
LARGEST_OFFSET_S = 1e6
LARGEST = 1e9  # of a robot's numbers: with it and the tables' limit nothing overflows

Matrix3 = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class RobotTable:
    """``[robot]``; see `DifferentialDrive`. Radii and base may be absent with odometry.csv only."""

    wheel_radius_left: float | None = None
    wheel_radius_right: float | None = None
    wheel_base: float | None = None
    noise_left: float | None = None
    noise_right: float | None = None
    law: Literal["distance", "paper"] = "distance"
    slip: tuple[float, float, float] = (0.002, 0.002, 0.005)

    def __post_init__(self) -> None:
        for name in GEOMETRY:
            value = getattr(self, name)
            if value is not None and value > 0 and not 1 / LARGEST <= value <= LARGEST:
                raise BadConfig(f"{name} = {value}: is no robot's; write metres")
        for value in (self.noise_left or 0.0, self.noise_right or 0.0, *self.slip):
            if value > LARGEST:
                raise BadConfig(f"noise or slip = {value}: is beyond {LARGEST:g}; write it smaller")

    def drive(self, geometry_needed: bool) -> DifferentialDrive:
        """Returns the drive; without radii and base, one whose wheels have no noise of their own.

        Raises:
            BadConfig: radii and base are needed, or given in part; or a value cannot be used.
        """
        values = {name: getattr(self, name) for name in GEOMETRY}
        missing = [name for name, value in values.items() if value is None]
        if not missing:
            return DifferentialDrive(**{f.name: getattr(self, f.name) for f in fields(self)})
        if geometry_needed or len(missing) < len(GEOMETRY):
            raise BadConfig(f"{missing[0]} is missing; add `{missing[0]} = ...` in metres")
        return replace(UNKNOWN_WHEELS, slip=self.slip)


@dataclass(frozen=True, slots=True)
class CameraTable:
    """``[camera]`` or ``[cameras.NAME]``, looking at floor or ceiling; see `Camera`."""

    image_size: tuple[int, int]
    homography: Matrix3
    looks_at: str = "floor"
    matrix: Matrix3 | None = None
    distortion: tuple[float, ...] | None = None
    lens: str = "plain"
    ignore_px: tuple[tuple[float, ...], ...] = ()
    delay: float = 0.0

    def camera(self, name: str) -> Camera:
        """Returns the camera; raises BadConfig where its numbers make none."""
        matrix = None if self.matrix is None else np.array(self.matrix)
        distortion = None if self.distortion is None else np.array(self.distortion)
        return Camera(
            name,
            self.looks_at,
            self.image_size,
            np.array(self.homography),
            matrix,
            distortion,
            self.lens,
            self.ignore_px,
            self.delay,
        )


@dataclass(frozen=True, slots=True)
class StartTable:
    """``[start]``: pose at the first node and its standard deviations, m and rad."""

    pose: tuple[float, float, float]
    sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if max(map(abs, (*self.pose, *self.sigma))) > LARGEST:
            raise BadConfig(f"pose or sigma is beyond {LARGEST:g}; write metres and radians")
        if max(self.sigma[:2]) > LARGEST_START_M or self.sigma[2] > math.pi:
            raise BadConfig(
                f"sigma = {list(self.sigma)}: at most {LARGEST_START_M:g} m and pi; write what is "
                "known of the start, or leave [start] out"
            )
        if min(self.sigma) < 0:
            raise BadConfig(f"sigma = {list(self.sigma)}: standard deviations are not negative")


@dataclass(frozen=True, slots=True)
class TimeTable:
    """``[time]``."""

    camera_offset: float = 0.0
    """What to add to the times of images and sightings, s."""

    def __post_init__(self) -> None:
        if abs(self.camera_offset) > LARGEST_OFFSET_S:
            raise BadConfig(f"camera_offset = {self.camera_offset}: is no offset in seconds")


@dataclass(frozen=True, slots=True)
class LogTable:
    """The whole file, cameras not yet looked into."""

    format: str
    name: str | None = None
    robot: RobotTable | None = None
    camera: Mapping[str, Any] | None = None
    cameras: Mapping[str, Any] = field(default_factory=dict)
    start: StartTable | None = None
    video: str | None = None
    time: TimeTable = TimeTable()
    bearings: BearingCorrection = field(default_factory=BearingCorrection)
    """What to add to bearings.csv."""

    def __post_init__(self) -> None:
        check_name(self.name)


def check_name(name: str | None) -> None:
    """Raises BadConfig where a log's name cannot be that of a folder."""
    if name is not None and (
        not name.strip() or len(name) > 100 or name[0] == "." or not _plain(name)
    ):
        raise BadConfig(
            f"name = {name[:100]!r}: becomes the name of a folder; write 1 to 100 characters, "
            'no / \\ : * ? " < > |, no dot at the beginning'
        )


def read_log_toml(path: Path) -> LogTable:
    """Returns the content of ``log.toml``.

    Raises:
        BadLog: the file contradicts the format.
    """
    return read_formatted(path, LogTable, FORMAT)


def read_formatted(path: Path, kind: type[T], form: str, cure: str = "") -> T:
    """Returns the content of a TOML file whose first line names its format.

    Args:
        path: the file.
        kind: what is in it.
        form: the format that this version reads.
        cure: what more to do about another one.

    Raises:
        BadLog: the file contradicts the format.
    """
    content = load_toml(path, BadLog)
    if content.get("format") != form:
        found = f"format = {content['format']!r}" if "format" in content else "no format line"
        raise BadLog(
            f'{path}: {found}; this version reads `format = "{form}"`, the first line of the '
            f"file{cure}"
        )
    return from_dict(kind, content, str(path), BadLog)


class _Described(Protocol):
    def camera(self, name: str) -> AnyCamera:
        """Returns the camera; raises BadConfig where its numbers make none."""
        ...


TABLES: Mapping[str, type[_Described]] = MappingProxyType(
    {"floor": CameraTable, "ceiling": CameraTable, "overhead": OverheadTable, "omni": OmniTable}
)
"""By where a camera looks: the keys that describe it."""


def every_camera(path: Path, content: LogTable) -> dict[str, AnyCamera]:
    """Returns the cameras by name.

    Raises:
        BadLog: a camera is described wrongly.
    """
    found: dict[str, AnyCamera] = {}
    for at, name, table, looks_at in _cameras(path, content):
        given = from_dict(TABLES[looks_at], table, str(path), BadLog, at)
        try:
            found[name] = given.camera(name)
        except BadConfig as refused:
            raise BadLog(f"{path}: [{at}] {refused}") from None
    return found


def _cameras(path: Path, content: LogTable) -> Iterator[tuple[str, str, Any, str]]:
    """Yields of each camera where it is described, its name, its table and where it looks."""
    tables: dict[str, tuple[str, Any]] = {}
    if content.camera is not None:
        if DEFAULT_CAMERA in content.cameras:
            raise BadLog(
                f"{path}: has [camera] and [cameras.{DEFAULT_CAMERA}], which mean the same camera; "
                "remove one"
            )
        tables["camera"] = (DEFAULT_CAMERA, content.camera)
    tables |= {f"cameras.{name}": (name, table) for name, table in content.cameras.items()}
    for at, (name, table) in tables.items():
        yield at, name, table, _looks_at(path, at, name, table)


def _looks_at(path: Path, at: str, name: str, table: Any) -> str:
    if not isinstance(table, Mapping):
        raise BadLog(f"{path}: {at} must be a table: write [{at}] with the camera's keys below")
    looks_at = table.get("looks_at", "floor" if name == DEFAULT_CAMERA else None)
    if looks_at is None:
        raise BadLog(f'{path}: {at}.looks_at is missing; add `looks_at = "floor"` under [{at}]')
    if looks_at not in LOOKS_AT:
        cure = nearest(str(looks_at), LOOKS_AT)
        raise BadLog(f"{path}: {at}.looks_at = {looks_at!r} is not known; {cure}")
    return str(looks_at)


def _plain(name: str) -> bool:
    return name.isprintable() and not set(name) & set('/\\:*?"<>|')
