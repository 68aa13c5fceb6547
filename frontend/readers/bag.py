"""Reader of bags: ROS 1, ROS 2 (SQLite, MCAP) and bare MCAP files (docs/bags.md)."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from frontend.log import Log, Progress, with_camera_offset
from frontend.log_parts import ImageList, PoseTrack, Wheels
from frontend.readers.bag_choice import Choice, choose
from frontend.readers.bag_collect import collect
from frontend.readers.bag_content import BagContent, Stream
from frontend.readers.bag_places import BagImage, BagScan
from frontend.readers.bag_times import Times, times_of
from frontend.readers.bag_warnings import CURE_UNREADABLE, no_odometry, warnings_of, why
from frontend.readers.folder_tables import read_map
from frontend.readers.log_toml import every_camera
from frontend.readers.point_tables import read_landmarks
from frontend.readers.robot_toml import RobotFile, read_robot_file
from frontend.recorded import ScanList
from graphslam.errors import BadConfig, BadLog
from graphslam.geometry import wrap
from graphslam.measurements import LandmarkMap
from graphslam.models.wheels import DifferentialDrive

NO_ROBOT = "without a robot file"


def read_bag(path: Path, robot_file: Path | None = None, progress: Progress | None = None) -> Log:
    """Returns the log in a bag.

    Args:
        path: a bag's file, or the folder of a ROS 2 bag.
        robot_file: says what the bag does not; None: nothing does.
        progress: told bytes.

    Raises:
        BadLog: nothing can be made of the bag, or the robot file contradicts its format or the
            bag; the message says what is there and what to do.
    """
    robot = robot_of(robot_file)
    if robot_file is not None:
        every_camera(robot_file, robot)  # what is wrong with them is told before the long part
    return open_collected(open_content(path, progress), robot, robot_file)


def robot_of(path: Path | None) -> RobotFile:
    """Returns a robot file's content, or of none what holds without one."""
    return RobotFile() if path is None else read_robot_file(path)


def open_content(path: Path, progress: Progress | None = None) -> BagContent:
    """Returns what a bag holds; raises BadLog where nothing of it can be read."""
    content = collect(path, progress)
    if not content.messages:
        raise BadLog(f"{path}: nothing of it can be read: {why(content)}; {CURE_UNREADABLE}")
    return content


def open_collected(content: BagContent, robot: RobotFile, robot_file: Path | None) -> Log:
    """Returns the log that a bag's content makes; raises BadLog where it makes none."""
    cameras = {} if robot_file is None else every_camera(robot_file, robot)
    path, choice = content.path, choose(content, robot)
    drive = _drive(robot, robot_file, choice)
    wheels_used = choice.wheels is not None and drive is not None and _has_size(robot)
    if not wheels_used and choice.odometry is None:
        raise BadLog(no_odometry(content, choice))
    used = _used(choice, cameras, wheels_used)
    reference = "left" if wheels_used else "odometry"
    times = times_of(used, robot.time.stamp, reference)
    wheels, wheel_notes = _wheels(used, times) if wheels_used else (None, ())
    odometry = None if wheels_used else _track(used["odometry"], times["odometry"])
    if odometry is not None and len(odometry.t) < 2:
        raise BadLog(
            f"{path}: {used['odometry'].label} has {len(odometry.t)} usable poses and needs at "
            "least 2; record more"
        )
    truth = _track(used["truth"], times["truth"]) if "truth" in used else None
    images = _images(content, used, times)
    scans = _scans(content, choice, times)
    start = robot.start
    log = Log(
        name=bag_name(path, robot),
        folder=path,
        robot=drive,
        cameras=cameras,
        start_pose=np.array(start.pose if start else (0.0, 0.0, 0.0)),
        start_sigma=np.array(start.sigma if start else (0.0, 0.0, 0.0)),
        start_given=start is not None,
        wheels=wheels,
        odometry=odometry,
        images=images,
        sightings=None,
        pose_fixes=None,
        truth=truth if truth is not None and len(truth.t) else None,
        map=_beside(robot_file, robot.map, read_map),
        landmarks=_beside(robot_file, robot.landmarks, read_landmarks),
        warnings=(),
        digest=_digest(used, robot_file, robot.landmarks),
        scans=scans,
        labels={**_labels(used, choice), "map": "map.csv"},
        described=NO_ROBOT if robot_file is None else robot_file.name,
    )
    notes = [f"{used[name].label}: {note}" for name, one in times.items() for note in one.notes]
    notes += wheel_notes
    log = replace(log, warnings=warnings_of(log, content, choice, robot_file, notes))
    if robot.time.camera_offset:
        log = replace(with_camera_offset(log, robot.time.camera_offset), offset_s=0.0)
    return log


def _has_size(robot: RobotFile) -> bool:
    return robot.robot is not None and robot.robot.wheel_base is not None


def _drive(robot: RobotFile, path: Path | None, choice: Choice) -> DifferentialDrive | None:
    if robot.robot is None:
        return None
    try:
        return robot.robot.drive(geometry_needed=choice.odometry is None)
    except BadConfig as refused:
        raise BadLog(f"{path}: [robot] {refused}") from None


