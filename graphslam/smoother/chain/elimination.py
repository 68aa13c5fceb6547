"""Elimination of the poses inside a chunk, one after the other, and the way back."""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

import math

from numba import njit

from graphslam.smoother.chain.chunks import POSE


@njit(cache=True)
def eliminate(k, chunks, linear, damping, M, B, P, chain, solved):  # type: ignore[no-untyped-def]
    """Eliminates the poses inside chunk ``k``; returns whether there is a right separator.

    Fills ``M`` (width, width), lower, over the local order; ``P`` (3, 3), lower, of the right
    separator; ``B`` (3, width) between both; and ``chain[i]``: for each pose inside the lower
    Cholesky factor (6) and its coupling to the next pose (9). Unless it is empty, ``solved`` (poses
    inside, 3, width) is filled with their couplings to the local scalars.
    """
    s0, s1, width = chunks.bound[k], chunks.bound[k + 1], chunks.width[k]
    rows, motion = linear.rows, linear.motion
    row_start, slot = chunks.row_start, chunks.slot
    wide = rows.shape[1] - 1 - POSE
    at_left = POSE if k > 0 else 0
    for i in range(width + wide):
        for j in range(i + 1):
            M[i, j] = 0.0
    for r in range(row_start[s0], row_start[s0 + 1]):
        _add_kept(M, rows, r, slot[r], wide, at_left)
    active = 1 + at_left
    if s1 == s0:
        return False
    for i in range(s0, s1):
        if i == s0:
            _start_chain(M, B, P, motion, i, at_left, width + wide)
        else:
            for a in range(POSE):
                P[a, a] += damping
            active = _solve_pose(i, row_start, slot, rows, motion, active, B, M, P, chain, wide)
            for a in range(POSE if len(solved) else 0):
                for j in range(width):
                    solved[i - s0 - 1, a, j] = B[a, j] if j < active else 0.0
            _pass_on(i, motion, active, M, B, P, chain)
    if s1 == len(row_start) - 2:
        _add_rows(s1, row_start, slot, rows, active, M, B, P, wide)
        for a in range(POSE):
            for j in range(width, width + wide):
                B[a, j] = 0.0
    return True


@njit(cache=True)
def _add_kept(M, rows, r, slot, wide, at_left):  # type: ignore[no-untyped-def]
    """Adds a row of the left separator's own; the first pose of all is held."""
    e = rows[r, 0]
    M[0, 0] += e * e
    for a in range(at_left):
        M[1 + a, 0] += rows[r, 1 + a] * e
        for b in range(a + 1):
            M[1 + a, 1 + b] += rows[r, 1 + a] * rows[r, 1 + b]
    for q in range(wide):
        value = rows[r, 1 + POSE + q]
        M[slot + q, 0] += value * e
        for a in range(at_left):
            M[slot + q, 1 + a] += value * rows[r, 1 + a]
        for p in range(q + 1):
            M[slot + q, slot + p] += value * rows[r, 1 + POSE + p]


@njit(cache=True)
def _start_chain(M, B, P, motion, i, at_left, width):  # type: ignore[no-untyped-def]
    """Adds the first increment, from the left separator to the next pose."""
    for a in range(POSE):
        for j in range(width):
            B[a, j] = 0.0
        for b in range(POSE):
            P[a, b] = 0.0
    for row in range(POSE):
        e = motion[i, row, 0]
        M[0, 0] += e * e
        for a in range(at_left):
            left = motion[i, row, 1 + a]
            M[1 + a, 0] += left * e
            for b in range(a + 1):
                M[1 + a, 1 + b] += left * motion[i, row, 1 + b]
        for a in range(POSE):
            right = motion[i, row, 4 + a]
            B[a, 0] += right * e
            for b in range(at_left):
                B[a, 1 + b] += right * motion[i, row, 1 + b]
            for b in range(a + 1):
                P[a, b] += right * motion[i, row, 4 + b]


