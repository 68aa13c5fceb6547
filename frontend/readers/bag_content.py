"""What a bag holds, collected in one pass: numbers in columns, images and scans as places.

Memory grows with the number of messages (tens of bytes each), never with their size.
"""

from __future__ import annotations

import hashlib
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from frontend.readers.bag_parts import Channel, Container, Losses, Place
from graphslam.geometry import Array


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
