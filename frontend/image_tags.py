"""Poses from all overhead images of a log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from frontend.config import ExtractConfig
from frontend.images import read_bgr
from frontend.log import Log
from frontend.overhead import BESIDE
from frontend.search import Found, Progress, Search, looked_at, search_images
from frontend.tags import SeenTags, detect_tags
from graphslam.geometry import Array
from graphslam.measurements import IntArray


@dataclass(frozen=True, slots=True)
class DetectedFixes:
    """Poses that overhead images gave; one image gives one at the most.

    Attributes:
        z: (K, 3) poses, floor frame, m and rad.
        cov: (K, 3, 3) their covariances as measured.
        rejected: how many images gave none, and objects were passed over, by reason.
    """

    z: Array
    cov: Array
    rejected: Mapping[str, int]

    def __len__(self) -> int:
        return len(self.z)


NO_FIXES = DetectedFixes(np.zeros((0, 3)), np.zeros((0, 3, 3)), {})


def fixes_in_images(
    log: Log, numbers: IntArray, config: ExtractConfig, progress: Progress | None = None
) -> Found[DetectedFixes]:
    """Returns the poses that images show.

    Args:
        log: with images and overhead cameras.
        numbers: which of the log's images to search.
        config: detector and workers.
        progress: called with (images done, images in all).

    Raises:
        BadLog: an image has not the size that the log states.
    """
    search = Search(read_bgr, lambda bgr, eye: _fixes(detect_tags(bgr, eye, config.tags)), NO_FIXES)
    return search_images(log, numbers, search, config.workers, progress)


def look(log: Log, number: int, config: ExtractConfig) -> SeenTags | None:
    """Returns what one overhead image of a log shows; None where it cannot be read.

    Raises:
        BadLog: it has not the size that the log states.
    """
    return looked_at(log, number, read_bgr, lambda bgr, eye: detect_tags(bgr, eye, config.tags))


def _fixes(seen: SeenTags) -> DetectedFixes:
    """Returns what an image shows as a table of one row, or of none with the reason."""
    if seen.pose is None or seen.cov is None:
        return DetectedFixes(NO_FIXES.z, NO_FIXES.cov, {seen.refused: 1})
    return DetectedFixes(seen.pose[None], seen.cov[None], {BESIDE: len(seen.beside)})
