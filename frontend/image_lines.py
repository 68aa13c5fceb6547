"""Lines in all images of a log, searched in parallel and returned in order."""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from frontend.config import ExtractConfig
from frontend.images import check_size, read_grey
from frontend.line_cache import Found, cache_key, keep, load
from frontend.lines import DetectedLines, detect_lines
from frontend.log import Log
from graphslam.measurements import IntArray


def lines_in_images(
    log: Log,
    numbers: IntArray,
    config: ExtractConfig,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[DetectedLines, IntArray, int]:
    """Returns all lines, image by image, each one's image number, and how many are unreadable.

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
        found = _search_all(log, numbers, config, progress)
        if config.cache:
            keep(key, found)
    elif progress is not None:
        for done in range(1, len(numbers) + 1):
            progress(done, len(numbers))
    return found.lines, found.source, found.unreadable


def _search_all(
    log: Log,
    numbers: IntArray,
    config: ExtractConfig,
    progress: Callable[[int, int], None] | None,
) -> Found:
    found: list[DetectedLines] = []
    source: list[int] = []
    rejected: Counter[str] = Counter()
    unreadable = 0
    for done, (number, lines) in enumerate(_in_order(log, numbers, config), start=1):
        if lines is None:
            unreadable += 1
        else:
            rejected.update(lines.rejected)
            found.append(lines)
            source += [number] * len(lines.z)
        if progress is not None:
            progress(done, len(numbers))
    merged = DetectedLines(
        z=np.concatenate([np.zeros((0, 2)), *(lines.z for lines in found)]),
        cov=np.concatenate([np.zeros((0, 2, 2)), *(lines.cov for lines in found)]),
        extent=np.concatenate([np.zeros((0, 2)), *(lines.extent for lines in found)]),
        quality=np.concatenate([np.zeros(0), *(lines.quality for lines in found)]),
        rejected=rejected,
    )
    return Found(merged, np.array(source, np.int64), unreadable)


def _in_order(
    log: Log, numbers: IntArray, config: ExtractConfig
) -> Iterator[tuple[int, DetectedLines | None]]:
    """Yields each image's number and lines in order, None where it cannot be read.

    OpenCV releases the interpreter lock, so threads do; only a few images are held at a time.
    """
    workers = config.workers or os.cpu_count() or 1
    waiting: deque[tuple[int, Future[DetectedLines | None]]] = deque()
    pool = ThreadPoolExecutor(workers)
    try:
        for number in numbers.tolist():
            waiting.append((number, pool.submit(_search, log, number, config)))
            if len(waiting) > 2 * workers:
                first, lines = waiting.popleft()
                yield first, lines.result()
        for number, lines in waiting:
            yield number, lines.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _search(log: Log, number: int, config: ExtractConfig) -> DetectedLines | None:
    assert log.images is not None
    path, camera = log.images.file[number], log.cameras[log.images.camera[number]]
    grey = read_grey(path)
    if grey is None:
        return None
    check_size(grey, camera.name, camera.image_size, path, log.described)
    return detect_lines(grey, camera, config.detector)
