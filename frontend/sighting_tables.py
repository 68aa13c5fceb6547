"""Tables of sightings from readings that come by time, not by node."""

from __future__ import annotations

from typing import Any

import numpy as np

from graphslam.geometry import Array
from graphslam.measurements import IntArray, Sightings


def at_nodes(times: Array, chosen: Array, t: Array) -> tuple[IntArray, IntArray, int]:
    """Returns the rows at nodes, their nodes, and how many were chosen but lie at no node."""
    node = np.minimum(np.searchsorted(t, times), len(t) - 1)
    at_node = (t[node] == times) & np.isin(times, chosen)
    lost = np.isin(times, chosen) & ~at_node
    return np.flatnonzero(at_node), node[at_node], int(lost.sum())


def given(kind: str, part: Any, chosen: Array, t: Array, *columns: str) -> tuple[Sightings, int]:
    """Returns what a log gives of one kind as sightings at nodes, and how many lie at none.

    Args:
        kind: of the table.
        part: readings by time, with ``t``, ``z``, ``cov`` and ``t_received``.
        chosen: (C,) times of the moments that are used, s.
        t: (N,) times of the nodes, s.
        columns: what else the part tells of each reading, as the table has it.
    """
    rows, node, lost = at_nodes(part.t, chosen, t)
    told = {name: getattr(part, name)[rows] for name in columns}
    return table(kind, node, part.z[rows], part.cov[rows], part.t_received[rows], **told), lost


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
