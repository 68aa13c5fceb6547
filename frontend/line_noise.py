"""What a line's covariance is made of: residuals, those of its neighbours, the calibration.

A line is fitted as an offset and a slope at the middle of its stretch; their covariance has two
parts. The *fit* part shrinks with the number of blocks: its shape follows from where they lie, its
size from the residuals. The *fixed* part does not: calibration, and lines that are not straight.

Compiled, without the interpreter lock.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from frontend.fit_table import (
    COV_AA,
    COV_RA,
    COV_RR,
    FIT_OO,
    FIT_OS,
    FIT_SS,
    FIXED_OO,
    FIXED_OS,
    FIXED_SS,
    FREEDOM,
    LAGGED,
    LAGS,
    MIDDLE,
    SQUARES,
)
from frontend.profiles import PLACE, U, V

PRIOR_BLOCKS = 6.0  # what the grey noise says of the blocks of an image weighs as so many of them
SHARED_BLOCKS = 20.0  # what an image's other lines say of a line's noise weighs as so many blocks
LIMIT_PX = 0.005  # what profiles without noise are off by: 0.003 to 0.006 pixels at the ends
PRIOR_PX = 0.01  # a block's error beside that of grey noise: texture, wear, interpolation
MOST_ALIKE = 6.0  # factor on the variance that correlation may make


@njit(cache=True, nogil=True)
def set_covariances(fits, count):  # type: ignore[no-untyped-def]
    """Sets the covariances of an image's lines from their residuals.

    The variance of a block, and the correlation between neighbouring ones, are what the residuals
    of all lines of the image show; a line's own residuals count for more, the more it has.
    """
    squares, freedom = 0.0, 0.0
    lagged = np.zeros(LAGS)
    for k in range(count):
        squares += fits[k, SQUARES]
        freedom += fits[k, FREEDOM] - 2.0
        for lag in range(LAGS):
            lagged[lag] += fits[k, LAGGED + lag]
    common = (squares + PRIOR_BLOCKS) / (freedom + PRIOR_BLOCKS)
    alike = 1.0
    if squares > 0.0:
        for lag in range(LAGS):
            # two fitted numbers make residuals anticorrelated by about 2 blocks' worth a line
            alike += (
                2.0
                * (lagged[lag] + 2.0 * count * squares / (freedom + 2.0 * count))
                / (squares + PRIOR_BLOCKS * common)
            )
    alike = min(max(alike, 1.0), MOST_ALIKE)
    for k in range(count):
        fit = fits[k]
        own = fit[SQUARES] + SHARED_BLOCKS * common
        factor = alike * own / (fit[FREEDOM] - 2.0 + SHARED_BLOCKS)
        c_oo = factor * fit[FIT_OO] + fit[FIXED_OO]
        c_os = factor * fit[FIT_OS] + fit[FIXED_OS]
        c_ss = factor * fit[FIT_SS] + fit[FIXED_SS]
        at = fit[MIDDLE]  # along the line, where offset and slope hold
        fit[COV_RR] = c_oo - 2.0 * at * c_os + at * at * c_ss
        fit[COV_RA] = -c_os + at * c_ss
        fit[COV_AA] = c_ss


@njit(cache=True, nogil=True)
def add_lagged(blocks, residual, weight, first, last, lagged):  # type: ignore[no-untyped-def]
    """Sets ``lagged`` to sums of products of the residuals of blocks 1, 2, ... places apart."""
    for lag in range(LAGS):
        lagged[lag] = 0.0
    for k in range(first, last + 1):
        for other in range(max(first, k - LAGS), k):
            apart = int(blocks[k, PLACE] - blocks[other, PLACE])
            if apart <= LAGS:
                both = weight[k] * weight[other]
                lagged[apart - 1] += both * residual[k] * residual[other]


@njit(cache=True, nogil=True)
def set_fixed_part(  # type: ignore[no-untyped-def]
    shape, blocks, first, last, pixels, half, limits, fit
):
    """Sets what calibration and straightness add to the covariance of offset and slope.

    The calibration is off independently at each corner of the image, and by a bilinear mixture in
    between; the line wanders independently at its two ends.

    Args:
        shape: (height, width) of the image.
        blocks: of `read_blocks`.
        first, last: blocks at the ends of the stretch.
        pixels: floor of a pixel across the line at both, m.
        half: half the length of the stretch, m.
        limits: `Limits`.
        fit: a row of the table.
    """
    share_first, share_last = np.empty(4), np.empty(4)
    _corner_share(blocks[first, U], blocks[first, V], shape, share_first)
    _corner_share(blocks[last, U], blocks[last, V], shape, share_last)
    calibration, wander = limits.calibration_px**2, limits.straightness**2
    same_first = same_last = both = 0.0
    for k in range(4):
        same_first += share_first[k] ** 2
        same_last += share_last[k] ** 2
        both += share_first[k] * share_last[k]
    var_first = same_first * calibration + LIMIT_PX**2
    var_last = same_last * calibration + LIMIT_PX**2
    var_first = var_first * pixels[0] ** 2 + wander
    var_last = var_last * pixels[1] ** 2 + wander
    cov_both = both * calibration * pixels[0] * pixels[1]
    fit[FIXED_OO] = 0.25 * (var_first + var_last + 2.0 * cov_both)
    fit[FIXED_OS] = 0.25 * (var_last - var_first) / half
    fit[FIXED_SS] = 0.25 * (var_first + var_last - 2.0 * cov_both) / half**2


@njit(cache=True, nogil=True)
def _corner_share(u, v, shape, share):  # type: ignore[no-untyped-def]
    """Fills ``share`` (4,): how far a pixel moves with each corner of the image (bilinear)."""
    a, b = u / shape[1], v / shape[0]
    share[0], share[1] = (1.0 - a) * (1.0 - b), a * (1.0 - b)
    share[2], share[3] = (1.0 - a) * b, a * b
