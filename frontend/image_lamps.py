"""Lamps in all images of the ceiling, searched in parallel and returned in order."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from frontend.config import ExtractConfig, LampConfig
from frontend.images import check_size, read_grey
from frontend.lamps import DetectedLamps, detect_lamps
from frontend.log import Log
from graphslam.measurements import IntArray


def lamps_in_images(
    log: Log,
    numbers: IntArray,
    config: ExtractConfig,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[DetectedLamps, IntArray, int]:
    """Returns all lamps, image by image, each one's image number, and how many are unreadable.

    Args:
        log: with images and cameras that look at the ceiling.
        numbers: which of the log's images to search.
        config: detector and workers.
        progress: called with (images done, images in all).

    Raises:
        BadLog: an image has not the size that the log states.
    """
    found: list[DetectedLamps] = []
    source: list[int] = []
    rejected: Counter[str] = Counter()
    with ThreadPoolExecutor(config.workers or os.cpu_count() or 1) as pool:  # OpenCV runs unlocked
        answers = pool.map(lambda number: _search(log, number, config.lamps), numbers.tolist())
        for done, (number, lamps) in enumerate(zip(numbers.tolist(), answers, strict=True), 1):
            if lamps is not None:
                found.append(lamps)
                source += [number] * len(lamps)
                rejected.update(lamps.rejected)
            if progress is not None:
                progress(done, len(numbers))
    merged = DetectedLamps(
        np.concatenate([np.zeros((0, 3)), *(lamps.z for lamps in found)]),
        np.concatenate([np.zeros((0, 3, 3)), *(lamps.cov for lamps in found)]),
        np.concatenate([np.zeros((0, 2)), *(lamps.size for lamps in found)]),
        np.concatenate([np.zeros(0), *(lamps.visible for lamps in found)]),
        dict(rejected),
    )
    return merged, np.array(source, np.int64), len(numbers) - len(found)


def _search(log: Log, number: int, config: LampConfig) -> DetectedLamps | None:
    assert log.images is not None
    path, camera = log.images.file[number], log.ceiling[log.images.camera[number]]
    grey = read_grey(path)
    if grey is None:
        return None
    check_size(grey, camera.name, camera.image_size, path, log.described)
    return detect_lamps(grey, camera, config)
