"""Nested dissection by place: which variables to keep to the last because they join far parts.

Minimum degree sees one variable at a time and leaves large dense fronts on maps that cover an area.
Cutting the area in halves, and those again, finds the few landmarks and poses that the halves
share.

Source: George, 'Nested dissection of a regular finite element mesh' (1973).
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

import numpy as np
from numba import njit

from graphslam.geometry import Array
from graphslam.measurements import IntArray

LEAF = 48
"""Cliques below which a part is not cut further."""


@njit(cache=True)
def stages(place: Array, start: IntArray, member: IntArray, n: int) -> IntArray:
    """Returns for each variable (n,) the stage of the elimination in which it goes, from 0.

    Args:
        place: (E, 2) where each clique lies, m.
        start: (E + 1,) where each clique's variables start in ``member``.
        member: variables of each clique.
        n: number of variables.
    """
    cliques = len(place)
    order = np.arange(cliques)
    cut_at, seen = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    todo = [(0, cliques, 0)]
    deepest, cut = 0, 0
    while len(todo) > 0:
        low, high, depth = todo.pop()
        if high - low <= LEAF:
            continue
        part = order[low:high].copy()
        wide = place[part, 0].max() - place[part, 0].min()
        high_is_y = place[part, 1].max() - place[part, 1].min() > wide
        order[low:high] = part[np.argsort(place[part, 1 if high_is_y else 0])]
        middle = (low + high) // 2
        for i in range(low, high):
            e = order[i]
            for at in range(start[e], start[e + 1]):
                v = member[at]
                if cut_at[v] < 0:
                    if i < middle:
                        seen[v] = cut
                    elif seen[v] == cut:
                        cut_at[v] = depth
        deepest, cut = max(deepest, depth + 1), cut + 1
        todo.append((low, middle, depth + 1))
        todo.append((middle, high, depth + 1))
    return np.where(cut_at < 0, 0, deepest - cut_at)
