"""Logs as bags: ROS 1, ROS 2 (SQLite) or MCAP, and the robot file that says the rest."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from frontend.images import image_file, read_grey
from frontend.log import Log, PoseTrack
from frontend.readers import bag_types as types
from frontend.readers.robot_toml import FORMAT
from frontend.write_folder import description, text
from graphslam.errors import BadConfig
from graphslam.geometry import Array

BagFormat = Literal["rosbag1", "rosbag2", "mcap"]
Progress = Callable[[int, int], None]

ROBOT_FRAME, ODOMETRY_FRAME, LASER_FRAME, FLOOR_FRAME = "base_link", "odom", "laser", "map"
WHEELS, ODOMETRY, SCANS, TRUTH = "/joint_states", "/odom", "/scan", "/ground_truth"
JOINTS = ("left_wheel_joint", "right_wheel_joint")


class _Entry(NamedTuple):
    """A message to write: when (ns), a number that keeps the order, topic, type and content."""

    when: int
    number: int
    topic: str
    kind: str
    make: Callable[[], Any]


def write_bag(
    log: Log, out: Path, to: BagFormat, raw: bool = False, progress: Progress | None = None
) -> None:
    """Writes wheels or odometry, images, scans and truth of a log as a bag.

    Messages are written in the order of time, one at a time.

    Args:
        log: the recording.
        out: a file ("rosbag1", "mcap") or a folder ("rosbag2"), which must not exist.
        to: the format.
        raw: images as sensor_msgs/Image with grey levels, not as compressed ones.
        progress: called with (messages written, messages in all).

    Raises:
        BadConfig: the log has times before zero, which ROS 1 cannot write.
    """
    first = min(float(t[0]) for t in _times(log))
    if first < 0:
        raise BadConfig(f"{log.name}: begins at t = {first:g} s; bags hold no times before 0")
    store = types.store_of("ros1" if to == "rosbag1" else "cdr")
    total = sum(len(t) for t in _times(log))
    with _Writer(out, to, store) as writer:
        for done, entry in enumerate(heapq.merge(*_streams(log, store, raw)), start=1):
            message = entry.make()
            if message is not None:
                writer.write(entry.topic, entry.kind, entry.when, message)
            if progress is not None:
                progress(min(done, total), total)


def robot_file_text(log: Log, map_file: str | None = None) -> str:
    """Returns the robot file that goes with a bag that `write_bag` wrote.

    Args:
        log: the recording.
        map_file: name of a map.csv beside the robot file, or None.
    """
    lines = [f'format = "{FORMAT}"', f"name = {text(log.name)}"]
    if map_file is not None:
        lines.append(f"map = {text(map_file)}")
    lines += description(log)
    lines += ["", "[topics]"]
    if log.wheels is not None:
        lines.append(f'wheels = "{WHEELS}"')
    if log.odometry is not None:
        lines.append(f'odometry = "{ODOMETRY}"')
    cameras = sorted(set(log.images.camera)) if log.images is not None else []
    lines += [f"images.{text(name)} = {text(image_topic(name))}" for name in cameras]
    if log.scans is not None:
        lines.append(f'scans = "{SCANS}"')
    if log.truth is not None:
        lines.append(f'truth = "{TRUTH}"')
    if log.wheels is not None:
        lines += ["", "[joints]", f'left = "{JOINTS[0]}"', f'right = "{JOINTS[1]}"']
    return "".join(f"{line}\n" for line in lines)


def left_out(log: Log) -> tuple[str, ...]:
    """Returns what of a log no bag can hold: it has no message for it."""
    parts = {"sightings": log.sightings, "pose fixes": log.pose_fixes}
    return tuple(name for name, part in parts.items() if part is not None)


def image_topic(camera: str) -> str:
    """Returns the topic of a camera's images."""
    plain = "".join(c if c.isalnum() and c.isascii() else "_" for c in camera)
    return f"/camera/{plain}/image"


