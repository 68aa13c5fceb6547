"""The table of fitted lines: its columns, the limits that lines keep, and why some are left out."""

from __future__ import annotations

from typing import NamedTuple

# why a line is not used
(
    FITS,
    NO_EDGES,
    TOO_POOR,
    TOO_WIDE,
    NOT_STRAIGHT,
    NOT_PARALLEL,
    TOO_SHORT,
    TOO_VAGUE,
    SEEN_TWICE,
) = range(9)
REASONS = (
    "",
    "edges too weak",
    "of too low quality",
    "too wide or too narrow",
    "not straight",
    "edges not parallel",
    "too short",
    "direction too vague",
    "seen twice",
)

LAGS = 4  # neighbouring blocks whose errors may be alike

# columns of a fitted line: what it is (robot frame, m and rad; extent along it and width in m,
# residual in pixels, contrast in grey levels), then what its covariance is made of (`line_noise`)
RHO, ALPHA, COV_RR, COV_RA, COV_AA, LOW, HIGH, WIDE, QUALITY, BLOCKS, RESIDUAL, CONTRAST = range(12)
MIDDLE, FIT_OO, FIT_OS, FIT_SS, FIXED_OO, FIXED_OS, FIXED_SS, SQUARES, FREEDOM = range(12, 21)
LAGGED = 21  # and the next LAGS
FIT_COLUMNS = LAGGED + LAGS


class Limits(NamedTuple):
    """What a line has to keep to, and how far it is off at least.

    Attributes:
        narrowest: distance between its edges, m.
        widest: the same at most, m; what a lens makes of a thin line is allowed for.
        longest_gap: break over which it is joined, m.
        least_quality: 0 to 1.
        angle: largest between its edges, rad.
        shortest: stretch of it, m.
        vaguest: standard deviation of its direction, rad.
        calibration_px: standard deviation of the calibration at each corner of the image, pixels.
        straightness: standard deviation of how far it wanders from straight at each end, m.
        sense: 1 dark lines only, -1 bright ones only, 0 both.
    """

    narrowest: float
    widest: float
    longest_gap: float
    least_quality: float
    angle: float
    shortest: float
    vaguest: float
    calibration_px: float
    straightness: float
    sense: float
