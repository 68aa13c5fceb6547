"""Directions of landmarks in all images of omnidirectional cameras."""

from __future__ import annotations

from frontend.cones import NO_BEARINGS, DetectedBearings, detect_bearings
from frontend.config import ExtractConfig
from frontend.images import read_bgr
from frontend.log import Log
from frontend.search import Found, Progress, Search, search_images
from graphslam.measurements import IntArray


def bearings_in_images(
    log: Log, numbers: IntArray, config: ExtractConfig, progress: Progress | None = None
) -> Found[DetectedBearings]:
    """Returns all directions, image by image.

    Args:
        log: with images and omnidirectional cameras.
        numbers: which of the log's images to search.
        config: thresholds, noise and workers.
        progress: called with (images done, images in all).

    Raises:
        BadLog: an image has not the size that the log states.
    """
    search = Search(
        read_bgr, lambda bgr, camera: detect_bearings(bgr, camera, config.omni), NO_BEARINGS
    )
    return search_images(log, numbers, search, config.workers, progress)
