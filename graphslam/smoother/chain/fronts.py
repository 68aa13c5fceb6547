"""Numerical factorisation of the whole system, front by front, and what is solved with it.

Source: Duff and Reid, 'The multifrontal solution of indefinite sparse symmetric linear equations'
(1983); selected inverse as Takahashi, Fagan, Chin (1973), by fronts.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

from graphslam.smoother.chain.chunks import POSE, Chunks, Linear
from graphslam.smoother.chain.elimination import back_substitute, eliminate
from graphslam.smoother.chain.symbolic import Symbolic

SINGULAR = 1e-13
"""A pivot below this part of the diagonal that it came from counts as zero."""
BLOCK, FEW, STRIP = 32, 4, 512
"""Pivots eliminated before the rest of a front is touched; at a time; and columns of a strip."""


@njit(cache=True)
def factorise(  # type: ignore[no-untyped-def]
    symbolic: Symbolic, chunks: Chunks, linear: Linear, prior, scale, damping, panel, chain
):
    """Factorises the system; returns the scalar whose pivot vanished, or -1, and the cost there.

    Args:
        symbolic: of the chunks' system.
        chunks: of the chain.
        linear: residuals and Jacobians.
        prior: (4, 4) information of variable 0 beyond the rows', right-hand side first.
        scale: (n,) diagonal of the system's information, as by `linearise.diagonal`.
        damping: added to the diagonal.
        panel: filled with the factor: of each front its pivots' rows, right-hand side last.
        chain: (N, 15) filled as by `chunks.eliminate`.

    Returns:
        The scalar, and the sum of the squared rows at the linear system's minimum.
    """
    fronts = len(symbolic.parent)
    largest, widest = symbolic.size.max() + 1, chunks.width.max() + linear.rows.shape[1]
    F, T, own = np.empty((largest, largest)), np.empty((BLOCK, largest)), np.empty(largest)
    stack, top = np.empty(symbolic.stack), 0
    M, B, P = np.empty((widest, widest)), np.empty((POSE, widest)), np.empty((POSE, POSE))
    at = np.empty(widest + POSE, np.int64)
    least, nothing = 0.0, np.empty((0, POSE, 0))
    for s in range(fronts):
        size, pivots = symbolic.size[s], symbolic.pivots[s]
        for i in range(size + 1):
            for j in range(i + 1):
                F[i, j] = 0.0
        for i in range(symbolic.child_start[s + 1] - 1, symbolic.child_start[s] - 1, -1):
            top = _take_child(symbolic, symbolic.child[i], F, size, stack, top)
        for i in range(symbolic.clique_start[s], symbolic.clique_start[s + 1]):
            k = symbolic.clique[i]
            ended = eliminate(k, chunks, linear, damping, M, B, P, chain, nothing)
            _add_chunk(k, chunks, symbolic.clique_at, ended, M, B, P, F, size, at)
        if s == symbolic.var_front[0]:
            first = _place_of(symbolic, s, 0)
            for a in range(POSE):
                F[size, first + a] += prior[1 + a, 0]
                for b in range(a + 1):
                    F[first + a, first + b] += prior[1 + a, 1 + b]
            F[size, size] += prior[0, 0]
        for i in range(pivots):
            F[i, i] += damping
            own[i] = scale[symbolic.scalar[symbolic.scalar_start[s] + i]]
        bad = _partial_cholesky(F, pivots, size + 1, own, T)
        if bad >= 0:
            return symbolic.scalar[symbolic.scalar_start[s] + bad], least
        out = symbolic.panel_start[s]
        for p in range(pivots):
            for i in range(size + 1):
                panel[out + i] = F[i, p] if i >= p else 0.0
            out += size + 1
        if symbolic.parent[s] >= 0:
            for i in range(pivots, size + 1):
                for j in range(pivots, i + 1):
                    stack[top + j - pivots] = F[i, j]
                top += size + 1 - pivots
        else:
            least += F[size, size]
    return -1, least


@njit(cache=True)
def _place_of(symbolic, s, scalar):  # type: ignore[no-untyped-def]
    at = symbolic.scalar_start[s]
    while symbolic.scalar[at] != scalar:
        at += 1
    return at - symbolic.scalar_start[s]


@njit(cache=True)
def _take_child(symbolic, c, F, size, stack, top):  # type: ignore[no-untyped-def]
    """Adds a child's update, the last on the stack, to its parent's front."""
    first = symbolic.scalar_start[c] + symbolic.pivots[c]
    outer = symbolic.size[c] - symbolic.pivots[c]
    top -= (outer + 1) ** 2
    for i in range(outer + 1):
        row = symbolic.relative[first + i] if i < outer else size
        here = top + i * (outer + 1)
        for j in range(min(i + 1, outer)):  # boundaries are sorted: places rise
            F[row, symbolic.relative[first + j]] += stack[here + j]
        if i == outer:
            F[size, size] += stack[here + outer]
    return top


@njit(cache=True)
def _local_places(k, chunks, clique_at, size, at):  # type: ignore[no-untyped-def]
    """Fills ``at``: places in the front of a chunk's scalars, the right separator's last."""
    at[0], fill = size, 1
    for m in range(chunks.member_start[k], chunks.member_start[k + 1]):
        for q in range(chunks.dims[chunks.member[m]]):
            at[fill] = clique_at[m] + q
            fill += 1
    return fill


@njit(cache=True)
def _add_chunk(k, chunks, clique_at, ended, M, B, P, F, size, at):  # type: ignore[no-untyped-def]
    _local_places(k, chunks, clique_at, size, at)
    width = chunks.width[k]
    for i in range(width):
        for j in range(i + 1):
            F[max(at[i], at[j]), min(at[i], at[j])] += M[i, j]
    if ended:
        for a in range(POSE):
            row = at[width + a]
            for j in range(width):
                F[max(row, at[j]), min(row, at[j])] += B[a, j]
            for b in range(a + 1):
                F[row, at[width + b]] += P[a, b]


@njit(cache=True)
def _partial_cholesky(F, pivots, size, scale, T):  # type: ignore[no-untyped-def]
    """Eliminates the first ``pivots`` of a lower matrix in place; returns a zero pivot or -1.

    A pivot is zero when little is left of what it was made from, ``scale``. Blocks in blocks: what
    is far from the pivots is touched once for `BLOCK` of them.
    """
    for begin in range(0, pivots, BLOCK):
        stop = min(begin + BLOCK, pivots)
        for first in range(begin, stop, FEW):
            last = min(first + FEW, stop)
            for p in range(first, last):
                for i in range(first, p):
                    value = F[p, i]
                    for q in range(first, i):
                        value -= F[p, q] * F[i, q]
                    F[p, i] = value / F[i, i]
                    F[p, p] -= F[p, i] * F[p, i]
                if not F[p, p] > SINGULAR * scale[p]:
                    return p
                F[p, p] = math.sqrt(F[p, p])
            for i in range(last, size):
                for p in range(first, last):
                    value = F[i, p]
                    for q in range(first, p):
                        value -= F[i, q] * F[p, q]
                    F[i, p] = value / F[p, p]
            if last < stop:
                _update(F, first, last, last, stop, size, T)
        _update(F, begin, stop, stop, size, size, T)
    return -1


@njit(cache=True)
def _update(F, first, last, left, right, size, T):  # type: ignore[no-untyped-def]
    """Subtracts the products of the columns ``first:last`` from the columns ``left:right``.

    Lower part only, two rows and four products at a time, in strips that stay in the cache.
    """
    for j in range(left, right):
        for p in range(last - first):
            T[p, j] = F[j, first + p]
    whole = first + (last - first) // FEW * FEW
    for strip in range(left, right, STRIP):
        for i in range(strip, size - 1, 2):
            stop = min(i + 1, right, strip + STRIP)
            ends = stop == i + 1 and i + 1 < min(right, strip + STRIP)
            a, b = F[i, strip:stop], F[i + 1, strip:stop]
            for p in range(first, whole, FEW):
                a0, a1, a2, a3 = F[i, p], F[i, p + 1], F[i, p + 2], F[i, p + 3]
                b0, b1, b2, b3 = F[i + 1, p], F[i + 1, p + 1], F[i + 1, p + 2], F[i + 1, p + 3]
                t0, t1 = T[p - first, strip:stop], T[p + 1 - first, strip:stop]
                t2, t3 = T[p + 2 - first, strip:stop], T[p + 3 - first, strip:stop]
                for j in range(len(a)):
                    x0, x1, x2, x3 = t0[j], t1[j], t2[j], t3[j]
                    a[j] -= a0 * x0 + a1 * x1 + a2 * x2 + a3 * x3
                    b[j] -= b0 * x0 + b1 * x1 + b2 * x2 + b3 * x3
            for p in range(whole, last):
                a0, b0, t0 = F[i, p], F[i + 1, p], T[p - first, strip:stop]
                for j in range(len(a)):
                    a[j] -= a0 * t0[j]
                    b[j] -= b0 * t0[j]
            if ends:  # the second row's own diagonal
                for p in range(first, last):
                    F[i + 1, i + 1] -= F[i + 1, p] * F[i + 1, p]
        if (size - strip) % 2:
            i, stop = size - 1, min(size, right, strip + STRIP)
            for p in range(first, last):
                value = F[i, p]
                for j in range(strip, stop):
                    F[i, j] -= value * T[p - first, j]


@njit(cache=True)
def solve(symbolic: Symbolic, panel, x):  # type: ignore[no-untyped-def]
    """Fills ``x`` with the minimum of the system that was factorised with its right-hand side."""
    for s in range(len(symbolic.parent) - 1, -1, -1):
        size, pivots, first = symbolic.size[s], symbolic.pivots[s], symbolic.scalar_start[s]
        for p in range(pivots - 1, -1, -1):
            row = symbolic.panel_start[s] + p * (size + 1)
            value = -panel[row + size]
            for i in range(p + 1, size):
                value -= panel[row + i] * x[symbolic.scalar[first + i]]
            x[symbolic.scalar[first + p]] = value / panel[row + p]


@njit(cache=True)
def solve_chain(chunks: Chunks, linear: Linear, chain, x, var_at, step):  # type: ignore[no-untyped-def]
    """Fills ``step`` (N, 3), the poses' part of a solution ``x``, relative to the first pose's."""
    known = np.zeros(chunks.width.max() + linear.rows.shape[1])
    known[0], step[0] = 1.0, 0.0
    for k in range(len(chunks.bound) - 1):
        solve_chunk(k, chunks, linear, chain, x, var_at, known, step)


@njit(cache=True)
def solve_chunk(k, chunks: Chunks, linear: Linear, chain, x, var_at, known, step):  # type: ignore[no-untyped-def]
    """Fills ``step`` (N, 3) of the poses of chunk ``k`` but its left separator.

    ``known[0]`` is 1 for the system's own right-hand side, 0 where the poses inside have none; all
    else in ``known`` is filled.
    """
    fill, stop = 1, chunks.member_start[k + 1]
    ends = chunks.bound[k + 1] > chunks.bound[k]
    for m in range(chunks.member_start[k], stop - 1 if ends else stop):
        v = chunks.member[m]
        for q in range(chunks.dims[v]):
            known[fill] = x[var_at[v] + q]
            fill += 1
    if ends:
        for a in range(POSE):
            step[chunks.bound[k + 1], a] = x[var_at[k + 1] + a]
        back_substitute(k, chunks, linear, known, chain, step)
