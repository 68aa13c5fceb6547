"""Which topics of a bag are what: named by the robot file, or told by type and name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from frontend.log import DEFAULT_CAMERA
from frontend.quaternions import rotation
from frontend.readers import bag_types as types
from frontend.readers.bag_content import BagContent, Stream
from frontend.readers.robot_toml import RobotFile
from frontend.strict import nearest
from graphslam.errors import BadLog
from graphslam.geometry import Array

ROBOT_FRAMES = ("base_footprint", "base_link", "base", "robot", "chassis")
"""Usual names of the robot's frame in tf, likeliest first."""
ODOMETRY_FRAMES = ("odom", "odometry", "odom_combined")
TRUTH_WORDS = ("truth", "mocap", "vicon", "optitrack", "gt_pose")
"""Poses whose topic has such a word in its name count as the truth; other poses are goals, paths
or somebody's estimates."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What of a bag is used as what.

    Attributes:
        wheels: streams of the left and right wheel's joint, or None.
        odometry: poses by odometry, or None.
        images: by the name of the camera.
        scans: of the laser, or None.
        truth: true poses, or None.
        laser_pose: (3,) the laser in the robot frame, m and rad.
        laser_upside_down: whether its z axis points down.
        laser_known: whether tf or the robot file says where the laser is.
        notes: what was chosen among several, or guessed.
    """

    wheels: tuple[Stream, Stream] | None
    odometry: Stream | None
    images: Mapping[str, Stream]
    scans: Stream | None
    truth: Stream | None
    laser_pose: Array
    laser_upside_down: bool
    laser_known: bool
    notes: tuple[str, ...]


def choose(content: BagContent, robot: RobotFile) -> Choice:
    """Returns what of a bag is used as what.

    Raises:
        BadLog: the robot file names a topic, a joint or a frame that the bag has not.
    """
    notes: list[str] = []
    odometry = _odometry(content, robot, notes)
    scans = _one(content, robot.topics.scans, (types.SCAN,), "scans", notes)
    robot_frame = robot.frames.robot or _child(odometry)
    pose, upside_down, known = np.zeros(3), False, False
    if robot.laser is not None:
        pose, known = np.array(robot.laser.pose), True
    elif scans is not None:
        found = fixed_transform(content, robot_frame, scans.frame)
        if found is not None:
            pose, upside_down, known = *found, True
    return Choice(
        wheels=_wheels(content, robot, notes),
        odometry=odometry,
        images=_images(content, robot, notes),
        scans=scans,
        truth=_truth(content, robot),
        laser_pose=pose,
        laser_upside_down=upside_down,
        laser_known=known,
        notes=tuple(notes),
    )


def fixed_transform(content: BagContent, parent: str, child: str) -> tuple[Array, bool] | None:
    """Returns a frame in another by tf's transforms that never change, seen from above.

    Returns:
        x, y and heading (m, rad), and whether its z axis points down; None where tf does not say.
    """
    parent, child = parent.lstrip("/"), child.lstrip("/")
    if not parent or not child:
        return None
    reached = {parent: np.eye(4)}
    queue = [parent]
    while queue and child not in reached:
        here = queue.pop(0)
        for (one, other), transform in content.transforms.items():
            if not transform.fixed or not np.linalg.norm(transform.turn):
                continue
            step = np.eye(4)
            step[:3, :3], step[:3, 3] = rotation(transform.turn), transform.place
            for start, end, move in ((one, other, step), (other, one, np.linalg.inv(step))):
                if start == here and end not in reached:
                    reached[end] = reached[here] @ move
                    queue.append(end)
    if child not in reached:
        return None
    found = reached[child]
    heading = np.arctan2(found[1, 0], found[0, 0])
    return np.array([found[0, 3], found[1, 3], heading]), bool(found[2, 2] < 0)


def wheel_joints(content: BagContent) -> list[tuple[str, str, str]]:
    """Returns topic and names of joints that look like the left and right wheel's."""
    found = []
    for topic, name in sorted(content.joints):
        for left, right in (("left", "right"), ("Left", "Right"), ("_l", "_r"), ("l_", "r_")):
            twin = name.replace(left, right, 1)
            if left in name and (topic, twin) in content.joints and twin != name:
                found.append((topic, name, twin))
                break
    return sorted(found, key=lambda joint: "wheel" not in joint[1].lower())


