"""Lines measured in an image: each read along its whole length, fitted, and held against limits.

Compiled, without the interpreter lock.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from frontend.fit_table import (
    ALPHA,
    COV_AA,
    FIT_COLUMNS,
    FITS,
    HIGH,
    LOW,
    NO_EDGES,
    REASONS,
    RHO,
    SEEN_TWICE,
    TOO_SHORT,
    TOO_VAGUE,
    WIDE,
)
from frontend.floor_fit import fit_on_floor
from frontend.line_noise import set_covariances
from frontend.profiles import COLUMNS, MOST_BLOCKS, PIXEL, WIDTH, read_blocks, to_floor
from frontend.straight import fit_straight, keep_strong, median_of, through_view, turned

FIRST_REACH, LAST_REACH = 3.5, 1.5  # pixels, as of `read_blocks`
FIRST_MOST, LAST_MOST = 96.0, 320.0  # profiles, as of `read_blocks`
WEAKEST_BEYOND = 0.2  # share of the step near its segments that a line has beyond them
SAME_TURN = math.sin(math.radians(5.0))


@njit(cache=True, nogil=True)
def measure_lines(sight, box, lines, limits):  # type: ignore[no-untyped-def]
    """Returns rows (K, FIT_COLUMNS) of lines that hold, and how many each of `REASONS` left out.

    Args:
        sight: image and camera.
        box: (4,) smallest u, v and largest u, v of the view, undistorted pixels.
        lines: (C, 6) of `join_pairs`, most trusted first.
        limits: `Limits`.
    """
    fits, counts = np.empty((len(lines), FIT_COLUMNS)), np.zeros(len(REASONS), np.int64)
    blocks = np.empty((MOST_BLOCKS, COLUMNS))
    found = len(lines) - len(lines)  # a plain 0 would have callees compiled for it alone
    for k in range(len(lines)):
        fit = fits[found]
        reason = _fit_line(sight, box, lines[k], limits, blocks, fit)
        if reason == FITS and fit[HIGH] - fit[LOW] < limits.shortest:
            reason = TOO_SHORT
        elif reason == FITS and _seen(fits, found, fit):
            reason = SEEN_TWICE
        counts[reason] += 1
        if reason == FITS:
            found += 1
    set_covariances(fits, found)
    sure = 0
    for k in range(found):
        if fits[k, COV_AA] > limits.vaguest**2:
            counts[TOO_VAGUE] += 1
        else:
            for column in range(FIT_COLUMNS):
                fits[sure, column] = fits[k, column]
            sure += 1
    return fits[:sure], counts


@njit(cache=True, nogil=True)
def _fit_line(sight, box, line, limits, blocks, fit):  # type: ignore[no-untyped-def]
    """Fits one line of `join_pairs` to the image; fills ``fit``; returns why not, or FITS.

    Twice: near the segments that it was found by, then through the whole view. The covariances
    follow when all lines of the image are known.

    Args:
        sight: image and camera.
        box: (4,) smallest u, v and largest u, v of the view, undistorted pixels.
        line: (6,) floor ends, width, 1 dark or -1 bright.
        limits: `Limits`.
        blocks: (MOST_BLOCKS, COLUMNS) scratch.
        fit: a row of the table, `fit_table`.
    """
    H = sight.pixel_T_floor
    ends = np.empty((2, 2))
    for k in range(2):
        x, y = line[2 * k], line[2 * k + 1]
        u, v, _ = to_floor(H, x, y)
        ends[k, 0], ends[k, 1] = u, v
    weight = np.empty(MOST_BLOCKS)
    count = read_blocks(sight, ends, line[4], line[5], FIRST_REACH, FIRST_MOST, blocks)
    count, typical = keep_strong(blocks, count, 0.0)
    if count < 2:
        return NO_EDGES
    a, b = fit_straight(blocks, count, weight)
    ends = through_view(turned(ends, a, b), box)
    for k in range(count):
        weight[k] = blocks[k, WIDTH] * blocks[k, PIXEL]
    width = median_of(weight[:count])
    count = read_blocks(sight, ends, width, line[5], LAST_REACH, LAST_MOST, blocks)
    count, typical = keep_strong(blocks, count, WEAKEST_BEYOND * typical)
    if count < 3:
        return NO_EDGES
    fit_straight(blocks, count, weight)
    return fit_on_floor(sight, ends, blocks, count, weight, typical, limits, fit)


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
