"""What the user should know about a bag: what was lost, guessed, or is not used."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from frontend.log import Log
from frontend.readers import bag_types as types
from frontend.readers.bag_choice import Choice
from frontend.readers.bag_content import BagContent, Stream

CURE_UNREADABLE = "copy it again from the robot, or record again"


def why(content: BagContent) -> str:
    """Returns what kept a bag from being read."""
    return "; ".join(content.losses.texts()) or "it holds no message"


def warnings_of(
    log: Log, content: BagContent, choice: Choice, robot_file: Path | None, notes: Iterable[str]
) -> tuple[str, ...]:
    """Returns all warnings about a bag, each once.

    Args:
        log: made of it.
        content: of the bag.
        choice: what of it is used.
        robot_file: the robot file, or None.
        notes: on times, wheels and cameras.
    """
    doubtful = _doubtful(log, content, choice, robot_file)
    return tuple(dict.fromkeys([*_losses(content), *choice.notes, *notes, *doubtful]))


def no_odometry(content: BagContent, choice: Choice) -> str:
    """Returns why a bag makes no log, and what to do."""
    topics = ", ".join(f"{name} ({topic.channel.type})" for name, topic in content.topics.items())
    lost = "".join(f"; lost: {text}" for text in content.losses.texts())
    if choice.wheels is not None:
        return (
            f"{content.path}: {choice.wheels[0].label} tells how the wheels turned, but not how "
            "large they are; give a robot file with [robot] wheel_radius_left, wheel_radius_right "
            f"and wheel_base: graphslam inspect {content.path} proposes one{lost}"
        )
    return (
        f"{content.path}: nothing tells how the robot moved: there is no nav_msgs/Odometry, no "
        "moving robot frame in tf and no JointState of wheels. Name them in a robot file ([topics],"
        f" [frames], [joints]), or record one of them. The bag has {topics or 'no topic'}{lost}"
    )


def _losses(content: BagContent) -> Iterator[str]:
    texts = content.losses.texts()
    if texts:
        yield (
            f"not all of the bag could be read ({content.messages:,} messages were): "
            f"{'; '.join(texts)}. What could be read is used; {CURE_UNREADABLE}"
        )


def _doubtful(
    log: Log, content: BagContent, choice: Choice, robot_file: Path | None
) -> Iterator[str]:
    """Yields warnings about what is usable, but hardly meant."""
    missing = "give a robot file" if robot_file is None else f"describe it in {robot_file.name}"
    for camera, stream in choice.images.items():
        if camera not in log.cameras:
            yield (
                f"{stream.label}: its images are not used: camera {camera!r} is not described; "
                f"{missing} (graphslam inspect {content.path} proposes one)"
            )
        yield from _unreadable(stream)
    if log.scans is not None and not log.has_walls():
        yield f"{log.labels['scans']}: not searched for walls, because there are images"
    elif log.scans is not None and not choice.laser_known:
        yield f"{log.labels['scans']}: {_LASER_UNKNOWN}"
    if choice.wheels is not None and log.wheels is None and log.robot is None:
        yield (
            f"{choice.wheels[0].label}: the wheels are not used, because nothing says how large "
            f"they are; odometry is ({log.labels['odometry']})"
        )
    if not len(log.searched_images()) and not log.has_walls():
        yield "no images that are searched: there is only odometry to estimate from"


_LASER_UNKNOWN = (
    "tf does not say where the laser is: the robot's origin is assumed, [laser] pose in a robot "
    "file says otherwise"
)


def _unreadable(stream: Stream) -> Iterator[str]:
    """Yields which encodings of a topic's images cannot be read."""
    if stream.kind != types.IMAGE or not stream.about:
        return
    from frontend.encodings import KNOWN

    encodings: dict[str, Any] = stream.about["encodings"]
    for encoding, count in encodings.items():
        if encoding not in KNOWN:
            yield (
                f"{stream.label}: {count} images are encoded as {encoding!r}, which this version "
                f"cannot read; publish one of {', '.join(KNOWN)}, or compressed images"
            )