def _wheels(
    content: BagContent, robot: RobotFile, notes: list[str]
) -> tuple[Stream, Stream] | None:
    topic = robot.topics.wheels
    if topic is not None:
        _must_have(content, topic, (types.JOINTS,), "wheels")
    if robot.joints is not None:
        topics = {t for t, _ in content.joints if topic in (None, t)}
        streams = []
        for name in (robot.joints.left, robot.joints.right):
            known = [t for t in sorted(topics) if (t, name) in content.joints]
            if not known:
                names = sorted({joint for t, joint in content.joints if t in topics})
                raise BadLog(
                    f"{content.path}: has no joint {name!r}, which [joints] of the robot file "
                    f"names; {nearest(name, names)}"
                )
            streams.append(content.joints[known[0], name])
        return streams[0], streams[1]
    pairs = [pair for pair in wheel_joints(content) if topic in (None, pair[0])]
    if not pairs:
        return None
    topic, left, right = pairs[0]
    if robot.robot is not None:
        notes.append(
            f"{topic}: the joints {left} and {right} are taken for the wheels; [joints] in a robot "
            "file says otherwise"
        )
    return content.joints[topic, left], content.joints[topic, right]


def _odometry(content: BagContent, robot: RobotFile, notes: list[str]) -> Stream | None:
    asked = robot.topics.odometry
    topic = None if asked is None else content.topics.get(asked)
    if topic is not None and topic.channel.type == types.TRANSFORMS:
        return _moving_frame(content, robot, notes)
    if asked is not None or robot.frames.odometry is None:
        found = _one(content, asked, (types.ODOMETRY,), "odometry", notes, "truth")
        if found is not None:
            return found
    return _moving_frame(content, robot, notes)


def _moving_frame(content: BagContent, robot: RobotFile, notes: list[str]) -> Stream | None:
    """Returns the robot's frame in odometry's, by tf."""
    moving = {pair: one.moves for pair, one in content.transforms.items() if not one.fixed}
    parents = (robot.frames.odometry,) if robot.frames.odometry else ODOMETRY_FRAMES
    children = (robot.frames.robot,) if robot.frames.robot else ROBOT_FRAMES
    for parent in parents:
        for child in children:
            if (parent, child) in moving:
                if not (robot.frames.odometry and robot.frames.robot):
                    notes.append(f"odometry is the frame {child} in {parent}, by tf")
                return moving[parent, child]
    if robot.frames.odometry and robot.frames.robot:
        known = ", ".join(f"{child} in {parent}" for parent, child in sorted(moving)) or "none"
        raise BadLog(
            f"{content.path}: tf has no moving frame {robot.frames.robot!r} in "
            f"{robot.frames.odometry!r}, which [frames] of the robot file names; it has {known}"
        )
    return None


def _images(content: BagContent, robot: RobotFile, notes: list[str]) -> dict[str, Stream]:
    kinds = (types.IMAGE, types.COMPRESSED)
    if robot.topics.images:
        return {
            camera: _must_have(content, topic, kinds, f"images.{camera}")
            for camera, topic in robot.topics.images.items()
        }
    found = content.of_type(*kinds)
    if not found:
        return {}
    topic, stream = next(iter(found.items()))
    cameras = [*robot.cameras, *([DEFAULT_CAMERA] if robot.camera is not None else [])]
    camera = cameras[0] if len(cameras) == 1 else DEFAULT_CAMERA
    if len(found) > 1:
        others = ", ".join(name for name in found if name != topic)
        notes.append(
            f"{topic} is taken for the images of camera {camera!r}; there are {others} too: "
            "[topics] images in a robot file says otherwise"
        )
    return {camera: stream}


def _truth(content: BagContent, robot: RobotFile) -> Stream | None:
    kinds = (types.POSE, types.POSE_WITH_COVARIANCE, types.ODOMETRY)
    if robot.topics.truth is not None:
        return _must_have(content, robot.topics.truth, kinds, "truth")
    for name, stream in content.of_type(*kinds).items():
        if any(word in name.lower() for word in TRUTH_WORDS):
            return stream
    return None


def _one(
    content: BagContent,
    asked: str | None,
    kinds: tuple[str, ...],
    part: str,
    notes: list[str],
    without: str = "",
) -> Stream | None:
    """Returns the topic that was asked for, or that with the most messages of its types."""
    if asked is not None:
        return _must_have(content, asked, kinds, part)
    found = [name for name in content.of_type(*kinds) if not without or without not in name.lower()]
    if not found:
        return None
    if len(found) > 1:
        notes.append(
            f"{found[0]} is taken for the {part}; there are {', '.join(found[1:])} too: [topics] "
            f"{part} in a robot file says otherwise"
        )
    return content.streams[found[0]]


def _must_have(content: BagContent, topic: str, kinds: Iterable[str], part: str) -> Stream:
    """Returns the stream of a topic that the robot file names."""
    known = content.topics.get(topic)
    if known is None:
        raise BadLog(
            f"{content.path}: has no topic {topic!r}, which [topics] {part} of the robot file "
            f"names; {nearest(topic, sorted(content.topics))}"
        )
    if known.channel.type not in kinds:
        raise BadLog(
            f"{content.path}: {topic} holds {known.channel.type}, which cannot be {part}; it must "
            f"be {' or '.join(kinds)}"
        )
    return content.streams.get(topic) or Stream(known.channel.type, topic)


def _child(odometry: Stream | None) -> str:
    return "" if odometry is None else odometry.child
