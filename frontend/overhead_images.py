"""Poses from all overhead images of a log, searched in parallel and returned in order."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from frontend.config import ExtractConfig
from frontend.images import check_size, read_bgr
from frontend.log import Log
from frontend.overhead import BESIDE
from frontend.tags import SeenTags, detect_tags
from graphslam.geometry import Array
from graphslam.measurements import IntArray

UNREADABLE = "overhead image that cannot be read"


@dataclass(frozen=True, slots=True)
class FixesSeen:
    """Poses that overhead images gave, in the order of the images.

    Attributes:
        source: (K,) number of each one's image.
        z: (K, 3) poses, floor frame, m and rad.
        cov: (K, 3, 3) their covariances as measured.
        rejected: how many images gave none, and objects were passed over, by reason.
    """

    source: IntArray
    z: Array
    cov: Array
    rejected: Mapping[str, int]


def fixes_in_images(
    log: Log,
    numbers: IntArray,
    config: ExtractConfig,
    progress: Callable[[int, int], None] | None = None,
) -> FixesSeen:
    """Returns the poses that images show.

    Args:
        log: with images and overhead cameras.
        numbers: which of the log's images to search.
        config: detector and workers.
        progress: called with (images done, images in all).

    Raises:
        BadLog: an image has not the size that the log states.
    """
    rejected: Counter[str] = Counter()
    source, z, cov = [], [np.zeros((0, 3))], [np.zeros((0, 3, 3))]
    with ThreadPoolExecutor(config.workers or os.cpu_count() or 1) as pool:
        found = pool.map(lambda number: look(log, number, config), numbers.tolist())
        for done, (number, seen) in enumerate(zip(numbers.tolist(), found, strict=True), start=1):
            if seen is None:
                rejected[UNREADABLE] += 1
            elif seen.pose is None or seen.cov is None:
                rejected[seen.refused] += 1
            else:
                rejected[BESIDE] += len(seen.beside)
                source.append(number)
                z.append(seen.pose[None])
                cov.append(seen.cov[None])
            if progress is not None:
                progress(done, len(numbers))
    kept = np.array(source, np.int64)
    return FixesSeen(kept, np.concatenate(z), np.concatenate(cov), rejected)


def look(log: Log, number: int, config: ExtractConfig) -> SeenTags | None:
    """Returns what one overhead image of a log shows; None where it cannot be read.

    Raises:
        BadLog: it has not the size that the log states.
    """
    assert log.images is not None, "only logs with images are looked at"
    image, eye = log.images.file[number], log.overhead[log.images.camera[number]]
    bgr = read_bgr(image)
    if bgr is None:
        return None
    called = log.images.name(number, log.folder)
    check_size(bgr, eye.camera.name, eye.camera.image_size, called, log.described)
    return detect_tags(bgr, eye, config.tags)
