"""Lines from straight segments: placed on the floor, paired, joined, measured in the image."""

from __future__ import annotations

import math

import numpy as np
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
from frontend.pairing import (
    FIRST,
    SECOND,
    clearest_first,
    join_pairs,
    pair_segments,
    place_segments,
)
from frontend.segments import hough_segments, lsd_segments
from frontend.sight import region_of

SENSE = {"dark": 1.0, "bright": -1.0, "both": 0.0}


def segment_lines(grey: NDArray[np.uint8], camera: Camera, config: DetectorConfig) -> DetectedLines:
    """Returns the lines of an image (H, W); as `frontend.lines.detect_lines`."""
    find = lsd_segments if config.method == "lsd" else hough_segments
    segments = find(grey, config)
    region = region_of(camera, config.coarsest_pixel_m)
    sight, limits = region.sight(grey), _limits(config)
    placed = place_segments(camera.undistort(segments), segments, sight)
    pairs = pair_segments(placed, limits)
    lines = join_pairs(pairs, clearest_first(pairs), placed, limits.longest_gap)
    fits, counts = measure_lines(sight, region.box, lines, limits)
    rejected = dict(zip(REASONS[1:], counts[1:].tolist(), strict=True))
    rejected["outside the region"] = len(segments) - len(placed)
    rejected["one edge only"] = len(placed) - len(np.unique(pairs[:, [FIRST, SECOND]]))
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