@njit(cache=True)
def _add_rows(i, row_start, slots, rows, active, M, B, P, wide):  # type: ignore[no-untyped-def]
    """Adds the rows of pose ``i``; returns how many local scalars are in use.

    Sums are kept in scalars meanwhile: an array might be another one's memory, for all that the
    compiler knows, and would be written and read back at every row.
    """
    p00, p10, p11, p20, p21, p22 = P[0, 0], P[1, 0], P[1, 1], P[2, 0], P[2, 1], P[2, 2]
    b0, b1, b2, square = B[0, 0], B[1, 0], B[2, 0], M[0, 0]
    for r in range(row_start[i], row_start[i + 1]):
        slot = slots[r]
        e, j0, j1, j2 = rows[r, 0], rows[r, 1], rows[r, 2], rows[r, 3]
        active = max(active, slot + wide)
        square += e * e
        b0 += j0 * e
        b1 += j1 * e
        b2 += j2 * e
        p00 += j0 * j0
        p10 += j1 * j0
        p11 += j1 * j1
        p20 += j2 * j0
        p21 += j2 * j1
        p22 += j2 * j2
        for q in range(wide):
            value = rows[r, 4 + q]
            B[0, slot + q] += j0 * value
            B[1, slot + q] += j1 * value
            B[2, slot + q] += j2 * value
            M[slot + q, 0] += value * e
            for p in range(q + 1):
                M[slot + q, slot + p] += value * rows[r, 4 + p]
    P[0, 0], P[1, 0], P[1, 1], P[2, 0], P[2, 1], P[2, 2] = p00, p10, p11, p20, p21, p22
    B[0, 0], B[1, 0], B[2, 0], M[0, 0] = b0, b1, b2, square
    return active


@njit(cache=True)
def _solve_pose(i, row_start, slots, rows, motion, active, B, M, P, chain, wide):  # type: ignore[no-untyped-def]
    """Factorises pose ``i`` and solves ``B`` for it; returns the scalars in use."""
    active = _add_rows(i, row_start, slots, rows, active, M, B, P, wide)
    out = chain[i]
    p00, p10, p11, p20, p21, p22 = P[0, 0], P[1, 0], P[1, 1], P[2, 0], P[2, 1], P[2, 2]
    e0, e1, e2, square = B[0, 0], B[1, 0], B[2, 0], M[0, 0]
    for row in range(POSE):
        e, j0, j1, j2 = motion[i, row, 0], motion[i, row, 1], motion[i, row, 2], motion[i, row, 3]
        square += e * e
        e0 += j0 * e
        e1 += j1 * e
        e2 += j2 * e
        p00 += j0 * j0
        p10 += j1 * j0
        p11 += j1 * j1
        p20 += j2 * j0
        p21 += j2 * j1
        p22 += j2 * j2
    B[0, 0], B[1, 0], B[2, 0], M[0, 0] = e0, e1, e2, square
    l00 = math.sqrt(p00)
    r0 = 1.0 / l00
    l10, l20 = p10 * r0, p20 * r0
    l11 = math.sqrt(p11 - l10 * l10)
    r1 = 1.0 / l11
    l21 = (p21 - l20 * l10) * r1
    l22 = math.sqrt(p22 - l20 * l20 - l21 * l21)
    r2 = 1.0 / l22
    out[0], out[1], out[2], out[3], out[4], out[5] = l00, l10, l11, l20, l21, l22
    for b in range(POSE):  # coupling to the next pose, solved
        o0, o1, o2 = 0.0, 0.0, 0.0
        for row in range(POSE):
            right = motion[i, row, 4 + b]
            o0 += motion[i, row, 1] * right
            o1 += motion[i, row, 2] * right
            o2 += motion[i, row, 3] * right
        o0 *= r0
        o1 = (o1 - l10 * o0) * r1
        out[6 + b], out[9 + b], out[12 + b] = o0, o1, (o2 - l20 * o0 - l21 * o1) * r2
    for j in range(active):
        b0 = B[0, j] * r0
        b1 = (B[1, j] - l10 * b0) * r1
        B[0, j], B[1, j], B[2, j] = b0, b1, (B[2, j] - l20 * b0 - l21 * b1) * r2
    return active


