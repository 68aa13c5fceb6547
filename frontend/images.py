"""Image files to grey or coloured images, and to thumbnails."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.recorded import RecordedImage

PICTURE_QUALITY = 75
"""JPEG quality of pictures that are looked at, 0 to 100."""
THUMBNAIL_QUALITY = 50
"""JPEG quality of thumbnails, 0 to 100."""


SUFFIXES = {b"\xff\xd8\xff": ".jpg", b"\x89PNG\r\n\x1a\n": ".png"}
"""Endings of image files, by their first bytes."""


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


def read_grey(image: Path | RecordedImage) -> NDArray[np.uint8] | None:
    """Returns an image as (H, W) grey levels, or None where it cannot be read whole.

    A file that is cut off counts as unreadable: `cv2.imread` would fill the rest with grey, whose
    border looks like a line, so the bytes are read here and decoded from memory.
    """
    if not isinstance(image, Path):
        return image.grey()
    try:
        return decoded(image.read_bytes())
    except OSError:
        return None


def read_bgr(image: Path | RecordedImage) -> NDArray[np.uint8] | None:
    """Returns an image as (H, W, 3) colours, BGR, or None where it cannot be read whole."""
    if not isinstance(image, Path):
        return image.bgr()
    try:
        return decoded_bgr(image.read_bytes())
    except OSError:
        return None


def decoded(data: bytes | memoryview | NDArray[np.uint8]) -> NDArray[np.uint8] | None:
    """Returns the bytes of an image file as (H, W) grey levels, or None where not whole."""
    return _decoded(data, cv2.IMREAD_GRAYSCALE)


def decoded_bgr(data: bytes | memoryview | NDArray[np.uint8]) -> NDArray[np.uint8] | None:
    """Returns the bytes of an image file as (H, W, 3) colours, BGR, or None where not whole."""
    return _decoded(data, cv2.IMREAD_COLOR)


def _decoded(data: bytes | memoryview | NDArray[np.uint8], how: int) -> NDArray[np.uint8] | None:
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), how)
    except cv2.error:
        return None
    return None if picture is None else np.asarray(picture, np.uint8)


def image_file(image: Path | RecordedImage) -> tuple[str, bytes] | None:
    """Returns an image as a file: its ending (".jpg"), and its bytes; None where it is unreadable.

    What was recorded compressed stays as it was; all else becomes a grey PNG, without loss.
    """
    try:
        if isinstance(image, Path):
            return image.suffix, image.read_bytes()
    except OSError:
        return None
    packed = image.packed()
    if packed is not None:
        for magic, suffix in SUFFIXES.items():
            if packed.startswith(magic):
                return suffix, packed
    grey = image.grey()
    return None if grey is None else (".png", cv2.imencode(".png", grey)[1].tobytes())


def image_digest(image: Path | RecordedImage) -> str:
    """Returns the SHA-256 of an image as it was recorded, hexadecimal, or "unreadable"."""
    if not isinstance(image, Path):
        return image.digest
    try:
        return hashlib.sha256(image.read_bytes()).hexdigest()
    except OSError:
        return "unreadable"


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


def thumbnail(
    path: Path | RecordedImage, width: int, camera: Camera | None = None
) -> Thumbnail | None:
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


def jpeg_of(picture: NDArray[np.uint8], width: int) -> tuple[bytes, int, int]:
    """Returns a picture as the bytes of a JPEG file at most ``width`` pixels wide, and its size."""
    rows, columns = picture.shape[:2]
    if columns > width:
        size = (width, max(1, round(rows * width / columns)))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, PICTURE_QUALITY])
    return jpeg.tobytes(), picture.shape[1], picture.shape[0]
