"""Images as robots' drivers publish them, to grey levels or to colours."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_COLOURS = {
    "bgr8": (3, cv2.COLOR_BGR2GRAY, None),
    "rgb8": (3, cv2.COLOR_RGB2GRAY, cv2.COLOR_RGB2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY, cv2.COLOR_BGRA2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY, cv2.COLOR_RGBA2BGR),
    "8UC3": (3, cv2.COLOR_BGR2GRAY, None),
    "8UC4": (4, cv2.COLOR_BGRA2GRAY, cv2.COLOR_BGRA2BGR),
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2GRAY, cv2.COLOR_BayerBG2BGR),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2GRAY, cv2.COLOR_BayerRG2BGR),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2GRAY, cv2.COLOR_BayerGR2BGR),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2GRAY, cv2.COLOR_BayerGB2BGR),
    "yuv422": (2, cv2.COLOR_YUV2GRAY_UYVY, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2GRAY_UYVY, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2GRAY_YUY2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2GRAY_YUY2, cv2.COLOR_YUV2BGR_YUY2),
}
"""Bytes of a pixel, and OpenCV's conversions to grey and to BGR (None: it is), by encoding."""
_GREY = {"mono8": np.uint8, "8UC1": np.uint8, "mono16": np.uint16, "16UC1": np.uint16}
KNOWN = (*_GREY, *_COLOURS)
"""Encodings that can be read."""


def grey_of(
    data: NDArray[np.uint8], encoding: str, width: int, height: int, step: int, big_endian: bool
) -> NDArray[np.uint8] | None:
    """Returns (H, W) grey levels, or None where the bytes are not those of such an image.

    The arguments are those of `pixels_of`.
    """
    pixels = pixels_of(data, encoding, width, height, step, big_endian)
    if pixels is None or encoding not in _COLOURS:
        return pixels
    return _converted(pixels, _COLOURS[encoding][1])


def bgr_of(
    data: NDArray[np.uint8], encoding: str, width: int, height: int, step: int, big_endian: bool
) -> NDArray[np.uint8] | None:
    """Returns (H, W, 3) colours, BGR; None where the bytes are not those of such an image.

    The arguments are those of `pixels_of`; grey images are grey in all three.
    """
    pixels = pixels_of(data, encoding, width, height, step, big_endian)
    if pixels is None:
        return None
    conversion = _COLOURS[encoding][2] if encoding in _COLOURS else cv2.COLOR_GRAY2BGR
    return pixels if conversion is None else _converted(pixels, conversion)


def pixels_of(
    data: NDArray[np.uint8], encoding: str, width: int, height: int, step: int, big_endian: bool
) -> NDArray[np.uint8] | None:
    """Returns (H, W) or (H, W, channels) bytes of an image as encoded, without what pads its rows.

    None where the bytes are not those of such an image.

    Args:
        data: bytes of the pixels, row by row.
        encoding: as of `sensor_msgs/image_encodings.h`.
        width: pixels.
        height: pixels.
        step: bytes from one row to the next.
        big_endian: order of the bytes of 16-bit levels, of which the upper byte is taken.
    """
    channels = _COLOURS[encoding][0] if encoding in _COLOURS else 1
    size = 2 if _GREY.get(encoding) is np.uint16 else 1
    row = width * channels * size
    if (
        encoding not in KNOWN
        or width <= 0
        or height <= 0
        or step < row
        or len(data) < step * height
    ):
        return None
    rows = np.asarray(data[: step * height], np.uint8).reshape(height, step)[:, :row]
    if size == 2:
        return np.ascontiguousarray(rows[:, 0 if big_endian else 1 :: 2])
    pixels = np.ascontiguousarray(rows)
    return pixels.reshape(height, width, channels) if channels > 1 else pixels


def _converted(pixels: NDArray[np.uint8], conversion: int) -> NDArray[np.uint8] | None:
    try:
        return np.asarray(cv2.cvtColor(pixels, conversion), np.uint8)
    except cv2.error:  # an odd width where pixels come in pairs
        return None
