"""A straight line through the blocks of one profile reading: robust, in the image.

Compiled, without the interpreter lock.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from frontend.profiles import ACROSS, ALONG, COLUMNS, STEP_HIGH, STEP_LOW

WEAKEST = 0.35  # share of a line's own median step that a block needs
TUKEY = 4.685
TUKEY_RESIDUAL = (
    1.079  # the weights shrink residuals: as much larger is the standard deviation of a
)
# block by which the covariance of such a fit comes out right for normal errors
FINEST_SCALE = 0.04  # pixels: smaller residuals than these are never outliers


@njit(cache=True, nogil=True)
def median_of(values):  # type: ignore[no-untyped-def]
    """Returns the median of contiguous values, by Shell's sort of a copy.

    `numpy.sort` takes seconds to compile.
    """
    n = len(values)
    ordered = np.empty(n)
    for k in range(n):
        ordered[k] = values[k]
    gap = 1
    while gap < n // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for k in range(gap, n):
            value, place = ordered[k], k
            while place >= gap and ordered[place - gap] > value:
                ordered[place] = ordered[place - gap]
                place -= gap
            ordered[place] = value
        gap //= 3
    return 0.5 * (ordered[(n - 1) // 2] + ordered[n // 2])


@njit(cache=True, nogil=True)
def keep_strong(blocks, count, least):  # type: ignore[no-untyped-def]
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
    typical = median_of(weakest[:seen])
    kept = 0
    for k in range(count):
        if min(blocks[k, STEP_LOW], blocks[k, STEP_HIGH]) >= max(WEAKEST * typical, least):
            for c in range(COLUMNS):
                blocks[kept, c] = blocks[k, c]
            kept += 1
    return kept, typical


@njit(cache=True, nogil=True)
def fit_straight(blocks, count, weight):  # type: ignore[no-untyped-def]
    """Fits ACROSS = a + b ALONG robustly; fills ``weight``; returns a (pixels) and b."""
    along, across, residual = np.empty(count), np.empty(count), np.empty(count)
    for k in range(count):
        along[k], across[k] = blocks[k, ALONG], blocks[k, ACROSS]
    a = b = 0.0
    # a first direction that no third of strays can turn: through the medians of two of the three
    # thirds, whichever two leave the smallest residuals
    third = max(count // 3, 1)
    least = math.inf
    for first, second in ((0, count - third), (0, third), (third, count - third)):
        first_last, second_last = min(first + third, count), min(second + third, count)
        s_0, s_1 = median_of(along[first:first_last]), median_of(along[second:second_last])
        if s_1 <= s_0:
            continue
        d_0, d_1 = median_of(across[first:first_last]), median_of(across[second:second_last])
        slope = (d_1 - d_0) / (s_1 - s_0)
        for k in range(count):
            residual[k] = across[k] - slope * along[k]
        offset = median_of(residual)
        for k in range(count):
            residual[k] = abs(residual[k] - offset)
        size = median_of(residual)
        if size < least:
            least, a, b = size, offset, slope
    for _ in range(5):
        for k in range(count):
            residual[k] = abs(across[k] - a - b * along[k])
        scale = max(1.4826 * median_of(residual), FINEST_SCALE)
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
    return a, b


@njit(cache=True, nogil=True)
def turned(ends, a, b):  # type: ignore[no-untyped-def]
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
def through_view(ends, box):  # type: ignore[no-untyped-def]
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
