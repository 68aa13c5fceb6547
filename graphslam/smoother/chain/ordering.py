"""The order of elimination: approximate minimum degree on a hypergraph.

The system is given by its cliques (one a chunk of the chain); no list of neighbours is ever made.
Eliminating a variable joins the cliques that hold it into one, which is all the bookkeeping that a
symbolic factorisation needs.

Source: Amestoy, Davis, Duff, 'An approximate minimum degree ordering algorithm' (1996): quotient
graph, approximate external degree, element absorption, mass elimination; variables in very many
cliques (*dense* ones: the few lines seen all along the way) go last, together. Looking through all
their cliques at each elimination would take time with the square of the way.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from graphslam.measurements import IntArray

DENSE, DENSE_LEAST = 1.0, 16.0
"""A variable is dense in more cliques than the first times the root of their number, at least the
second: there are few of them, so that one front for all costs little. At 4 instead of 1, ordering
200 lines along 200,000 poses takes 0.09 s instead of 0.01 s.
"""


class Groups(NamedTuple):
    """Variables in the order of elimination, and what they leave coupled.

    Attributes:
        start: (G + 1,) where each group starts in ``order``; a group is eliminated together.
        order: (n,) variables.
        bound_start: (G + 1,) where each group's part of ``bound`` starts.
        bound: variables, all of later groups, that are coupled once a group is gone.
    """

    start: IntArray
    order: IntArray
    bound_start: IntArray
    bound: IntArray


class Quotient(NamedTuple):
    """What is left of the system while it is eliminated.

    Given cliques are followed by those made on the way, one a group.

    Attributes:
        first: where each clique's variables start in the pool.
        middle: where the dense ones start among them.
        last: where they end.
        weight: scalars of each clique.
        alive: whether it is not yet part of another one.
        seen: the last group whose variables were looked up in it.
        outside: scalars of it outside that group's clique.
        of_start: (n + 1,) where each variable's cliques start in ``of``.
        of_count: (n,) how many they are.
        of: cliques of each variable.
        degree: (n,) bound on the scalars coupled to each variable.
        head: first variable of each degree, among those of the stage at hand.
        after: (n,) next variable of the same degree.
        before: (n,) the one before it.
        gone: (n,) whether a variable is eliminated.
        dense: (n,) whether it is in so many cliques that it goes last; those are not kept up to
            date in ``of``.
    """

    first: IntArray
    middle: IntArray
    last: IntArray
    weight: IntArray
    alive: NDArray[np.bool_]
    seen: IntArray
    outside: IntArray
    of_start: IntArray
    of_count: IntArray
    of: IntArray
    degree: IntArray
    head: IntArray
    after: IntArray
    before: IntArray
    gone: NDArray[np.bool_]
    dense: NDArray[np.bool_]


def minimum_degree(start: IntArray, member: IntArray, dims: IntArray, stage: IntArray) -> Groups:
    """Returns an order of elimination that leaves little fill.

    Args:
        start: (E + 1,) where each clique's variables start in ``member``.
        member: variables of each clique, each once.
        dims: (n,) scalars of each variable.
        stage: (n,) variables of a lower stage go before those of a higher one, unless they cost
            nothing. Dense ones go last, whatever their stage.
    """
    return Groups(*_minimum_degree(start, member, dims, stage))


@njit(cache=True)
def _minimum_degree(start, member, dims, stage):  # type: ignore[no-untyped-def]
    n, cliques = len(dims), len(start) - 1
    pool, used = np.empty(2 * len(member) + 16, np.int64), len(member)
    q = _quotient(start, member, dims, pool)
    group_start, order = np.zeros(n + 1, np.int64), np.zeros(n, np.int64)
    bound_start, bound_stop = np.zeros(n, np.int64), np.zeros(n, np.int64)
    stamp, left = np.full(n, -1, np.int64), dims.sum()
    groups, done, lowest, now = 0, 0, len(q.head), -1
    sparse = n - np.count_nonzero(q.dense)
    while done < sparse:
        while lowest < len(q.head) and q.head[lowest] < 0:
            lowest += 1
        if lowest == len(q.head):
            now, lowest = now + 1, 0
            for v in range(n):
                if stage[v] == now and not q.gone[v] and not q.dense[v]:
                    _insert(q, v)
            continue
        p, new = q.head[lowest], cliques + groups
        _remove(q, p)
        order[done], q.gone[p] = p, True
        done += 1
        left -= dims[p]
        pool = _with_room(q, p, pool, used)
        middle, end = _join(q, p, new, pool, used, stamp, dims)
        _measure(q, new, pool, used, middle, stamp, dims)
        keep = used
        for i in range(used, middle):
            v = pool[i]
            if stage[v] == now:
                _remove(q, v)
            beyond = _clean(q, v, new)
            if beyond == 0:  # coupled to nothing outside: goes with the pivot
                order[done], q.gone[v] = v, True
                done += 1
                left -= dims[v]
                q.weight[new] -= dims[v]
            else:
                pool[keep] = v
                keep += 1
                q.degree[v] = min(q.degree[v], beyond)
        for i in range(used, keep):
            v = pool[i]
            q.degree[v] = min(q.degree[v] + q.weight[new] - dims[v], left - dims[v])
            if stage[v] == now:
                lowest = min(lowest, q.degree[v])
                _insert(q, v)
        q.first[new], q.middle[new], q.alive[new] = used, keep, True
        for i in range(middle, end):
            pool[keep] = pool[i]
            keep += 1
        q.last[new] = keep
        bound_start[groups], bound_stop[groups] = used, keep
        used = keep
        groups += 1
        group_start[groups] = done
    if sparse < n:
        order[sparse:] = np.flatnonzero(q.dense)
        bound_start[groups] = bound_stop[groups] = used
        groups += 1
        group_start[groups] = n
    return _packed(groups, group_start, order, bound_start, bound_stop, pool)


@njit(cache=True)
def _quotient(start, member, dims, pool):  # type: ignore[no-untyped-def]
    """Returns the system before any elimination, its cliques written to the pool, dense last."""
    n, cliques = len(dims), len(start) - 1
    of_start, of, of_count = _cliques_of(start, member, n)
    room = cliques + n
    first, middle, last = (
        np.zeros(room, np.int64),
        np.zeros(room, np.int64),
        np.zeros(room, np.int64),
    )
    weight, alive = np.zeros(room, np.int64), np.zeros(room, np.bool_)
    dense = of_count > max(DENSE_LEAST, DENSE * np.sqrt(cliques))
    for e in range(cliques):
        first[e], last[e], alive[e] = start[e], start[e + 1], True
        fill = start[e]
        for wanted in (False, True):
            for at in range(start[e], start[e + 1]):
                if dense[member[at]] == wanted:
                    pool[fill] = member[at]
                    fill += 1
                    weight[e] += dims[member[at]]
            if not wanted:
                middle[e] = fill
    degree, total = np.zeros(n, np.int64), dims.sum()
    for v in range(n):
        for at in range(of_start[v], of_start[v] + of_count[v]):
            degree[v] += weight[of[at]] - dims[v]
        degree[v] = min(degree[v], total)
    return Quotient(
        first,
        middle,
        last,
        weight,
        alive,
        np.full(room, -1, np.int64),
        np.zeros(room, np.int64),
        of_start,
        of_count,
        of,
        degree,
        np.full(total + 1, -1, np.int64),
        np.full(n, -1, np.int64),
        np.full(n, -1, np.int64),
        np.zeros(n, np.bool_),
        dense,
    )


@njit(cache=True)
def _with_room(q, p, pool, used):  # type: ignore[no-untyped-def]
    """Returns the pool, or a larger copy, with room for the clique that ``p`` leaves."""
    room = used
    for at in range(q.of_start[p], q.of_start[p] + q.of_count[p]):
        room += q.last[q.of[at]] - q.first[q.of[at]]
    if room <= len(pool):
        return pool
    grown = np.empty(2 * room, np.int64)
    grown[:used] = pool[:used]
    return grown


@njit(cache=True)
def _join(q, p, new, pool, used, stamp, dims):  # type: ignore[no-untyped-def]
    """Writes all that share a clique with ``p`` to the pool, as clique ``new``, dense ones last.

    Returns where the dense ones start, and its end.
    """
    end, middle, stamp[p] = used, used, new
    for dense in (False, True):
        middle = end
        for at in range(q.of_start[p], q.of_start[p] + q.of_count[p]):
            e = q.of[at]
            q.alive[e] = False
            a, b = (q.middle[e], q.last[e]) if dense else (q.first[e], q.middle[e])
            for i in range(a, b):
                v = pool[i]
                if stamp[v] != new:
                    stamp[v] = new
                    pool[end] = v
                    end += 1
                    q.weight[new] += dims[v]
    return middle, end


@njit(cache=True)
def _measure(q, new, pool, used, end, stamp, dims):  # type: ignore[no-untyped-def]
    """Fills how much of every clique that touches the new one lies outside it."""
    for i in range(used, end):
        v = pool[i]
        kept = q.of_start[v]
        for at in range(q.of_start[v], q.of_start[v] + q.of_count[v]):
            e = q.of[at]
            if q.alive[e]:
                if q.seen[e] != new:
                    q.seen[e], q.outside[e] = new, q.weight[e]
                    for k in range(q.middle[e], q.last[e]):
                        if stamp[pool[k]] == new:
                            q.outside[e] -= dims[pool[k]]
                q.outside[e] -= dims[v]
                q.of[kept] = e
                kept += 1
        q.of_count[v] = kept - q.of_start[v]


@njit(cache=True)
def _clean(q, v, new):  # type: ignore[no-untyped-def]
    """Gives ``v`` the new clique for those inside it; returns what it couples to beyond."""
    kept, beyond = q.of_start[v], 0
    for at in range(q.of_start[v], q.of_start[v] + q.of_count[v]):
        e = q.of[at]
        if q.outside[e] > 0:
            beyond += q.outside[e]
            q.of[kept] = e
            kept += 1
        else:
            q.alive[e] = False
    q.of[kept] = new
    q.of_count[v] = kept + 1 - q.of_start[v]
    return beyond


@njit(cache=True)
def _packed(groups, group_start, order, bound_start, bound_stop, pool):  # type: ignore[no-untyped-def]
    starts = np.zeros(groups + 1, np.int64)
    for g in range(groups):
        starts[g + 1] = starts[g] + bound_stop[g] - bound_start[g]
    bound = np.empty(starts[groups], np.int64)
    for g in range(groups):
        for i in range(starts[g + 1] - starts[g]):
            bound[starts[g] + i] = pool[bound_start[g] + i]
    return group_start[: groups + 1].copy(), order, starts, bound


@njit(cache=True)
def _cliques_of(start, member, n):  # type: ignore[no-untyped-def]
    """Returns for each variable where its cliques start, the cliques, and their count."""
    count = np.zeros(n, np.int64)
    for v in member:
        count[v] += 1
    of_start = np.zeros(n + 1, np.int64)
    for v in range(n):
        of_start[v + 1] = of_start[v] + max(count[v], 1)
    of = np.zeros(of_start[n], np.int64)
    fill = of_start[:-1].copy()
    for e in range(len(start) - 1):
        for at in range(start[e], start[e + 1]):
            of[fill[member[at]]] = e
            fill[member[at]] += 1
    return of_start, of, count


@njit(cache=True)
def _insert(q, v):  # type: ignore[no-untyped-def]
    degree = q.degree[v]
    q.after[v], q.before[v] = q.head[degree], -1
    if q.head[degree] >= 0:
        q.before[q.head[degree]] = v
    q.head[degree] = v


@njit(cache=True)
def _remove(q, v):  # type: ignore[no-untyped-def]
    if q.before[v] >= 0:
        q.after[q.before[v]] = q.after[v]
    else:
        q.head[q.degree[v]] = q.after[v]
    if q.after[v] >= 0:
        q.before[q.after[v]] = q.before[v]
