"""A camera fixed above the floor that watches two coloured tags on the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from frontend.camera import Camera
from graphslam.errors import BadConfig
from graphslam.geometry import Array, rotation, wrap

Point = tuple[float, float]

NO_CENTRE = "overhead image that does not show the centre tag"
NO_FRONT = "overhead image that does not show the front tag"
NEITHER = "overhead image that shows neither tag"
AT_BORDER = "overhead image with a tag cut off at its border"
OTHER_SIZE = "overhead image with a tag of another size than stated: partly hidden, or merged"
APART = "overhead image with tags that are not as far apart as stated"
AMBIGUOUS = "overhead image in which several pairs of objects may be the tags"
BESIDE = "object of a tag's colour that is none of the tags"
NO_POSE = (NEITHER, NO_CENTRE, NO_FRONT, AT_BORDER, OTHER_SIZE, APART, AMBIGUOUS)
"""Why an overhead image gives no pose."""

SMALLEST_APART_M = 0.005
"""Tags nearer to each other than this tell no direction."""
SOLVES = 4
"""Gauss-Newton steps of `pose_of_tags`; from the closed form two reach rounding."""
STEP_PX = 0.25
"""Step of the difference quotient that carries pixel noise to the floor."""


@dataclass(frozen=True, slots=True)
class TagMount:
    """Where the two tags are on the robot.

    Attributes:
        front: (x, y) of the middle of the tag that shows the direction, robot frame, m.
        centre: (x, y) of the middle of the other one, robot frame, m.
        diameter: of both, m; None where it is not known, so that size tells nothing.
        height: of the tags above the plane that the camera's homography maps, m.
    """

    front: Point
    centre: Point = (0.0, 0.0)
    diameter: float | None = None
    height: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite([*self.front, *self.centre, self.height]).all():
            raise BadConfig("tags: front, centre and height must be finite numbers, m")
        if self.distance < SMALLEST_APART_M:
            raise BadConfig(
                f"tags: front = {list(self.front)} and centre = {list(self.centre)} are at one "
                "place; give the middle of each tag in metres, robot frame"
            )
        if self.diameter is not None and not 0 < self.diameter < math.inf:
            raise BadConfig(f"tags: diameter = {self.diameter}: must be positive, m")

    @property
    def distance(self) -> float:
        """From tag to tag, m."""
        return math.dist(self.front, self.centre)

    def points(self) -> Array:
        """Returns both tags (2, 2), the centre one first, robot frame, m."""
        return np.array([self.centre, self.front])


@dataclass(frozen=True, slots=True)
class OverheadCamera:
    """A camera in the room, and the tags that it watches.

    Attributes:
        camera: image size, lens, and the homography from the *floor frame*, m, to undistorted
            pixels; it maps the plane in which the calibration marks lay.
        tags: on the robot.
        position: (x, y, z) of the camera, floor frame, m, z above that plane; needed where the tags
            are not in it.
    """

    camera: Camera
    tags: TagMount
    position: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.tags.height == 0.0:
            return
        if self.position is None:
            raise BadConfig(
                f"camera {self.camera.name!r}: tags.height = {self.tags.height}: needs position = "
                "[x, y, z] of the camera, floor frame, m; or map the plane of the tags, and write 0"
            )
        if not self.tags.height < self.position[2]:
            raise BadConfig(
                f"camera {self.camera.name!r}: tags.height = {self.tags.height} is not below the "
                f"camera, position = {list(self.position)}; give both in metres"
            )

    @property
    def name(self) -> str:
        """Name of the camera in the log."""
        return self.camera.name

    @property
    def looks_at(self) -> str:
        """At the robot, from above: "overhead"."""
        return "overhead"

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.camera.image_size

    @property
    def delay_s(self) -> float:
        """How long after an image was taken what it shows is known, s."""
        return self.camera.delay_s

    def to_floor(self, pixels: Array) -> tuple[Array, Array]:
        """Returns where tags are (K, 2), m, floor frame, and the derivative by their pixels.

        Tags above the plane of the homography are moved towards the camera's foot, by the share of
        the camera's height that they are high.

        Args:
            pixels: (K, 2) of the recorded image.

        Returns:
            Places, and (K, 2, 2) metres per pixel; NaN above the horizon.
        """
        pixels = np.asarray(pixels, float)
        du, dv = np.array([STEP_PX, 0.0]), np.array([0.0, STEP_PX])
        steps = [pixels, pixels + du, pixels - du, pixels + dv, pixels - dv]
        place, right, left, down, up = (self._place(p) for p in steps)
        J = np.stack([right - left, down - up], axis=-1) / (2.0 * STEP_PX)
        return place, J

    def _place(self, pixels: Array) -> Array:
        plane = self.camera.pixel_to_floor(self.camera.undistort(pixels))
        if self.position is None or self.tags.height == 0.0:
            return plane
        foot = np.array(self.position[:2])
        return foot + (1.0 - self.tags.height / self.position[2]) * (plane - foot)

    def to_pixels(self, points: Array) -> Array:
        """Returns pixels (..., 2) of the recorded image of places (..., 2) as high as the tags."""
        points = np.asarray(points, float)
        if self.position is not None and self.tags.height != 0.0:
            foot = np.array(self.position[:2])
            points = foot + (points - foot) / (1.0 - self.tags.height / self.position[2])
        return self.camera.distort(self.camera.floor_to_pixel(points))


def pose_of_tags(floor: Array, cov: Array, mount: TagMount) -> tuple[Array, Array]:
    """Returns the robot's pose (3,) and its covariance (3, 3), floor frame, from both tags.

    The least-squares pose for the noise of both: the direction is that from the centre tag to the
    front one, and the known distance between them helps along it.

    Args:
        floor: (2, 2) where the centre and the front tag were seen, floor frame, m.
        cov: (2, 2, 2) their covariances, m^2.
        mount: where they are on the robot.

    Source: Atali eq. (1), ``atan2(y_green - y_blue, x_green - x_blue)`` in the floor frame; printed
    with atan of the quotient, which loses half of all directions, and blue minus green, which turns
    the rest round.
    """
    on_robot = mount.points()
    seen, own = floor[1] - floor[0], on_robot[1] - on_robot[0]
    theta = math.atan2(seen[1], seen[0]) - math.atan2(own[1], own[0])
    pose = np.append(floor.mean(axis=0) - rotation(theta) @ on_robot.mean(axis=0), theta)
    weight = np.linalg.inv(cov)
    for _ in range(SOLVES):
        turned = on_robot @ rotation(pose[2]).T
        e = pose[:2] + turned - floor
        J = np.zeros((2, 2, 3))
        J[:, 0, 0] = J[:, 1, 1] = 1.0
        J[:, 0, 2], J[:, 1, 2] = -turned[:, 1], turned[:, 0]
        information = np.sum(np.swapaxes(J, 1, 2) @ weight @ J, axis=0)
        gradient = np.sum(np.swapaxes(J, 1, 2) @ weight @ e[..., None], axis=0)[:, 0]
        pose = pose - np.linalg.solve(information, gradient)
    pose[2] = wrap(pose[2])
    covariance = np.linalg.inv(information)
    return pose, 0.5 * (covariance + covariance.T)
