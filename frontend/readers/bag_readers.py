"""What each type of message becomes: numbers in the columns of a stream, or a place."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from frontend.quaternions import yaw
from frontend.readers import bag_types as types
from frontend.readers.bag_content import BagContent, Stream, Transform
from frontend.readers.bag_parts import Message

BEYOND = 1e9
"""Numbers beyond this, m or rad, count as damage."""

Rows = Iterator[tuple[Stream, int, tuple[float, ...]]]


def _stream(found: BagContent, topic: str, message: Message) -> Stream:
    if topic not in found.streams:
        found.streams[topic] = Stream(message.channel.type, topic)
    return found.streams[topic]


def _planar(position: Any, turn: Any) -> tuple[float, float, float]:
    q = (float(turn.x), float(turn.y), float(turn.z), float(turn.w))
    check(q)
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
    check(angles)
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
        check((*place, *q))
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


def check(values: tuple[float, ...]) -> None:
    if not all(-BEYOND <= value <= BEYOND for value in values):
        raise types.Undecodable("holds NaN, infinity or a number that no robot has")
