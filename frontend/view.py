"""What a camera sees of the floor, in figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frontend.camera import Camera
from frontend.ignored import is_ignored
from graphslam.geometry import Array

GRID = 24  # pixels looked at along each side of the image


@dataclass(frozen=True, slots=True)
class View:
    """The floor that a camera sees.

    Attributes:
        camera: name of the camera.
        image_size: (width, height), pixels.
        area_m2: floor in view, m²; a horizon cuts it off (`Camera.view`).
        nearest_m: distance of the nearest floor in view from the middle of the robot, m.
        across_m: longest straight stretch in view, m.
        pixel_m: floor that the middle of the usable part of the image covers with a pixel, m; NaN
            where nothing of it is usable.
        usable: share of the image that shows floor finely enough for the detector, and not what
            the camera ignores.
        horizon: share of the image that is above the horizon.
        mirrored: whether the homography mirrors the floor, as no camera above it does.
    """

    camera: str
    image_size: tuple[int, int]
    area_m2: float
    nearest_m: float
    across_m: float
    pixel_m: float
    usable: float
    horizon: float
    mirrored: bool


def view_of(camera: Camera, coarsest_pixel_m: float) -> View:
    """Returns what a camera sees.

    Args:
        camera: looks at the floor.
        coarsest_pixel_m: pixels that cover more floor than this are not usable, m.
    """
    width, height = camera.image_size
    u, v = np.meshgrid(
        (np.arange(GRID) + 0.5) * width / GRID - 0.5, (np.arange(GRID) + 0.5) * height / GRID - 0.5
    )
    raw = np.column_stack([u.ravel(), v.ravel()])
    pixels = camera.undistort(raw)
    size = np.max(
        [camera.pixel_size(pixels, _normals(pixels, n)) for n in ([1, 0], [0, 1])], axis=0
    )
    usable = (size <= coarsest_pixel_m) & ~is_ignored(camera, raw)
    corners = camera.view()
    gaps = corners[:, None] - corners[None]
    return View(
        camera=camera.name,
        image_size=camera.image_size,
        area_m2=_area(corners),
        nearest_m=_distance_to(corners),
        across_m=float(np.linalg.norm(gaps, axis=2).max()),
        pixel_m=float(np.median(size[usable])) if usable.any() else np.nan,
        usable=float(usable.mean()),
        horizon=float(np.isinf(size).mean()),
        mirrored=bool(np.linalg.det(camera.homography) > 0),
    )


def _normals(pixels: Array, normal: list[int]) -> Array:
    return np.broadcast_to(np.array(normal, float), pixels.shape)


def _area(corners: Array) -> float:
    x, y = (corners - corners.mean(axis=0)).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _distance_to(corners: Array) -> float:
    """Returns how far the origin is from a convex polygon (V, 2), counter-clockwise; 0 inside."""
    edge = np.roll(corners, -1, axis=0) - corners
    if np.all(edge[:, 1] * corners[:, 0] - edge[:, 0] * corners[:, 1] >= 0):
        return 0.0
    along = np.sum(-corners * edge, axis=1) / np.sum(edge**2, axis=1)
    nearest = corners + np.clip(along, 0.0, 1.0)[:, None] * edge
    return float(np.linalg.norm(nearest, axis=1).min())
