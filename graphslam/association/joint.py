"""Joint compatibility: the sightings of a node matched together, correlations and all.

One by one, two parallel lines may each fit two landmarks; together they fit only in one order, and
a pose error moves all of them at once.

Source: Neira and Tardos, Data association in stochastic mapping using the joint compatibility
test, 2001.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from graphslam.arrays import AnyArray
from graphslam.association.distances import gate_for
from graphslam.geometry import Array
from graphslam.measurements import IntArray

MOST_HYPOTHESES = 20_000
"""Partial matchings that are looked at for one node; the best one so far is taken then."""


def jcbb(
    row: IntArray,
    landmark: IntArray,
    e: Array,
    S: Array,
    gate: float,
    extra: Array | None = None,
    ambiguity: float = 0.0,
) -> AnyArray:
    """Returns which pairs (p,) make the largest jointly compatible matching.

    Among matchings with as many pairs the one of smallest joint distance is taken. Each sighting
    and each landmark stands in at most one of the pairs taken.

    Args:
        row: (p,) sighting of each candidate pair.
        landmark: (p,) landmark of each.
        e: (p, d) residuals.
        S: (p d, p d) their joint covariance; entries between pairs that exclude each other do not
            count.
        gate: largest squared distance of one pair of two dimensions (chi-square); more pairs take
            the same probability.
        extra: (p,) squared distance that each pair has besides its residual's; 0 where None.
        ambiguity: pairs are left out on which another matching, with as many pairs, differs whose
            squared joint distance is larger by less than this.
    """
    count, d = e.shape
    distance = np.zeros(count) if extra is None else np.asarray(extra, float)
    if not count:
        return np.zeros(0, bool)
    alone = distance + [
        e[i] @ np.linalg.solve(S[i * d : i * d + d, i * d : i * d + d], e[i]) for i in range(count)
    ]
    order = np.lexsort((alone, row))
    names, starts = np.unique(row[order], return_index=True)
    starts = np.append(starts, count)
    limits = np.array([0.0] + [gate_for(gate, n * d) for n in range(1, len(names) + 1)])
    best = np.zeros(count, np.bool_)
    place = (order[:, None] * d + np.arange(d)).ravel()
    problem = (
        starts.astype(np.int64),
        np.ascontiguousarray(landmark[order], np.int64),
        np.ascontiguousarray(e[order], float),
        np.ascontiguousarray(S[np.ix_(place, place)]),
        distance[order],
        limits,
    )
    pairs, total = _search(*problem, 0, math.inf, False, MOST_HYPOTHESES, best)
    if ambiguity > 0.0 and pairs:
        _search(*problem, pairs, total + ambiguity, True, MOST_HYPOTHESES, best)
    chosen = np.zeros(count, bool)
    chosen[order] = best
    return chosen


@njit(cache=True)
def _search(  # type: ignore[no-untyped-def]
    starts, landmark, e, S, extra, limits, fewest, farthest, common, budget, best
):
    """Looks through matchings, deepest first, nearest pairs first; returns pairs and distance.

    Args:
        starts: (k + 1,) candidate pairs of sighting i are starts[i] to starts[i + 1].
        landmark, e, S, extra: of the pairs in this order; see `jcbb`.
        limits: (k + 1,) largest distance of so many pairs.
        fewest, farthest: only matchings with as many pairs or more, and not beyond this distance
            if no more, are of interest.
        common: whether to keep in ``best`` only pairs that all matchings of interest have; else
            the best matching is written there.
        budget: how many partial matchings to look at.
        best: (p,) in and out.
    """
    rows, d = len(starts) - 1, e.shape[1]
    L = np.zeros((rows * d, rows * d))
    y = np.zeros(rows * d)
    place = np.zeros(rows * d, np.int64)
    pair = np.full(rows, -1)
    step = np.zeros(rows, np.int64)
    number = np.zeros(rows + 1, np.int64)
    distance = np.zeros(rows + 1)
    most, nearest = fewest, farthest
    level = 0
    while level >= 0 and budget > 0:
        if level == rows:
            if common:
                for q in range(len(best)):
                    kept = False
                    for r in range(rows):
                        kept = kept or pair[r] == q
                    best[q] = best[q] and kept
            else:
                most, nearest = number[level], distance[level]
                best[:] = False
                for r in range(rows):
                    if pair[r] >= 0:
                        best[pair[r]] = True
            level -= 1
            continue
        q = starts[level] + step[level]
        if q > starts[level + 1]:
            step[level] = 0
            pair[level] = -1
            level -= 1
            continue
        step[level] += 1
        budget -= 1
        n, total = number[level], distance[level]
        pair[level] = -1
        if q < starts[level + 1]:
            free = True
            for r in range(level):
                free = free and (pair[r] < 0 or landmark[pair[r]] != landmark[q])
            if not free:
                continue
            total += extra[q] + _extend(L, y, place, n * d, e, S, q)
            n += 1
            if not total <= limits[n]:
                continue
            pair[level] = q
        possible = n + rows - level - 1
        worse = total > nearest if common else total >= nearest
        if possible < most or (possible == most and worse):
            pair[level] = -1
            continue
        number[level + 1], distance[level + 1] = n, total
        level += 1
        if level < rows:
            step[level] = 0
    return most, nearest


@njit(cache=True)
def _extend(L, y, place, size, e, S, q):  # type: ignore[no-untyped-def]
    """Appends pair q to a Cholesky factor; returns what it adds to the squared distance."""
    d = e.shape[1]
    added = 0.0
    for a in range(d):
        i = size + a
        place[i] = q * d + a
        left = e[q, a]
        for j in range(i + 1):
            entry = S[place[i], place[j]]
            for m in range(j):
                entry -= L[i, m] * L[j, m]
            if j < i:
                L[i, j] = entry / L[j, j]
                left -= L[i, j] * y[j]
            elif entry > 0.0:
                L[i, i] = math.sqrt(entry)
            else:
                return math.inf
        y[i] = left / L[i, i]
        added += y[i] * y[i]
    return added