class _Writer:
    """A bag that is being written, whatever its format."""

    def __init__(self, out: Path, to: BagFormat, store: Any) -> None:
        self._out, self._to, self._store = out, to, store
        self._connections: dict[str, Any] = {}
        self._folder = out.with_name(f"{out.name}.folder") if to == "mcap" else out
        if to == "rosbag1":
            from rosbags.rosbag1 import Writer

            self._writer: Any = Writer(out)
        else:
            from rosbags.rosbag2 import StoragePlugin
            from rosbags.rosbag2 import Writer as Writer2

            plugin = StoragePlugin.MCAP if to == "mcap" else StoragePlugin.SQLITE3
            self._writer = Writer2(self._folder, version=9, storage_plugin=plugin)

    def __enter__(self) -> _Writer:
        self._writer.open()
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        self._writer.close()
        if self._to == "mcap":  # the file alone is the bag
            (self._folder / f"{self._folder.name}.mcap").replace(self._out)
            (self._folder / "metadata.yaml").unlink()
            self._folder.rmdir()

    def write(self, topic: str, kind: str, when: int, message: Any) -> None:
        """Writes a message; its topic is noted with the first."""
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self._store
            )
        store = self._store
        serialize = store.serialize_ros1 if self._to == "rosbag1" else store.serialize_cdr
        self._writer.write(self._connections[topic], when, bytes(serialize(message, kind)))


def _times(log: Log) -> list[Array]:
    parts = (log.wheels, log.odometry, log.images, log.scans, log.truth)
    return [part.t for part in parts if part is not None and len(part.t)]


def _streams(log: Log, store: Any, raw: bool) -> Iterator[Iterator[_Entry]]:
    """Yields the messages of each part, in the order of time."""
    maker = _Maker(store)
    if log.wheels is not None:
        rows = log.wheels.angle
        yield _entries(0, log.wheels.t, WHEELS, types.JOINTS, lambda i, t: maker.joints(t, rows[i]))
    if log.odometry is not None:
        yield _poses(1, log.odometry, ODOMETRY, types.ODOMETRY, maker.odometry)
    if log.images is not None:
        yield _images(log, maker, raw)
    if log.scans is not None:
        scans = log.scans
        pose = scans.sensor_pose
        yield iter([_Entry(_ns(scans.t[0]), 2, "/tf_static", types.TRANSFORMS,
                           lambda: maker.laser(float(scans.t[0]), pose))])  # fmt: skip
        yield _entries(4, scans.t, SCANS, types.SCAN, lambda i, t: maker.scan(t, scans.place[i]))
    if log.truth is not None:
        yield _poses(5, log.truth, TRUTH, types.POSE, maker.pose)


def _entries(
    number: int, t: Array, topic: str, kind: str, make: Callable[[int, float], Any]
) -> Iterator[_Entry]:
    for i, when in enumerate(t.tolist()):
        yield _Entry(_ns(when), number, topic, kind, lambda i=i, when=when: make(i, when))  # type: ignore[misc]


def _poses(
    number: int, track: PoseTrack, topic: str, kind: str, make: Callable[[float, Array], Any]
) -> Iterator[_Entry]:
    yield from _entries(number, track.t, topic, kind, lambda i, t: make(t, track.pose[i]))


def _images(log: Log, maker: _Maker, raw: bool) -> Iterator[_Entry]:
    images = log.images
    assert images is not None, "checked before"
    kind = types.IMAGE if raw else types.COMPRESSED
    make = maker.image if raw else maker.compressed
    for i, when in enumerate(images.t.tolist()):
        topic = image_topic(images.camera[i])
        yield _Entry(_ns(when), 3, topic, kind, lambda i=i, when=when: make(when, images.file[i]))  # type: ignore[misc]


def _ns(t: float) -> int:
    return round(t * 1e9)


