"""Lines on the floor in one image, by the detector that the configuration names."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.config import DetectorConfig
from frontend.detected import DetectedLines, line_covariance
from graphslam.errors import BadLog

__all__ = ["DetectedLines", "detect_lines", "line_covariance"]


def detect_lines(grey: NDArray[np.uint8], camera: Camera, config: DetectorConfig) -> DetectedLines:
    """Returns the grooves and painted lines that an image shows.

    Args:
        grey: (H, W) image as recorded, lens distortion and all.
        camera: homography and lens.
        config: detector, thresholds, width of a line, noise.

    Raises:
        BadLog: the image does not have the size that the camera states.
    """
    if grey.shape[::-1] != camera.image_size:
        raise BadLog(
            f"the image has shape {grey.shape}; camera {camera.name!r} has image_size = "
            f"{list(camera.image_size)}: give a grey image of that size, or correct the camera"
        )
    if config.method == "hough":
        from frontend.hough_lines import hough_lines

        return hough_lines(grey, camera, config)
    from frontend.segment_lines import segment_lines

    return segment_lines(grey, camera, config)
