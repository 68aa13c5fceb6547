"""CARMEN logs: scans and odometry as text, one message a line, taken in the order of the file.

A message ends with the time of its sender, the sender's name, and the time of the logger. Those of
the sender are used. They come in bursts and swapped in real logs, where the order of the file is
right: a time that repeats or runs backwards counts as just after the one before it.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from frontend.log import Log
from frontend.log_parts import PoseTrack
from frontend.readers.carmen_messages import (
    LINE_LIMIT,
    OTHERS,
    PARAMETERS,
    PARSERS,
    Message,
    Unfinished,
    laser_of,
)
from frontend.recorded import Scan, ScanList
from graphslam.errors import BadLog
from graphslam.geometry import Array

HEAD = 2**16
"""Bytes at the beginning of a file in which a CARMEN log shows what it is."""
MOST_BEAMS = 2**28
"""Distances that all scans of a log may have together: 1 GiB in memory."""
STEP = 1e-6
"""By how much a time that repeats is put off, s: double precision tells it apart until 2100."""


@dataclass(frozen=True, slots=True)
class CarmenScan:
    """A scan of a CARMEN log.

    Attributes:
        line: where it stands in the file, from 1.
        ranges: (B,) m.
        about: the other fields of `Scan`.
    """

    line: int
    ranges: NDArray[np.float32]
    about: dict[str, float]

    @property
    def name(self) -> str:
        """Its line."""
        return f"line {self.line}"

    def scan(self) -> Scan | None:
        """Returns the scan."""
        return Scan(self.ranges.astype(float), **self.about)


@dataclass(slots=True)
class _Content:
    """What a file holds, message by message, as it is read."""

    messages: dict[str, list[Message]] = field(
        default_factory=lambda: {name: [] for name in PARSERS}
    )
    parameters: dict[str, float] = field(default_factory=dict)
    unread: Counter[str] = field(default_factory=Counter)
    unknown: Counter[str] = field(default_factory=Counter)
    cut_off: int = 0
    beams: int = 0


def is_carmen(path: Path) -> bool:
    """Returns whether a file's first message that is no comment is one of a CARMEN log."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        head = stream.read(HEAD)
    for line in head.splitlines():
        words = line.split(maxsplit=2)
        if words and not words[0].startswith(b"#"):
            name = words[0].decode("ascii", "replace")
            return len(words) > 1 and name in {"PARAM", *PARSERS, *OTHERS}
    return False


def read_carmen(path: Path) -> Log:
    """Returns the log in a CARMEN file (docs/walls.md).

    Raises:
        BadLog: a message contradicts the format; the error names file, line and cure.
    """
    digest = hashlib.sha256()
    content = _Content()
    with path.open("rb") as stream:
        for number, line in _lines(path, stream, digest):
            _take(path, number, line, content)
    found = content.messages
    name = next((n for n in ("ROBOTLASER1", "FLASER", "ODOM") if found[n]), None)
    if name is None:
        raise BadLog(
            f"{path}: holds no FLASER, ROBOTLASER1 or ODOM message, so nothing tells how the robot "
            "moved; record one of them"
        )
    used = found[name]
    t, notes = _in_order(np.array([message.t for message in used]))
    label = f"{path.name}: {name}"
    return Log(
        name=path.stem or path.name,
        folder=path.parent,
        robot=None,
        cameras={},
        start_pose=np.zeros(3),
        start_sigma=np.zeros(3),
        start_given=False,
        wheels=None,
        odometry=PoseTrack(t, np.array([message.pose for message in used])),
        images=None,
        sightings=None,
        pose_fixes=None,
        truth=None,
        map=None,
        warnings=(*notes, *_warnings(content, name)),
        digest=digest.hexdigest(),
        scans=None if name == "ODOM" else _scans(path, t, used, content.parameters),
        labels={"odometry": label, "scans": label},
        described=path.name,
    )


