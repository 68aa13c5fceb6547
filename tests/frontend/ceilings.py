"""Pictures of lamps on a ceiling, drawn by asking of each quarter pixel whether it is a lamp's."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from graphslam.geometry import Array, compose, inverse

SIZE = (320, 240)
PER_M = 100.0  # pixels for a metre of the ceiling
PLAIN = np.array([[PER_M, 0.0, 159.5], [0.0, PER_M, 119.5], [0.0, 0.0, 1.0]])
TILTED = np.array([[PER_M, 8.0, 159.5], [-6.0, PER_M, 119.5], [0.04, -0.05, 1.0]])
LENS = np.array([[250.0, 0.0, 159.5], [0.0, 250.0, 119.5], [0.0, 0.0, 1.0]])
LAMP = (0.8, 0.3)
FINER = 4


@cache
def ceiling_camera(lens: str = "none") -> Camera:
    """Returns a camera that looks up: without a lens, or with a plain or a fisheye one."""
    if lens == "none":
        return Camera("up", "ceiling", SIZE, TILTED)
    distortion = {"plain": [-0.2, 0.05, 1e-3, -1e-3], "fisheye": [0.05, -0.01, 0.0, 0.0]}[lens]
    return Camera("up", "ceiling", SIZE, PLAIN, LENS, np.array(distortion), lens)


@cache
def _quarter_pixels(camera: Camera) -> Array:
    """Returns where on the ceiling each quarter pixel looks."""
    u, v = ((np.arange(n * FINER) + 0.5) / FINER - 0.5 for n in camera.image_size)
    raw = np.stack(np.meshgrid(u, v), axis=-1)
    return camera.pixel_to_floor(camera.undistort(raw))


def border(camera: Camera) -> float:
    """Returns how far ahead, m, the middle of the image's right border looks."""
    at = camera.undistort(np.array([SIZE[0] - 0.5, 0.5 * (SIZE[1] - 1)]))
    return float(camera.pixel_to_floor(at)[0])


def picture(
    camera: Camera,
    lamps: Array,
    size: tuple[float, float] = LAMP,
    dark: float = 20.0,
    bright: float = 220.0,
) -> NDArray[np.uint8]:
    """Returns a grey image (H, W) of lamps (K, 3), ``(x, y, phi)`` in the robot frame."""
    width, height = camera.image_size
    plane = _quarter_pixels(camera)
    at = np.concatenate([plane, np.zeros((*plane.shape[:2], 1))], axis=-1)
    lit = np.zeros(plane.shape[:2], bool)
    for lamp in lamps:
        own = compose(inverse(lamp), at)[..., :2]
        lit |= (np.abs(own) <= 0.5 * np.array(size)).all(axis=-1)
    cover = lit.reshape(height, FINER, width, FINER).mean(axis=(1, 3))
    return np.rint(dark + (bright - dark) * cover).astype(np.uint8)
