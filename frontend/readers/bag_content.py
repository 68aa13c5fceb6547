"""What a bag holds, collected in one pass: numbers in columns, images and scans as places.

Memory grows with the number of messages (tens of bytes each), never with their size.
"""

from __future__ import annotations

import hashlib
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from frontend.log import Progress
from frontend.quaternions import yaw
from frontend.readers import bag_types as types
from frontend.readers.bag_files import files_of
from frontend.readers.bag_parts import Channel, Container, Losses, Message, Place
from graphslam.geometry import Array

BEYOND = 1e9
"""Numbers beyond this, m or rad, count as damage."""


@dataclass(slots=True)
class Stream:
    """The messages of one topic, one joint or one pair of frames.

    Attributes:
        kind: type of the messages.
        label: how messages call it.
        frame: frame that the header names, of the first message.
        child: frame that an odometry or a transform is about, of the first message.
        received: (K,) ns.
        stamp: (K,) of the headers, ns.
        order: (K,) number of each message in the bag.
        values: (K * width,) what was read: x, y, yaw of poses, the angle of joints.
        place: (K * 4,) where images and scans are.
        digest: SHA-256 of all that was read, images and scans by theirs.
        image_digest: (K,) SHA-256 of each image.
        about: what is told once: size and encoding of images, a camera's matrix, ...
    """

    kind: str
    label: str
    frame: str = ""
    child: str = ""
    received: array[int] = field(default_factory=lambda: array("q"))
    stamp: array[int] = field(default_factory=lambda: array("q"))
    order: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    place: array[int] = field(default_factory=lambda: array("q"))
    image_digest: list[bytes] = field(default_factory=list)
    about: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.received)

    def rows(self, width: int) -> Array:
        """Returns the values, (K, width)."""
        return np.frombuffer(self.values, float).reshape(-1, width).copy()

    def places(self) -> list[Place]:
        """Returns where each message is."""
        flat = self.place.tolist()
        return [Place(*flat[i : i + 4]) for i in range(0, len(flat), 4)]

    def digest(self) -> bytes:
        """Returns the SHA-256 of all that was read."""
        total = hashlib.sha256(f"{self.kind} {self.label} {self.frame} {self.child}".encode())
        for column in (self.received, self.stamp, self.values):
            total.update(column.tobytes())
        for one in self.image_digest:
            total.update(one)
        return total.digest()


@dataclass(slots=True)
class Transform:
    """From one frame to another: fixed as long as it never changed.

    Attributes:
        place: (3,) of the child's origin in the parent, m, of the first message.
        turn: (4,) quaternion x, y, z, w of the same.
        fixed: whether every message said the same.
        count: of messages.
        last: received, stamp and order of the last message.
        moves: x, y and yaw over time; empty while it is fixed.
    """

    place: Array
    turn: Array
    fixed: bool
    count: int
    last: tuple[int, int, int]
    moves: Stream


@dataclass(slots=True)
class Topic:
    """What is known of every topic, whether it is read or not.

    Attributes:
        channel: its stream.
        count: messages.
        first_ns: when the first was received.
        last_ns: when the last was.
        bytes: of all messages.
    """

    channel: Channel
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    bytes: int = 0


@dataclass(slots=True)
class BagContent:
    """All of a bag that logs are made of.

    Attributes:
        path: the bag.
        files: its files, which single messages are read from.
        topics: every topic, by name.
        streams: those that can be read, by topic; joints by topic and joint.
        joints: by topic and name of the joint.
        transforms: by parent and child.
        losses: what could not be read.
        messages: how many were read, of all topics.
    """

    path: Path
    files: list[Container]
    topics: dict[str, Topic] = field(default_factory=dict)
    streams: dict[str, Stream] = field(default_factory=dict)
    joints: dict[tuple[str, str], Stream] = field(default_factory=dict)
    transforms: dict[tuple[str, str], Transform] = field(default_factory=dict)
    losses: Losses = field(default_factory=Losses)
    messages: int = 0

    def of_type(self, *kinds: str) -> dict[str, Stream]:
        """Returns the streams of some types, by topic, most messages first."""
        found = {name: stream for name, stream in self.streams.items() if stream.kind in kinds}
        return dict(sorted(found.items(), key=lambda item: (-len(item[1]), item[0])))


