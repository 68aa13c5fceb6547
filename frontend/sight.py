"""What a camera and a configuration fix for every image: what to look at, and the lens."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.ignored import ignored_image
from frontend.profiles import Sight
from graphslam.geometry import Array

LENS_STEP = 2.0  # undistorted pixels from node to node: a strong lens is off by 0.002 pixels
MOST_LENS_NODES = 1024  # along each side; the view of an extreme fisheye gets a coarser grid


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """What is the same in every image of one camera.

    Attributes:
        usable: (H, W) pixels of the recorded image that show floor finely enough, and not the
            robot itself.
        box: (4,) smallest u, v and largest u, v of those, undistorted pixels.
        pixel_T_floor: (3, 3) floor (robot frame, m) to undistorted pixel.
        floor_T_pixel: (3, 3) its inverse.
        lens: (h, w, 2) raw pixels on a grid of undistorted ones; (0, 0, 2) without distortion.
        lens_at: (3,) undistorted u, v of the grid's first node, and its step, pixels.
    """

    usable: NDArray[np.bool_]
    box: Array
    pixel_T_floor: Array
    floor_T_pixel: Array
    lens: Array
    lens_at: Array

    def sight(self, image: NDArray[np.uint8]) -> Sight:
        """Returns this with an image, as compiled code takes it."""
        return Sight(
            np.ascontiguousarray(image),
            self.usable,
            self.pixel_T_floor,
            self.floor_T_pixel,
            self.lens,
            self.lens_at,
        )


@lru_cache(maxsize=32)
def region_of(camera: Camera, coarsest_pixel_m: float) -> Region:
    """Returns what of a camera's images is looked at.

    Args:
        camera: looks at the floor, but where its ``ignore_px`` says.
        coarsest_pixel_m: pixels that cover more floor than this are not looked at: they are next to
            the horizon, m.
    """
    width, height = camera.image_size
    raw = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float)
    pixels = camera.undistort(raw)
    coarse = [
        camera.pixel_size(pixels, np.broadcast_to(np.array(normal, float), pixels.shape))
        for normal in ((1.0, 0.0), (0.0, 1.0))
    ]
    # a lens model used beyond its range throws pixels far out
    sane = np.abs(pixels).max(axis=-1) < 8.0 * max(camera.image_size)
    usable = sane & (np.max(coarse, axis=0) < coarsest_pixel_m) & ~ignored_image(camera)
    seen = pixels[usable] if usable.any() else np.zeros((1, 2))
    box = np.concatenate([seen.min(axis=0), seen.max(axis=0)])
    lens, lens_at = _lens_grid(camera, box)
    return Region(usable, box, camera.homography, np.linalg.inv(camera.homography), lens, lens_at)


def _lens_grid(camera: Camera, box: Array) -> tuple[Array, Array]:
    """Returns raw pixels on a grid of undistorted ones around ``box``, and where the grid lies."""
    if camera.distortion is None:
        return np.zeros((0, 0, 2)), np.array([0.0, 0.0, 1.0])
    size = box[2:] - box[:2]
    step = max(LENS_STEP, float(size.max()) / MOST_LENS_NODES)
    first = box[:2] - 4.0 * step
    columns, rows = (np.ceil(size / step).astype(int) + 9).tolist()
    nodes = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
    return camera.distort(first + step * nodes), np.array([*first, step])
