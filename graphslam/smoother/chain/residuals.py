"""What stays of a problem while its poses and landmarks move: who saw what, and how well."""

# mypy: disallow-untyped-decorators=False, disallow-untyped-calls=False

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit

from graphslam.geometry import Array
from graphslam.measurements import IntArray, Sightings
from graphslam.models import MODELS, Model
from graphslam.smoother.chain.chunks import POSE, SmallIntArray
from graphslam.smoother.problem import Problem

FIRST_POSE = 0
"""The variable that stands for a change of the first pose, which carries the floor along."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Sightings of one kind, all of free or all of fixed landmarks (or of none).

    Attributes:
        model: their model.
        free: whether their landmarks are variables.
        node: (k,) node of each.
        landmark: (k,) row of its landmark in the problem; -1 for kinds without.
        z: (k, d) values.
        whitener: (k, d, d) lower roots of the weighted information: ``whitener @ e`` is normalised.
        row: (k,) its first row.
    """

    model: Model
    free: bool
    node: IntArray
    landmark: IntArray
    z: Array
    whitener: Array
    row: SmallIntArray


@dataclass(frozen=True, slots=True)
class Residuals:
    """All residuals of a problem, laid out in rows of one scalar residual each, node by node.

    Attributes:
        problem: the problem.
        batches: its sightings.
        motion: (N - 1, 3, 3) whiteners of the increments.
        start: (3, 3) whitener of the start.
        row_start: (N + 1,) where each node's rows start.
        row_var: (R,) variable, beside the pose, of each row.
        columns: largest number of derivatives by that variable.
    """

    problem: Problem
    batches: tuple[Batch, ...]
    motion: Array
    start: Array
    row_start: IntArray
    row_var: SmallIntArray
    columns: int


def collect(problem: Problem, var_of: IntArray) -> Residuals:
    """Returns the residuals of a problem.

    Args:
        problem: the problem.
        var_of: (M,) variable of each landmark, -1 for fixed ones.
    """
    measurements = problem.measurements
    chosen = list(_chosen(problem))
    rows_at = np.zeros(len(measurements.t), np.int64)
    for _, table, rows, _ in chosen:
        dim = MODELS[table.kind].dim_z
        rows_at += dim * np.bincount(table.node[rows], minlength=len(rows_at))
    row_start = np.concatenate([[0], np.cumsum(rows_at)])
    row_var = np.full(row_start[-1], FIRST_POSE, np.int32)
    fill = row_start[:-1].copy()
    batches, columns = [], 0
    for free, table, rows, match in chosen:
        model, node, landmark = MODELS[table.kind], table.node[rows], match[rows]
        variable = var_of[landmark] if free else np.full(len(node), FIRST_POSE)
        row = _lay_out(node, variable, model.dim_z, fill, row_var)
        whitener = whiteners(table.cov[rows], _weights(problem, table)[rows])
        batches.append(Batch(model, free, node, landmark, table.z[rows], whitener, row))
        columns = max(columns, model.dim_landmark if free else POSE)
    return Residuals(
        problem,
        tuple(batches),
        whiteners(measurements.odometry.cov, problem.odometry_weight),
        whiteners(measurements.start_cov[None], np.ones(1))[0],
        row_start,
        row_var,
        columns,
    )


def _chosen(
    problem: Problem,
) -> Iterator[tuple[bool, Sightings, slice | IntArray, IntArray]]:
    """Yields whether landmarks are free, the table, its rows that count, and its part of match."""
    for first, table in problem.measurements.tables():
        match = problem.match[first : first + len(table)]
        counts = np.full(len(table), True)
        free = np.full(len(table), False)
        if MODELS[table.kind].dim_landmark:
            counts = match >= 0
            free = counts & ~problem.fixed[match] if len(problem.fixed) else counts
        for is_free, mask in ((True, free), (False, counts & ~free)):
            if mask.all() and len(mask):
                yield is_free, table, slice(None), match
            elif mask.any():
                yield is_free, table, np.flatnonzero(mask), match


def _weights(problem: Problem, table: Sightings) -> Array:
    first = next(first for first, other in problem.measurements.tables() if other is table)
    return problem.weight[first : first + len(table)]


def whiteners(cov: Array, weight: Array) -> Array:
    """Returns lower roots W (k, d, d) with ``W' W = weight * inv(cov)``."""
    out = np.empty(cov.shape)
    _whiteners(cov, weight, out)
    return out


@njit(cache=True)
def _whiteners(cov, weight, out):  # type: ignore[no-untyped-def]
    """Inverts the lower Cholesky factors, column by column, and scales them."""
    d = cov.shape[1]
    L = np.zeros((d, d))
    for k in range(len(cov)):
        root = math.sqrt(weight[k])
        for i in range(d):
            for j in range(i + 1):
                value = cov[k, i, j]
                for q in range(j):
                    value -= L[i, q] * L[j, q]
                L[i, j] = math.sqrt(value) if i == j else value / L[j, j]
        for j in range(d):
            for i in range(d):
                value = root if i == j else 0.0
                for q in range(j, i):
                    value -= L[i, q] * out[k, q, j]
                out[k, i, j] = value / L[i, i] if i >= j else 0.0


@njit(cache=True)
def _lay_out(node, variable, dim, fill, row_var):  # type: ignore[no-untyped-def]
    """Returns each sighting's first row, after those already laid out at its node."""
    row = np.empty(len(node), np.int32)
    for k in range(len(node)):
        row[k] = fill[node[k]]
        fill[node[k]] += dim
        for axis in range(dim):
            row_var[row[k] + axis] = variable[k]
    return row
