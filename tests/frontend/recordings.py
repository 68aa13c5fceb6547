"""A short log of the bundled sample, to be written in every format, and bags made by `rosbags`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from frontend.images import image_file
from frontend.log import Log, open_log
from frontend.log_parts import PoseTrack, Wheels
from frontend.readers.bag_types import store_of
from frontend.write_bag import robot_file_text
from frontend.write_folder import write_images_csv, write_log, write_map

ROOT = Path(__file__).resolve().parents[2]
FORMATS = ("rosbag1", "rosbag2", "mcap")
NAMES = {"rosbag1": "log.bag", "rosbag2": "log-ros2", "mcap": "log.mcap"}


def short_log(seconds: float = 12.0) -> Log:
    """Returns the beginning of the bundled sample."""
    log = open_log(ROOT / "data" / "sample")
    assert log.images is not None
    assert log.wheels is not None
    assert log.truth is not None
    count = int(np.searchsorted(log.images.t, seconds))
    wheels, truth = log.wheels.t <= seconds + 1, log.truth.t <= seconds
    return replace(
        log,
        images=replace(
            log.images,
            t=log.images.t[:count],
            file=log.images.file[:count],
            camera=log.images.camera[:count],
        ),
        wheels=Wheels(log.wheels.t[wheels], log.wheels.angle[wheels]),
        truth=PoseTrack(log.truth.t[truth], log.truth.pose[truth]),
    )


def write_folder(log: Log, folder: Path) -> Path:
    """Writes a log with images as a log folder."""
    assert log.images is not None
    (folder / "images").mkdir(parents=True)
    write_log(folder, log, exact=True)
    files = []
    for number, image in enumerate(log.images.file):
        found = image_file(image)
        assert found is not None
        files.append(f"images/{number:06d}{found[0]}")
        (folder / files[-1]).write_bytes(found[1])
    write_images_csv(folder, log.images.t, files)
    return folder


def write_robot_file(log: Log, path: Path) -> Path:
    """Writes the robot file of a log's bags, its map beside it."""
    map_file = None
    if log.map is not None:
        map_file = f"{path.stem}-map.csv"
        write_map(path.with_name(map_file), log.map)
    path.write_text(robot_file_text(log, map_file), encoding="utf-8")
    return path


class Bag:
    """A bag that a test writes message by message, with `rosbags` alone."""

    def __init__(self, path: Path, ros: int, storage: str = "mcap") -> None:
        self.path, self.ros = path, ros
        self.store = store_of("ros1" if ros == 1 else "cdr")
        plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
        self.writer: Any = Writer1(path)
        if ros == 2:
            self.writer = Writer2(path, version=8, storage_plugin=plugin)
        self.connections: dict[str, Any] = {}

    def __enter__(self) -> Bag:
        self.writer.open()
        return self

    def __exit__(self, *ignored: object) -> None:
        self.writer.close()

    def type(self, kind: str, /, **fields: Any) -> Any:
        """Returns a message."""
        return self.store.types[kind](**fields)

    def header(self, t: float, frame: str = "") -> Any:
        """Returns a header."""
        seconds, nanoseconds = divmod(round(t * 1e9), 10**9)
        stamp = self.type("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        number = {"seq": 7} if self.ros == 1 else {}
        return self.type("std_msgs/msg/Header", **number, stamp=stamp, frame_id=frame)

    def pose(self, x: float, y: float, theta: float) -> Any:
        """Returns a pose in the plane."""
        z, w = float(np.sin(theta / 2)), float(np.cos(theta / 2))
        return self.type(
            "geometry_msgs/msg/Pose",
            position=self.type("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
            orientation=self.type("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=z, w=w),
        )

    def write(self, topic: str, kind: str, t: float, message: Any) -> None:
        """Writes a message that is received at t."""
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.ros == 1 else self.store.serialize_cdr
        data = bytes(serialize(message, kind))
        self.writer.write(self.connections[topic], round(t * 1e9), data)

    def odometry(self, t: float, x: float = 0.0, stamp: float | None = None) -> None:
        """Writes a pose by odometry."""
        zero = self.type("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.type("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        none = np.zeros(36)
        message = self.type(
            "nav_msgs/msg/Odometry",
            header=self.header(t if stamp is None else stamp, "odom"),
            child_frame_id="base_link",
            pose=self.type(
                "geometry_msgs/msg/PoseWithCovariance", pose=self.pose(x, 0.0, 0.0), covariance=none
            ),
            twist=self.type("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=none),
        )
        self.write("/odom", "nav_msgs/msg/Odometry", t, message)

    def joints(self, t: float, names: list[str], angles: list[float]) -> None:
        """Writes angles of joints."""
        message = self.type(
            "sensor_msgs/msg/JointState",
            header=self.header(t),
            name=names,
            position=np.array(angles),
            velocity=np.zeros(0),
            effort=np.zeros(0),
        )
        self.write("/joint_states", "sensor_msgs/msg/JointState", t, message)

    def image(self, t: float, grey: np.ndarray, encoding: str = "mono8") -> None:
        """Writes an image."""
        message = self.type(
            "sensor_msgs/msg/Image",
            header=self.header(t, "camera"),
            height=grey.shape[0],
            width=grey.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=grey.nbytes // grey.shape[0],
            data=np.frombuffer(np.ascontiguousarray(grey).tobytes(), np.uint8),
        )
        self.write("/image", "sensor_msgs/msg/Image", t, message)

    def scan(self, t: float, ranges: np.ndarray, frame: str = "laser") -> None:
        """Writes a scan."""
        message = self.type(
            "sensor_msgs/msg/LaserScan",
            header=self.header(t, frame),
            angle_min=-1.0,
            angle_max=1.0,
            angle_increment=0.5,
            time_increment=0.01,
            scan_time=0.1,
            range_min=0.1,
            range_max=30.0,
            ranges=ranges.astype(np.float32),
            intensities=np.zeros(0, np.float32),
        )
        self.write("/scan", "sensor_msgs/msg/LaserScan", t, message)

    def transform(self, t: float, parent: str, child: str, place: Any, turn: Any) -> None:
        """Writes one transform to /tf: place x, y, z and quaternion x, y, z, w."""
        one = self.type(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(t, parent),
            child_frame_id=child,
            transform=self.type(
                "geometry_msgs/msg/Transform",
                translation=self.type(
                    "geometry_msgs/msg/Vector3", **dict(zip("xyz", place, strict=True))
                ),
                rotation=self.type(
                    "geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn, strict=True))
                ),
            ),
        )
        message = self.type("tf2_msgs/msg/TFMessage", transforms=[one])
        self.write("/tf", "tf2_msgs/msg/TFMessage", t, message)
