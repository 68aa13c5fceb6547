"""Messages of ROS 1 and ROS 2: from bytes to values, by `rosbags`, and types that are read."""

from __future__ import annotations

from functools import cache
from typing import Any

ODOMETRY = "nav_msgs/msg/Odometry"
JOINTS = "sensor_msgs/msg/JointState"
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
SCAN = "sensor_msgs/msg/LaserScan"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

READ = (
    ODOMETRY, JOINTS, IMAGE, COMPRESSED, CAMERA_INFO, SCAN, POSE, POSE_WITH_COVARIANCE, TRANSFORMS,
)  # fmt: skip
"""Types that a log can be made of."""
ENCODINGS = ("ros1", "cdr")

_OLD_TRANSFORMS = "tf/msg/tfMessage"


class Undecodable(Exception):
    """A message whose bytes do not follow its type."""


def normal_type(name: str) -> str:
    """Returns a type's name as ROS 2 writes it: ``package/msg/Name``."""
    parts = [part for part in name.split("/") if part]
    name = "/".join([parts[0], "msg", parts[1]]) if len(parts) == 2 else "/".join(parts)
    return TRANSFORMS if name == _OLD_TRANSFORMS else name


def decode(kind: str, encoding: str, data: bytes | memoryview, definition: str = "") -> Any:
    """Returns a message of one of the types in `READ`.

    Args:
        kind: its type.
        encoding: "ros1" or "cdr".
        data: its bytes.
        definition: text of a definition of the type that differs from the standard one, or empty.

    Raises:
        Undecodable: the bytes do not follow the type.
    """
    store = store_of(encoding, kind, definition)
    try:
        read = store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr
        return read(data, kind)
    except Exception as error:  # generated code on arbitrary bytes: nearly anything may be raised
        raise Undecodable(f"does not follow its type {kind}") from error


@cache
def differing_definition(kind: str, encoding: str, definition: str, md5: str) -> str:
    """Returns a definition where it is another than the standard one of its type, else nothing."""
    if encoding != "ros1" or not definition or not md5 or md5 == "*":
        return ""
    return "" if _standard("ros1").generate_msgdef(kind)[1] == md5 else definition


@cache
def store_of(encoding: str, kind: str = "", definition: str = "") -> Any:
    """Returns a store of types of `rosbags`, in which ``kind`` is as ``definition`` has it.

    Raises:
        Undecodable: the definition cannot be parsed.
    """
    if not definition:
        return _standard(encoding)
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(definition, kind))
    except Exception as error:  # the parser's own errors, and what a damaged text provokes
        raise Undecodable(f"the bag's definition of {kind} cannot be parsed") from error
    return store


@cache
def _standard(encoding: str) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if encoding != "ros1":
        return get_typestore(Stores.ROS2_HUMBLE)
    store = get_typestore(Stores.ROS1_NOETIC)
    text = "geometry_msgs/TransformStamped[] transforms\n"
    store.register(get_types_from_msg(text, TRANSFORMS))
    return store


def stamp_of(header: Any) -> int:
    """Returns the time stamp of a message's header, ns."""
    return 10**9 * int(header.stamp.sec) + int(header.stamp.nanosec)
