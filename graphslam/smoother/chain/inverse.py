"""Parts of the system's inverse, taken from its factor without forming the rest.

Source: Takahashi, Fagan, Chin, 'Formation of a sparse bus impedance matrix' (1973), by fronts.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

import numpy as np
from numba import njit

from graphslam.smoother.chain.chunks import POSE, Chunks, Linear
from graphslam.smoother.chain.elimination import eliminate
from graphslam.smoother.chain.symbolic import Symbolic


@njit(cache=True)
def pose_marginals(  # type: ignore[no-untyped-def]
    symbolic: Symbolic, chunks: Chunks, linear: Linear, panel, chain, cov, with_first
):
    """Fills covariances of all poses, relative to the first one's change.

    Args:
        symbolic: of the chunks' system.
        chunks: of the chain.
        linear: what was factorised, without damping.
        panel: its factor.
        chain: the same of the poses inside chunks.
        cov: (N, 3, 3) filled with the poses' covariances.
        with_first: (N, 3, 3) filled with their covariances with variable 0, where chunks hold it;
            0 elsewhere.
    """
    fronts = len(symbolic.parent)
    path, at, top = np.empty(fronts, np.int64), np.zeros(fronts + 1, np.int64), 0
    Z = np.empty(_deepest(symbolic))
    widest = chunks.width.max() + linear.rows.shape[1]
    C, places = np.empty((widest + POSE, widest + POSE)), np.empty(widest + POSE, np.int64)
    M, B, P = np.empty((widest, widest)), np.empty((POSE, widest)), np.empty((POSE, POSE))
    longest = 1
    for k in range(len(chunks.bound) - 1):
        longest = max(longest, chunks.bound[k + 1] - chunks.bound[k])
    solved = np.zeros((longest, POSE, widest))
    cov[:], with_first[:] = 0.0, 0.0
    for s in range(fronts - 1, -1, -1):
        while top > 0 and path[top - 1] != symbolic.parent[s]:
            top -= 1
        size = symbolic.size[s]
        path[top], at[top + 1] = s, at[top] + size * size
        own = Z[at[top] : at[top + 1]].reshape((size, size))
        if top > 0:
            wide = symbolic.size[symbolic.parent[s]]
            _from_parent(symbolic, s, Z[at[top - 1] : at[top]].reshape((wide, wide)), own)
        top += 1
        _invert_front(symbolic, s, panel, own)
        for i in range(symbolic.clique_start[s], symbolic.clique_start[s + 1]):
            k = symbolic.clique[i]
            if chunks.bound[k + 1] > chunks.bound[k]:
                count = _gather(k, chunks, symbolic.clique_at, own, places, C)
                eliminate(k, chunks, linear, 0.0, M, B, P, chain, solved)
                _inside(k, chunks, C, count, solved, chain, cov, with_first)


@njit(cache=True)
def _deepest(symbolic):  # type: ignore[no-untyped-def]
    """Returns the largest storage that a front and all above it need."""
    fronts = len(symbolic.parent)
    above, deepest = np.zeros(fronts, np.int64), 0
    for s in range(fronts - 1, -1, -1):
        above[s] = symbolic.size[s] ** 2
        if symbolic.parent[s] >= 0:
            above[s] += above[symbolic.parent[s]]
        deepest = max(deepest, above[s])
    return deepest


@njit(cache=True)
def _from_parent(symbolic, s, parent, own):  # type: ignore[no-untyped-def]
    first, pivots = symbolic.scalar_start[s], symbolic.pivots[s]
    for i in range(pivots, symbolic.size[s]):
        row = parent[symbolic.relative[first + i]]
        for j in range(pivots, symbolic.size[s]):
            own[i, j] = row[symbolic.relative[first + j]]


@njit(cache=True)
def _invert_front(symbolic, s, panel, Z):  # type: ignore[no-untyped-def]
    """Completes the inverse of a front whose boundary's part is there; Z is filled on both sides.

    With the pivots' columns L of the factor, ``Z[:, p] = (1/L_pp - sum_i>p Z[:, i] L_ip) / L_pp``,
    from the last pivot to the first.
    """
    size = symbolic.size[s]
    for p in range(symbolic.pivots[s] - 1, -1, -1):
        at = symbolic.panel_start[s] + p * (size + 1)
        L = panel[at : at + size]
        for j in range(p + 1, size):
            value, row = 0.0, Z[j]
            for i in range(p + 1, size):
                value -= row[i] * L[i]
            value /= L[p]
            Z[j, p], Z[p, j] = value, value
        value = 1.0 / L[p]
        for i in range(p + 1, size):
            value -= Z[p, i] * L[i]
        Z[p, p] = value / L[p]


@njit(cache=True)
def _gather(k, chunks, clique_at, Z, places, C):  # type: ignore[no-untyped-def]
    """Fills C with the covariance of a chunk's variables, the right-hand side's place left out."""
    count = 0
    for m in range(chunks.member_start[k], chunks.member_start[k + 1]):
        for q in range(chunks.dims[chunks.member[m]]):
            places[count] = clique_at[m] + q
            count += 1
    for i in range(count):
        for j in range(count):
            C[i, j] = Z[places[i], places[j]]
    return count


@njit(cache=True)
def _inside(k, chunks, C, count, solved, chain, cov, with_first):  # type: ignore[no-untyped-def]
    """Fills covariances of the poses of a chunk but its left separator, from right to left."""
    s0, s1, kept = chunks.bound[k], chunks.bound[k + 1], count - POSE
    holds_first = -1
    fill = 0
    for m in range(chunks.member_start[k], chunks.member_start[k + 1]):
        if chunks.member[m] == 0:
            holds_first = fill
        fill += chunks.dims[chunks.member[m]]
    D, new, K = np.empty((POSE, kept)), np.empty((POSE, kept)), np.empty((POSE, POSE))
    X, after, both = np.empty((POSE, kept)), np.empty((POSE, POSE)), np.empty((POSE, POSE))
    for a in range(POSE):
        for j in range(kept):
            D[a, j] = C[kept + a, j]
        for b in range(POSE):
            after[a, b] = C[kept + a, kept + b]
    for i in range(s1, s0, -1):
        if i < s1:
            c = chain[i]
            for b in range(POSE):
                K[2, b] = c[12 + b] / c[5]
                K[1, b] = (c[9 + b] - c[4] * K[2, b]) / c[2]
                K[0, b] = (c[6 + b] - c[1] * K[1, b] - c[3] * K[2, b]) / c[0]
            x = solved[i - s0 - 1]
            for j in range(kept):
                X[2, j] = x[2, 1 + j] / c[5]
                X[1, j] = (x[1, 1 + j] - c[4] * X[2, j]) / c[2]
                X[0, j] = (x[0, 1 + j] - c[1] * X[1, j] - c[3] * X[2, j]) / c[0]
            for a in range(POSE):
                for b in range(POSE):  # with the next pose
                    value = 0.0
                    for n in range(POSE):
                        value -= K[a, n] * after[n, b]
                    for j in range(kept):
                        value -= X[a, j] * D[b, j]
                    both[a, b] = value
                for j in range(kept):
                    new[a, j] = -K[a, 0] * D[0, j] - K[a, 1] * D[1, j] - K[a, 2] * D[2, j]
                for n in range(kept):
                    value = X[a, n]
                    for j in range(kept):
                        new[a, j] -= value * C[n, j]
            _own(c, K, X, both, new, kept, after)
            D, new = new, D
        for a in range(POSE):
            for b in range(POSE):
                cov[i, a, b] = after[a, b]
                if holds_first >= 0:
                    with_first[i, a, b] = D[a, holds_first + b]


@njit(cache=True)
def _own(c, K, X, both, new, kept, out):  # type: ignore[no-untyped-def]
    """Fills the covariance of a pose from its factor and its covariances with what it leans on."""
    i0, i1, i2 = 1.0 / c[0], 1.0 / c[2], 1.0 / c[5]
    i10, i21 = -c[1] * i0 * i1, -c[4] * i1 * i2
    i20 = -(c[3] * i0 + c[4] * i10) * i2
    out[0, 0] = i0 * i0 + i10 * i10 + i20 * i20
    out[1, 0] = i1 * i10 + i21 * i20
    out[1, 1] = i1 * i1 + i21 * i21
    out[2, 0], out[2, 1], out[2, 2] = i2 * i20, i2 * i21, i2 * i2
    for a in range(POSE):
        for b in range(a + 1):
            value = out[a, b]
            for n in range(POSE):
                value -= both[a, n] * K[b, n]
            for j in range(kept):
                value -= new[a, j] * X[b, j]
            out[a, b], out[b, a] = value, value


@njit(cache=True)
def columns(symbolic: Symbolic, panel, x, needed):  # type: ignore[no-untyped-def]
    """Replaces ``x`` (n, m) by the inverse times ``x``, in the fronts ``needed`` (S,) only.

    A front that holds a non-zero of ``x``, or is asked for, needs all above it too.
    """
    solve_fronts(symbolic, panel, x, np.flatnonzero(needed))


@njit(cache=True)
def solve_fronts(symbolic, panel, x, chosen):  # type: ignore[no-untyped-def]
    """Replaces ``x`` (n, m) by the inverse times ``x``, in chosen fronts, in order, only."""
    wide = x.shape[1]
    for s in chosen:
        size, first = symbolic.size[s], symbolic.scalar_start[s]
        for p in range(symbolic.pivots[s]):
            at = symbolic.panel_start[s] + p * (size + 1)
            source, unit = x[symbolic.scalar[first + p]], 1.0 / panel[at + p]
            for c in range(wide):
                source[c] *= unit
            for i in range(p + 1, size):
                row, value = x[symbolic.scalar[first + i]], panel[at + i]
                for c in range(wide):
                    row[c] -= value * source[c]
    for s in chosen[::-1]:
        size, first = symbolic.size[s], symbolic.scalar_start[s]
        for p in range(symbolic.pivots[s] - 1, -1, -1):
            at = symbolic.panel_start[s] + p * (size + 1)
            target, unit = x[symbolic.scalar[first + p]], 1.0 / panel[at + p]
            for i in range(p + 1, size):
                row, value = x[symbolic.scalar[first + i]], panel[at + i]
                for c in range(wide):
                    target[c] -= value * row[c]
            for c in range(wide):
                target[c] *= unit


@njit(cache=True)
def pivots_of(symbolic: Symbolic, panel):  # type: ignore[no-untyped-def]
    """Returns the diagonal (n,) of the factor."""
    out, count = np.empty(symbolic.pivots.sum()), 0
    for s in range(len(symbolic.parent)):
        for p in range(symbolic.pivots[s]):
            out[count] = panel[symbolic.panel_start[s] + p * (symbolic.size[s] + 1) + p]
            count += 1
    return out
