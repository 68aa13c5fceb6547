"""Lamps in all images of the ceiling."""

from __future__ import annotations

from frontend.config import ExtractConfig
from frontend.images import read_grey
from frontend.lamps import NO_LAMPS, DetectedLamps, detect_lamps
from frontend.log import Log
from frontend.search import Found, Progress, Search, search_images
from graphslam.measurements import IntArray


def lamps_in_images(
    log: Log, numbers: IntArray, config: ExtractConfig, progress: Progress | None = None
) -> Found[DetectedLamps]:
    """Returns all lamps, image by image.

    Args:
        log: with images and cameras that look at the ceiling.
        numbers: which of the log's images to search.
        config: detector and workers.
        progress: called with (images done, images in all).

    Raises:
        BadLog: an image has not the size that the log states.
    """
    search = Search(
        read_grey, lambda grey, camera: detect_lamps(grey, camera, config.lamps), NO_LAMPS
    )
    return search_images(log, numbers, search, config.workers, progress)
