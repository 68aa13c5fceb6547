"""Images as robots' drivers publish them, to grey levels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_COLOURS = {
    "bgr8": (3, cv2.COLOR_BGR2GRAY), "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY), "rgba8": (4, cv2.COLOR_RGBA2GRAY),
    "8UC3": (3, cv2.COLOR_BGR2GRAY), "8UC4": (4, cv2.COLOR_BGRA2GRAY),
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2GRAY), "bayer_bggr8": (1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2GRAY), "bayer_grbg8": (1, cv2.COLOR_BayerGB2GRAY),
    "yuv422": (2, cv2.COLOR_YUV2GRAY_UYVY), "uyvy": (2, cv2.COLOR_YUV2GRAY_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2GRAY_YUY2), "yuyv": (2, cv2.COLOR_YUV2GRAY_YUY2),
}  # fmt: skip
"""Bytes of a pixel, and OpenCV's conversion, by encoding."""
_GREY = {"mono8": np.uint8, "8UC1": np.uint8, "mono16": np.uint16, "16UC1": np.uint16}
KNOWN = (*_GREY, *_COLOURS)
"""Encodings that can be read."""


def grey_of(
    data: NDArray[np.uint8], encoding: str, width: int, height: int, step: int, big_endian: bool
) -> NDArray[np.uint8] | None:
    """Returns (H, W) grey levels, or None where the bytes are not those of such an image.

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
    if encoding not in _COLOURS:
        return np.ascontiguousarray(rows)
    pixels = np.ascontiguousarray(rows)
    if channels > 1:
        pixels = pixels.reshape(height, width, channels)
    try:
        return np.asarray(cv2.cvtColor(pixels, _COLOURS[encoding][1]), np.uint8)
    except cv2.error:  # an odd width where pixels come in pairs
        return None
