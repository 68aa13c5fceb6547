"""Parts of a log as messages of ROS 1 or ROS 2."""

from __future__ import annotations

from typing import Any

import numpy as np

from frontend.images import image_file, read_grey
from frontend.readers import bag_types as types
from graphslam.geometry import Array

ROBOT_FRAME, ODOMETRY_FRAME, LASER_FRAME, FLOOR_FRAME = "base_link", "odom", "laser", "map"
JOINTS = ("left_wheel_joint", "right_wheel_joint")


def nanoseconds(t: float) -> int:
    """Returns a time in whole nanoseconds."""
    return round(t * 1e9)


class Maker:
    """Makes messages of one store of types."""

    def __init__(self, store: Any) -> None:
        self._types = store.types

    def header(self, t: float, frame: str) -> Any:
        """Returns a header with a stamp; ROS 1's has a number besides."""
        seconds, rest = divmod(nanoseconds(t), 10**9)
        stamp = self._types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
        kind = self._types["std_msgs/msg/Header"]
        number = {"seq": 0} if "seq" in kind.__dataclass_fields__ else {}
        return kind(**number, stamp=stamp, frame_id=frame)

    def joints(self, t: float, angles: Array) -> Any:
        """Returns the angles of both wheels."""
        nothing = np.zeros(0)
        return self._types[types.JOINTS](
            header=self.header(t, ROBOT_FRAME),
            name=list(JOINTS),
            position=np.array(angles, float),
            velocity=nothing,
            effort=nothing,
        )

    def pose_of(self, pose: Array) -> Any:
        """Returns a pose in the plane."""
        names = self._types
        point = names["geometry_msgs/msg/Point"](x=float(pose[0]), y=float(pose[1]), z=0.0)
        half = 0.5 * float(pose[2])
        turn = names["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half))
        )
        return names["geometry_msgs/msg/Pose"](position=point, orientation=turn)

    def pose(self, t: float, pose: Array) -> Any:
        """Returns a true pose."""
        return self._types[types.POSE](header=self.header(t, FLOOR_FRAME), pose=self.pose_of(pose))

    def odometry(self, t: float, pose: Array) -> Any:
        """Returns a pose by odometry; its covariances are zero, which means unknown."""
        names, none = self._types, np.zeros(36)
        zero = names["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        twist = names["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
        return names[types.ODOMETRY](
            header=self.header(t, ODOMETRY_FRAME),
            child_frame_id=ROBOT_FRAME,
            pose=names["geometry_msgs/msg/PoseWithCovariance"](self.pose_of(pose), none),
            twist=names["geometry_msgs/msg/TwistWithCovariance"](twist, none),
        )

    def compressed(self, t: float, image: Any) -> Any:
        """Returns an image as the file that it is or becomes; None where it is unreadable."""
        found = image_file(image)
        if found is None:
            return None
        suffix, data = found
        return self._types[types.COMPRESSED](
            header=self.header(t, "camera"),
            format=suffix.lstrip(".").replace("jpg", "jpeg"),
            data=np.frombuffer(data, np.uint8),
        )

    def image(self, t: float, image: Any) -> Any:
        """Returns an image as grey levels; None where it is unreadable."""
        grey = read_grey(image)
        if grey is None:
            return None
        return self._types[types.IMAGE](
            header=self.header(t, "camera"),
            height=grey.shape[0],
            width=grey.shape[1],
            encoding="mono8",
            is_bigendian=0,
            step=grey.shape[1],
            data=grey.ravel(),
        )

    def scan(self, t: float, place: Any) -> Any:
        """Returns a scan; None where it is unreadable."""
        scan = place.scan()
        if scan is None:
            return None
        beams = max(1, len(scan.ranges) - 1)
        return self._types[types.SCAN](
            header=self.header(t, LASER_FRAME),
            angle_min=scan.angle_min,
            angle_max=scan.angle_min + (len(scan.ranges) - 1) * scan.angle_step,
            angle_increment=scan.angle_step,
            time_increment=scan.duration / beams,
            scan_time=0.0,
            range_min=scan.range_min,
            range_max=scan.range_max,
            ranges=np.array(scan.ranges, np.float32),
            intensities=np.zeros(0, np.float32),
        )

    def laser(self, t: float, pose: Array) -> Any:
        """Returns where the laser is."""
        names, half = self._types, 0.5 * float(pose[2])
        shift = names["geometry_msgs/msg/Vector3"](x=float(pose[0]), y=float(pose[1]), z=0.0)
        turn = names["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half))
        )
        one = names["geometry_msgs/msg/TransformStamped"](
            header=self.header(t, ROBOT_FRAME),
            child_frame_id=LASER_FRAME,
            transform=names["geometry_msgs/msg/Transform"](translation=shift, rotation=turn),
        )
        return names[types.TRANSFORMS](transforms=[one])
