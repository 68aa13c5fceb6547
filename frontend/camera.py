"""A camera that sees a plane: floor metres to pixels and back, distortion, and what is in view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from graphslam.errors import BadConfig
from graphslam.geometry import Array, points_on_line

LOOKS_AT = ("floor", "overhead", "ceiling", "omni")
LENSES = ("plain", "fisheye")
DISTORTION_LENGTHS = (4, 5, 8, 12, 14)

LONGEST_DELAY_S = 1e6

LOST_PX = 1e5  # OpenCV's answer for directions that no undistorted pixel shows is beyond this

# Floor beyond this many times the depth of the nearest floor in the image does not count as seen:
# next to a horizon one pixel covers metres.
FARTHEST_VIEW = 30.0
BORDER_SAMPLES = 32


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A camera fixed to the robot (or to the room) that looks at a plane.

    Pixel centres are at integers, so that an image covers (-0.5, width - 0.5).

    Attributes:
        name: name of the camera in the log.
        looks_at: "floor", "overhead", "ceiling" or "omni".
        image_size: (width, height), pixels.
        homography: (3, 3) floor (robot frame, m) -> undistorted pixel (u, v), scaled so that its
            third row is positive for points in front of the camera.
        matrix: (3, 3) camera matrix, pixels, or None; it also makes the undistorted pixels.
        distortion: (n,) OpenCV coefficients k1 k2 p1 p2 [k3 ...] (fisheye: k1 k2 k3 k4), or None.
        lens: which of OpenCV's models ``distortion`` belongs to, "plain" or "fisheye".
        ignore_px: parts of the image that show the robot itself, each the corners u, v, u, v, ...
            of a rectangle (two) or a polygon (three or more), pixels of the recorded image.
        delay_s: how long after an image was taken what it shows is known, s.

    Raises:
        BadConfig: a value cannot be used; the message names it and the cure.
    """

    name: str
    looks_at: str
    image_size: tuple[int, int]
    homography: Array
    matrix: Array | None = None
    distortion: Array | None = None
    lens: str = "plain"
    ignore_px: tuple[tuple[float, ...], ...] = ()
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        if self.looks_at not in LOOKS_AT:
            raise self._bad(f"looks_at = {self.looks_at!r}: must be one of {', '.join(LOOKS_AT)}")
        if self.lens not in LENSES:
            raise self._bad(f"lens = {self.lens!r}: must be one of {', '.join(LENSES)}")
        size = tuple(self.image_size)
        if len(size) != 2 or any(n != int(n) or n <= 0 for n in size):
            raise self._bad(f"image_size = {size}: give [width, height] in pixels, both positive")
        object.__setattr__(self, "image_size", (int(size[0]), int(size[1])))
        check_delay(self.name, self.delay_s)
        self._check_ignored()
        self._set_array("homography", (3, 3))
        if self.matrix is not None:
            self._set_array("matrix", (3, 3))
            if self.matrix[0, 0] <= 0 or self.matrix[1, 1] <= 0:
                raise self._bad("matrix: the focal lengths on its diagonal must be positive")
        if self.distortion is not None:
            if self.matrix is None:
                raise self._bad("distortion needs the camera matrix it belongs to; give matrix too")
            self._set_array("distortion", (None,))
            if self.lens == "fisheye" and len(self.distortion) != 4:
                raise self._bad(
                    f"distortion has {len(self.distortion)} coefficients; OpenCV's fisheye model "
                    "takes 4 (k1 k2 k3 k4)"
                )
            if len(self.distortion) not in DISTORTION_LENGTHS:
                raise self._bad(
                    f"distortion has {len(self.distortion)} coefficients; OpenCV's model takes "
                    "4 (k1 k2 p1 p2), 5, 8, 12 or 14"
                )
        self._orient_homography()

    def _check_ignored(self) -> None:
        for corners in self.ignore_px:
            if len(corners) < 4 or len(corners) % 2 or not np.isfinite(corners).all():
                raise self._bad(
                    f"ignore_px has a part {list(corners)}; give its corners u, v, u, v, ... in "
                    "pixels, two of a rectangle or all of a polygon"
                )

    def _set_array(self, name: str, shape: tuple[int | None, ...]) -> None:
        try:
            array = np.array(getattr(self, name), dtype=float)
        except (TypeError, ValueError):
            raise self._bad(f"{name} is not an array of numbers") from None
        if array.ndim != len(shape) or any(
            w not in (None, g) for w, g in zip(shape, array.shape, strict=True)
        ):
            raise self._bad(f"{name} has shape {array.shape}; it must be {shape}")
        if not np.isfinite(array).all():
            raise self._bad(f"{name} holds NaN or infinity; calibrate again")
        self._freeze(name, array)

    def _freeze(self, name: str, array: Array) -> None:
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    def _orient_homography(self) -> None:
        """Scales the homography so that the middle of the image's lower edge is in front."""
        if np.linalg.cond(self.homography) > 1e12:
            raise self._bad(
                "homography cannot be inverted; it must map four floor points, no three on a "
                "line, to four different pixels"
            )
        width, height = self.image_size
        bottom = self.undistort(np.array([(width - 1) / 2, height - 1.0]))
        inverse = np.linalg.inv(self.homography)
        depth = inverse[2] @ np.append(bottom, 1.0)
        if abs(depth) <= 1e-12 * np.abs(inverse[2]).sum() * max(width, height):
            raise self._bad(
                "homography puts the horizon into the middle of the image's lower edge; it must "
                "map floor metres (x forward, y left) to pixels, not the other way round"
            )
        self._freeze("homography", self.homography * np.sign(depth))

    def _bad(self, text: str) -> BadConfig:
        return BadConfig(f"camera {self.name!r}: {text}")

    def floor_to_pixel(self, points: Array) -> Array:
        """Returns undistorted pixels (..., 2) of floor points (..., 2), m, robot frame.

        NaN for points behind the camera. Source: SantanaSLAM eq. (28), SantanaLoc eq. (31).
        """
        return _project(self.homography, points)

    def pixel_to_floor(self, points: Array) -> Array:
        """Returns floor points (..., 2), m, robot frame, of undistorted pixels (..., 2).

        NaN on and above the horizon. Source: SantanaLoc eq. (31), inverted; the matrix printed
        there as '(23)' is this direction, in centimetres.
        """
        return _project(np.linalg.inv(self.homography), points)

    def pixel_size(self, points: Array, normals: Array) -> Array:
        """Returns how much floor (...), m, one undistorted pixel covers across an edge.

        Args:
            points: (..., 2) undistorted pixels on the edge.
            normals: (..., 2) unit vectors across the edge, in (u, v).

        Returns:
            Metres, across the edge as it lies on the floor; infinite on and above the horizon.
        """
        points, normals = np.asarray(points, float), np.asarray(normals, float)
        floor = self.pixel_to_floor(points)
        depth = _apply(self.homography, floor)[..., 2]
        constant = -np.sum(normals * points, axis=-1, keepdims=True)
        n, H = np.concatenate([normals, constant], axis=-1), self.homography
        across = n[..., :1] * H[0, :2] + n[..., 1:2] * H[1, :2] + n[..., 2:] * H[2, :2]
        size = depth / np.hypot(across[..., 0], across[..., 1])
        return np.where(np.isnan(size), np.inf, size)

    def undistort(self, points: Array) -> Array:
        """Returns undistorted pixels (..., 2) of raw ones; unchanged without lens distortion.

        NaN where a fisheye looks sideways or backwards.
        """
        points = np.asarray(points, float)
        if self.distortion is None or points.size == 0:
            return points.copy()
        import cv2

        stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-10)
        rows = points.reshape(-1, 1, 2)
        ideal: Any
        if self.lens == "fisheye":
            ideal = cv2.fisheye.undistortPoints(
                rows, self.matrix, self.distortion, P=self.matrix, criteria=stop
            )
            ideal = np.where(np.abs(ideal) < LOST_PX, ideal, np.nan)
        else:
            ideal = cv2.undistortPoints(
                rows, self.matrix, self.distortion, P=self.matrix, criteria=stop
            )
        return np.asarray(ideal, float).reshape(points.shape)

    def distort(self, points: Array) -> Array:
        """Returns raw pixels (..., 2) of undistorted ones: the inverse of `undistort`."""
        points = np.asarray(points, float)
        if self.distortion is None or points.size == 0:
            return points.copy()
        import cv2

        assert self.matrix is not None, "checked on entry"
        normal = _project(np.linalg.inv(self.matrix), points).reshape(-1, 1, 2)
        if self.lens == "fisheye":
            raw: Any = cv2.fisheye.distortPoints(normal, self.matrix, self.distortion)
        else:
            rays = np.concatenate([normal, np.ones((len(normal), 1, 1))], axis=2)
            none = np.zeros(3)
            raw, _ = cv2.projectPoints(rays, none, none, self.matrix, self.distortion)
        return np.asarray(raw, float).reshape(points.shape)

    def view(self) -> Array:
        """Returns (V, 2) the convex polygon on the floor that the image shows, counter-clockwise.

        In metres, robot frame. A horizon in the image cuts it off where the floor is 30 times as
        deep as the nearest floor in the image. With lens distortion it is the convex hull of the
        image's curved border.
        """
        width, height = self.image_size
        corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
        if self.distortion is not None:
            border = self.undistort(_along_border(corners))
            corners = _convex_hull(border[np.isfinite(border).all(axis=1)])
        inverse = np.linalg.inv(self.homography)
        closeness = corners @ inverse[2, :2] + inverse[2, 2]  # 1 / depth
        visible = _clip(corners, closeness - closeness.max() / FARTHEST_VIEW)
        floor = self.pixel_to_floor(visible)
        x, y = (floor - floor.mean(axis=0)).T
        area = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
        return np.ascontiguousarray(floor if area > 0 else floor[::-1])

    def visible_stretch(self, lines_robot: Array) -> Array:
        """Returns (K, 2) where each line enters and leaves the view, m along the line; or NaN.

        Args:
            lines_robot: (K, 2) lines ``(rho, alpha)``, m and rad, robot frame.
        """
        lines = np.asarray(lines_robot, float).reshape(-1, 2)
        corners = self.view()
        edges = np.roll(corners, -1, axis=0) - corners
        inward = np.column_stack([-edges[:, 1], edges[:, 0]])
        start = points_on_line(lines, np.zeros(len(lines)))
        step = points_on_line(lines, np.ones(len(lines))) - start
        gap = (
            np.sum(inward * corners, axis=1) - start @ inward.T
        )  # (K, V): inside where s * rate >= gap
        rate = step @ inward.T
        s = np.divide(gap, rate, out=np.zeros_like(gap), where=rate != 0)
        enter = np.where(rate > 0, s, -np.inf).max(axis=1)
        leave = np.where(rate < 0, s, np.inf).min(axis=1)
        seen = (enter < leave) & ~np.any((rate == 0) & (gap > 0), axis=1)
        return np.where(seen[:, None], np.column_stack([enter, leave]), np.nan)


