"""Where a line's two edges lie in an image, finer than a pixel: profiles across it, in blocks.

Along a line that is known to a pixel or two, grey profiles across it are averaged over a few
neighbouring pixels (a block). In each averaged profile the two edges are the centroids of the two
gradient lobes. Averaging makes weak lines measurable, and the errors of neighbouring pixels, which
smoothing and JPEG make alike, fall into one block instead of counting as many.

Compiled, without the interpreter lock.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from graphslam.geometry import Array

STEP = 0.5  # pixels from sample to sample across a line
UNEQUAL = 0.4  # share of the stronger edge's step that the weaker one's must have
LOBE = 0.3  # a gradient lobe reaches down to this share of its peak
MARGIN = 1.5  # pixels sampled beyond where an edge is looked for
MOST_SAMPLES = 400  # across a line
MOST_BLOCKS = 256  # along a line
FINEST_BLOCK = 4  # pixels along a line
COARSEST_BLOCK = 8

# columns of a block
U, V, ACROSS, WIDTH, STEP_LOW, STEP_HIGH, SIGMA, ALONG, PLACE, PIXEL = range(10)
COLUMNS = 10


class Sight(NamedTuple):
    """What the profiles of one image are read from.

    Attributes:
        image: (H, W) grey levels, as recorded.
        usable: (H, W) which pixels show floor that is looked at.
        pixel_T_floor: (3, 3) homography, floor (robot frame, m) to undistorted pixel.
        floor_T_pixel: (3, 3) its inverse.
        lens: (h, w, 2) raw pixels of undistorted ones on a grid; (0, 0, 2) without distortion.
        lens_at: (3,) undistorted u and v of the grid's first node, and its step, pixels.
    """

    image: NDArray[np.uint8]
    usable: NDArray[np.bool_]
    pixel_T_floor: Array
    floor_T_pixel: Array
    lens: Array
    lens_at: Array


@njit(cache=True, nogil=True)
def to_floor(T, u, v):  # type: ignore[no-untyped-def]
    """Returns x, y (m) under a pixel, and the third homogeneous coordinate: positive on floor."""
    w = T[2, 0] * u + T[2, 1] * v + T[2, 2]
    x = T[0, 0] * u + T[0, 1] * v + T[0, 2]
    y = T[1, 0] * u + T[1, 1] * v + T[1, 2]
    return x / w, y / w, w


@njit(cache=True, nogil=True)
def to_raw(u, v, lens, lens_at):  # type: ignore[no-untyped-def]
    """Returns the pixel of the recorded image that shows an undistorted one; NaN off the grid."""
    if lens.shape[0] == 0:
        return u, v
    a, b = (u - lens_at[0]) / lens_at[2], (v - lens_at[1]) / lens_at[2]
    i, j = math.floor(b), math.floor(a)
    if i < 0 or j < 0 or i + 1 >= lens.shape[0] or j + 1 >= lens.shape[1]:
        return math.nan, math.nan
    a, b = a - j, b - i
    p, q, r, s = (1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b
    raw_u = p * lens[i, j, 0] + q * lens[i, j + 1, 0]
    raw_v = p * lens[i, j, 1] + q * lens[i, j + 1, 1]
    raw_u += r * lens[i + 1, j, 0] + s * lens[i + 1, j + 1, 0]
    raw_v += r * lens[i + 1, j, 1] + s * lens[i + 1, j + 1, 1]
    return raw_u, raw_v


@njit(cache=True, nogil=True)
def _inside(at, step, size, first, last):  # type: ignore[no-untyped-def]
    """Returns the part of ``first`` to ``last`` (samples) for which at + k step is in the image."""
    most = size - 1.001  # a sample's right and lower neighbour are read too
    if abs(step) < 1e-9:
        return (first, last) if 0.0 <= at <= most else (first, first - 1)
    a, b = -at / step, (most - at) / step
    return max(first, math.ceil(min(a, b))), min(last, math.floor(max(a, b)))


@njit(cache=True, nogil=True)
def _add_profile(image, ray, first, stop, profile, last, again):  # type: ignore[no-untyped-def]
    """Adds greys along a ray to samples ``first`` to ``stop`` of a profile.

    Returns the sum of squared differences from the ``last`` profile; 0 unless ``again``.
    """
    du, dv = ray[2], ray[3]
    u, v = ray[0] + first * du, ray[1] + first * dv
    change = 0.0
    for k in range(first, stop):
        j, i = int(u), int(v)
        a, b = u - j, v - i
        top = image[i, j] + a * (float(image[i, j + 1]) - image[i, j])
        low = image[i + 1, j] + a * (float(image[i + 1, j + 1]) - image[i + 1, j])
        grey = top + b * (low - top)
        profile[k] += grey
        if again:
            change += (grey - last[k]) ** 2
        last[k] = grey
        u += du
        v += dv
    return change


@njit(cache=True, nogil=True)
def _lobe(profile, first, last, sense, whole):  # type: ignore[no-untyped-def]
    """Returns centroid (samples) and area of the highest gradient lobe of one sense, or zeros.

    Args:
        profile: greys; the gradient at k is half the difference of its neighbours.
        first, last: where the lobe's peak may be.
        sense: 1 for rising greys, -1 for falling.
        whole: whether the profile ends where it should, not at the border of the image; there a
            lobe that reaches its end does not count.
    """
    first, last = max(first, 1), min(last, len(profile) - 2)
    best, peak = 0.0, -1
    for k in range(first, last + 1):
        g = sense * (profile[k + 1] - profile[k - 1])
        if g > best:
            best, peak = g, k
    if peak < 0:
        return 0.0, 0.0
    low = high = peak
    floor = LOBE * best
    while low > 1 and sense * (profile[low] - profile[low - 2]) > floor:
        low -= 1
    while high < len(profile) - 2 and sense * (profile[high + 2] - profile[high]) > floor:
        high += 1
    if not whole and (low <= 1 or high >= len(profile) - 2):
        return 0.0, 0.0
    total = moment = 0.0
    for k in range(low, high + 1):
        weight = sense * (profile[k + 1] - profile[k - 1]) - floor
        total += weight
        moment += weight * k
    area = 0.5 * (total + floor * (high - low + 1))
    return moment / total, area


@njit(cache=True, nogil=True)
def read_blocks(sight, ends, width_m, dark, reach, most, blocks):  # type: ignore[no-untyped-def]
    """Fills ``blocks`` (MOST_BLOCKS, COLUMNS) with what is seen along a line; returns their number.

    Args:
        sight: image and camera, as of `Sight`.
        ends: (2, 2) undistorted pixels between which to look, on the line's middle.
        width_m: distance between its edges, m.
        dark: 1 where the line is darker than the floor, -1 where brighter.
        reach: how far from where it is expected an edge may lie, pixels.
        most: profiles to read at most; a longer line is read at every second, third, ... pixel.
        blocks: columns, per block: U, V middle of the block on ``ends``; ACROSS how far off it the
            middle between the edges lies, along the normal (-dv, du); WIDTH between the edges;
            STEP_LOW and STEP_HIGH the grey steps at both, as a line of this kind has them
            (0: not seen); SIGMA noise of ACROSS that the greys' noise makes; ALONG pixels along
            ``ends``; PLACE number of the block; PIXEL floor of a pixel across the line, m.
    """
    du, dv = ends[1, 0] - ends[0, 0], ends[1, 1] - ends[0, 1]
    length = math.hypot(du, dv)
    if not length >= FINEST_BLOCK:
        return 0
    du, dv = du / length, dv / length
    stride = max(1.0, length / most)
    size = int(min(COARSEST_BLOCK, max(FINEST_BLOCK, length / (16.0 * stride))))
    number = min(int(length / (size * stride)), MOST_BLOCKS)
    profile, last = np.empty(MOST_SAMPLES), np.empty(MOST_SAMPLES)
    rays = np.empty((COARSEST_BLOCK, 4))  # u, v of the first sample, and steps, recorded pixels
    height, width = sight.image.shape
    found = 0
    for place in range(number):
        along = (place + 0.5) * size * stride
        u, v = ends[0, 0] + along * du, ends[0, 1] + along * dv
        x, y, depth = to_floor(sight.floor_T_pixel, u, v)
        if not depth > 0.0:
            continue
        x_off, y_off, _ = to_floor(sight.floor_T_pixel, u - dv, v + du)
        x_on, y_on, _ = to_floor(sight.floor_T_pixel, u + du, v + dv)
        run = math.hypot(x_on - x, y_on - y)
        pixel_m = abs((x_off - x) * (y_on - y) - (y_off - y) * (x_on - x)) / run
        half = 0.5 * width_m / pixel_m
        samples = 2 * int((half + reach + MARGIN) / STEP) + 1
        if samples > MOST_SAMPLES:
            continue
        used, start, stop = 0, 0, samples
        for k in range(size):
            at = along + (k - 0.5 * (size - 1)) * stride
            u_k, v_k = ends[0, 0] + at * du, ends[0, 1] + at * dv
            span = 0.5 * STEP * (samples - 1)
            low_u, low_v = to_raw(u_k + span * dv, v_k - span * du, sight.lens, sight.lens_at)
            high_u, high_v = to_raw(u_k - span * dv, v_k + span * du, sight.lens, sight.lens_at)
            i, j = 0.5 * (low_v + high_v), 0.5 * (low_u + high_u)
            if not (0 <= i < height - 1 and 0 <= j < width - 1):
                continue
            if not sight.usable[int(i + 0.5), int(j + 0.5)]:
                continue
            ray = rays[used]
            ray[0], ray[1] = low_u, low_v
            ray[2], ray[3] = (high_u - low_u) / (samples - 1), (high_v - low_v) / (samples - 1)
            start, end = _inside(low_u, ray[2], width, start, stop - 1)
            start, end = _inside(low_v, ray[3], height, start, end)
            stop = end + 1
            used += 1
        if used < 0.75 * size or stop - start < 3:
            continue
        for k in range(start, stop):
            profile[k] = 0.0
        change = 0.0
        for k in range(used):
            change += _add_profile(sight.image, rays[k], start, stop, profile, last, k > 0)
        for k in range(start, stop):
            profile[k] /= used
        seen_part, whole = profile[start:stop], stop - start == samples
        middle, wide = 0.5 * (samples - 1) - start, half / STEP
        search = reach / STEP
        first, last_k = int(middle - wide - search), int(middle - wide + search)
        low, step_low = _lobe(seen_part, first, last_k, -dark, whole)
        first, last_k = int(middle + wide - search), int(middle + wide + search)
        high, step_high = _lobe(seen_part, first, last_k, dark, whole)
        grey_noise = math.sqrt(0.5 * change / (max(used - 1, 1) * (stop - start)) / used)
        row = blocks[found]
        row[U], row[V], row[ALONG], row[PLACE] = u, v, along, place
        row[PIXEL] = pixel_m
        row[ACROSS] = (0.5 * (low + high) - middle) * STEP
        row[WIDTH] = (high - low) * STEP
        row[STEP_LOW], row[STEP_HIGH] = step_low, step_high
        weakest = min(step_low, step_high)
        seen = weakest > 4.0 * grey_noise and weakest > 1.0 and row[WIDTH] > 1.0
        seen = seen and weakest > UNEQUAL * max(step_low, step_high)
        if not seen:
            row[STEP_LOW] = row[STEP_HIGH] = 0.0
            weakest = 1.0
        row[SIGMA] = 1.2 * grey_noise / weakest
        found += 1
    return found
