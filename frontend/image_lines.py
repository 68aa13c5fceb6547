"""Lines in all images of the floor."""

from __future__ import annotations

from frontend.config import ExtractConfig
from frontend.detected import NO_LINES, DetectedLines
from frontend.images import read_grey
from frontend.line_cache import cache_key, keep, load
from frontend.lines import detect_lines
from frontend.log import Log
from frontend.search import Found, Progress, Search, search_images
from graphslam.measurements import IntArray


def lines_in_images(
    log: Log, numbers: IntArray, config: ExtractConfig, progress: Progress | None = None
) -> Found[DetectedLines]:
    """Returns all lines, image by image.

    They are taken from the cache where the same images were searched in the same way before.

    Args:
        log: with images and cameras.
        numbers: which of the log's images to search.
        config: detector and workers.
        progress: called with (images done, images in all).

    Raises:
        BadLog: an image has not the size that the log states.
    """
    key = cache_key(log, numbers, config.detector) if config.cache else ""
    found = load(key) if config.cache else None
    if found is None:
        search = Search(
            read_grey, lambda grey, camera: detect_lines(grey, camera, config.detector), NO_LINES
        )
        found = search_images(log, numbers, search, config.workers, progress)
        if config.cache:
            keep(key, found)
    elif progress is not None:
        for done in range(1, len(numbers) + 1):
            progress(done, len(numbers))
    return found
