"""How far along a landmark a sighting may lie from what was seen of it."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from graphslam.association import gate_for
from graphslam.config import RematchConfig
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Sightings
from graphslam.models import Model
from graphslam.models.base import Stretched
from graphslam.rematch.ends import POWER, UNKNOWN, Ends
from graphslam.rematch.fitted import Fitted


def gap_price(gap: Array, config: RematchConfig, ends: Ends = UNKNOWN) -> Array:
    """Returns what a gap (m) between stretches costs, as a squared distance; see `Ends.price`."""
    return 2.0 * ends.price(gap, config)


def widest_gap(gate: float, config: RematchConfig) -> float:
    """Returns the gap, m, that costs as much as a gate allows."""
    return config.gap_m * math.expm1(0.5 * gate / POWER)


def close_pairs(
    fitted: Fitted, model: Model, table: Sightings, landmarks: IntArray, config: RematchConfig
) -> tuple[IntArray, IntArray]:
    """Returns rows of the table and places in ``landmarks`` that no gap keeps from being one.

    So a sighting is compared with what is about it, not with the whole map. Landmarks of which no
    stretch is known are about everything. In order of landmarks, then of rows.
    """
    nodes = len(fitted.problem.pose)
    starts = table.starts(nodes)
    rows, columns = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for column, near in enumerate(_nodes_near(fitted, model, table, landmarks, config)):
        own = np.arange(len(table)) if near is None else _ranges(starts[near], starts[near + 1])
        rows.append(own)
        columns.append(np.full(len(own), column))
    return np.concatenate(rows), np.concatenate(columns)


def _nodes_near(
    fitted: Fitted, model: Model, table: Sightings, landmarks: IntArray, config: RematchConfig
) -> list[IntArray | None]:
    """Returns for each landmark the nodes that might see a part of it; None where all might."""
    found: list[IntArray | None] = [None] * len(landmarks)
    if not isinstance(model, Stretched):
        return found
    params = fitted.problem.params[landmarks, : model.dim_landmark]
    ends = model.ends(params, fitted.extent[landmarks])
    seen = model.ends(table.z, table.extent)
    sight = float(np.nanmax(np.hypot(seen[..., 0], seen[..., 1]), initial=0.0))
    length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    far = 0.5 * length + sight + widest_gap(gate_for(config.gate, model.dim_z), config)
    tree = cKDTree(fitted.problem.pose[:, :2])
    for place in np.flatnonzero(np.isfinite(far)).tolist():
        near = tree.query_ball_point(ends[place].mean(axis=0), far[place], return_sorted=True)
        found[place] = np.array(near, np.int64)
    return found


def _ranges(first: IntArray, last: IntArray) -> IntArray:
    """Returns the numbers of all ranges ``first`` (k,) to ``last`` (k,), one after the other."""
    count = last - first
    before = np.cumsum(count) - count
    return np.asarray(np.arange(int(count.sum())) + np.repeat(first - before, count))
