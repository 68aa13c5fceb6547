"""Logs as bags: ROS 1, ROS 2 (SQLite) or MCAP, and the robot file that says the rest."""

from __future__ import annotations

import heapq
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

from frontend.bag_messages import JOINTS, Maker, nanoseconds
from frontend.log import Log
from frontend.log_parts import PoseTrack
from frontend.omni import BearingCorrection
from frontend.readers import bag_types as types
from frontend.readers.robot_toml import FORMAT
from frontend.write_folder import description, text
from graphslam.errors import BadConfig
from graphslam.geometry import Array

BagFormat = Literal["rosbag1", "rosbag2", "mcap"]
Progress = Callable[[int, int], None]

WHEELS, ODOMETRY, SCANS, TRUTH = "/joint_states", "/odom", "/scan", "/ground_truth"


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


def robot_file_text(
    log: Log, map_file: str | None = None, landmarks_file: str | None = None
) -> str:
    """Returns the robot file that goes with a bag that `write_bag` wrote.

    Args:
        log: the recording.
        map_file: name of a map.csv beside the robot file, or None.
        landmarks_file: name of a landmarks.csv beside it, or None.
    """
    lines = [f'format = "{FORMAT}"', f"name = {text(log.name)}"]
    if map_file is not None:
        lines.append(f"map = {text(map_file)}")
    if landmarks_file is not None:
        lines.append(f"landmarks = {text(landmarks_file)}")
    lines += description(replace(log, bearing_correction=BearingCorrection()))  # of bearings.csv
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
    parts = {
        "sightings": log.sightings,
        "pose fixes": log.pose_fixes,
        "bearings": log.bearings,
        "lamps": log.lamps,
    }
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
        if kind is not None:
            self._writer.abort()
            if self._to == "mcap":
                shutil.rmtree(self._folder, ignore_errors=True)
            return
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
    maker = Maker(store)
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
        yield iter([_Entry(nanoseconds(scans.t[0]), 2, "/tf_static", types.TRANSFORMS,
                           lambda: maker.laser(float(scans.t[0]), pose))])  # fmt: skip
        yield _entries(4, scans.t, SCANS, types.SCAN, lambda i, t: maker.scan(t, scans.place[i]))
    if log.truth is not None:
        yield _poses(5, log.truth, TRUTH, types.POSE, maker.pose)


def _entries(
    number: int, t: Array, topic: str, kind: str, make: Callable[[int, float], Any]
) -> Iterator[_Entry]:
    for i, when in enumerate(t.tolist()):
        yield _Entry(nanoseconds(when), number, topic, kind, partial(make, i, when))


def _poses(
    number: int, track: PoseTrack, topic: str, kind: str, make: Callable[[float, Array], Any]
) -> Iterator[_Entry]:
    yield from _entries(number, track.t, topic, kind, lambda i, t: make(t, track.pose[i]))


def _images(log: Log, maker: Maker, raw: bool) -> Iterator[_Entry]:
    images = log.images
    assert images is not None, "checked before"
    kind = types.IMAGE if raw else types.COMPRESSED
    make = maker.image if raw else maker.compressed
    for i, when in enumerate(images.t.tolist()):
        topic, file = image_topic(images.camera[i]), images.file[i]
        yield _Entry(nanoseconds(when), 3, topic, kind, partial(make, when, file))
