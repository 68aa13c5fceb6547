"""The messages of a CARMEN log that tell of scans and odometry, word by word."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from graphslam.geometry import Array, between

LINE_LIMIT = 2**20
"""Longest line that is read, bytes."""
MOST_READINGS = 10_000
"""Largest number of beams of a scan."""
NO_ECHO_M = 81.0
"""Distance from which a SICK laser reports codes instead of distances (8183 cm and more), m."""
OTHERS = (
    "SYNC",
    "TRUEPOS",
    "RLASER",
    "LASER3",
    "LASER4",
    "LASER5",
    "ROBOTLASER2",
    "RAWLASER1",
    "RAWLASER2",
    "RAWLASER3",
    "RAWLASER4",
    "RAWLASER5",
    "POSITION",
    "BASEVELOCITY",
    "NMEAGGA",
    "NMEARMC",
    "SONAR",
    "BUMPER",
    "GPS",
    "MARKER",
)
"""Other messages of the format, which are counted and left out."""
PARAMETERS = (
    "robot_frontlaser_offset",
    "robot_frontlaser_side_offset",
    "robot_frontlaser_angular_offset",
    "robot_frontlaser_max",
)
"""Parameters that say where the laser of FLASER is, m and rad, and how far it sees, m."""


class Unfinished(Exception):
    """A message ends before it is complete."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message, checked.

    Attributes:
        line: where it stands, from 1.
        t: time of its sender, s.
        pose: (3,) odometry's pose of the robot, m and rad.
        ranges: (B,) distances, m; empty for odometry.
        laser: (3,) the laser's pose in the same frame, where the message has it.
        about: angle_min, angle_step (rad) and range_max (m), where the message has them.
    """

    line: int
    t: float
    pose: Array
    ranges: NDArray[np.float32]
    laser: Array | None = None
    about: Mapping[str, float] = field(default_factory=dict)


def flaser(line: int, words: list[str]) -> Message:
    """Returns ``FLASER n r_1 ... r_n x y theta odom_x odom_y odom_theta t host logger_t``.

    The first pose is the laser's, or in corrected logs another program's: it is not used.
    """
    count = _count(words, 1)
    _numbers(words, 2 + count, 3)
    pose = _numbers(words, 5 + count, 3)
    t = _numbers(words, 8 + count, 1)[0]
    return Message(line, float(t), pose, _ranges(words, 2, count))


def robotlaser(line: int, words: list[str]) -> Message:
    """Returns ``ROBOTLASER1 type start fov step max accuracy remission n r_1 ... m e_1 ... poses``.

    The poses are the laser's and the robot's, then speeds and distances of the safety zone.
    """
    start, _, step, most = _numbers(words, 2, 4)
    count = _count(words, 8)
    remissions = _count(words, 9 + count)
    begin = 10 + count + remissions
    laser, pose = _numbers(words, begin, 3), _numbers(words, begin + 3, 3)
    t = _numbers(words, begin + 11, 1)[0]
    if step == 0:
        raise ValueError("has an angular resolution of 0; write it in rad")
    about = {"angle_min": float(start), "angle_step": float(step)}
    if most > 0:
        about["range_max"] = float(most)
    return Message(line, float(t), pose, _ranges(words, 9, count), laser, about)


def odom(line: int, words: list[str]) -> Message:
    """Returns ``ODOM x y theta tv rv accel t host logger_t``."""
    pose, t = _numbers(words, 1, 3), _numbers(words, 7, 1)[0]
    return Message(line, float(t), pose, np.zeros(0, np.float32))


PARSERS: Mapping[str, Callable[[int, list[str]], Message]] = MappingProxyType(
    {"ROBOTLASER1": robotlaser, "FLASER": flaser, "ODOM": odom}
)


def laser_of(message: Message, parameters: Mapping[str, float]) -> tuple[Array, dict[str, float]]:
    """Returns where the laser is in the robot frame (3,), and the fields of `Scan` but ranges.

    FLASER does not say in which directions its beams go: they are 180 degrees from right to left,
    with both ends where the number of beams is odd, else without the last, as SICK lasers send
    them. A FLASER's laser is where PARAM says, else in the robot's origin.
    """
    if message.laser is not None:
        pose = between(message.pose, message.laser)
        return np.asarray(pose), dict(message.about)
    names = PARAMETERS[:3]
    pose = np.array([parameters.get(name, 0.0) for name in names])
    count = len(message.ranges)
    step = math.pi / max(count - count % 2, 1)
    most = parameters.get("robot_frontlaser_max", NO_ECHO_M)
    return pose, {"angle_min": -0.5 * math.pi, "angle_step": step, "range_max": most}


def _count(words: list[str], at: int) -> int:
    """Returns the number of readings that a message declares.

    Raises:
        Unfinished: the message has fewer words.
        ValueError: it is no number of readings.
    """
    if len(words) <= at:
        raise Unfinished(f"has {len(words)} words where more than {at} are needed")
    try:
        count = int(words[at])
    except ValueError:
        raise ValueError(f"has {words[at][:40]!r} where a number of readings is needed") from None
    if not 0 <= count <= MOST_READINGS:
        raise ValueError(f"declares {count} readings; 0 to {MOST_READINGS} are read")
    if len(words) <= at + count:
        raise Unfinished(f"declares {count} readings and has {len(words) - at - 1} words for them")
    return count


def _numbers(words: list[str], at: int, count: int) -> Array:
    """Returns finite numbers of a message.

    Raises:
        Unfinished: the message has fewer words.
        ValueError: a word is no finite number.
    """
    part = words[at : at + count]
    if len(part) < count:
        raise Unfinished(f"has {len(words)} words where {at + count} are needed")
    try:
        values = np.array([float(word) for word in part])
    except ValueError:
        raise ValueError(f"has {' '.join(part)[:60]!r} where {count} numbers are needed") from None
    if not np.isfinite(values).all():
        raise ValueError(f"has {' '.join(part)[:60]!r} where finite numbers are needed")
    return values


def _ranges(words: list[str], at: int, count: int) -> NDArray[np.float32]:
    """Returns distances; NaN and infinity are beams without an echo."""
    try:
        return np.array(words[at : at + count], np.float32)
    except ValueError:
        raise ValueError("has words between its readings that are no numbers") from None
