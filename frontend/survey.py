"""What a bag holds, and a robot file for it: what could be found, and what is missing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from frontend.log import DEFAULT_CAMERA
from frontend.readers import bag_types as types
from frontend.readers.bag_choice import Choice, choose
from frontend.readers.bag_content import BagContent, Stream
from frontend.readers.bag_places import BagImage
from frontend.readers.robot_toml import FORMAT, RobotFile
from frontend.write_folder import text, toml

LENSES = {"plumb_bob": "plain", "rational_polynomial": "plain", "equidistant": "fisheye"}
"""Models of `sensor_msgs/CameraInfo`, as `frontend.camera` calls them."""


@dataclass(frozen=True, slots=True)
class TopicRow:
    """One topic of a bag.

    Attributes:
        topic: its name.
        type: of its messages.
        count: messages.
        first_s: when the first was received, s.
        last_s: when the last was.
        mean_hz: messages a second between the first and the last; NaN for a single one.
        bytes: of all messages.
        use: what of a log it becomes; empty where it is not used.
    """

    topic: str
    type: str
    count: int
    first_s: float
    last_s: float
    mean_hz: float
    bytes: int
    use: str


@dataclass(frozen=True, slots=True)
class Survey:
    """What `survey` found out about a bag.

    Attributes:
        path: the bag.
        topics: in the order of their first message.
        frames: pairs of frames in tf, and whether they move.
        proposal: a robot file: what was found, and as comments what is missing.
        missing: what to add to it, in words.
        losses: what of the bag could not be read.
    """

    path: Path
    topics: tuple[TopicRow, ...]
    frames: tuple[str, ...]
    proposal: str
    missing: tuple[str, ...]
    losses: tuple[str, ...]


def survey(content: BagContent, robot: RobotFile | None = None) -> Survey:
    """Returns what a bag holds, and a proposed robot file.

    Args:
        content: of the bag.
        robot: the robot file that is there already, or None.

    Raises:
        BadLog: the robot file names what the bag has not.
    """
    robot = robot or RobotFile()
    choice = choose(content, robot)
    missing: list[str] = []
    proposal = "".join(f"{line}\n" for line in _proposal(content, choice, robot, missing))
    uses = _uses(choice)
    rows = []
    for name, topic in content.topics.items():
        lasts = (topic.last_ns - topic.first_ns) / 1e9
        rate = (topic.count - 1) / lasts if lasts > 0 else float("nan")
        rows.append(
            TopicRow(
                name,
                topic.channel.type,
                topic.count,
                topic.first_ns / 1e9,
                topic.last_ns / 1e9,
                rate,
                topic.bytes,
                uses.get(name, ""),
            )
        )
    frames = tuple(
        f"{child} in {parent}: {'fixed' if one.fixed else 'moves'}"
        for (parent, child), one in sorted(content.transforms.items())
    )
    losses = content.losses.texts()
    return Survey(content.path, tuple(rows), frames, proposal, tuple(missing), losses)


def _uses(choice: Choice) -> dict[str, str]:
    uses: dict[str, str] = {}
    if choice.wheels is not None:
        uses[choice.wheels[0].label.partition(" joint ")[0]] = "wheels"
    for name, stream in (
        ("odometry", choice.odometry),
        ("scans", choice.scans),
        ("truth", choice.truth),
    ):
        if stream is not None:
            uses[stream.label.split(" ")[0]] = name
    uses |= {stream.label: f"images of {camera}" for camera, stream in choice.images.items()}
    return uses


def _proposal(
    content: BagContent, choice: Choice, robot: RobotFile, missing: list[str]
) -> Iterator[str]:
    """Yields the lines of a robot file; what is missing goes into ``missing`` too."""
    yield f'format = "{FORMAT}"'
    yield f"# proposed for {content.path.name}; lines that begin with # are missing or optional"
    yield from _robot(choice, robot, missing)
    yield from _cameras(content, choice, robot, missing)
    yield ""
    yield "# [start]                       # where the robot is at first; absent: the origin, known"
    yield "# pose = [0.0, 0.0, 0.0]        # m, m, rad, floor frame"
    yield ""
    yield "[topics]"
    if choice.wheels is not None:
        yield f"wheels = {text(choice.wheels[0].label.partition(' joint ')[0])}"
    if choice.odometry is not None:
        yield f"odometry = {text(choice.odometry.label.split(' ')[0])}"
    for camera, stream in choice.images.items():
        yield f"images.{text(camera)} = {text(stream.label)}"
    if choice.scans is not None:
        yield f"scans = {text(choice.scans.label)}"
    if choice.truth is not None:
        yield f"truth = {text(choice.truth.label)}"
    else:
        yield '# truth = "/mocap/pose"         # geometry_msgs/PoseStamped, for judging only'
    if choice.wheels is not None:
        left, right = (stream.label.partition(" joint ")[2] for stream in choice.wheels)
        yield from ("", "[joints]", f"left = {text(left)}", f"right = {text(right)}")
    if choice.odometry is not None and choice.odometry.kind == types.TRANSFORMS:
        yield from ("", "[frames]", f"odometry = {text(choice.odometry.frame)}")
        yield f"robot = {text(choice.odometry.child)}"
    yield from _laser(choice, missing)


def _robot(choice: Choice, robot: RobotFile, missing: list[str]) -> Iterator[str]:
    yield ""
    names = ("wheel_radius_left", "wheel_radius_right", "wheel_base")
    given = {name: getattr(robot.robot, name) for name in names} if robot.robot else {}
    if all(given.get(name) for name in names):
        yield "[robot]"
        yield from (f"{name} = {given[name]!r}" for name in names)
        return
    note = "missing" if choice.odometry is None else "optional beside odometry"
    if choice.odometry is None:
        missing.append("[robot]: radii of the wheels and wheel base, m; no message holds them")
    yield f"# [robot]                       # {note}"
    yield from (f"# {name} = 0.0".ljust(32) + "# m, measure it" for name in names)


def _cameras(
    content: BagContent, choice: Choice, robot: RobotFile, missing: list[str]
) -> Iterator[str]:
    described = {*robot.cameras, *([DEFAULT_CAMERA] if robot.camera is not None else [])}
    for camera, stream in choice.images.items():
        table = "[camera]" if camera == DEFAULT_CAMERA else f"[cameras.{text(camera)}]"
        if camera in described:
            yield from ("", f"# {table}: as in the robot file that was given")
            continue
        missing.append(
            f"{table} homography: where the floor is in the images of {stream.label}; "
            "`graphslam calibrate --points` (or --chessboard) finds it"
        )
        yield from ("", f"# {table}                      # needs its homography")
        info = _info(content, stream)
        size = _size(content, stream) or (info.about["size"] if info is not None else None)
        yield f"# image_size = {list(size) if size else '[640, 480]'}"
        yield "# homography = [[...], [...], [...]]    # graphslam calibrate --points prints it"
        if info is None or not np.any(info.about["matrix"]):
            missing.append(
                f"{table} matrix, distortion: no CameraInfo goes with {stream.label}; without them "
                "the lens counts as straight"
            )
            continue
        yield f"# matrix = {toml(info.about['matrix'])}    # of {info.label}"
        if np.any(info.about["distortion"]):
            yield f"# distortion = {toml(info.about['distortion'])}"
        lens = LENSES.get(info.about["model"], "plain")
        if lens != "plain":
            yield f'# lens = "{lens}"'


def _laser(choice: Choice, missing: list[str]) -> Iterator[str]:
    if choice.scans is None:
        return
    if choice.laser_known:
        yield from ("", "[laser]", f"pose = {toml(choice.laser_pose)}    # by tf; m, m, rad")
        return
    missing.append(f"[laser] pose: tf does not say where {choice.scans.frame or 'the laser'} is")
    yield from (
        "",
        "# [laser]",
        "# pose = [0.0, 0.0, 0.0]        # missing: robot frame, m, m, rad",
    )


def _info(content: BagContent, images: Stream) -> Stream | None:
    """Returns the CameraInfo of a camera: that of its frame, or whose topic lies beside."""
    infos = content.of_type(types.CAMERA_INFO)
    for info in infos.values():
        if info.frame and info.frame == images.frame:
            return info
    for name, info in infos.items():
        if images.label.startswith(name.rpartition("/")[0] + "/"):
            return info
    return None


def _size(content: BagContent, stream: Stream) -> tuple[int, int] | None:
    """Returns width and height of a topic's first image."""
    if not len(stream):
        return None
    place = stream.places()[0]
    channel = content.topics[stream.label].channel
    first = BagImage(stream.label, "", content.files[place.file], channel, place).grey()
    return None if first is None else (first.shape[1], first.shape[0])
