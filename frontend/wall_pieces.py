"""Straight pieces in the points of one scan: split where it bends, fit, merge what is one wall.

Compiled, without the interpreter lock.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

RHO, ALPHA, COV_RR, COV_RA, COV_AA, LOW, HIGH, POINTS, CHI2 = range(9)
PIECE_COLUMNS = 9
REASONS = (
    "piece of a scan with too few points",
    "short piece of a scan",
    "piece of a scan seen at a grazing angle",
    "curved piece of a scan",
    "piece of a scan whose own fit leaves its direction too uncertain",
)
FEW, SHORT, GRAZING, CURVED, VAGUE = range(5)
FITS = -1
OUTLIER = 3.0
"""Standard deviations from its line beyond which the last point at an end of a piece is cut off: it
lies half on what is behind."""
ONE_WALL = 9.0
"""Squared Mahalanobis distance between two pieces of one scan up to which they are one wall."""


class Limits(NamedTuple):
    """What counts as a wall; see `frontend.config.WallConfig`."""

    range_sigma: float
    beam_sigma: float
    split: float
    fewest: int
    shortest: float
    steepest: float  # cosine of the largest angle of incidence
    straightness: float
    bent: float  # largest root mean square of residuals over their standard deviation
    vaguest: float
    largest_break: float
    floor_rho: float
    floor_alpha: float


@njit(cache=True, nogil=True)
def find_pieces(points, beams, limits):  # type: ignore[no-untyped-def]
    """Returns rows (K, PIECE_COLUMNS) of walls, and how many pieces each of `REASONS` left out.

    Args:
        points: (B, 2) ends of beams, robot frame, m; NaN where there is no echo.
        beams: (B, 2) length (m) and direction (rad, robot frame) of each beam.
        limits: `Limits`.
    """
    count = len(points)
    pieces = np.zeros((count + 1, PIECE_COLUMNS))
    counts = np.zeros(len(REASONS), np.int64)
    found, begin = 0, 0
    ends = np.empty(count + 1, np.int64)
    while begin < count:
        if math.isnan(points[begin, 0]):
            begin += 1
            continue
        end = begin + 1
        while end < count and _joined(points, beams, end, limits):
            end += 1
        parts = _split(points, beams, begin, end, limits, ends)
        first = begin
        for k in range(parts):
            reason = _fit(points, beams, first, ends[k], limits, pieces[found])
            if reason == FITS:
                found += 1
            else:
                counts[reason] += 1
            first = ends[k]
        begin = end
    found = _merge(pieces, found, limits)
    for k in range(found):
        _add_floor(pieces[k], limits)
    return pieces[:found], counts


@njit(cache=True, nogil=True)
def _joined(points, beams, k, limits):  # type: ignore[no-untyped-def]
    """Returns whether beams k - 1 and k can end on one wall that is not grazed."""
    if math.isnan(points[k, 0]):
        return False
    gap = math.hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
    near = min(beams[k, 0], beams[k - 1, 0])
    step = abs(beams[k, 1] - beams[k - 1, 1])
    return gap <= near * step / limits.steepest + 4.0 * limits.range_sigma


@njit(cache=True, nogil=True)
def _across_sigma(beams, k, alpha, limits):  # type: ignore[no-untyped-def]
    """Returns the standard deviation of point k across a line of direction alpha, m."""
    away = beams[k, 1] - alpha
    along = limits.range_sigma * math.cos(away)
    turned = limits.beam_sigma * beams[k, 0] * math.sin(away)
    return math.sqrt(along * along + turned * turned + limits.straightness**2)


@njit(cache=True, nogil=True)
def _split(points, beams, begin, end, limits, ends):  # type: ignore[no-untyped-def]
    """Fills ``ends`` with where pieces of points begin:end end; returns how many they are.

    A piece is split at its point farthest from the chord while that is farther than what noise
    explains. Source: iterative end point fit (Ramer; Douglas and Peucker).
    """
    stack = np.empty((64, 2), np.int64)
    stack[0, 0], stack[0, 1] = begin, end
    depth, parts = 1, 0
    while depth > 0:
        depth -= 1
        i, j = stack[depth, 0], stack[depth, 1]
        worst, at = 0.0, -1
        if j - i > 2:
            dx, dy = points[j - 1, 0] - points[i, 0], points[j - 1, 1] - points[i, 1]
            length = max(math.hypot(dx, dy), 1e-9)
            alpha = math.atan2(dx, -dy)
            for k in range(i + 1, j - 1):
                away = (
                    abs(dx * (points[k, 1] - points[i, 1]) - dy * (points[k, 0] - points[i, 0]))
                    / length
                )
                over = away / max(limits.split, 4.0 * _across_sigma(beams, k, alpha, limits))
                if over > worst:
                    worst, at = over, k
        if worst > 1.0 and depth + 2 <= len(stack):
            stack[depth, 0], stack[depth, 1] = at + 1, j
            stack[depth + 1, 0], stack[depth + 1, 1] = i, at + 1
            depth += 2
        else:
            ends[parts] = j
            parts += 1
    return parts


@njit(cache=True, nogil=True)
def _fit(points, beams, begin, end, limits, out):  # type: ignore[no-untyped-def]
    """Fits points begin:end into a row ``out``; returns `FITS`, or why they are no wall."""
    while True:
        if end - begin < limits.fewest:
            return FEW
        alpha = _total_least_squares(points, beams, begin, end, limits, out)
        first = _over(points, beams, begin, alpha, out[RHO], limits)
        last = _over(points, beams, end - 1, alpha, out[RHO], limits)
        if max(first, last) <= OUTLIER:
            break
        if first > last:
            begin += 1
        else:
            end -= 1
    out[LOW], out[HIGH], out[CHI2], out[POINTS] = math.inf, -math.inf, 0.0, end - begin
    grazing = 0.0
    for k in range(begin, end):
        s = -points[k, 0] * math.sin(alpha) + points[k, 1] * math.cos(alpha)
        out[LOW], out[HIGH] = min(out[LOW], s), max(out[HIGH], s)
        out[CHI2] += _over(points, beams, k, alpha, out[RHO], limits) ** 2
        grazing += abs(math.cos(beams[k, 1] - alpha)) / (end - begin)
    if out[HIGH] - out[LOW] < limits.shortest:
        return SHORT
    if grazing < limits.steepest:
        return GRAZING
    if math.sqrt(out[CHI2] / (end - begin - 2)) > limits.bent:
        return CURVED
    if math.sqrt(out[COV_AA]) > limits.vaguest:
        return VAGUE
    return FITS


@njit(cache=True, nogil=True)
def _over(points, beams, k, alpha, rho, limits):  # type: ignore[no-untyped-def]
    """Returns how many standard deviations point k lies from a line."""
    away = points[k, 0] * math.cos(alpha) + points[k, 1] * math.sin(alpha) - rho
    return abs(away) / _across_sigma(beams, k, alpha, limits)


@njit(cache=True, nogil=True)
def _total_least_squares(points, beams, begin, end, limits, out):  # type: ignore[no-untyped-def]
    """Writes the weighted line through points begin:end and its covariance; returns alpha.

    The noise of a point across the line depends on the line: the first pass weighs all alike, the
    second by the direction found. Perturbing (rho, alpha) moves a point at ``s`` along the line by
    ``s d_alpha - d_rho`` across it, which gives the information matrix.
    """
    alpha = rho = 0.0
    for step in range(2):
        w = wx = wy = wxx = wxy = wyy = 0.0
        for k in range(begin, end):
            one = 1.0 if step == 0 else 1.0 / _across_sigma(beams, k, alpha, limits) ** 2
            x, y = points[k, 0], points[k, 1]
            w, wx, wy = w + one, wx + one * x, wy + one * y
        x_0, y_0 = wx / w, wy / w
        for k in range(begin, end):
            one = 1.0 if step == 0 else 1.0 / _across_sigma(beams, k, alpha, limits) ** 2
            x, y = points[k, 0] - x_0, points[k, 1] - y_0
            wxx, wxy, wyy = wxx + one * x * x, wxy + one * x * y, wyy + one * y * y
        alpha = 0.5 * math.atan2(-2.0 * wxy, wyy - wxx)
        rho = x_0 * math.cos(alpha) + y_0 * math.sin(alpha)
    i_rr = i_ra = i_aa = 0.0
    for k in range(begin, end):
        one = 1.0 / _across_sigma(beams, k, alpha, limits) ** 2
        s = -points[k, 0] * math.sin(alpha) + points[k, 1] * math.cos(alpha)
        i_rr, i_ra, i_aa = i_rr + one, i_ra - one * s, i_aa + one * s * s
    det = max(i_rr * i_aa - i_ra * i_ra, 1e-300)
    out[RHO], out[ALPHA] = rho, alpha
    out[COV_RR], out[COV_RA], out[COV_AA] = i_aa / det, -i_ra / det, i_rr / det
    return alpha


@njit(cache=True, nogil=True)
def _add_floor(piece, limits):  # type: ignore[no-untyped-def]
    """Adds what all points of a piece have in common: an offset and a turn about its middle."""
    s = 0.5 * (piece[LOW] + piece[HIGH])
    turn = limits.floor_alpha**2
    piece[COV_RR] += limits.floor_rho**2 + s * s * turn
    piece[COV_RA] += s * turn
    piece[COV_AA] += turn


@njit(cache=True, nogil=True)
def _merge(pieces, found, limits):  # type: ignore[no-untyped-def]
    """Joins pieces that are one wall, nearest in the scan first; returns how many are left.

    Two fits are one by a chi-square test on their difference; they are joined as the product of
    both, which is the fit to all their points.
    """
    k = 0
    while k < found:
        joined = False
        for j in range(k + 1, found):
            if _same_wall(pieces[k], pieces[j], limits):
                _join(pieces[k], pieces[j])
                for m in range(j, found - 1):
                    pieces[m] = pieces[m + 1]
                found -= 1
                joined = True
                break
        if not joined:
            k += 1
    return found


@njit(cache=True, nogil=True)
def _difference(one, other):  # type: ignore[no-untyped-def]
    """Returns (rho, alpha) of ``other`` less that of ``one``, by the nearer twin, and the sign."""
    turn = other[ALPHA] - one[ALPHA]
    turn -= 2.0 * math.pi * round(turn / (2.0 * math.pi))
    if abs(turn) <= 0.5 * math.pi:
        return other[RHO] - one[RHO], turn, 1.0
    turn -= math.copysign(math.pi, turn)
    return -other[RHO] - one[RHO], turn, -1.0


@njit(cache=True, nogil=True)
def _same_wall(one, other, limits):  # type: ignore[no-untyped-def]
    d_rho, d_alpha, sign = _difference(one, other)
    low = other[LOW] if sign > 0 else -other[HIGH]
    high = other[HIGH] if sign > 0 else -other[LOW]
    gap = max(low - one[HIGH], one[LOW] - high)
    if gap > limits.largest_break:
        return False
    # compared at the middle between both: the floor is what both would share
    middle = 0.5 * (max(low, one[LOW]) + min(high, one[HIGH]))
    floor, turn = 2.0 * limits.floor_rho**2, 2.0 * limits.floor_alpha**2
    a = one[COV_RR] + other[COV_RR] + floor + middle * middle * turn
    b = one[COV_RA] + sign * other[COV_RA] + middle * turn
    c = one[COV_AA] + other[COV_AA] + turn
    det = a * c - b * b
    distance = (c * d_rho * d_rho - 2.0 * b * d_rho * d_alpha + a * d_alpha * d_alpha) / det
    return distance <= ONE_WALL


@njit(cache=True, nogil=True)
def _join(one, other):  # type: ignore[no-untyped-def]
    """Replaces ``one`` by the fit to the points of both."""
    d_rho, d_alpha, sign = _difference(one, other)
    a, b, c = one[COV_RR], one[COV_RA], one[COV_AA]
    e, f, g = other[COV_RR], sign * other[COV_RA], other[COV_AA]
    det_1, det_2 = a * c - b * b, e * g - f * f
    # informations of both, and of their sum
    p, q, r = c / det_1 + g / det_2, -b / det_1 - f / det_2, a / det_1 + e / det_2
    det = p * r - q * q
    y_0 = g / det_2 * d_rho - f / det_2 * d_alpha
    y_1 = -f / det_2 * d_rho + e / det_2 * d_alpha
    step_rho, step_alpha = (r * y_0 - q * y_1) / det, (p * y_1 - q * y_0) / det
    left = d_rho - step_rho, d_alpha - step_alpha
    one[CHI2] += other[CHI2] + (
        (c * step_rho**2 - 2.0 * b * step_rho * step_alpha + a * step_alpha**2) / det_1
        + (g * left[0] ** 2 - 2.0 * f * left[0] * left[1] + e * left[1] ** 2) / det_2
    )
    one[RHO] += step_rho
    one[ALPHA] += step_alpha
    one[COV_RR], one[COV_RA], one[COV_AA] = r / det, -q / det, p / det
    one[POINTS] += other[POINTS]
    low = other[LOW] if sign > 0 else -other[HIGH]
    high = other[HIGH] if sign > 0 else -other[LOW]
    one[LOW], one[HIGH] = min(one[LOW], low), max(one[HIGH], high)
