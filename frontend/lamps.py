"""Ceiling lamps in one image: place and axis of each in the robot frame, with their covariance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.lamp_config import LampConfig
from frontend.lamp_shape import Completed, Moments, complete, moments
from frontend.lamp_spots import FINER, Spot, levels, spots
from frontend.sight import region_of
from graphslam.errors import BadLog
from graphslam.geometry import Array

BLACK = "black image of the ceiling"
SMALL = "bright spot smaller than a lamp"
LARGE = "bright spot larger than a lamp"
ROUND = "bright spot without a long axis"
FRAYED = "bright spot that is no rectangle"
CUT = "lamp cut by the image's border"
HARDLY = "lamp cut by the image's border of which too little is visible"
NO_FIT = "lamp cut by the image's border that its edges do not complete"

STRETCH_PX = 20.0
"""Errors along a lamp's edge are taken as alike over this length, pixels, where cut lamps are
completed."""
HOPELESS = 0.4
"""Spots below this share of the smallest lamp are not looked at closely."""
WORST_FIT_PX = 2.0
"""Edges farther than this from the completed lamp (root mean square) are of something else."""


@dataclass(frozen=True, slots=True)
class DetectedLamps:
    """Lamps seen in one image, robot frame.

    Attributes:
        z: (K, 3) centre and axis ``(x, y, phi)``, m and rad, phi in (-pi/2, pi/2].
        cov: (K, 3, 3) their covariances, of a robot that stands still.
        size: (K, 2) length and width as they appear, m; of a cut lamp, of what is visible.
        visible: (K,) share of the lamp that is visible: 1, or less where it was completed.
        rejected: what was left out, by reason.
    """

    z: Array
    cov: Array
    size: Array
    visible: Array
    rejected: Mapping[str, int]

    def __len__(self) -> int:
        return len(self.z)


NO_LAMPS = DetectedLamps(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 2)), np.zeros(0), {})
"""What a black image shows."""


def detect_lamps(grey: NDArray[np.uint8], camera: Camera, config: LampConfig) -> DetectedLamps:
    """Returns the lamps that an image of the ceiling shows; a black image, which is normal: none.

    Args:
        grey: (H, W) image as recorded, lens distortion and all.
        camera: its homography takes points of the lamps' plane, robot frame, to pixels.
        config: threshold, sizes, noise.

    Raises:
        BadLog: the image does not have the size that the camera states.

    Source: Bellini section 3.2.
    """
    if grey.shape[::-1] != camera.image_size:
        raise BadLog(
            f"the image has shape {grey.shape}; camera {camera.name!r} has image_size = "
            f"{list(camera.image_size)}: give a grey image of that size, or correct the camera"
        )
    rejected: Counter[str] = Counter()
    found: list[tuple[Array, Array, tuple[float, float], float]] = []
    usable = region_of(camera, config.coarsest_pixel_m).usable
    grey_levels = levels(grey, usable, config)
    if grey_levels is None:
        rejected[BLACK] += 1
    else:
        area, least = pixel_areas(camera), HOPELESS * _areas(config)[0]

        def worth(labels: NDArray[np.int32], count: int) -> NDArray[np.bool_]:
            return np.bincount(labels.ravel(), area.ravel(), count) >= least

        for spot in spots(grey, usable, grey_levels.border, config.clean_px, worth):
            lamp = SMALL if spot is None else _lamp(spot, camera, config)
            if isinstance(lamp, str):
                rejected[lamp] += 1
            else:
                found.append(lamp)
    return DetectedLamps(
        np.array([z for z, *_ in found]).reshape(-1, 3),
        np.array([cov for _, cov, *_ in found]).reshape(-1, 3, 3),
        np.array([size for *_, size, _ in found]).reshape(-1, 2),
        np.array([visible for *_, visible in found], float),
        dict(rejected),
    )


@lru_cache(maxsize=8)
def pixel_areas(camera: Camera) -> Array:
    """Returns how much (H, W) of the lamps' plane each recorded pixel covers, m²; 0 where none."""
    width, height = camera.image_size
    corners = np.stack(np.meshgrid(np.arange(width + 1), np.arange(height + 1)), axis=-1) - 0.5
    plane = camera.pixel_to_floor(camera.undistort(corners))
    one, other = plane[1:, 1:] - plane[:-1, :-1], plane[1:, :-1] - plane[:-1, 1:]
    area = 0.5 * np.abs(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
    return np.nan_to_num(area)


def motion_covariance(z: Array, velocity: Array, timing_s: float) -> Array:
    """Returns what not knowing exactly when an image was taken adds to sightings' covariances.

    A lamp moves by ``-(v + omega x p)`` a second in the robot frame and its axis by ``-omega``, so
    that the noise grows with the speed, along the motion.

    Args:
        z: (K, 3) sightings, robot frame.
        velocity: (K, 3) of the robot ``(v_x, v_y, omega)``, robot frame, m/s and rad/s.
        timing_s: standard deviation of the time, s.

    Returns:
        (K, 3, 3) m², m rad, rad²; of rank one.

    Source: Bellini section 4.1, 'the vision system accuracy is correlated to the robot velocity',
    which gives no law.
    """
    v_x, v_y, omega = velocity.T
    moved = timing_s * np.column_stack([v_x - omega * z[:, 1], v_y + omega * z[:, 0], omega])
    return np.asarray(moved[:, :, None] * moved[:, None, :])


def _lamp(
    spot: Spot, camera: Camera, config: LampConfig
) -> tuple[Array, Array, tuple[float, float], float] | str:
    """Returns place, covariance, size and visible share of a lamp, or why a spot is none."""
    outline = camera.pixel_to_floor(camera.undistort(spot.outline))
    if not np.isfinite(outline).all():
        return CUT
    seen = moments(outline)
    smallest, largest = _areas(config)
    if seen.area > largest:
        return LARGE
    if not spot.is_cut:
        return _whole(spot, outline, camera, config, seen, smallest)
    if config.size_m is None:
        return CUT if seen.area >= smallest else SMALL
    share = seen.area / (config.size_m[0] * config.size_m[1])
    if share < config.least_visible:
        return HARDLY
    done = complete(outline, spot.cut, config.size_m)
    pixel = np.sqrt(abs(np.linalg.det(_plane_per_pixel(camera, spot.outline.mean(axis=0)))))
    if done is None or done.rms > WORST_FIT_PX * pixel:
        return NO_FIT
    cov = _completed_covariance(spot, camera, config, done, pixel)
    return done.place, cov, (seen.length, seen.width), min(1.0, share)


def _areas(config: LampConfig) -> tuple[float, float]:
    """Returns the smallest and the largest area of a whole lamp, m²."""
    if config.size_m is None:
        return config.area_m2
    area = config.size_m[0] * config.size_m[1]
    return config.least_share * area, area / config.least_share


def _whole(
    spot: Spot, outline: Array, camera: Camera, config: LampConfig, seen: Moments, smallest: float
) -> tuple[Array, Array, tuple[float, float], float] | str:
    if seen.area < smallest:
        return SMALL
    if seen.length < config.least_elongation * seen.width:
        return ROUND
    if seen.fill < config.least_fill:
        return FRAYED
    if config.size_m is not None:
        # the edges, robustly: reflections that touch the lamp would turn and shift its moments
        done = complete(outline, spot.cut, config.size_m)
        pixel = np.sqrt(abs(np.linalg.det(_plane_per_pixel(camera, spot.outline.mean(axis=0)))))
        if done is None or done.rms > WORST_FIT_PX * pixel:
            return FRAYED
        cov = _completed_covariance(spot, camera, config, done, pixel)
        return done.place, cov, (seen.length, seen.width), 1.0
    cov = _whole_covariance(spot, camera, config, seen)
    return seen.place, cov, (seen.length, seen.width), 1.0


def _whole_covariance(spot: Spot, camera: Camera, config: LampConfig, seen: Moments) -> Array:
    """Returns the covariance of a whole lamp's place.

    Each of its edges is off by `edge_px` as a whole, and the centre is the middle between two; the
    ends of the axis are off by edges and calibration, each by itself.
    """
    J = _plane_per_pixel(camera, spot.outline.mean(axis=0))
    plane = J @ J.T  # covariance of one pixel
    cov = np.zeros((3, 3))
    cov[:2, :2] = (0.5 * config.edge_px**2 + config.calibration_px**2) * plane
    cov[2, 2] = _turn_variance(config, plane, seen.place[2], seen.length)
    return cov


def _turn_variance(config: LampConfig, plane: Array, phi: float, length: float) -> float:
    across = np.array([-np.sin(phi), np.cos(phi)])
    ends = (config.edge_px**2 + config.calibration_px**2) * float(across @ plane @ across)
    return 2.0 * ends / length**2


def _completed_covariance(
    spot: Spot, camera: Camera, config: LampConfig, done: Completed, pixel: float
) -> Array:
    """Returns the covariance of a completed lamp's place: of its fit, and of the calibration."""
    assert config.size_m is not None, "only lamps of known size are completed"
    J = _plane_per_pixel(camera, spot.outline.mean(axis=0))
    plane = J @ J.T
    alike = STRETCH_PX * FINER  # points whose errors are one error
    cov = alike * (config.edge_px * pixel) ** 2 * np.linalg.inv(done.information)
    cov[:2, :2] += config.calibration_px**2 * plane
    if spot.is_cut:
        axis = np.array([np.cos(done.place[2]), np.sin(done.place[2])])
        cov[:2, :2] += config.cut_end_m**2 * np.outer(axis, axis)
    calibration = _turn_variance(config, plane, done.place[2], config.size_m[0])
    cov[2, 2] += calibration
    return np.asarray(0.5 * (cov + cov.T))


def _plane_per_pixel(camera: Camera, pixel: Array) -> Array:
    """Returns (2, 2) how a point of the lamps' plane moves with its recorded pixel, m per pixel."""
    steps = 0.5 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    right, left, down, up = camera.pixel_to_floor(camera.undistort(pixel + steps))
    return np.column_stack([right - left, down - up])
