"""Covariances of chosen poses with chosen landmarks, one landmark at a time."""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

import numpy as np
from numba import njit

from graphslam.smoother.chain.chunks import POSE, Chunks, Linear
from graphslam.smoother.chain.fronts import solve_chunk
from graphslam.smoother.chain.inverse import solve_fronts
from graphslam.smoother.chain.symbolic import Symbolic


@njit(cache=True)
def pair_columns(  # type: ignore[no-untyped-def]
    symbolic: Symbolic, chunks: Chunks, linear: Linear, panel, chain, pairs, column, own, with_first
):
    """Fills covariances of landmarks with poses, all beyond the first pose's change.

    Args:
        symbolic: of the chunks' system.
        chunks: of the chain.
        linear: what was factorised, without damping.
        panel: its factor.
        chain: the same of the poses inside chunks.
        pairs: nodes (k,), the landmarks' variables (k,) and numbers (k,), ordered by landmark, then
            by node.
        column: (k, 3, l) filled with the poses' covariances with the landmarks.
        own: (k, l, l) filled with the landmarks' own.
        with_first: (k, 3, l) filled with those of the first pose's change with the landmarks.
    """
    node, variable, landmark = pairs
    bound, var_at = chunks.bound, symbolic.var_at
    wide, fronts = own.shape[1], len(symbolic.parent)
    mark = np.full(fronts, -1, np.int64)
    needed = np.empty(fronts, np.int64)
    x = np.empty((symbolic.scalar.max() + 1, wide))
    known = np.zeros(chunks.width.max() + linear.rows.shape[1])
    step = np.zeros((len(chain), POSE))
    begin = 0
    while begin < len(node):
        end, v = begin, variable[begin]
        while end < len(node) and landmark[end] == landmark[begin]:
            end += 1
        count = _mark_above(symbolic, symbolic.var_front[0], begin, mark, needed, 0)
        count = _mark_above(symbolic, symbolic.var_front[v], begin, mark, needed, count)
        last = -1
        for n in range(begin, end):
            k = _chunk_of(bound, node[n])
            if k != last:
                for i in range(chunks.member_start[k], chunks.member_start[k + 1]):
                    front = symbolic.var_front[chunks.member[i]]
                    count = _mark_above(symbolic, front, begin, mark, needed, count)
                last = k
        chosen, dim = np.sort(needed[:count]), chunks.dims[v]
        for s in chosen:
            for p in range(symbolic.scalar_start[s], symbolic.scalar_start[s + 1]):
                x[symbolic.scalar[p]] = 0.0
        for q in range(dim):
            x[var_at[v] + q, q] = 1.0
        solve_fronts(symbolic, panel, x, chosen)
        for q in range(dim):
            last = -1
            for n in range(begin, end):
                k = _chunk_of(bound, node[n])
                if k != last:
                    solve_chunk(k, chunks, linear, chain, x[:, q], var_at, known, step)
                    last = k
                for a in range(POSE):
                    column[n, a, q] = step[node[n], a]
                    with_first[n, a, q] = x[var_at[0] + a, q]
                for b in range(dim):
                    own[n, b, q] = x[var_at[v] + b, q]
        begin = end


@njit(cache=True)
def _mark_above(symbolic, front, name, mark, needed, count):  # type: ignore[no-untyped-def]
    """Adds a front and all above it to ``needed``, under a name; returns how many are there."""
    while front >= 0 and mark[front] != name:
        mark[front] = name
        needed[count] = front
        count += 1
        front = symbolic.parent[front]
    return count


@njit(cache=True)
def _chunk_of(bound, node):  # type: ignore[no-untyped-def]
    """Returns the chunk that holds a node, its left separator excluded."""
    return min(max(np.searchsorted(bound, node) - 1, 0), len(bound) - 2)
