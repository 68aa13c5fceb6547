"""What the factorisation of a system of cliques looks like, before any number is known.

A *front* is a dense block of the elimination: its pivots are eliminated, its boundary is what they
leave coupled. Fronts form a tree; each comes after its children.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from graphslam.geometry import Array
from graphslam.measurements import IntArray
from graphslam.smoother.chain.dissection import stages
from graphslam.smoother.chain.ordering import minimum_degree

WORTH_CUTTING = 2e8
"""Multiplications of a factorisation above which another order is tried."""


class Symbolic(NamedTuple):
    """The tree of fronts and where everything stands in them; sizes in scalars.

    Attributes:
        parent: (S,) front that each front's boundary is added to, -1 for roots.
        pivots: (S,) scalars eliminated in each front.
        size: (S,) scalars of each front, pivots first.
        child_start: (S + 1,) where each front's children start in ``child``.
        child: children, in the order in which they are taken from the stack.
        scalar_start: (S + 1,) where each front's scalars start in ``scalar``.
        scalar: for each scalar of each front, its place in the solution.
        relative: for each scalar of a front's boundary (aligned with ``scalar``), its place in the
            parent's front.
        panel_start: (S + 1,) where each front's part of the factor starts: pivots times (size + 1).
        clique_start: (S + 1,) where each front's cliques start in ``clique``.
        clique: cliques, each in the front that eliminates its first variable.
        clique_at: aligned with the cliques' members: a variable's first scalar in that front.
        stack: largest number of scalars waiting on the stack of updates.
        var_front: (n,) front that eliminates each variable.
        var_at: (n,) place of each variable's first scalar in the solution.
    """

    parent: IntArray
    pivots: IntArray
    size: IntArray
    child_start: IntArray
    child: IntArray
    scalar_start: IntArray
    scalar: IntArray
    relative: IntArray
    panel_start: IntArray
    clique_start: IntArray
    clique: IntArray
    clique_at: IntArray
    stack: int
    var_front: IntArray
    var_at: IntArray


def analyse(start: IntArray, member: IntArray, dims: IntArray, place: Array) -> Symbolic:
    """Returns the tree of fronts of a system of cliques.

    Args:
        start: (E + 1,) where each clique's variables start in ``member``.
        member: variables of each clique, each once.
        dims: (n,) scalars of each variable; solutions hold the variables in their given order.
        place: (E, 2) where each clique lies, m: large systems are cut up by it where that pays.
    """
    groups = minimum_degree(start, member, dims, np.zeros(len(dims), np.int64))
    work = _work(dims, *groups)
    if work > WORTH_CUTTING:
        cut = minimum_degree(start, member, dims, stages(place, start, member, len(dims)))
        if _work(dims, *cut) < work:
            groups = cut
    return Symbolic(*_build(start, member, dims, *_merge(dims, *groups)))


@njit(cache=True)
def _work(dims, group_start, order, bound_start, bound):  # type: ignore[no-untyped-def]
    """Returns about how many multiplications the factorisation takes."""
    work = 0.0
    for g in range(len(group_start) - 1):
        pivots, size = 0, 0
        for at in range(group_start[g], group_start[g + 1]):
            pivots += dims[order[at]]
        for at in range(bound_start[g], bound_start[g + 1]):
            size += dims[bound[at]]
        work += pivots * (pivots + size) ** 2.0
    return work


@njit(cache=True)
def _worth_merging(pivots, size, zeros):  # type: ignore[no-untyped-def]
    """Returns whether a front with this many explicit zeros is faster than its two parts."""
    share = zeros / (0.5 * pivots * (2 * size - pivots))
    return share < 0.05 or (pivots <= 48 and share < 0.15) or (pivots <= 12 and share < 0.6)


@njit(cache=True)
def _merge(dims, group_start, order, bound_start, bound):  # type: ignore[no-untyped-def]
    """Returns fronts: the groups with children merged into parents where few zeros come in.

    These are the front of each variable, numbered in postorder; each front's parent; the group that
    has its boundary; and the boundaries themselves, unchanged.
    """
    count, n = len(group_start) - 1, len(dims)
    group, rank = np.empty(n, np.int64), np.empty(n, np.int64)
    pivots, outer, zeros = np.zeros(count), np.zeros(count), np.zeros(count)
    for g in range(count):
        for at in range(group_start[g], group_start[g + 1]):
            group[order[at]], rank[order[at]] = g, at
            pivots[g] += dims[order[at]]
        for at in range(bound_start[g], bound_start[g + 1]):
            outer[g] += dims[bound[at]]
    parent, into = np.full(count, -1, np.int64), np.full(count, -1, np.int64)
    for g in range(count):
        nearest = n
        for at in range(bound_start[g], bound_start[g + 1]):
            nearest = min(nearest, rank[bound[at]])
        if nearest < n:
            q = group[order[nearest]]
            parent[g] = q
            filled = zeros[g] + zeros[q] + pivots[g] * (pivots[q] + outer[q] - outer[g])
            if _worth_merging(pivots[g] + pivots[q], pivots[g] + pivots[q] + outer[q], filled):
                into[g] = q
                pivots[q] += pivots[g]
                zeros[q] = filled
    top = np.empty(count, np.int64)  # of each group, the group that it ends in
    for g in range(count - 1, -1, -1):
        top[g] = g if into[g] < 0 else top[into[g]]
    above = np.full(count, -1, np.int64)
    for g in range(count):
        if top[g] == g and parent[g] >= 0:
            above[g] = top[parent[g]]
    number, fronts = _postorder(top, above)
    front, front_parent = np.empty(n, np.int64), np.full(fronts, -1, np.int64)
    last_group = np.empty(fronts, np.int64)
    for v in range(n):
        front[v] = number[top[group[v]]]
    for g in range(count):
        if top[g] == g:
            last_group[number[g]] = g
            if above[g] >= 0:
                front_parent[number[g]] = number[above[g]]
    return front, front_parent, last_group, bound_start, bound


@njit(cache=True)
def _postorder(top, above):  # type: ignore[no-untyped-def]
    """Returns numbers of the groups that are fronts, children right before their parents."""
    count = len(top)
    child, sibling = np.full(count + 1, -1, np.int64), np.full(count, -1, np.int64)
    for g in range(count - 1, -1, -1):
        if top[g] == g:
            p = above[g] if above[g] >= 0 else count  # `count` is above all roots
            sibling[g], child[p] = child[p], g
    number, next_number = np.full(count, -1, np.int64), 0
    path, depth = np.empty(count + 1, np.int64), 0
    path[0] = count
    while depth >= 0:
        g = path[depth]
        if child[g] >= 0:
            depth += 1
            path[depth] = child[g]
            child[g] = sibling[path[depth]]
        else:
            if g < count:
                number[g] = next_number
                next_number += 1
            depth -= 1
    return number, next_number


@njit(cache=True)
def _starts(counts):  # type: ignore[no-untyped-def]
    starts = np.zeros(len(counts) + 1, np.int64)
    for i in range(len(counts)):
        starts[i + 1] = starts[i] + counts[i]
    return starts


@njit(cache=True)
def _grouped(key, groups):  # type: ignore[no-untyped-def]
    """Returns where each group starts, and indices of ``key`` group by group; -1 is left out."""
    count = np.zeros(groups, np.int64)
    for k in key:
        if k >= 0:
            count[k] += 1
    starts = _starts(count)
    fill, out = starts[:-1].copy(), np.empty(starts[groups], np.int64)
    for i in range(len(key)):
        if key[i] >= 0:
            out[fill[key[i]]] = i
            fill[key[i]] += 1
    return starts, out


@njit(cache=True)
def _build(start, member, dims, front, parent, last_group, bound_start, bound):  # type: ignore[no-untyped-def]
    count, n = len(parent), len(dims)
    var_at = _starts(dims)[:-1]
    own_start, own = _grouped(front, count)
    child_start, child = _grouped(parent, count)
    position = np.empty(n, np.int64)  # of each variable in the elimination
    for i in range(n):
        position[own[i]] = i
    pivots, size = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for s in range(count):
        for i in range(own_start[s], own_start[s + 1]):
            pivots[s] += dims[own[i]]
        size[s] = pivots[s]
        for i in range(bound_start[last_group[s]], bound_start[last_group[s] + 1]):
            size[s] += dims[bound[i]]
    scalar_start, panel_start = _starts(size), _starts(pivots * (size + 1))
    scalar = np.empty(scalar_start[count], np.int64)
    relative = np.full(scalar_start[count], -1, np.int64)
    owner = np.full(len(start) - 1, -1, np.int64)
    for e in range(len(start) - 1):
        first = n
        for at in range(start[e], start[e + 1]):
            first = min(first, position[member[at]])
        if first < n:
            owner[e] = front[own[first]]
    clique_start, clique = _grouped(owner, count)
    clique_at = np.zeros(len(member), np.int64)
    place = np.full(_starts(dims)[n], -1, np.int64)  # of a scalar in the front at hand
    for s in range(count):
        at = scalar_start[s]
        for i in range(own_start[s], own_start[s + 1]):
            for q in range(dims[own[i]]):
                scalar[at] = var_at[own[i]] + q
                at += 1
        g = last_group[s]
        outer = np.sort(position[bound[bound_start[g] : bound_start[g + 1]]])
        for i in outer:
            for q in range(dims[own[i]]):
                scalar[at] = var_at[own[i]] + q
                at += 1
    stack, deepest = 0, 0
    for s in range(count):
        for at in range(scalar_start[s], scalar_start[s + 1]):
            place[scalar[at]] = at - scalar_start[s]
        for i in range(child_start[s], child_start[s + 1]):
            c = child[i]
            for at in range(scalar_start[c] + pivots[c], scalar_start[c + 1]):
                relative[at] = place[scalar[at]]
            stack -= (size[c] - pivots[c] + 1) ** 2
        for i in range(clique_start[s], clique_start[s + 1]):
            for at in range(start[clique[i]], start[clique[i] + 1]):
                clique_at[at] = place[var_at[member[at]]]
        stack += (size[s] - pivots[s] + 1) ** 2
        deepest = max(deepest, stack)
    return (
        parent,
        pivots,
        size,
        child_start,
        child,
        scalar_start,
        scalar,
        relative,
        panel_start,
        clique_start,
        clique,
        clique_at,
        deepest,
        front,
        var_at,
    )
