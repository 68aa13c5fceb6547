"""Lines from straight segments: placed on the floor, paired, joined, measured in the image."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from frontend.camera import Camera
from frontend.config import DetectorConfig
from frontend.detected import DetectedLines, detected
from frontend.fit_table import (
    ALPHA,
    COV_AA,
    COV_RA,
    COV_RR,
    HIGH,
    LOW,
    QUALITY,
    REASONS,
    RHO,
    Limits,
)
from frontend.line_fit import measure_lines
from frontend.pairing import FIRST, SECOND, join_pairs, pair_segments, place_segments
from frontend.segments import hough_segments, lsd_segments
from frontend.sight import region_of

SENSE = {"dark": 1.0, "bright": -1.0, "both": 0.0}


def segment_lines(grey: NDArray[np.uint8], camera: Camera, config: DetectorConfig) -> DetectedLines:
    """Returns the lines of an image (H, W); as `frontend.lines.detect_lines`."""
    find = lsd_segments if config.method == "lsd" else hough_segments
    segments = find(grey, config)
    region = region_of(camera, config.coarsest_pixel_m)
    fits, counts, placed, alone = _lines_of_segments(
        region.sight(grey),
        region.box,
        camera.undistort(segments),
        segments,
        _limits(config),
    )
    rejected = dict(zip(REASONS[1:], counts[1:].tolist(), strict=True))
    rejected["outside the region"] = len(segments) - placed
    rejected["one edge only"] = alone
    cov = fits[:, [COV_RR, COV_RA, COV_RA, COV_AA]].reshape(-1, 2, 2)
    return detected(
        fits[:, [RHO, ALPHA]], cov, fits[:, [LOW, HIGH]], fits[:, QUALITY], rejected, config
    )


def _limits(config: DetectorConfig) -> Limits:
    narrowest, widest = config.line_width_m
    return Limits(
        narrowest=narrowest,
        widest=widest,
        longest_gap=config.max_break_m,
        least_quality=config.min_quality,
        angle=math.radians(config.pair_angle_deg),
        shortest=config.min_length_m,
        vaguest=math.radians(config.vaguest_alpha_deg),
        calibration_px=config.calibration_px,
        straightness=config.straightness_m,
        sense=SENSE[config.polarity],
    )


@njit(cache=True, nogil=True)
def _lines_of_segments(sight, box, ends, raw, limits):  # type: ignore[no-untyped-def]
    """Returns lines, counts of `REASONS`, and how many segments are in the region, and unpaired.

    Args:
        sight: image and camera.
        box: as of `measure_lines`.
        ends: (N, 2, 2) segments, undistorted pixels, the bright side on their left.
        raw: (N, 2, 2) the same in the recorded image.
        limits: `Limits`.
    """
    segments = place_segments(ends, raw, sight)
    pairs = pair_segments(segments, limits)
    lines = join_pairs(pairs, segments, limits.longest_gap)
    fits, counts = measure_lines(sight, box, lines, limits)
    alone = np.ones(len(segments), np.bool_)
    for k in range(len(pairs)):
        alone[int(pairs[k, FIRST])] = alone[int(pairs[k, SECOND])] = False
    return fits, counts, len(segments), int(np.sum(alone))