def collect(path: Path, progress: Progress | None = None) -> BagContent:
    """Returns what a bag holds.

    Args:
        path: a bag's file, or the folder of a ROS 2 bag.
        progress: told bytes.

    Raises:
        BadLog: there is no bag, or nothing of it can be read.
    """
    found = BagContent(path, [])
    files = found.files
    files += files_of(path, found.losses)
    sizes = [file.path.stat().st_size for file in files]
    for number, file in enumerate(files):
        before, total = sum(sizes[:number]), sum(sizes)

        def tell(done: int, size: int, before: int = before, total: int = total) -> None:
            if progress is not None:
                progress(before + done, total)

        for message in file.messages(found.losses, tell):
            found.messages += 1
            _note(found, message)
    return found


def _note(found: BagContent, message: Message) -> None:
    channel = message.channel
    topic = found.topics.get(channel.topic)
    if topic is None:
        topic = found.topics[channel.topic] = Topic(channel, first_ns=message.received_ns)
    topic.count += 1
    topic.bytes += len(message.data)
    topic.last_ns = message.received_ns
    reader = READERS.get(channel.type)
    if reader is None:
        return
    place = f"message {topic.count} of {channel.topic}"
    if channel.encoding not in types.ENCODINGS:
        found.losses.add(
            f"{channel.topic} holds messages encoded as {channel.encoding!r}; known are "
            f"{' and '.join(types.ENCODINGS)}",
            place,
        )
        return
    try:
        definition = types.differing_definition(
            channel.type, channel.encoding, channel.definition, channel.md5
        )
        content = types.decode(channel.type, channel.encoding, message.data, definition)
        for stream, stamp, values in reader(found, channel.topic, content, message):
            _check(values)
            stream.received.append(message.received_ns)
            stream.stamp.append(stamp)
            stream.order.append(found.messages)
            stream.values.extend(values)
    except types.Undecodable as problem:
        found.losses.add(f"a message of {channel.topic} {problem}", place)


def _check(values: tuple[float, ...]) -> None:
    if not all(-BEYOND <= value <= BEYOND for value in values):
        raise types.Undecodable("holds NaN, infinity or a number that no robot has")


Rows = Iterator[tuple[Stream, int, tuple[float, ...]]]


def _stream(found: BagContent, topic: str, message: Message) -> Stream:
    if topic not in found.streams:
        found.streams[topic] = Stream(message.channel.type, topic)
    return found.streams[topic]


def _planar(position: Any, turn: Any) -> tuple[float, float, float]:
    q = (float(turn.x), float(turn.y), float(turn.z), float(turn.w))
    _check(q)
    if not any(q):
        raise types.Undecodable("holds a quaternion of zeros: no direction")
    heading = float(yaw(np.array(q)))
    return float(position.x), float(position.y), heading


def _odometry(found: BagContent, topic: str, content: Any, message: Message) -> Rows:
    stream = _stream(found, topic, message)
    stream.frame = stream.frame or content.header.frame_id
    stream.child = stream.child or content.child_frame_id
    pose = content.pose.pose
    yield stream, types.stamp_of(content.header), _planar(pose.position, pose.orientation)


def _pose(found: BagContent, topic: str, content: Any, message: Message) -> Rows:
    stream = _stream(found, topic, message)
    stream.frame = stream.frame or content.header.frame_id
    pose = content.pose if message.channel.type == types.POSE else content.pose.pose
    yield stream, types.stamp_of(content.header), _planar(pose.position, pose.orientation)