def check_delay(name: str, delay_s: float) -> None:
    """Raises BadConfig where what a camera's images show cannot be known so late, s."""
    if not 0 <= delay_s <= LONGEST_DELAY_S:
        raise BadConfig(
            f"camera {name!r}: delay = {delay_s}: must be from 0 to {LONGEST_DELAY_S:g}, in seconds"
        )


def _apply(transform: Array, points: Array) -> Array:
    """Returns homogeneous coordinates (..., 3) of points (..., 2) after a homography.

    Elementwise: a matrix product would round differently with the number of BLAS threads.
    """
    x, y = points[..., :1], points[..., 1:]
    return np.asarray(x * transform[:, 0] + y * transform[:, 1] + transform[:, 2])


def _project(transform: Array, points: Array) -> Array:
    image = _apply(transform, np.asarray(points, float))
    depth = image[..., 2:]
    depth = np.where(depth > 0, depth, np.nan)
    return np.asarray(image[..., :2] / depth)


def _along_border(corners: Array) -> Array:
    """Returns points along a polygon's edges, `BORDER_SAMPLES` to each."""
    part = np.arange(BORDER_SAMPLES)[:, None, None] / BORDER_SAMPLES
    points = corners + part * (np.roll(corners, -1, axis=0) - corners)
    return points.transpose(1, 0, 2).reshape(-1, 2)


def _convex_hull(points: Array) -> Array:
    import cv2

    rows: Any = cv2.convexHull(points.astype(np.float32), returnPoints=False)
    return points[rows.ravel()]


def _clip(corners: Array, height: Array) -> Array:
    """Returns the part of a convex polygon (V, 2) where a linear function ``height`` (V,) >= 0."""
    following, height_following = np.roll(corners, -1, axis=0), np.roll(height, -1)
    crosses = (height >= 0) != (height_following >= 0)
    fall = np.where(crosses, height - height_following, 1.0)
    cut = corners + (height / fall)[:, None] * (following - corners)
    both = np.stack([corners, cut], axis=1).reshape(-1, 2)
    return both[np.column_stack([height >= 0, crosses]).ravel()]