class _Maker:
    """Makes messages of one store of types."""

    def __init__(self, store: Any) -> None:
        self._types = store.types

    def header(self, t: float, frame: str) -> Any:
        """Returns a header with a stamp; ROS 1's has a number besides."""
        seconds, nanoseconds = divmod(_ns(t), 10**9)
        stamp = self._types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        kind = self._types["std_msgs/msg/Header"]
        number = {"seq": 0} if "seq" in kind.__dataclass_fields__ else {}
        return kind(**number, stamp=stamp, frame_id=frame)

    def joints(self, t: float, angles: Array) -> Any:
        """Returns the angles of both wheels."""
        nothing = np.zeros(0)
        return self._types[types.JOINTS](
            header=self.header(t, ROBOT_FRAME),
            name=list(JOINTS),
            position=np.array(angles, float),
            velocity=nothing,
            effort=nothing,
        )

    def pose_of(self, pose: Array) -> Any:
        """Returns a pose in the plane."""
        names = self._types
        point = names["geometry_msgs/msg/Point"](x=float(pose[0]), y=float(pose[1]), z=0.0)
        half = 0.5 * float(pose[2])
        turn = names["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half))
        )
        return names["geometry_msgs/msg/Pose"](position=point, orientation=turn)

    def pose(self, t: float, pose: Array) -> Any:
        """Returns a true pose."""
        return self._types[types.POSE](header=self.header(t, FLOOR_FRAME), pose=self.pose_of(pose))

    def odometry(self, t: float, pose: Array) -> Any:
        """Returns a pose by odometry; its covariances are zero, which means unknown."""
        names, none = self._types, np.zeros(36)
        zero = names["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        twist = names["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
        return names[types.ODOMETRY](
            header=self.header(t, ODOMETRY_FRAME),
            child_frame_id=ROBOT_FRAME,
            pose=names["geometry_msgs/msg/PoseWithCovariance"](self.pose_of(pose), none),
            twist=names["geometry_msgs/msg/TwistWithCovariance"](twist, none),
        )

    def compressed(self, t: float, image: Any) -> Any:
        """Returns an image as the file that it is or becomes; None where it is unreadable."""
        found = image_file(image)
        if found is None:
            return None
        suffix, data = found
        return self._types[types.COMPRESSED](
            header=self.header(t, "camera"),
            format=suffix.lstrip(".").replace("jpg", "jpeg"),
            data=np.frombuffer(data, np.uint8),
        )

    def image(self, t: float, image: Any) -> Any:
        """Returns an image as grey levels; None where it is unreadable."""
        grey = read_grey(image)
        if grey is None:
            return None
        return self._types[types.IMAGE](
            header=self.header(t, "camera"),
            height=grey.shape[0],
            width=grey.shape[1],
            encoding="mono8",
            is_bigendian=0,
            step=grey.shape[1],
            data=grey.ravel(),
        )

    def scan(self, t: float, place: Any) -> Any:
        """Returns a scan; None where it is unreadable."""
        scan = place.scan()
        if scan is None:
            return None
        beams = max(1, len(scan.ranges) - 1)
        return self._types[types.SCAN](
            header=self.header(t, LASER_FRAME),
            angle_min=scan.angle_min,
            angle_max=scan.angle_min + (len(scan.ranges) - 1) * scan.angle_step,
            angle_increment=scan.angle_step,
            time_increment=scan.duration / beams,
            scan_time=0.0,
            range_min=scan.range_min,
            range_max=scan.range_max,
            ranges=np.array(scan.ranges, np.float32),
            intensities=np.zeros(0, np.float32),
        )

    def laser(self, t: float, pose: Array) -> Any:
        """Returns where the laser is."""
        names, half = self._types, 0.5 * float(pose[2])
        shift = names["geometry_msgs/msg/Vector3"](x=float(pose[0]), y=float(pose[1]), z=0.0)
        turn = names["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half))
        )
        one = names["geometry_msgs/msg/TransformStamped"](
            header=self.header(t, ROBOT_FRAME),
            child_frame_id=LASER_FRAME,
            transform=names["geometry_msgs/msg/Transform"](translation=shift, rotation=turn),
        )
        return names[types.TRANSFORMS](transforms=[one])