@njit(cache=True)
def _pass_on(i, motion, active, M, B, P, chain):  # type: ignore[no-untyped-def]
    """Takes what the elimination of pose ``i`` leaves to ``M`` and to the next pose."""
    out = chain[i]
    for a in range(active):
        m, x0, x1, x2 = M[a], B[0, a], B[1, a], B[2, a]
        for j in range(a + 1):
            m[j] -= x0 * B[0, j] + x1 * B[1, j] + x2 * B[2, j]
    for j in range(active):
        b0, b1, b2 = B[0, j], B[1, j], B[2, j]
        B[0, j] = -(out[6] * b0 + out[9] * b1 + out[12] * b2)
        B[1, j] = -(out[7] * b0 + out[10] * b1 + out[13] * b2)
        B[2, j] = -(out[8] * b0 + out[11] * b1 + out[14] * b2)
    for a in range(POSE):
        for b in range(a + 1):
            P[a, b] = -(
                out[6 + a] * out[6 + b] + out[9 + a] * out[9 + b] + out[12 + a] * out[12 + b]
            )
            for row in range(POSE):
                P[a, b] += motion[i, row, 4 + a] * motion[i, row, 4 + b]
        for row in range(POSE):
            B[a, 0] += motion[i, row, 4 + a] * motion[i, row, 0]


@njit(cache=True)
def back_substitute(k, chunks, linear, known, chain, step):  # type: ignore[no-untyped-def]
    """Fills ``step[i]`` of the poses inside chunk ``k``.

    Args:
        k: the chunk.
        chunks: of the chain.
        linear: what was eliminated.
        known: (width,) solution in local order, 1 for the right-hand side, or 0 to leave it out.
        chain: as filled by `eliminate`.
        step: (N, 3) whose rows of the two separators are known.
    """
    s0, s1 = chunks.bound[k], chunks.bound[k + 1]
    rows, motion = linear.rows, linear.motion
    wide = rows.shape[1] - 1 - POSE
    g0, g1, g2 = 0.0, 0.0, 0.0
    for row in range(POSE):
        e = motion[s0, row, 0] * known[0]
        if k > 0:
            for a in range(POSE):
                e += motion[s0, row, 1 + a] * known[1 + a]
        g0 += motion[s0, row, 4] * e
        g1 += motion[s0, row, 5] * e
        g2 += motion[s0, row, 6] * e
    for i in range(s0 + 1, s1):
        for r in range(chunks.row_start[i], chunks.row_start[i + 1]):
            e, slot = rows[r, 0] * known[0], chunks.slot[r]
            for q in range(wide):
                e += rows[r, 4 + q] * known[slot + q]
            g0 += rows[r, 1] * e
            g1 += rows[r, 2] * e
            g2 += rows[r, 3] * e
        h0, h1, h2 = 0.0, 0.0, 0.0
        for row in range(POSE):
            e = motion[i, row, 0] * known[0]
            g0 += motion[i, row, 1] * e
            g1 += motion[i, row, 2] * e
            g2 += motion[i, row, 3] * e
            h0 += motion[i, row, 4] * e
            h1 += motion[i, row, 5] * e
            h2 += motion[i, row, 6] * e
        c = chain[i]
        z0 = g0 / c[0]
        z1 = (g1 - c[1] * z0) / c[2]
        z2 = (g2 - c[3] * z0 - c[4] * z1) / c[5]
        step[i, 0], step[i, 1], step[i, 2] = z0, z1, z2
        g0 = h0 - (c[6] * z0 + c[9] * z1 + c[12] * z2)
        g1 = h1 - (c[7] * z0 + c[10] * z1 + c[13] * z2)
        g2 = h2 - (c[8] * z0 + c[11] * z1 + c[14] * z2)
    for i in range(s1 - 1, s0, -1):
        c, x, after = chain[i], step[i], step[i + 1]
        t0 = -x[0] - (c[6] * after[0] + c[7] * after[1] + c[8] * after[2])
        t1 = -x[1] - (c[9] * after[0] + c[10] * after[1] + c[11] * after[2])
        t2 = -x[2] - (c[12] * after[0] + c[13] * after[1] + c[14] * after[2])
        x[2] = t2 / c[5]
        x[1] = (t1 - c[4] * x[2]) / c[2]
        x[0] = (t0 - c[1] * x[1] - c[3] * x[2]) / c[0]
