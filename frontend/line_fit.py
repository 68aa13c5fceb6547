"""A line fitted to what is seen along it, in the floor plane, with the covariance of the fit.

Compiled, without the interpreter lock.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from frontend.profiles import (
    ACROSS,
    ALONG,
    COLUMNS,
    MOST_BLOCKS,
    PIXEL,
    PLACE,
    SIGMA,
    STEP_HIGH,
    STEP_LOW,
    WIDTH,
    U,
    V,
    read_blocks,
    to_floor,
)

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

# columns of a fitted line: what it is, then what its covariance is made of
RHO, ALPHA, COV_RR, COV_RA, COV_AA, LOW, HIGH, WIDE, QUALITY, BLOCKS, RESIDUAL, CONTRAST = range(12)
MIDDLE, FIT_OO, FIT_OS, FIT_SS, FIXED_OO, FIXED_OS, FIXED_SS, SQUARES, FREEDOM = range(12, 21)
LAGGED = 21  # and the next LAGS
LAGS = 4  # neighbouring blocks whose errors may be alike
FIT_COLUMNS = LAGGED + LAGS

FIRST_REACH, LAST_REACH = 3.5, 1.5  # pixels, as of `read_blocks`
FIRST_MOST, LAST_MOST = 96, 320  # profiles, as of `read_blocks`
WEAKEST = 0.35  # share of a line's own median step that a block needs
WEAKEST_BEYOND = 0.2  # share of the step near its segments that a line has beyond them
TUKEY = 4.685
FINEST_SCALE = 0.04  # pixels: smaller residuals than these are never outliers
PRIOR_BLOCKS = 6.0  # what the grey noise says of the blocks of an image weighs as so many of them
SHARED_BLOCKS = 20.0  # what an image's other lines say of a line's noise weighs as so many blocks
LIMIT_PX = 0.005  # what profiles without noise are off by: 0.003 to 0.006 pixels at the ends
PRIOR_PX = 0.01  # a block's error beside that of grey noise: texture, wear, interpolation
MOST_ALIKE = 6.0  # factor on the variance that correlation may make
CROOKED_PX = 0.5  # root mean square of the residuals of what is no straight line, pixels
BLURRED_PX = 3.5  # a thin line's edges are seen this far apart at most, pixels
SPARE_PLACES = 2.0  # blocks that a line must show beyond chance: short ones are doubted most
SAME_TURN = math.sin(math.radians(5.0))


@njit(cache=True, nogil=True)
def _median(values):  # type: ignore[no-untyped-def]
    ordered = np.sort(values)
    n = len(ordered)
    return 0.5 * (ordered[(n - 1) // 2] + ordered[n // 2])


@njit(cache=True, nogil=True)
def _strong(blocks, count, least):  # type: ignore[no-untyped-def]
    """Moves blocks whose both edges are seen clearly to the front.

    Returns how many those are, and the median of their steps; steps below ``least`` do not count.
    """
    weakest = np.empty(count)
    seen = 0
    for k in range(count):
        step = min(blocks[k, STEP_LOW], blocks[k, STEP_HIGH])
        if step > least:
            weakest[seen] = step
            seen += 1
    if seen == 0:
        return 0, 0.0
    typical = _median(weakest[:seen])
    kept = 0
    for k in range(count):
        if min(blocks[k, STEP_LOW], blocks[k, STEP_HIGH]) >= max(WEAKEST * typical, least):
            for c in range(COLUMNS):
                blocks[kept, c] = blocks[k, c]
            kept += 1
    return kept, typical


@njit(cache=True, nogil=True)
def _fit_straight(blocks, count, weight):  # type: ignore[no-untyped-def]
    """Fits ACROSS = a + b ALONG robustly; fills ``weight``; returns a, b and scale, pixels."""
    along, across = blocks[:count, ALONG], blocks[:count, ACROSS]
    a = b = 0.0
    scale = 1e9
    residual = np.empty(count)
    # a first direction that a third of strays cannot turn: medians of the two ends' thirds
    third = max(count // 3, 1)
    s_0, s_1 = _median(along[:third]), _median(along[count - third :])
    d_0, d_1 = _median(across[:third]), _median(across[count - third :])
    if s_1 > s_0:
        b = (d_1 - d_0) / (s_1 - s_0)
        a = _median(across - b * along)
    for _ in range(5):
        for k in range(count):
            residual[k] = abs(across[k] - a - b * along[k])
        scale = max(1.4826 * _median(residual), FINEST_SCALE)
        n0 = n1 = n2 = d0 = d1 = 0.0
        for k in range(count):
            r = residual[k] / (TUKEY * scale)
            w = (1.0 - r * r) ** 2 if r < 1.0 else 0.0
            weight[k] = w
            n0 += w
            n1 += w * along[k]
            n2 += w * along[k] ** 2
            d0 += w * across[k]
            d1 += w * along[k] * across[k]
        det = n0 * n2 - n1 * n1
        if det <= 0.0:
            break
        b = (n0 * d1 - n1 * d0) / det
        a = (d0 - b * n1) / n0
    return a, b, scale


@njit(cache=True, nogil=True)
def _turned(ends, a, b):  # type: ignore[no-untyped-def]
    """Returns ``ends`` moved across by a + b along, pixels."""
    du, dv = ends[1, 0] - ends[0, 0], ends[1, 1] - ends[0, 1]
    length = math.hypot(du, dv)
    du, dv = du / length, dv / length
    out = np.empty((2, 2))
    for k in range(2):
        d = a + b * length * k
        out[k, 0], out[k, 1] = ends[k, 0] - d * dv, ends[k, 1] + d * du
    return out


@njit(cache=True, nogil=True)
def _through_view(ends, box):  # type: ignore[no-untyped-def]
    """Returns ``ends`` moved along their line to where it enters and leaves ``box`` (u v u v)."""
    du, dv = ends[1, 0] - ends[0, 0], ends[1, 1] - ends[0, 1]
    low, high = -1e9, 1e9
    for at, d, first, last in (
        (ends[0, 0], du, box[0], box[2]),
        (ends[0, 1], dv, box[1], box[3]),
    ):
        if abs(d) > 1e-9:
            p, q = (first - at) / d, (last - at) / d
            low, high = max(low, min(p, q)), min(high, max(p, q))
    out = np.empty((2, 2))
    out[0, 0], out[0, 1] = ends[0, 0] + low * du, ends[0, 1] + low * dv
    out[1, 0], out[1, 1] = ends[0, 0] + high * du, ends[0, 1] + high * dv
    return out


@njit(cache=True, nogil=True)
def fit_line(sight, box, line, limits, blocks, fit):  # type: ignore[no-untyped-def]
    """Fits one line of `join_pairs` to the image; fills ``fit`` (12,); returns why not, or FITS.

    Twice: near the segments that it was found by, then through the whole view. The covariances
    follow when all lines of the image are known.

    Args:
        sight: image and camera.
        box: (4,) smallest u, v and largest u, v of the view, undistorted pixels.
        line: (6,) floor ends, width, 1 dark or -1 bright.
        limits: narrowest, widest (m), longest gap (m), smallest quality, largest angle between
            the edges (rad), sigma of the calibration (pixels).
        blocks: (MOST_BLOCKS, COLUMNS) scratch.
        fit: columns as above.
    """
    H = sight.pixel_T_floor
    ends = np.empty((2, 2))
    for k in range(2):
        x, y = line[2 * k], line[2 * k + 1]
        u, v, _ = to_floor(H, x, y)
        ends[k, 0], ends[k, 1] = u, v
    weight = np.empty(MOST_BLOCKS)
    count = read_blocks(sight, ends, line[4], line[5], FIRST_REACH, FIRST_MOST, blocks)
    count, typical = _strong(blocks, count, 0.0)
    if count < 2:
        return NO_EDGES
    a, b, scale = _fit_straight(blocks, count, weight)
    ends = _through_view(_turned(ends, a, b), box)
    width = _median(blocks[:count, WIDTH] * blocks[:count, PIXEL])
    count = read_blocks(sight, ends, width, line[5], LAST_REACH, LAST_MOST, blocks)
    count, typical = _strong(blocks, count, WEAKEST_BEYOND * typical)
    if count < 3:
        return NO_EDGES
    a, b, scale = _fit_straight(blocks, count, weight)
    return _on_floor(sight, ends, blocks, count, weight, typical, scale, limits, fit)


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
        floor[k, 0], floor[k, 1], floor[k, 2], floor[k, 3] = x, y, wide / (2.0 * half), wide


@njit(cache=True, nogil=True)
def _best_run(blocks, count, weight, s, longest_gap):  # type: ignore[no-untyped-def]
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
def _add_lagged(blocks, residual, weight, first, last, lagged):  # type: ignore[no-untyped-def]
    """Sets ``lagged`` to sums of products of the residuals of blocks 1, 2, ... places apart."""
    lagged[:] = 0.0
    for k in range(first, last + 1):
        for other in range(max(first, k - LAGS), k):
            apart = int(blocks[k, PLACE] - blocks[other, PLACE])
            if apart <= LAGS:
                both = weight[k] * weight[other]
                lagged[apart - 1] += both * residual[k] * residual[other]


@njit(cache=True, nogil=True)
def _corner_share(u, v, size, share):  # type: ignore[no-untyped-def]
    """Fills ``share`` (4,): how far a pixel moves with each corner of the image (bilinear)."""
    a, b = u / size[0], v / size[1]
    share[0], share[1] = (1.0 - a) * (1.0 - b), a * (1.0 - b)
    share[2], share[3] = (1.0 - a) * b, a * b


@njit(cache=True, nogil=True)
def _on_floor(  # type: ignore[no-untyped-def]
    sight, ends, blocks, count, weight, typical, scale, limits, fit
):
    """Fits rho and alpha on the floor to blocks; fills ``fit``; returns why not, or FITS."""
    floor = np.empty((count, 4))
    _place_on_floor(sight, ends, blocks, count, floor)
    tx, ty = floor[count - 1, 0] - floor[0, 0], floor[count - 1, 1] - floor[0, 1]
    length = math.hypot(tx, ty)
    nx, ny = ty / length, -tx / length  # s = -x ny + y nx increases along (tx, ty)
    s, across = floor[:, 1] * nx - floor[:, 0] * ny, floor[:, 0] * nx + floor[:, 1] * ny
    first, last = _best_run(blocks, count, weight, s, limits[2])
    support = 0
    w = np.zeros(count)
    for k in range(first, last + 1):
        if weight[k] > 0.0:
            support += 1
            variance = (blocks[k, SIGMA] ** 2 + PRIOR_PX**2) * floor[k, 2] ** 2
            w[k] = weight[k] / variance
    places = blocks[last, PLACE] - blocks[first, PLACE] + 1.0
    if support < 3:
        return NO_EDGES

    n0 = n1 = n2 = d0 = d1 = e0 = e1 = 0.0
    middle = 0.5 * (s[first] + s[last])
    near = across[first]
    for k in range(first, last + 1):
        sk, dk, ek = s[k] - middle, across[k] - near, floor[k, 3]
        n0 += w[k]
        n1 += w[k] * sk
        n2 += w[k] * sk * sk
        d0 += w[k] * dk
        d1 += w[k] * sk * dk
        e0 += w[k] * ek
        e1 += w[k] * sk * ek
    det = n0 * n2 - n1 * n1
    slope, taper = (n0 * d1 - n1 * d0) / det, (n0 * e1 - n1 * e0) / det
    offset, wide = (d0 - slope * n1) / n0, (e0 - taper * n1) / n0
    total = freedom = square = pixel = 0.0
    residual = np.zeros(count)
    for k in range(first, last + 1):
        r = across[k] - near - offset - slope * (s[k] - middle)
        residual[k] = r * math.sqrt(w[k] / weight[k]) if weight[k] > 0.0 else 0.0
        total += weight[k] * residual[k] ** 2
        freedom += weight[k]
        square += weight[k] * (r / floor[k, 2]) ** 2
        pixel += weight[k] * floor[k, 2]
    pixel /= freedom
    crooked = square / freedom / CROOKED_PX**2
    if crooked > 1.0:
        return NOT_STRAIGHT
    quality = support / (places + SPARE_PLACES) * (1.0 - 0.5 * crooked)
    if quality < limits[3]:
        return TOO_POOR
    if wide < limits[0] - 0.5 * pixel or wide > max(limits[1], BLURRED_PX * pixel) + pixel:
        return TOO_WIDE
    if abs(taper) > math.tan(limits[4]):
        return NOT_PARALLEL

    # offset and slope at the middle of the stretch, for a unit variance
    fit[MIDDLE], fit[SQUARES], fit[FREEDOM] = middle, total, freedom
    fit[FIT_OO], fit[FIT_OS], fit[FIT_SS] = n2 / det, -n1 / det, n0 / det
    _add_lagged(blocks, residual, weight, first, last, fit[LAGGED:])
    # the calibration is off at the image's corners, and the line at its ends
    size = (float(sight.image.shape[1]), float(sight.image.shape[0]))
    share_first, share_last = np.empty(4), np.empty(4)
    _corner_share(blocks[first, U], blocks[first, V], size, share_first)
    _corner_share(blocks[last, U], blocks[last, V], size, share_last)
    var_first = np.sum(share_first**2) * limits[5] ** 2 + LIMIT_PX**2
    var_last = np.sum(share_last**2) * limits[5] ** 2 + LIMIT_PX**2
    var_first = var_first * floor[first, 2] ** 2 + limits[8] ** 2
    var_last = var_last * floor[last, 2] ** 2 + limits[8] ** 2
    cov_both = np.sum(share_first * share_last) * limits[5] ** 2
    cov_both *= floor[first, 2] * floor[last, 2]
    half = 0.5 * (s[last] - s[first])
    fit[FIXED_OO] = 0.25 * (var_first + var_last + 2.0 * cov_both)
    fit[FIXED_OS] = 0.25 * (var_last - var_first) / half
    fit[FIXED_SS] = 0.25 * (var_first + var_last - 2.0 * cov_both) / half**2

    turn = math.atan(slope)
    tilt = math.cos(turn)
    # n . p = near + offset + slope (s - middle): a line turned by -turn
    fit[RHO] = (near + offset - slope * middle) * tilt
    fit[ALPHA] = math.atan2(ny, nx) - turn
    c, n = math.cos(fit[ALPHA]), math.sin(fit[ALPHA])
    fit[LOW] = floor[first, 1] * c - floor[first, 0] * n
    fit[HIGH] = floor[last, 1] * c - floor[last, 0] * n
    fit[WIDE], fit[QUALITY], fit[BLOCKS] = wide, quality, support
    fit[RESIDUAL], fit[CONTRAST] = math.sqrt(square / freedom), typical
    return FITS


@njit(cache=True, nogil=True)
def _seen(fits, count, fit):  # type: ignore[no-untyped-def]
    """Returns whether a line is one of those found before: nearly parallel, on the same floor."""
    middle = 0.5 * (fit[LOW] + fit[HIGH])
    c, s = math.cos(fit[ALPHA]), math.sin(fit[ALPHA])
    x, y = fit[RHO] * c - middle * s, fit[RHO] * s + middle * c
    for k in range(count):
        other = fits[k]
        if abs(math.sin(fit[ALPHA] - other[ALPHA])) > SAME_TURN:
            continue
        off = x * math.cos(other[ALPHA]) + y * math.sin(other[ALPHA]) - other[RHO]
        if abs(off) < 0.5 * (fit[WIDE] + other[WIDE]):
            return True
    return False


@njit(cache=True, nogil=True)
def _set_covariances(fits, count):  # type: ignore[no-untyped-def]
    """Sets the covariances of an image's lines from their residuals.

    The variance of a block, and the correlation between neighbouring ones, are what the residuals
    of all lines of the image show; a line's own residuals count for more, the more it has.
    """
    squares, freedom = 0.0, 0.0
    lagged = np.zeros(LAGS)
    for k in range(count):
        squares += fits[k, SQUARES]
        freedom += fits[k, FREEDOM] - 2.0
        lagged += fits[k, LAGGED:]
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
def measure_lines(sight, box, lines, limits):  # type: ignore[no-untyped-def]
    """Returns the lines (K, 12) that hold, and how many were left out for each of `REASONS`.

    Args:
        sight: image and camera.
        box: as of `fit_line`.
        lines: (C, 6) of `join_pairs`, most trusted first.
        limits: as of `fit_line`, then shortest line (m), vaguest direction (sigma, rad),
            and how far lines wander from straight (sigma, m).
    """
    fits, counts = np.empty((len(lines), FIT_COLUMNS)), np.zeros(len(REASONS), np.int64)
    blocks, found = np.empty((MOST_BLOCKS, COLUMNS)), 0
    for k in range(len(lines)):
        fit = fits[found]
        reason = fit_line(sight, box, lines[k], limits, blocks, fit)
        if reason == FITS and fit[HIGH] - fit[LOW] < limits[6]:
            reason = TOO_SHORT
        elif reason == FITS and _seen(fits, found, fit):
            reason = SEEN_TWICE
        counts[reason] += 1
        if reason == FITS:
            found += 1
    _set_covariances(fits, found)
    sure = 0
    for k in range(found):
        if fits[k, COV_AA] > limits[7] ** 2:
            counts[TOO_VAGUE] += 1
        else:
            fits[sure] = fits[k]
            sure += 1
    return fits[:sure], counts