def _lines(path: Path, stream: BinaryIO, digest: hashlib._Hash) -> Iterator[tuple[int, bytes]]:
    """Yields the lines of a file with their numbers, none longer than `LINE_LIMIT`."""
    number = 0
    while line := stream.readline(LINE_LIMIT + 1):
        number += 1
        digest.update(line)
        if len(line) > LINE_LIMIT:
            raise BadLog(
                f"{path}:{number}: is longer than {LINE_LIMIT // 2**20} MiB, so it is no CARMEN "
                "message; copy the log again"
            )
        yield number, line


def _take(path: Path, number: int, line: bytes, content: _Content) -> None:
    """Notes what a line says.

    Raises:
        BadLog: a message contradicts the format.
    """
    words = line.decode("utf-8", "replace").split()
    if not words or words[0].startswith("#"):
        return
    name = words[0]
    try:
        if name == "PARAM":
            _take_parameter(words, content)
        elif name in PARSERS:
            message = PARSERS[name](number, words)
            content.beams += len(message.ranges)
            if content.beams > MOST_BEAMS:
                raise BadLog(f"{path}:{number}: the scans so far fill a gigabyte; split the log")
            content.messages[name].append(message)
        elif name in OTHERS:
            content.unread[name] += 1
        else:
            content.unknown[name[:40]] += 1
    except Unfinished as reason:
        if not line.endswith(b"\n"):  # the logger was stopped while it wrote this
            content.cut_off = number
            return
        raise BadLog(f"{path}:{number}: {name} {reason}; copy the log again") from None
    except ValueError as reason:
        raise BadLog(f"{path}:{number}: {name} {reason}") from None


def _take_parameter(words: list[str], content: _Content) -> None:
    if len(words) >= 3 and words[1] in PARAMETERS:
        value = float(words[2])
        if not math.isfinite(value):
            raise ValueError(f"{words[1]} is {words[2]}; write a number")
        content.parameters[words[1]] = value


def _in_order(stamp: Array) -> tuple[Array, list[str]]:
    """Returns times (K,) that increase strictly, and what was wrong with the stamps (K,)."""
    ramp = STEP * np.arange(len(stamp))
    t = np.maximum.accumulate(stamp - ramp) + ramp
    back, same = int(np.sum(np.diff(stamp) < 0)), int(np.sum(np.diff(stamp) == 0))
    if not back and not same:
        return t, []
    return t, [
        f"times that run backwards: {back}, that repeat: {same}; the order of the file is taken, "
        "and each of them counts as just after the one before it"
    ]


def _scans(path: Path, t: Array, used: list[Message], parameters: dict[str, float]) -> ScanList:
    """Returns the scans of messages; all must be of one laser at one place on the robot."""
    places = [laser_of(message, parameters) for message in used]
    pose = places[0][0]
    for message, (other, _) in zip(used, places, strict=True):
        if np.max(np.abs(other - pose)) > 1e-3:
            raise BadLog(
                f"{path}:{message.line}: the laser has moved on the robot, from {pose.tolist()} to "
                f"{other.tolist()}; keep the scans of one laser"
            )
    scans = tuple(
        CarmenScan(message.line, message.ranges, about)
        for message, (_, about) in zip(used, places, strict=True)
    )
    return ScanList(t, scans, pose)


def _warnings(content: _Content, used: str) -> Iterator[str]:
    beside = {n: len(m) for n, m in content.messages.items() if m and n != used}
    unread = {**beside, **dict(sorted(content.unread.items()))}
    if unread:
        listed = ", ".join(f"{name} ({count})" for name, count in unread.items())
        yield f"messages that are not used beside {used}: {listed}"
    if content.unknown:
        listed = ", ".join(f"{n!r} ({c})" for n, c in sorted(content.unknown.items())[:5])
        yield f"lines that are no message of CARMEN, left out: {listed}"
    if content.cut_off:
        yield f"line {content.cut_off}, the last, is cut off and left out"
