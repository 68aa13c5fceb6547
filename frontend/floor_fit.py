"""A line's rho and alpha, fitted on the floor to the blocks that were read along it.

Compiled, without the interpreter lock.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from frontend.fit_table import (
    ALPHA,
    BLOCKS,
    CONTRAST,
    FIT_OO,
    FIT_OS,
    FIT_SS,
    FITS,
    FREEDOM,
    HIGH,
    LAGGED,
    LOW,
    MIDDLE,
    NO_EDGES,
    NOT_PARALLEL,
    NOT_STRAIGHT,
    QUALITY,
    RESIDUAL,
    RHO,
    SQUARES,
    TOO_POOR,
    TOO_WIDE,
    WIDE,
)
from frontend.line_noise import PRIOR_PX, add_lagged, set_fixed_part
from frontend.profiles import ACROSS, PLACE, SIGMA, WIDTH, U, V, to_floor
from frontend.straight import TUKEY_RESIDUAL, median_of

CROOKED_PX = 0.5  # root mean square of the residuals of what is no straight line, pixels
BLURRED_PX = 3.5  # a thin line's edges are seen this far apart at most, pixels
SPARE_PLACES = 2.0  # blocks that a line must show beyond chance: short ones are doubted most

# columns of blocks on the floor, m: middle, floor of a pixel across, width
X, Y, PIXEL_M, WIDTH_M = range(4)


@njit(cache=True, nogil=True)
def fit_on_floor(  # type: ignore[no-untyped-def]
    sight, ends, blocks, count, weight, typical, limits, fit
):
    """Fits rho and alpha on the floor to blocks; fills ``fit``; returns why not, or FITS.

    Args:
        sight: image and camera.
        ends: (2, 2) undistorted pixels between which the blocks were read.
        blocks: of `read_blocks`; the first ``count`` show the line.
        weight: (>= count,) how far each is trusted, 0 to 1; 0 for outliers.
        typical: median grey step of the line.
        limits: `Limits`.
        fit: a row of the table; all but the covariance is filled.
    """
    floor = np.empty((count, 4))
    _place_on_floor(sight, ends, blocks, count, floor)
    tx, ty = floor[count - 1, X] - floor[0, X], floor[count - 1, Y] - floor[0, Y]
    length = math.hypot(tx, ty)
    nx, ny = ty / length, -tx / length  # s = -x ny + y nx increases along (tx, ty)
    s, across, widths = np.empty(count), np.empty(count), np.empty(count)
    for k in range(count):
        s[k] = floor[k, Y] * nx - floor[k, X] * ny
        across[k] = floor[k, X] * nx + floor[k, Y] * ny
        widths[k] = floor[k, WIDTH_M]
    first, last = _best_run(count, weight, s, limits.longest_gap)
    w = np.zeros(count)
    support = _weigh(blocks, floor, weight, first, last, w)
    if support < 3:
        return NO_EDGES
    middle, near = 0.5 * (s[first] + s[last]), across[first]
    for k in range(count):
        s[k] -= middle
        across[k] -= near
    offset, slope = _straight_through(s, across, w, first, last, fit)
    wide, taper = _straight_through(s, widths, w, first, last, fit)
    residual = across
    for k in range(count):
        residual[k] -= offset + slope * s[k]
    square, pixel = _sum_up(blocks, floor, residual, w, weight, first, last, fit)

    crooked = square / CROOKED_PX**2
    places = blocks[last, PLACE] - blocks[first, PLACE] + 1.0
    quality = support / (places + SPARE_PLACES) * (1.0 - 0.5 * crooked)
    if crooked > 1.0:
        return NOT_STRAIGHT
    if quality < limits.least_quality:
        return TOO_POOR
    if wide < limits.narrowest - 0.5 * pixel:
        return TOO_WIDE
    if wide > max(limits.widest, BLURRED_PX * pixel) + pixel:
        return TOO_WIDE
    if abs(taper) > math.tan(limits.angle):
        return NOT_PARALLEL

    # offset and slope hold at the middle of the stretch
    fit[MIDDLE] = middle
    half = 0.5 * (s[last] - s[first])
    pixels = (floor[first, PIXEL_M], floor[last, PIXEL_M])
    set_fixed_part(sight.image.shape, blocks, first, last, pixels, half, limits, fit)
    turn = math.atan(slope)
    # n . p = near + offset + slope (s - middle): a line turned by -turn
    fit[RHO] = (near + offset - slope * middle) * math.cos(turn)
    fit[ALPHA] = math.atan2(ny, nx) - turn
    c, n = math.cos(fit[ALPHA]), math.sin(fit[ALPHA])
    fit[LOW] = floor[first, Y] * c - floor[first, X] * n
    fit[HIGH] = floor[last, Y] * c - floor[last, X] * n
    fit[WIDE], fit[QUALITY], fit[BLOCKS] = wide, quality, support
    fit[RESIDUAL], fit[CONTRAST] = math.sqrt(square), typical
    return FITS


@njit(cache=True, nogil=True)
def _place_on_floor(sight, ends, blocks, count, floor):  # type: ignore[no-untyped-def]
    """Fills ``floor`` (count, 4): x, y of each block's middle, m, floor of a pixel across, width m.

    The middle between two edges in the image is the middle between them on the floor but for
    perspective, which is second order in the line's width.
    """
    du, dv = ends[1, 0] - ends[0, 0], ends[1, 1] - ends[0, 1]
    length = math.hypot(du, dv)
    du, dv = du / length, dv / length
    T = sight.floor_T_pixel
    for k in range(count):
        d, half = blocks[k, ACROSS], 0.5 * blocks[k, WIDTH]
        u, v = blocks[k, U], blocks[k, V]
        low_x, low_y, _ = to_floor(T, u - (d - half) * dv, v + (d - half) * du)
        high_x, high_y, _ = to_floor(T, u - (d + half) * dv, v + (d + half) * du)
        x, y = 0.5 * (low_x + high_x), 0.5 * (low_y + high_y)
        on_x, on_y, _ = to_floor(T, u - d * dv + du, v + d * du + dv)
        off_x, off_y, _ = to_floor(T, u - d * dv, v + d * du)
        tx, ty = on_x - off_x, on_y - off_y
        run = math.hypot(tx, ty)
        wide = abs((high_x - low_x) * ty - (high_y - low_y) * tx) / run
        floor[k, X], floor[k, Y] = x, y
        floor[k, PIXEL_M], floor[k, WIDTH_M] = wide / (2.0 * half), wide


@njit(cache=True, nogil=True)
def _best_run(count, weight, s, longest_gap):  # type: ignore[no-untyped-def]
    """Returns first and last block of the best supported run without a long gap, -1 where none."""
    best_first, best_last, best = 0, -1, 0
    first, last, support = 0, -1, 0
    for k in range(count):
        if weight[k] <= 0.0:
            continue
        if last < 0 or abs(s[k] - s[last]) > longest_gap:
            first, support = k, 0
        last = k
        support += 1
        if support > best:
            best, best_first, best_last = support, first, last
    return best_first, best_last


@njit(cache=True, nogil=True)
def _weigh(blocks, floor, weight, first, last, w):  # type: ignore[no-untyped-def]
    """Fills ``w`` with weights of the blocks of a run, 1/m^2; returns how many have one.

    All blocks of a line have its median noise, in pixels: their own greys tell it too vaguely.
    """
    support = 0
    noise = np.empty(last - first + 1)
    for k in range(first, last + 1):
        noise[k - first] = blocks[k, SIGMA]
    typical = median_of(noise)
    for k in range(first, last + 1):
        if weight[k] > 0.0:
            support += 1
            variance = (typical**2 + PRIOR_PX**2) * floor[k, PIXEL_M] ** 2
            w[k] = weight[k] / variance
    return support


@njit(cache=True, nogil=True)
def _straight_through(s, d, w, first, last, fit):  # type: ignore[no-untyped-def]
    """Returns a, b of d = a + b s by weighted least squares; leaves their covariance in ``fit``."""
    n0 = n1 = n2 = d0 = d1 = 0.0
    for k in range(first, last + 1):
        n0 += w[k]
        n1 += w[k] * s[k]
        n2 += w[k] * s[k] * s[k]
        d0 += w[k] * d[k]
        d1 += w[k] * s[k] * d[k]
    det = n0 * n2 - n1 * n1
    fit[FIT_OO], fit[FIT_OS], fit[FIT_SS] = n2 / det, -n1 / det, n0 / det
    slope = (n0 * d1 - n1 * d0) / det
    return (d0 - slope * n1) / n0, slope


@njit(cache=True, nogil=True)
def _sum_up(blocks, floor, residual, w, weight, first, last, fit):  # type: ignore[no-untyped-def]
    """Fills in the sums over residuals (m); returns their mean square (pixels²), and a pixel (m).

    Residuals are divided by what grey noise says of them, so that their squares should be 1.
    """
    total = freedom = square = pixel = 0.0
    scaled = np.zeros(len(residual))
    for k in range(first, last + 1):
        r = residual[k]
        if weight[k] > 0.0:
            scaled[k] = TUKEY_RESIDUAL * r * math.sqrt(w[k] / weight[k])
        total += weight[k] * scaled[k] ** 2
        freedom += weight[k]
        square += weight[k] * (r / floor[k, PIXEL_M]) ** 2
        pixel += weight[k] * floor[k, PIXEL_M]
    fit[SQUARES], fit[FREEDOM] = total, freedom
    add_lagged(blocks, scaled, weight, first, last, fit[LAGGED:])
    return square / freedom, pixel / freedom
