"""Which straight segments of an image are the two edges of one line, and which lines are one.

Both compiled, without the interpreter lock; on the floor, in metres.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from frontend.profiles import to_floor
from graphslam.geometry import Array

MOST_PAIRS = 4096
SHORTEST_PX = 6.0  # of a segment, pixels
EDGE_PX = 1.0  # a detector's segment lies within this of the edge it belongs to
BLURRED_PX = 3.0  # how far apart, at most, a lens and a detector see the edges of a thin line

# columns of a segment: floor ends, unit normal towards the bright side, length (m), floor of a
# pixel across it (m), grey step across it
X0, Y0, X1, Y1, NX, NY, LENGTH, PIXEL, STEP = range(9)
SEGMENT_COLUMNS = 9
# columns of a pair: floor ends of its middle, width (m), 1 for dark and -1 for bright, overlap
# (pixels) times the weaker grey step, its two segments
PX0, PY0, PX1, PY1, WIDTH, DARK, SCORE, FIRST, SECOND = range(9)
PAIR_COLUMNS = 9


@njit(cache=True, nogil=True)
def pair_segments(segments, limits):  # type: ignore[no-untyped-def]
    """Returns pairs (P, 9) of segments (N, 9) that may be the two edges of a line.

    Their normals point in opposite directions, both away from a dark line or both into a bright
    one, they lie side by side, and their distance is a line's width.

    Args:
        segments: columns as above.
        limits: `Limits`; what a pixel makes of the angle of short edges is allowed for.
    """
    pairs = np.empty((MOST_PAIRS, PAIR_COLUMNS))
    count = 0
    for i in range(len(segments)):
        a = segments[i]
        tx, ty = -a[NY], a[NX]
        a0, a1 = a[X0] * tx + a[Y0] * ty, a[X1] * tx + a[Y1] * ty
        a_low, a_high = min(a0, a1), max(a0, a1)
        a_rho = a[X0] * a[NX] + a[Y0] * a[NY]
        for j in range(i + 1, len(segments)):
            b = segments[j]
            pixel = max(a[PIXEL], b[PIXEL])
            facing = a[NX] * b[NX] + a[NY] * b[NY]
            if facing > -0.8:
                continue
            slack = limits.angle + EDGE_PX * pixel * (1.0 / a[LENGTH] + 1.0 / b[LENGTH])
            turn = a[NX] * b[NY] - a[NY] * b[NX]
            if abs(turn) > math.sin(min(slack, 0.6)):
                continue
            b0, b1 = b[X0] * tx + b[Y0] * ty, b[X1] * tx + b[Y1] * ty
            b_low, b_high = min(b0, b1), max(b0, b1)
            low, high = max(a_low, b_low), min(a_high, b_high)
            if high - low <= 0.5 * min(a[LENGTH], b[LENGTH]) or b0 == b1:
                continue
            # how far segment b lies behind a, where the overlap begins and ends
            off_0 = a_rho - (b[X0] * a[NX] + b[Y0] * a[NY])
            off_1 = a_rho - (b[X1] * a[NX] + b[Y1] * a[NY])
            slope = (off_1 - off_0) / (b1 - b0)
            off_low, off_high = off_0 + slope * (low - b0), off_0 + slope * (high - b0)
            width = 0.5 * (off_low + off_high)  # dark lines: positive
            blur = EDGE_PX * pixel
            if abs(width) > max(limits.widest, BLURRED_PX * pixel) + blur:
                continue
            if abs(width) < limits.narrowest - blur or width * limits.sense < 0.0:
                continue
            if count == MOST_PAIRS:
                return pairs
            row = pairs[count]
            count += 1
            m_low, m_high = a_rho - 0.5 * off_low, a_rho - 0.5 * off_high
            row[PX0], row[PY0] = m_low * a[NX] + low * tx, m_low * a[NY] + low * ty
            row[PX1], row[PY1] = m_high * a[NX] + high * tx, m_high * a[NY] + high * ty
            row[WIDTH], row[DARK] = abs(width), 1.0 if width > 0 else -1.0
            row[SCORE] = (high - low) / pixel * min(a[STEP], b[STEP])
            row[FIRST], row[SECOND] = i, j
    return pairs[:count]


def clearest_first(pairs: Array) -> NDArray[np.int64]:
    """Returns the order (P,) of pairs (P, 9) by how clearly they are seen."""
    return np.argsort(-pairs[:, SCORE], kind="stable")


@njit(cache=True, nogil=True)
def join_pairs(pairs, order, segments, longest_gap):  # type: ignore[no-untyped-def]
    """Returns lines (C, 6): floor ends, width, 1 for dark or -1 for bright; in the order given.

    A pair takes up all others that continue it, so that crossings and stains do not part a line.
    A segment bounds one line only: the one of its clearest pair. Of a bevelled groove's four edges
    the two with the largest steps are the clearest.

    Args:
        pairs: of `pair_segments`.
        order: (P,) numbers of the pairs, clearest first.
        segments: the segments.
        longest_gap: between pairs of one line, m.
    """
    lines = np.empty((len(pairs), 6))
    taken = np.zeros(len(segments), np.bool_)
    member = np.zeros(len(pairs), np.bool_)
    ends = np.empty(4)
    count = 0
    for seed in order:
        p = pairs[seed]
        if taken[int(p[FIRST])] or taken[int(p[SECOND])]:
            continue
        ends[0], ends[1], ends[2], ends[3] = p[PX0], p[PY0], p[PX1], p[PY1]
        for _ in range(2):
            tx, ty = ends[2] - ends[0], ends[3] - ends[1]
            length = math.hypot(tx, ty)
            tx, ty = tx / length, ty / length
            low, high = 0.0, length
            # sums of a line fitted to ends of pairs: 1, s, s², d, s d
            n0 = n1 = n2 = d0 = d1 = 0.0
            for k in order:
                q = pairs[k]
                member[k] = False
                if q[DARK] != p[DARK] or taken[int(q[FIRST])] or taken[int(q[SECOND])]:
                    continue
                s0 = (q[PX0] - ends[0]) * tx + (q[PY0] - ends[1]) * ty
                s1 = (q[PX1] - ends[0]) * tx + (q[PY1] - ends[1]) * ty
                if min(s0, s1) > high + longest_gap or max(s0, s1) < low - longest_gap:
                    continue
                e0 = (q[PY0] - ends[1]) * tx - (q[PX0] - ends[0]) * ty
                e1 = (q[PY1] - ends[1]) * tx - (q[PX1] - ends[0]) * ty
                pixel = max(segments[int(q[FIRST]), PIXEL], segments[int(q[SECOND]), PIXEL])
                beyond = max(0.0, max(max(s0, s1) - length, -min(s0, s1)))
                slack = EDGE_PX * pixel * (1.0 + beyond / length) + 0.25 * p[WIDTH]
                if abs(e0) > slack or abs(e1) > slack:
                    continue
                member[k] = True
                low, high = min(low, s0, s1), max(high, s0, s1)
                w = q[SCORE]
                n0 += 2.0 * w
                n1 += w * (s0 + s1)
                n2 += w * (s0 * s0 + s1 * s1)
                d0 += w * (e0 + e1)
                d1 += w * (s0 * e0 + s1 * e1)
            det = n0 * n2 - n1 * n1
            slope = (n0 * d1 - n1 * d0) / det if det > 0.0 else 0.0
            offset = (d0 - slope * n1) / n0 if n0 > 0.0 else 0.0
            at_low, at_high = offset + slope * low, offset + slope * high
            x, y = ends[0], ends[1]
            ends[0], ends[1] = x + low * tx - at_low * ty, y + low * ty + at_low * tx
            ends[2], ends[3] = x + high * tx - at_high * ty, y + high * ty + at_high * tx
        for k in order:
            if member[k]:
                taken[int(pairs[k, FIRST])] = taken[int(pairs[k, SECOND])] = True
        taken[int(p[FIRST])] = taken[int(p[SECOND])] = True
        for k in range(4):
            lines[count, k] = ends[k]
        lines[count, 4], lines[count, 5] = p[WIDTH], p[DARK]
        count += 1
    return lines[:count]


@njit(cache=True, nogil=True)
def _grey_step(image, raw, first, last):  # type: ignore[no-untyped-def]
    """Returns the mean grey step across a part of a segment (2, 2), dark to bright, 1 at least.

    Between two pixels on either side, at nine places from ``first`` to ``last`` (0 to 1) along it.
    """
    height, width = image.shape
    du, dv = raw[1, 0] - raw[0, 0], raw[1, 1] - raw[0, 1]
    length = math.hypot(du, dv)
    nu, nv = 2.0 * dv / length, -2.0 * du / length  # to the bright side
    total = 0.0
    for n in range(9):
        part = first + (last - first) * n / 8.0
        u, v = raw[0, 0] + part * du, raw[0, 1] + part * dv
        i = min(max(int(v + nv + 0.5), 0), height - 1)
        j = min(max(int(u + nu + 0.5), 0), width - 1)
        total += image[i, j]
        i = min(max(int(v - nv + 0.5), 0), height - 1)
        j = min(max(int(u - nu + 0.5), 0), width - 1)
        total -= image[i, j]
    return max(total / 9.0, 1.0)


@njit(cache=True, nogil=True)
def place_segments(ends, raw, sight):  # type: ignore[no-untyped-def]
    """Returns segments (N, 9) on the floor, of those that are in the region that is looked at.

    Args:
        ends: (M, 2, 2) undistorted pixels, the bright side on the left.
        raw: (M, 2, 2) the same in the recorded image.
        sight: camera and region.
    """
    T = sight.floor_T_pixel
    height, width = sight.usable.shape
    placed = np.empty((len(ends), SEGMENT_COLUMNS))
    count = 0
    for k in range(len(ends)):
        # the part of it that is in the region, from nine points along it
        first, last = 2.0, -1.0
        for n in range(9):
            part = n / 8.0
            u = raw[k, 0, 0] + part * (raw[k, 1, 0] - raw[k, 0, 0])
            v = raw[k, 0, 1] + part * (raw[k, 1, 1] - raw[k, 0, 1])
            i = min(max(int(v + 0.5), 0), height - 1)
            j = min(max(int(u + 0.5), 0), width - 1)
            if sight.usable[i, j]:
                first, last = min(first, part), max(last, part)
        du, dv = ends[k, 1, 0] - ends[k, 0, 0], ends[k, 1, 1] - ends[k, 0, 1]
        pixels = math.hypot(du, dv)
        if not (last - first) * pixels >= SHORTEST_PX:
            continue
        u0, v0 = ends[k, 0, 0] + first * du, ends[k, 0, 1] + first * dv
        u1, v1 = ends[k, 0, 0] + last * du, ends[k, 0, 1] + last * dv
        x0, y0, w0 = to_floor(T, u0, v0)
        x1, y1, w1 = to_floor(T, u1, v1)
        um, vm = 0.5 * (u0 + u1), 0.5 * (v0 + v1)
        xm, ym, _ = to_floor(T, um, vm)
        xb, yb, _ = to_floor(T, um + dv / pixels, vm - du / pixels)  # a pixel to the bright side
        length = math.hypot(x1 - x0, y1 - y0)
        if not (w0 > 0.0 and w1 > 0.0 and length > 0.0):
            continue
        nx, ny = (y1 - y0) / length, (x0 - x1) / length
        off = (xb - xm) * nx + (yb - ym) * ny
        sense = 1.0 if off > 0.0 else -1.0
        row = placed[count]
        count += 1
        row[X0], row[Y0], row[X1], row[Y1] = x0, y0, x1, y1
        row[NX], row[NY] = sense * nx, sense * ny
        row[LENGTH], row[PIXEL] = length, abs(off)
        row[STEP] = _grey_step(sight.image, raw[k], first, last)
    return placed[:count]