def _joints(found: BagContent, topic: str, content: Any, message: Message) -> Rows:
    stamp = types.stamp_of(content.header)
    for name, angle in zip(content.name, content.position.tolist(), strict=False):
        key = (topic, str(name))
        if key not in found.joints:
            found.joints[key] = Stream(types.JOINTS, f"{topic} joint {name}")
        yield found.joints[key], stamp, (angle,)


def _placed(stream: Stream, message: Message) -> None:
    stream.place.extend(message.place)
    stream.image_digest.append(hashlib.sha256(message.data).digest())


def _image(found: BagContent, topic: str, content: Any, message: Message) -> Rows:
    stream = _stream(found, topic, message)
    stream.frame = stream.frame or content.header.frame_id
    if message.channel.type == types.IMAGE:
        encodings = stream.about.setdefault("encodings", {})
        encodings[content.encoding] = encodings.get(content.encoding, 0) + 1
        stream.about.setdefault("size", (int(content.width), int(content.height)))
    else:
        stream.about.setdefault("format", str(content.format))
    _placed(stream, message)
    yield stream, types.stamp_of(content.header), ()


def _scan(found: BagContent, topic: str, content: Any, message: Message) -> Rows:
    stream = _stream(found, topic, message)
    stream.frame = stream.frame or content.header.frame_id
    stream.about.setdefault("beams", len(content.ranges))
    angles = (content.angle_min, content.angle_increment, content.time_increment)
    _check(angles)
    stream.about.setdefault("angles", angles)
    _placed(stream, message)
    yield stream, types.stamp_of(content.header), ()


def _camera_info(found: BagContent, topic: str, content: Any, message: Message) -> Rows:
    stream = _stream(found, topic, message)
    if not stream.about:
        # ROS 1 writes the matrices in capitals
        matrix = getattr(content, "k", getattr(content, "K", None))
        distortion = getattr(content, "d", getattr(content, "D", None))
        stream.about.update(
            size=(int(content.width), int(content.height)),
            matrix=np.array(matrix, float).reshape(3, 3),
            distortion=np.array(distortion, float),
            model=str(content.distortion_model),
        )
        stream.frame = content.header.frame_id
    yield stream, types.stamp_of(content.header), ()


def _transforms(found: BagContent, topic: str, content: Any, message: Message) -> Rows:
    for one in content.transforms:
        key = (one.header.frame_id.lstrip("/"), one.child_frame_id.lstrip("/"))
        shift, turn = one.transform.translation, one.transform.rotation
        place = np.array([shift.x, shift.y, shift.z])
        q = np.array([turn.x, turn.y, turn.z, turn.w])
        _check((*place, *q))
        pose, now = _planar(shift, turn), (message.received_ns, types.stamp_of(one.header))
        at = (*now, found.messages)
        known = found.transforms.get(key)
        if known is None:
            moves = Stream(types.TRANSFORMS, f"{topic} {key[0]} to {key[1]}", *key)
            known = found.transforms[key] = Transform(place, q, True, 0, at, moves)
            _move(known, at, pose)
        elif known.fixed and np.array_equal(place, known.place) and np.array_equal(q, known.turn):
            pass
        else:
            if known.fixed and known.count > 1:  # it stood still until just now
                _move(known, known.last, tuple(known.moves.values[:3]))
            known.fixed = False
            _move(known, at, pose)
        known.count, known.last = known.count + 1, at
    yield from ()


def _move(known: Transform, at: tuple[int, int, int], pose: tuple[float, ...]) -> None:
    known.moves.received.append(at[0])
    known.moves.stamp.append(at[1])
    known.moves.order.append(at[2])
    known.moves.values.extend(pose)


READERS: dict[str, Callable[[BagContent, str, Any, Message], Rows]] = {
    types.ODOMETRY: _odometry,
    types.POSE: _pose,
    types.POSE_WITH_COVARIANCE: _pose,
    types.JOINTS: _joints,
    types.IMAGE: _image,
    types.COMPRESSED: _image,
    types.SCAN: _scan,
    types.CAMERA_INFO: _camera_info,
    types.TRANSFORMS: _transforms,
}
"""What reads the messages of each type."""
