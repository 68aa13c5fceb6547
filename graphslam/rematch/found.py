"""New landmarks from sightings that belong to none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graphslam.association import gate_for, mahalanobis
from graphslam.config import RematchConfig
from graphslam.geometry import Array
from graphslam.landmarks import padded
from graphslam.measurements import IntArray, Sightings
from graphslam.models import MODELS, Model
from graphslam.rematch.fitted import table_of
from graphslam.smoother.problem import Problem


def travelled(pose: Array) -> Array:
    """Returns the way (N,) from the first node along a path (N, 3), m."""
    steps = np.hypot(*np.diff(pose[:, :2], axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])


def start_landmarks(problem: Problem, alone: IntArray, config: RematchConfig) -> Problem:
    """Returns the problem with landmarks started from groups of unmatched sightings.

    Sightings make a group while they follow each other within ``config.window_m`` of the way, have
    one label and lie within the wide gate of the landmark that the first of them would start;
    groups of fewer than ``config.min_sightings`` start nothing.

    Args:
        problem: path, map and matches.
        alone: (k,) numbers of sightings that are near no landmark.
        config: gates, window and smallest group.
    """
    match, kinds = problem.match.copy(), list(problem.kinds)
    params = [row[:dim] for row, dim in zip(problem.params, problem.dims(), strict=True)]
    way = travelled(problem.pose)
    for kind in problem.measurements.sightings:
        model = MODELS[kind]
        first, table = table_of(problem, kind)
        left = [int(n) - first for n in alone if first <= n < first + len(table)]
        while model.dim_landmark and len(left) >= config.min_sightings:
            seed = left.pop(0)
            pose = problem.pose[table.node[seed]]
            started = model.initialise(pose, table.z[seed], table.cov[seed])
            if started is None:
                continue
            landmark, _, J_z = started
            cov = J_z @ table.cov[seed] @ J_z.T
            alike = np.array(left, np.int64)
            alike = alike[table.label[alike] == table.label[seed]]
            near = _near(problem, model, table, alike, landmark, cov, config)
            group = _follow(table, way, seed, near, config.window_m)
            if len(group) >= config.min_sightings:
                match[first + np.array(group)] = len(kinds)
                kinds.append(kind)
                params.append(landmark)
                left = [row for row in left if row not in set(group)]
    fixed = np.concatenate([problem.fixed, np.zeros(len(kinds) - len(problem.kinds), bool)])
    return replace(problem, match=match, kinds=tuple(kinds), fixed=fixed, params=padded(params))


def _near(
    problem: Problem,
    model: Model,
    table: Sightings,
    rows: IntArray,
    landmark: Array,
    cov: Array,
    config: RematchConfig,
) -> IntArray:
    """Returns which rows lie within the wide gate of a landmark just started."""
    if not len(rows):
        return rows
    params = np.broadcast_to(landmark, (len(rows), len(landmark)))
    e, _, J_l = model.residual(problem.pose[table.node[rows]], params, table.z[rows])
    S = J_l @ cov @ np.swapaxes(J_l, -1, -2) + table.cov[rows]
    return rows[mahalanobis(e, S) <= gate_for(config.gate_new, model.dim_z)]


def _follow(table: Sightings, way: Array, seed: int, near: IntArray, window: float) -> list[int]:
    """Returns the rows that follow the seed one by one, one a node, without a long gap."""
    group = [seed]
    for row in near.tolist():
        last, node = table.node[group[-1]], table.node[row]
        if way[node] - way[last] > window:
            break
        if node > last:
            group.append(row)
    return group