def _used(choice: Choice, cameras: Collection[str], wheels_used: bool) -> dict[str, Stream]:
    """Returns the streams that the log is made of, by their part."""
    used: dict[str, Stream] = {}
    if wheels_used:
        assert choice.wheels is not None
        used["left"], used["right"] = choice.wheels
    elif choice.odometry is not None:
        used["odometry"] = choice.odometry
    used |= {f"images {name}": s for name, s in choice.images.items() if name in cameras}
    if choice.scans is not None:
        used["scans"] = choice.scans
    if choice.truth is not None:
        used["truth"] = choice.truth
    return used


def _wheels(used: Mapping[str, Stream], times: Mapping[str, Times]) -> tuple[Wheels, list[str]]:
    """Returns the wheels at the times of the left one, and what was done to their angles."""
    notes, angles = [], {}
    for side in ("left", "right"):
        angle = used[side].rows(1)[times[side].row, 0]
        if len(angle) < 2:
            raise BadLog(f"{used[side].label} has {len(angle)} usable angles and needs at least 2")
        if np.abs(angle).max() < 2 * np.pi + 0.01 and np.abs(np.diff(angle)).max() > np.pi:
            notes.append(
                f"{used[side].label}: its angles start anew at each turn; they were unrolled"
            )
            angle = np.unwrap(angle)
        angles[side] = angle
    t, other = times["left"].t, times["right"].t
    inside = (t >= other[0]) & (t <= other[-1])
    right = np.interp(t[inside], other, angles["right"])
    if np.count_nonzero(inside) < 2:
        raise BadLog(f"{used['left'].label} and {used['right'].label} have no time in common")
    return Wheels(t[inside], np.column_stack([angles["left"][inside], right])), notes


def _track(stream: Stream, times: Times) -> PoseTrack:
    pose = stream.rows(3)[times.row]
    return PoseTrack(times.t, np.column_stack([pose[:, :2], wrap(pose[:, 2])]))


def _images(
    content: BagContent, used: Mapping[str, Stream], times: Mapping[str, Times]
) -> ImageList | None:
    rows: list[tuple[float, str, BagImage]] = []
    for part, stream in used.items():
        if not part.startswith("images "):
            continue
        places, channel = stream.places(), content.topics[stream.label].channel
        for t, row in zip(times[part].t.tolist(), times[part].row.tolist(), strict=True):
            place = places[row]
            image = BagImage(
                f"{stream.label} message {row + 1}",
                stream.image_digest[row].hex(),
                content.files[place.file],
                channel,
                place,
            )
            rows.append((t, part.removeprefix("images "), image))
    if not rows:
        return None
    rows.sort(key=lambda row: row[:2])
    t, cameras, images = zip(*rows, strict=True)
    return ImageList(np.array(t), images, cameras)


def _scans(content: BagContent, choice: Choice, times: Mapping[str, Times]) -> ScanList | None:
    stream = choice.scans
    if stream is None or not len(times["scans"].t):
        return None
    places, channel = stream.places(), content.topics[stream.label].channel
    scans = tuple(
        BagScan(
            f"{stream.label} message {row + 1}",
            content.files[places[row].file],
            channel,
            places[row],
            choice.laser_upside_down,
        )
        for row in times["scans"].row.tolist()
    )
    return ScanList(times["scans"].t, scans, choice.laser_pose)


def _beside(
    robot_file: Path | None, name: str | None, read: Callable[[Path], LandmarkMap]
) -> LandmarkMap | None:
    """Returns the landmarks of a file that the robot file names, None where it names none."""
    return None if robot_file is None or name is None else read(robot_file.parent / name)


def bag_name(path: Path, robot: RobotFile) -> str:
    """Returns the bag's name where the robot file gives none, without what no folder may have."""
    if robot.name is not None:
        return robot.name
    path = path.resolve()
    name = path.name if path.is_dir() else path.stem
    plain = "".join(c if c.isprintable() and c not in '/\\:*?"<>|' else "-" for c in name[:100])
    return plain.strip().lstrip(".") or "bag"


def _labels(used: Mapping[str, Stream], choice: Choice) -> dict[str, str]:
    images = [s.label for part, s in used.items() if part.startswith("images ")]
    labels = {"images": ", ".join(images) or "no image topic", "sightings": "no sightings"}
    if "left" in used and choice.wheels is not None:
        labels["wheels"] = used["left"].label.partition(" joint ")[0]
    for part in ("odometry", "scans", "truth"):
        labels[part] = used[part].label if part in used else f"no {part} topic"
    return labels


def _digest(used: Mapping[str, Stream], robot_file: Path | None, landmarks: str | None) -> str:
    """Returns the SHA-256, hexadecimal, of all that was read of the streams used."""
    total = hashlib.sha256(b"" if robot_file is None else robot_file.read_bytes())
    if robot_file is not None and landmarks is not None:
        total.update((robot_file.parent / landmarks).read_bytes())
    for part, stream in sorted(used.items()):
        total.update(part.encode() + stream.digest())
    return total.hexdigest()
