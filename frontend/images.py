"""Image files to grey images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


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
