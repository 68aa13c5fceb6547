"""Tables of sightings from readings that come by time, not by node."""

from __future__ import annotations

import numpy as np

from graphslam.geometry import Array
from graphslam.measurements import IntArray, Sightings


def at_nodes(times: Array, chosen: Array, t: Array) -> tuple[IntArray, IntArray, int]:
    """Returns the rows at nodes, their nodes, and how many were chosen but lie at no node."""
    node = np.minimum(np.searchsorted(t, times), len(t) - 1)
    at_node = (t[node] == times) & np.isin(times, chosen)
    lost = np.isin(times, chosen) & ~at_node
    return np.flatnonzero(at_node), node[at_node], int(lost.sum())


def table(
    kind: str,
    node: IntArray,
    z: Array,
    cov: Array,
    t_received: Array,
    extent: Array | None = None,
    quality: Array | None = None,
    source: IntArray | None = None,
    truth: IntArray | None = None,
    label: IntArray | None = None,
) -> Sightings:
    """Returns a table of sightings with 'unknown' in the columns that are not given."""
    count = len(node)
    none = np.full(count, -1, np.int64)
    return Sightings(
        kind,
        node,
        z,
        cov,
        np.full((count, 2), np.nan) if extent is None else extent,
        t_received,
        np.full(count, np.nan) if quality is None else quality,
        none if source is None else source,
        none if truth is None else truth,
        none if label is None else label,
    )
