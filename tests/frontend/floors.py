"""Floors of known lines, drawn as a camera sees them, and how far found lines are off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frontend.camera import Camera
from frontend.lines import DetectedLines
from graphslam.geometry import nearest_twin, offset_error, wrap

LINES = np.array([[0.55, 0.2], [0.05, 1.8], [-0.03, 1.33]])


def pinhole(
    size: tuple[int, int],
    focal: float,
    lens: Sequence[float] | None = None,
    model: str = "plain",
    ignore_px: tuple[tuple[float, ...], ...] = (),
) -> Camera:
    """A camera 0.62 m above the robot's origin that looks down at 47 degrees."""
    width, height = size
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    pitch = np.radians(47.0)
    right, ahead = np.array([0.0, -1, 0]), np.array([np.cos(pitch), 0, -np.sin(pitch)])
    axes = np.stack([right, np.cross(ahead, right), ahead])
    homography = matrix @ np.column_stack([axes[:, :2], -axes @ (0.0, 0.0, 0.62)])
    distortion = None if lens is None else np.array(lens)
    return Camera("floor", "floor", size, homography, matrix, distortion, model, ignore_px)


CAMERAS = {
    "160x120": pinhole((160, 120), 165.0),
    "320x240": pinhole((320, 240), 330.0),
    "640x480": pinhole((640, 480), 660.0),
    "320x240 bent": pinhole((320, 240), 330.0, (-0.25, 0.05, 1e-3, -1e-3)),
    "320x240 fisheye": pinhole((320, 240), 230.0, (0.08, -0.02, 0.01, -0.003), "fisheye"),
}


class Floor:
    """Grey floor seen by a camera, drawn on with 4 x 4 samples a pixel."""

    def __init__(self, camera: Camera, grey: float = 140.0) -> None:
        self.size = camera.image_size
        u, v = (np.arange(4 * n) / 4 - 0.375 for n in self.size)
        raw = np.stack(np.meshgrid(u, v), axis=-1)
        self.point = camera.pixel_to_floor(camera.undistort(raw))
        self.grey = np.full(self.point.shape[:2], grey)

    def across(self, line: np.ndarray) -> np.ndarray:
        return self.point @ (np.cos(line[1]), np.sin(line[1])) - line[0]

    def draw(self, line: np.ndarray, width: float = 0.008, grey: float = 60.0) -> Floor:
        self.grey[np.abs(self.across(line)) < 0.5 * width] = grey
        return self

    def image(self, rng: np.random.Generator | None = None, noise: float = 2.0) -> np.ndarray:
        width, height = self.size
        image = self.grey.reshape(height, 4, width, 4).mean(axis=(1, 3))
        if rng is not None:
            slope = np.linspace(0.9, 1.1, width) * np.linspace(1.1, 0.9, height)[:, None]
            image = image * slope + rng.normal(0.0, noise, image.shape)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def floor_with_lines(
    camera: Camera, width: float = 0.008, grey: float = 60.0, background: float = 140.0
) -> np.ndarray:
    floor = Floor(camera, background)
    for line in LINES:
        floor.draw(line, width, grey)
    return floor.image(np.random.default_rng(0))


def errors(found: DetectedLines, true: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which true line is nearest to each found one, and by how much it is off.

    Returns true line (K,), offset at the middle of the seen stretch (K,), m, and angle (K,), rad.
    """
    twins = nearest_twin(true[None], found.z[:, None])
    difference = found.z[:, None] - twins
    difference[..., 1] = wrap(difference[..., 1])
    offset = offset_error(difference, found.extent.mean(axis=1)[:, None])
    nearest = np.argmin(np.abs(offset) + 0.2 * np.abs(difference[..., 1]), axis=1)
    rows = np.arange(len(nearest))
    return nearest, offset[rows, nearest], difference[rows, nearest, 1]


def assert_found(
    found: DetectedLines, true: np.ndarray, offset_m: float = 1e-3, angle_deg: float = 0.3
) -> None:
    nearest, offset, angle = errors(found, true)
    assert sorted(nearest) == list(range(len(true)))
    assert np.abs(offset).max() < offset_m
    assert np.degrees(np.abs(angle)).max() < angle_deg
