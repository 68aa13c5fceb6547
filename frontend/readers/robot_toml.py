"""Robot files, format ``graphslam-robot/1``: what a bag does not say (docs/bags.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from frontend.readers.log_toml import LARGEST_OFFSET_S, RobotTable, StartTable, check_name
from frontend.strict import from_dict, load_toml
from graphslam.errors import BadConfig, BadLog

FORMAT = "graphslam-robot/1"


@dataclass(frozen=True, slots=True)
class TopicTable:
    """``[topics]``: which topic is what; what is absent is looked for by its type."""

    wheels: str | None = None
    """sensor_msgs/JointState with the angles of both wheels."""
    odometry: str | None = None
    """nav_msgs/Odometry, or a tf topic (with [frames]); used where there are no wheels."""
    images: Mapping[str, str] = field(default_factory=dict)
    """sensor_msgs/Image or CompressedImage by the name of its camera."""
    scans: str | None = None
    """sensor_msgs/LaserScan."""
    truth: str | None = None
    """geometry_msgs/PoseStamped or PoseWithCovarianceStamped, or nav_msgs/Odometry."""


@dataclass(frozen=True, slots=True)
class JointTable:
    """``[joints]``: names of the wheels' joints."""

    left: str
    right: str


@dataclass(frozen=True, slots=True)
class FrameTable:
    """``[frames]``: names of the frames in tf."""

    odometry: str | None = None
    robot: str | None = None


@dataclass(frozen=True, slots=True)
class TimeTable:
    """``[time]``."""

    stamp: Literal["header", "receive"] = "header"
    """When a message happened: the stamp in its header, or when it was received."""
    camera_offset: float = 0.0
    """What to add to the times of the images, s."""

    def __post_init__(self) -> None:
        if abs(self.camera_offset) > LARGEST_OFFSET_S:
            raise BadConfig(f"camera_offset = {self.camera_offset}: is no offset in seconds")


@dataclass(frozen=True, slots=True)
class LaserTable:
    """``[laser]``: where the laser is, in place of what tf says."""

    pose: tuple[float, float, float]
    """x, y, heading in the robot frame, m and rad."""


@dataclass(frozen=True, slots=True)
class RobotFile:
    """The whole file, cameras not yet looked into."""

    format: str = FORMAT
    name: str | None = None
    robot: RobotTable | None = None
    camera: Mapping[str, Any] | None = None
    cameras: Mapping[str, Any] = field(default_factory=dict)
    start: StartTable | None = None
    topics: TopicTable = field(default_factory=TopicTable)
    joints: JointTable | None = None
    frames: FrameTable = field(default_factory=FrameTable)
    time: TimeTable = field(default_factory=TimeTable)
    laser: LaserTable | None = None
    map: str | None = None
    """Path of a map.csv with true or known lines, from the robot file on."""

    def __post_init__(self) -> None:
        check_name(self.name)


def read_robot_file(path: Path) -> RobotFile:
    """Returns the content of a robot file, its format line checked first.

    Raises:
        BadLog: the file contradicts the format.
    """
    content = load_toml(path, BadLog)
    if content.get("format") != FORMAT:
        found = f"format = {content['format']!r}" if "format" in content else "no format line"
        raise BadLog(
            f'{path}: {found}; this version reads `format = "{FORMAT}"`, the first line of the '
            "file; `graphslam inspect BAG` proposes one"
        )
    return from_dict(RobotFile, content, str(path), BadLog)
