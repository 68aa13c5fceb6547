"""Robot files, format ``graphslam-robot/1``: what a bag does not say (docs/bags.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from frontend.readers.log_toml import (
    RobotTable,
    StartTable,
    TimeTable,
    check_name,
    read_formatted,
)

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
class BagTimeTable(TimeTable):
    """``[time]``."""

    stamp: Literal["header", "receive"] = "header"
    """When a message happened: the stamp in its header, or when it was received."""


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
    time: BagTimeTable = field(default_factory=BagTimeTable)
    laser: LaserTable | None = None
    map: str | None = None
    """Path of a map.csv with true or known lines, from the robot file on."""
    landmarks: str | None = None
    """Path of a landmarks.csv with known lamps or points, from the robot file on."""

    def __post_init__(self) -> None:
        check_name(self.name)


def read_robot_file(path: Path) -> RobotFile:
    """Returns the content of a robot file.

    Raises:
        BadLog: the file contradicts the format.
    """
    return read_formatted(path, RobotFile, FORMAT, "; `graphslam inspect BAG` proposes one")
