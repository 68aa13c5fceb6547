"""Measurements and an estimate as a g2o graph, whose optimum is the smoother's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from compare.interchange.g2o_format import (
    EDGE_LINE,
    EDGE_POSE,
    EDGE_PRIOR,
    FIX,
    NOTE,
    NOTE_SEEN,
    NOTE_TIME,
    VERTEX_LINE,
    VERTEX_POSE,
    pose_information,
    swapped,
)
from graphslam.errors import BadConfig, BadMeasurements
from graphslam.estimate import Estimate
from graphslam.geometry import Array, line_to_robot, nearest_twin
from graphslam.landmarks import Used, used_sightings
from graphslam.measurements import Measurements
from graphslam.models.line import LINE
from graphslam.models.pose_fix import POSE_FIX

POSE_UPPER, LINE_UPPER = np.triu_indices(3), np.triu_indices(2)


def g2o_text(measurements: Measurements, estimate: Estimate) -> str:
    """Returns a g2o file: the estimate as vertices, the measurements that it uses as edges.

    Poses are numbered 0 to N - 1 in time, line i of the map is N + i. Each sighting's information
    is multiplied by its robust weight, and sightings that the estimate rejects are left out, so
    that the graph's optimum is the estimate. (Not so where odometry was robust too: its weights are
    no part of an estimate.) Known lines are fixed. Where a node has a time or a line a stretch, a
    comment says so (see `compare.interchange.g2o_format`).

    Args:
        measurements: what the estimate was made from.
        estimate: its matches, and the values of the vertices.

    Raises:
        BadConfig: a sighting is of a kind that g2o has no edge for.
        BadMeasurements: the estimate belongs to other measurements.
    """
    sizes = (len(estimate.t), len(estimate.match))
    if sizes != (len(measurements.t), measurements.sighting_count):
        raise BadMeasurements(
            f"{estimate.method}: belongs to other measurements; give those that it was made from"
        )
    rows = [*_vertices(measurements, estimate), *_odometry(measurements)]
    for used in used_sightings(measurements, estimate.match, estimate.map.params):
        if used.model.kind == LINE.kind:
            rows += _line_edges(measurements, estimate, used)
        elif used.model.kind == POSE_FIX.kind:
            rows += _pose_fixes(estimate, used)
        else:
            raise BadConfig(
                f"g2o has no edge for sightings of kind {used.model.kind!r}; export a run without "
                "them"
            )
    return "\n".join(rows) + "\n"


def _vertices(measurements: Measurements, estimate: Estimate) -> Iterator[str]:
    for node, (t, pose) in enumerate(zip(estimate.t.tolist(), estimate.pose, strict=True)):
        yield f"{NOTE} {NOTE_TIME} {t!r}"
        yield _row(VERTEX_POSE, [node], pose)
    first = len(estimate.t)
    rows, lines = estimate.map.of_kind(LINE.kind)
    for row, line in zip(rows, swapped(lines), strict=True):
        yield from _seen(estimate.map.extent[row])
        yield f"{_row(VERTEX_LINE, [first + row], line)} -1 -1"
    known = 0 if measurements.known is None else len(measurements.known)
    fixed = [str(first + row) for row in rows if row < known]
    if fixed:
        yield " ".join([FIX, *fixed])


def _odometry(measurements: Measurements) -> Iterator[str]:
    start, odometry = measurements.start_pose[None], measurements.odometry
    information = pose_information(measurements.start_cov[None], start)
    yield _row(EDGE_PRIOR, [0], start[0], information[0][POSE_UPPER])
    information = pose_information(odometry.cov, odometry.increment)
    for node, increment in enumerate(odometry.increment):
        yield _row(EDGE_POSE, [node, node + 1], increment, information[node][POSE_UPPER])


def _line_edges(measurements: Measurements, estimate: Estimate, used: Used) -> Iterator[str]:
    table, rows = used.table, used.rows
    node = table.node[rows]
    z = nearest_twin(table.z[rows], line_to_robot(used.params, estimate.pose[node]))
    kept = z[:, 1] == table.z[rows, 1]
    J = np.zeros((len(rows), 2, 2))
    J[:, 0, 0], J[:, 1, 1] = np.where(kept, 1.0, -1.0), 1.0
    cov = J @ table.cov[rows] @ J
    information = swapped(np.linalg.inv(cov)) * estimate.weight[used.index, None, None]
    extent = np.where(kept[:, None], table.extent[rows], -table.extent[rows][:, ::-1])
    line = len(measurements.t) + used.landmark
    for k in np.flatnonzero(estimate.weight[used.index] > 0):
        yield from _seen(extent[k])
        yield _row(EDGE_LINE, [node[k], line[k]], z[k, ::-1], information[k][LINE_UPPER])


def _pose_fixes(estimate: Estimate, used: Used) -> Iterator[str]:
    z, weight = used.table.z[used.rows], estimate.weight[used.index]
    information = pose_information(used.table.cov[used.rows], z) * weight[:, None, None]
    for k in np.flatnonzero(weight > 0):
        yield _row(EDGE_PRIOR, [used.table.node[used.rows[k]]], z[k], information[k][POSE_UPPER])


def _seen(extent: Array) -> Iterator[str]:
    if np.isfinite(extent).all():
        yield " ".join([NOTE, NOTE_SEEN, *map(repr, extent.tolist())])


def _row(tag: str, ids: list[int], *values: Array) -> str:
    numbers = [repr(number) for part in values for number in part.tolist()]
    return " ".join([tag, *(str(int(i)) for i in ids), *numbers])
