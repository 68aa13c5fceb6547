"""Image files to grey images, and to thumbnails."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera

THUMBNAIL_QUALITY = 50
"""JPEG quality of thumbnails, 0 to 100."""


@dataclass(frozen=True, slots=True)
class Thumbnail:
    """A small copy of an image.

    Attributes:
        jpeg: the image, grey, as the bytes of a JPEG file.
        width: pixels.
        height: pixels.
    """

    jpeg: bytes
    width: int
    height: int


def read_grey(path: Path) -> NDArray[np.uint8] | None:
    """Returns an image as (H, W) grey levels, or None where it cannot be read whole.

    A file that is cut off counts as unreadable: `cv2.imread` would fill the rest with grey, whose
    border looks like a line, so the bytes are read here and decoded from memory.
    """
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    except (OSError, cv2.error):
        return None
    return None if image is None else np.asarray(image, np.uint8)


def undistorted(grey: NDArray[np.uint8], camera: Camera) -> NDArray[np.uint8]:
    """Returns an image as a lens without distortion shows it; for pictures, not for measuring."""
    if camera.distortion is None:
        return grey
    if camera.lens == "fisheye":
        flat = cv2.fisheye.undistortImage(
            grey, camera.matrix, camera.distortion, Knew=camera.matrix
        )
    else:
        flat = cv2.undistort(grey, camera.matrix, camera.distortion)
    return np.asarray(flat, np.uint8)


def thumbnail(path: Path, width: int, camera: Camera | None = None) -> Thumbnail | None:
    """Returns a copy of an image, at most ``width`` pixels wide, or None where it is unreadable.

    With a camera its lens distortion is taken out, so that `Camera.floor_to_pixel` fits.
    """
    grey = read_grey(path)
    if grey is None:
        return None
    if camera is not None:
        grey = undistorted(grey, camera)
    height, full = grey.shape
    if full > width:
        size = (width, max(1, round(height * width / full)))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, THUMBNAIL_QUALITY])
    return Thumbnail(jpeg.tobytes(), grey.shape[1], grey.shape[0])
