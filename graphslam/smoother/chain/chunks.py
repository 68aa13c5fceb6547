"""Chunks of the chain: stretches of poses between two separators.

The poses inside a chunk are eliminated first. What is left couples the chunk's separators and the
landmarks seen from it. Their scalars stand in *local order*: right-hand side, left separator
(but in the first chunk), the landmarks in order of first sight; the right separator is apart.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from graphslam.geometry import Array
from graphslam.measurements import IntArray

SmallIntArray = NDArray[np.int32]

POSE = 3


class Chunks(NamedTuple):
    """How the chain is cut, and which variables each chunk touches.

    Attributes:
        bound: (C + 1,) nodes that separate chunks; the first node is no variable of its own.
        member_start: (C + 1,) where each chunk's variables start in ``member``.
        member: variables in local order, the right separator last.
        width: (C,) scalars in local order, right-hand side included, right separator not.
        row_start: (N + 1,) where each node's rows start.
        slot: (R,) for each row, the local place of the landmark that it involves.
        dims: (n,) scalars of each variable.
    """

    bound: IntArray
    member_start: IntArray
    member: IntArray
    width: IntArray
    row_start: IntArray
    slot: SmallIntArray
    dims: IntArray


class Linear(NamedTuple):
    """All whitened residuals and their Jacobians at one point, one scalar residual a row.

    Attributes:
        rows: (R, 4 + l) residual, derivatives by the pose (3) and by the landmark (l).
        motion: (N - 1, 3, 7) for each increment three rows: residual, derivatives by the pose
            before (3) and after (3).
    """

    rows: Array
    motion: Array


def cut(
    row_start: IntArray, row_var: SmallIntArray, dims: IntArray, length: int, everywhere: int
) -> Chunks:
    """Returns the chunks of a chain.

    Args:
        row_start: (N + 1,) where each node's rows start.
        row_var: (R,) variable, beside the pose, of each row.
        dims: (n,) scalars of each variable; variable k is the k-th separator, for k up to the
            number of chunks.
        length: poses from separator to separator.
        everywhere: variable that every chunk shall hold, or -1.
    """
    nodes = len(row_start) - 1
    bound = np.append(np.arange(0, max(nodes - 1, 1), length), nodes - 1).astype(np.int64)
    member_start, member, width, slot = _members(bound, row_start, row_var, dims, everywhere)
    return Chunks(bound, member_start, member, width, row_start, slot, dims)


@njit(cache=True)
def _members(bound, row_start, row_var, dims, everywhere):  # type: ignore[no-untyped-def]
    chunks = len(bound) - 1
    member_start, width = np.zeros(chunks + 1, np.int64), np.zeros(chunks, np.int64)
    member = np.empty(len(row_var) + 3 * chunks, np.int64)
    slot = np.empty(len(row_var), np.int32)
    last, place = np.full(len(dims), -1, np.int64), np.zeros(len(dims), np.int64)
    used = 0
    for k in range(chunks):
        member_start[k] = used
        wide = 1
        if k > 0:
            member[used] = k
            used += 1
            wide += dims[k]
        if everywhere >= 0:
            member[used], last[everywhere], place[everywhere] = everywhere, k, wide
            used += 1
            wide += dims[everywhere]
        stop = bound[k + 1] if k + 1 < chunks else bound[k + 1] + 1
        for r in range(row_start[bound[k]], row_start[stop]):
            v = row_var[r]
            if last[v] != k:
                member[used], last[v], place[v] = v, k, wide
                used += 1
                wide += dims[v]
            slot[r] = place[v]
        if bound[k + 1] > bound[k]:
            member[used] = k + 1
            used += 1
        width[k] = wide
    member_start[chunks] = used
    return member_start, member[:used].copy(), width, slot


@njit(cache=True)
def diagonal(chunks, row_var, var_at, linear, prior, out):  # type: ignore[no-untyped-def]
    """Fills ``out`` (n,) with the information of every scalar alone, all others known."""
    rows, motion, bound = linear.rows, linear.motion, chunks.bound
    out[:] = 0.0
    for r in range(len(row_var)):
        v = row_var[r]
        for q in range(chunks.dims[v]):
            out[var_at[v] + q] += rows[r, 4 + q] ** 2
    for a in range(POSE):
        out[var_at[0] + a] += prior[1 + a, 1 + a]
        for k in range(1, len(bound) if bound[1] > 0 else 0):
            i, at = bound[k], var_at[k] + a
            for r in range(chunks.row_start[i], chunks.row_start[i + 1]):
                out[at] += rows[r, 1 + a] ** 2
            for row in range(POSE):
                out[at] += motion[i - 1, row, 4 + a] ** 2
                if i < len(motion):
                    out[at] += motion[i, row, 1 + a] ** 2
