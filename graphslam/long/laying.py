"""Two small line maps laid on each other within what is known of their relative position.

Lines are directed: walls are seen from one side, and only faces of the same side can be one. They
are rows ``(rho, alpha, low, high)`` with the robot where ``x cos(alpha) + y sin(alpha) < rho``.
Compiled.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

LAID_COLUMNS = 6  # motion x, y, theta; common length, m; pairs; length across the worse direction
BIN = math.radians(0.5)
PARALLEL = math.radians(2.5)
MOST_CELLS = 240
SIGMAS = 3.0
"""Standard deviations of the prior within which motions are looked for."""
LONGEST = 4.0
"""Longer common stretches count as this, m: a corridor must not outvote everything else."""
OVERLAP = 0.2
"""Shortest common stretch, m."""
OFFSET_SIGMA, TURN_SIGMA = 0.03, math.radians(1.0)
ROTATIONS = 6


@njit(cache=True)
def moved(line, motion, out):  # type: ignore[no-untyped-def]
    """Writes a line moved by a rigid motion."""
    alpha = line[1] + motion[2]
    c, s = math.cos(alpha), math.sin(alpha)
    along = -s * motion[0] + c * motion[1]
    out[0], out[1] = line[0] + c * motion[0] + s * motion[1], alpha
    out[2], out[3] = line[2] + along, line[3] + along


@njit(cache=True)
def _wrapped(angle):  # type: ignore[no-untyped-def]
    return angle - 2.0 * math.pi * round(angle / (2.0 * math.pi))


@njit(cache=True)
def settle(a, b, motion, prior, tolerance, pairs):  # type: ignore[no-untyped-def]
    """Improves ``motion`` (3,) in place until lines of b lie best on lines of a.

    Args:
        a, b: (n, 4), (m, 4) directed lines in one frame.
        motion: moves b.
        prior: (3, 3) information of the motion, whose mean is none.
        tolerance: largest offset of a pair, m; larger at first.
        pairs: (>= m, 2) filled with rows of a and b.

    Returns:
        Common length (m), number of pairs, and the part of the length across the direction that is
        fixed worse.
    """
    line, count, length, worse = np.zeros(4), 0, 0.0, 0.0
    for step in range(8):
        wide = tolerance * (3.0 if step < 2 else (2.0 if step < 4 else 1.0))
        H = prior.copy()
        y = np.zeros(3)
        for p in range(3):
            for q in range(3):
                y[p] -= prior[p, q] * motion[q]
        count, length, xx, xy, yy = 0, 0.0, 0.0, 0.0, 0.0
        for j in range(len(b)):
            moved(b[j], motion, line)
            i = _partner(a, line, wide, tolerance)
            if i < 0:
                continue
            turn = _wrapped(a[i, 1] - line[1])
            low, high = max(a[i, 2], line[2]), min(a[i, 3], line[3])
            s, common = 0.5 * (low + high), high - low
            offset = a[i, 0] - line[0] - s * turn
            c, n = math.cos(a[i, 1]), math.sin(a[i, 1])
            w, w_turn = min(common, 3.0) / OFFSET_SIGMA**2, min(common, 3.0) / TURN_SIGMA**2
            J = (c, n, -s)
            for p in range(3):
                for q in range(3):
                    H[p, q] += w * J[p] * J[q]
                y[p] += w * J[p] * offset
            H[2, 2] += w_turn
            y[2] += w_turn * turn
            xx, xy, yy = xx + common * c * c, xy + common * c * n, yy + common * n * n
            pairs[count, 0], pairs[count, 1] = i, j
            count, length = count + 1, length + common
        if count == 0:
            return 0.0, 0, 0.0
        x = _solved(H, y)
        c, n = math.cos(x[2]), math.sin(x[2])
        first = c * motion[0] - n * motion[1] + x[0]
        motion[1] = n * motion[0] + c * motion[1] + x[1]
        motion[0] = first
        motion[2] += x[2]
        root = math.sqrt(max((xx - yy) ** 2 + 4.0 * xy * xy, 0.0))
        worse = 0.5 * (xx + yy - root)
    return length, count, worse


@njit(cache=True)
def _solved(H, y):  # type: ignore[no-untyped-def]
    """Returns the solution of three equations with a symmetric, positive definite matrix."""
    a, b, c, d, e, f = H[0, 0], H[0, 1], H[0, 2], H[1, 1], H[1, 2], H[2, 2]
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    s, t, u = a * f - c * c, b * c - a * e, a * d - b * b
    det = a * p + b * q + c * r
    return (
        (p * y[0] + q * y[1] + r * y[2]) / det,
        (q * y[0] + s * y[1] + t * y[2]) / det,
        (r * y[0] + t * y[1] + u * y[2]) / det,
    )


@njit(cache=True)
def _partner(a, line, wide, tolerance):  # type: ignore[no-untyped-def]
    """Returns the row of a that shares most with a line, or -1."""
    most, partner = 0.0, -1
    for i in range(len(a)):
        turn = _wrapped(a[i, 1] - line[1])
        if abs(turn) > math.radians(2.0) * wide / tolerance + 0.03:
            continue
        low, high = max(a[i, 2], line[2]), min(a[i, 3], line[3])
        if high - low < OVERLAP:
            continue
        offset = abs(a[i, 0] - line[0] - 0.5 * (low + high) * turn)
        if offset > wide:
            continue
        value = (high - low) * (1.0 - 0.5 * offset / wide)
        if value > most:
            most, partner = value, i
    return partner


@njit(cache=True)
def lay(a, b, sigma, prior, tolerance, out):  # type: ignore[no-untyped-def]
    """Fills ``out`` (k, LAID_COLUMNS) with different ways to lay b on a; returns how many.

    Turns come from a histogram of angles between directed lines, shifts from votes by common
    length on a grid; each peak is settled by least squares.

    Args:
        a, b: (n, 4), (m, 4) directed lines in one frame.
        sigma: (3,) standard deviations of b's motion, m and rad.
        prior: (3, 3) its information.
        tolerance: largest offset of a pair of lines, m.
        out: room for the ways.
    """
    reach = min(SIGMAS * sigma[2] + math.radians(3.0), math.pi)
    half = int(reach / BIN)
    votes = _turns(a, b, half)
    pairs = np.zeros((len(b) + 1, 2), np.int64)
    found, highest = 0, votes.max()
    for _ in range(ROTATIONS):
        peak = int(np.argmax(votes))
        if votes[peak] <= 0.0 or votes[peak] < 0.4 * highest:
            break
        votes[max(peak - 5, 0) : peak + 6] = 0.0
        found = _shifts(a, b, (peak - half) * BIN, sigma, prior, tolerance, pairs, out, found)
    return found


@njit(cache=True)
def _turns(a, b, half):  # type: ignore[no-untyped-def]
    """Returns the votes (2 half + 1,) for turns of b in steps of `BIN`, spread by a triangle."""
    raw, votes = np.zeros(2 * half + 1), np.zeros(2 * half + 1)
    for i in range(len(a)):
        for j in range(len(b)):
            k = half + round(_wrapped(a[i, 1] - b[j, 1]) / BIN)
            if 0 <= k < len(raw):
                raw[k] += min(a[i, 3] - a[i, 2], b[j, 3] - b[j, 2], LONGEST)
    for k in range(len(raw)):
        for d in range(-3, 4):
            if 0 <= k + d < len(raw):
                votes[k] += raw[k + d] * (1.0 - 0.25 * abs(d))
    return votes


@njit(cache=True)
def _shifts(a, b, turn, sigma, prior, tolerance, pairs, out, found):  # type: ignore[no-untyped-def]
    """Settles the best shifts after a turn; returns how many ways ``out`` holds then."""
    width, height = SIGMAS * sigma[0] + 0.4, SIGMAS * sigma[1] + 0.4
    cell = max(0.1, 2.0 * max(width, height) / MOST_CELLS)
    nx, ny = int(width / cell), int(height / cell)
    raw = np.zeros((2 * nx + 1, 2 * ny + 1))
    _vote(a, b, turn, cell, raw)
    votes = np.zeros_like(raw)
    for x in range(raw.shape[0]):
        for y in range(raw.shape[1]):
            for dx in range(max(x - 1, 0), min(x + 2, raw.shape[0])):
                for dy in range(max(y - 1, 0), min(y + 2, raw.shape[1])):
                    votes[x, y] += raw[dx, dy] * (1.0 if dx == x and dy == y else 0.5)
    top = votes.max()
    if top <= 0.0:
        return found
    for x in range(raw.shape[0]):
        for y in range(raw.shape[1]):
            if votes[x, y] >= 0.5 * top and _is_peak(votes, x, y):
                motion = np.array([(x - nx) * cell, (y - ny) * cell, turn])
                length, count, worse = settle(a, b, motion, prior, tolerance, pairs)
                if count > 0:
                    found = _keep(out, found, motion, length, count, worse)
    return found


@njit(cache=True)
def _vote(a, b, turn, cell, raw):  # type: ignore[no-untyped-def]
    """Adds the length that parallel lines would share, at every shift between their ends."""
    line, motion = np.zeros(4), np.array([0.0, 0.0, turn])
    nx, ny = raw.shape[0] // 2, raw.shape[1] // 2
    for j in range(len(b)):
        moved(b[j], motion, line)
        for i in range(len(a)):
            away = _wrapped(a[i, 1] - line[1])
            if abs(away) > PARALLEL:
                continue
            c, s = math.cos(a[i, 1]), math.sin(a[i, 1])
            offset = a[i, 0] - line[0] - 0.5 * (a[i, 2] + a[i, 3]) * away
            most = min(a[i, 3] - a[i, 2], line[3] - line[2], LONGEST)
            first, last = a[i, 2] - line[3], a[i, 3] - line[2]
            u = first
            while u <= last:
                x = nx + round((offset * c - u * s) / cell)
                y = ny + round((offset * s + u * c) / cell)
                if 0 <= x < raw.shape[0] and 0 <= y < raw.shape[1]:
                    raw[x, y] += min(u - first, last - u, most)
                u += cell


@njit(cache=True)
def _is_peak(votes, x, y):  # type: ignore[no-untyped-def]
    """Returns whether no cell near by has more votes; of equal ones the last is the peak."""
    for dx in range(max(x - 3, 0), min(x + 4, votes.shape[0])):
        for dy in range(max(y - 3, 0), min(y + 4, votes.shape[1])):
            if votes[dx, dy] > votes[x, y]:
                return False
            if votes[dx, dy] == votes[x, y] and (dx > x or (dx == x and dy > y)):
                return False
    return True


@njit(cache=True)
def _keep(out, found, motion, length, count, worse):  # type: ignore[no-untyped-def]
    """Enters a way into ``out``, unless it is there or is weaker than all; returns how many."""
    motion[2] = _wrapped(motion[2])
    place = found
    for k in range(found):
        near = abs(out[k, 0] - motion[0]) + abs(out[k, 1] - motion[1]) < 0.3
        if near and abs(out[k, 2] - motion[2]) < 0.05:
            place = k
    if place == len(out):
        place = int(np.argmin(out[:, 3]))
    if place < found and length <= out[place, 3]:
        return found
    out[place, 0], out[place, 1], out[place, 2] = motion[0], motion[1], motion[2]
    out[place, 3], out[place, 4], out[place, 5] = length, count, worse
    return max(found, place + 1)
