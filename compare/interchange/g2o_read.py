"""A g2o graph of poses and lines as measurements with known matches, ready to be estimated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from compare.interchange.g2o_format import (
    EDGE_LINE,
    EDGE_POSE,
    EDGE_PRIOR,
    NOTE_TIME,
    VERTEX_LINE,
    VERTEX_POSE,
    pose_covariance,
    swapped,
)
from compare.interchange.g2o_rows import Elements, read_rows
from graphslam.errors import BadLog
from graphslam.estimate import Estimate
from graphslam.geometry import Array, wrap
from graphslam.measurements import IntArray, LandmarkMap, Measurements, Odometry, Sightings
from graphslam.models.line import LINE
from graphslam.models.pose_fix import POSE_FIX

FIXED_SIGMA = 1e-6
"""Standard deviation, m and rad, of a pose that the file fixes."""
FREE_SIGMA = (1e3, 1e3, np.pi)
"""The same of a first pose that only other poses' priors hold in place."""


@dataclass(frozen=True, slots=True)
class G2oGraph:
    """What a g2o file holds, in our terms.

    Attributes:
        measurements: nodes, odometry, line sightings and pose fixes; each sighting's `truth` is the
            row of its line in `landmarks`, so that `--matching known` uses the file's matches.
            Fixed lines are its `known`.
        pose: (N, 3) values of the pose vertices, floor frame.
        landmarks: the line vertices, canonical, fixed ones first; lines without edge are left out.
        match: (K,) line of each sighting, over all tables in order; -1 for pose fixes.
    """

    measurements: Measurements
    pose: Array
    landmarks: LandmarkMap
    match: IntArray

    def initial(self) -> Estimate:
        """Returns the vertices as an estimate to start from: covariances 0, which says nothing."""
        size, sightings = int(self.landmarks.offsets()[-1]), len(self.match)
        return Estimate(
            method="g2o",
            causal=False,
            t=self.measurements.t,
            pose=self.pose,
            cov_floor=np.zeros((len(self.pose), 3, 3)),
            map=self.landmarks,
            cov_joint=np.zeros((size, size)),
            match=self.match,
            used=np.ones(sightings, bool),
            nis=np.full(sightings, np.nan),
            weight=np.ones(sightings),
        )


def read_g2o(path: Path | str) -> G2oGraph:
    """Returns the graph of a g2o file with one chain of poses and any number of lines.

    Nodes are in the order of the chain; their times are those that our own export notes, else 0,
    1, 2, ... s. The first prior of the first pose is the start, all others are pose fixes. A first
    pose without prior is taken as known, as g2o does, unless other poses are held.

    Args:
        path: see `compare.interchange.g2o_format` for the elements that are read.

    Raises:
        BadLog: the file cannot be used; the message names file, line and cure.
    """
    path = Path(path)
    rows, fixed = read_rows(path)
    poses, edges = rows[VERTEX_POSE], rows[EDGE_POSE]
    _check_vertices(path, rows, fixed)
    order, steps = _chain(path, poses, edges)
    node_of = {int(i): node for node, i in enumerate(poses.ids[order, 0])}
    t, pose = _times(poses, order), poses.value[order]
    pose[:, 2] = wrap(pose[:, 2])
    landmarks, row_of, known = _landmarks(rows[VERTEX_LINE], rows[EDGE_LINE], fixed)
    start, fixes = _anchors(rows[EDGE_PRIOR], fixed, node_of, pose, t)
    increment, information = edges.value[steps], edges.information[steps]
    measurements = Measurements(
        t,
        *start,
        Odometry(increment, pose_covariance(information, increment)),
        {
            table.kind: table
            for table in (_sightings(rows[EDGE_LINE], node_of, row_of, t), fixes)
            if len(table)
        },
        _first(landmarks, known) if known else None,
    )
    truth = [table.truth for _, table in measurements.tables()]
    return G2oGraph(measurements, pose, landmarks, np.concatenate([np.zeros(0, np.int64), *truth]))


def _check_vertices(path: Path, rows: Mapping[str, Elements], fixed: Mapping[int, int]) -> None:
    """Raises BadLog where a vertex is there twice, or an edge or FIX names one that is not."""
    sort: dict[int, str] = {}
    for tag in (VERTEX_POSE, VERTEX_LINE):
        for number, vertex in zip(rows[tag].line, rows[tag].ids[:, 0].tolist(), strict=True):
            if vertex in sort:
                raise BadLog(f"{path}:{number}: vertex {vertex} is there twice; renumber one")
            sort[vertex] = tag
    if VERTEX_POSE not in sort.values():
        raise BadLog(f"{path}: holds no {VERTEX_POSE}; give a graph of poses in the plane")
    ends = {
        EDGE_PRIOR: (VERTEX_POSE,),
        EDGE_POSE: (VERTEX_POSE, VERTEX_POSE),
        EDGE_LINE: (VERTEX_POSE, VERTEX_LINE),
    }
    for tag, wanted in ends.items():
        for number, vertices in zip(rows[tag].line, rows[tag].ids.tolist(), strict=True):
            for vertex, kind in zip(vertices, wanted, strict=True):
                if sort.get(vertex) != kind:
                    raise BadLog(f"{path}:{number}: there is no {kind} {vertex}; add it")
    for vertex, number in fixed.items():
        if vertex not in sort:
            raise BadLog(f"{path}:{number}: there is no vertex {vertex} to fix; add it")


def _chain(path: Path, poses: Elements, edges: Elements) -> tuple[IntArray, IntArray]:
    """Returns the rows of the poses (N,) in the order of the chain, and of the edges (N - 1,)."""
    onward: dict[int, int] = {}
    entered: set[int] = set()
    for row, (i, j) in enumerate(edges.ids.tolist()):
        if i in onward or j in entered:
            raise BadLog(
                f"{path}:{edges.line[row]}: {EDGE_POSE} {i} {j} is a second way from {i} or to "
                f"{j}; odometry has to be one chain: remove loop closures (lines close loops)"
            )
        onward[i] = row
        entered.add(j)
    row_of = {vertex: row for row, vertex in enumerate(poses.ids[:, 0].tolist())}
    vertex = next((vertex for vertex in row_of if vertex not in entered), None)
    order: list[int] = []
    steps: list[int] = []
    while vertex is not None:
        order.append(row_of[vertex])
        step = onward.get(vertex)
        vertex = None if step is None else int(edges.ids[step, 1])
        steps += [] if step is None else [step]
    apart = sorted(set(range(len(poses))) - set(order))
    if apart:
        raise BadLog(
            f"{path}:{poses.line[apart[0]]}: {VERTEX_POSE} {poses.ids[apart[0], 0]} is not on the "
            f"chain of {EDGE_POSE} that begins at the first pose; add the edge that leads there, "
            "or remove one that closes a circle"
        )
    return np.array(order, np.int64), np.array(steps, np.int64)


def _times(poses: Elements, order: IntArray) -> Array:
    t = np.array([poses.note[row].get(NOTE_TIME, [np.nan])[0] for row in order])
    return t if np.all(np.diff(t, prepend=-np.inf) > 0) else np.arange(float(len(order)))


def _landmarks(
    lines: Elements, edges: Elements, fixed: Mapping[int, int]
) -> tuple[LandmarkMap, dict[int, int], int]:
    """Returns the map, the row of each line vertex in it, and how many of its lines are fixed."""
    seen = set(edges.ids[:, 1].tolist())
    ids = lines.ids[:, 0].tolist()
    known = [row for row, vertex in enumerate(ids) if vertex in fixed]
    free = [row for row, vertex in enumerate(ids) if vertex not in fixed and vertex in seen]
    rows = np.array(known + free, np.int64)
    row_of = {ids[row]: place for place, row in enumerate(rows.tolist())}
    params, extent, _ = LINE.canonical(swapped(lines.value)[rows], lines.stretch()[rows])
    supports = np.array([row_of[vertex] for vertex in edges.ids[:, 1].tolist()], np.int64)
    sightings = np.bincount(supports, minlength=len(rows))
    kinds = (LINE.kind,) * len(rows)
    return LandmarkMap(np.arange(len(rows)), kinds, params, extent, sightings), row_of, len(known)


def _first(landmarks: LandmarkMap, count: int) -> LandmarkMap:
    """Returns the first landmarks of a map as known ones."""
    none = np.zeros(count, np.int64)
    columns = (landmarks.params[:count], landmarks.extent[:count])
    return LandmarkMap(landmarks.id[:count], landmarks.kind[:count], *columns, none)


def _anchors(
    priors: Elements,
    fixed: Mapping[int, int],
    node_of: Mapping[int, int],
    pose: Array,
    t: Array,
) -> tuple[tuple[Array, Array], Sightings]:
    """Returns start pose and covariance, and all else that holds poses as pose fixes."""
    node = np.array([node_of[vertex] for vertex in priors.ids[:, 0].tolist()], np.int64)
    held = np.array([node_of[vertex] for vertex in fixed if vertex in node_of], np.int64)
    tight = np.broadcast_to(np.eye(3) * FIXED_SIGMA**2, (len(held), 3, 3))
    node = np.concatenate([held, node])
    z = np.concatenate([pose[held], priors.value])
    cov = np.concatenate([tight, pose_covariance(priors.information, priors.value)])
    order = np.argsort(node, kind="stable")
    node, z, cov = node[order], z[order], cov[order]
    if len(node) and node[0] == 0:
        start, rest = (z[0], cov[0]), slice(1, None)
    else:
        sigma = FREE_SIGMA if len(node) else (FIXED_SIGMA,) * 3
        start, rest = (pose[0], np.diag(np.square(sigma))), slice(0, None)
    nothing = np.full((len(node[rest]), 2), np.nan)
    return start, _table(POSE_FIX.kind, node[rest], z[rest], cov[rest], nothing, None, t)


def _sightings(
    edges: Elements, node_of: Mapping[int, int], row_of: Mapping[int, int], t: Array
) -> Sightings:
    node = np.array([node_of[vertex] for vertex in edges.ids[:, 0].tolist()], np.int64)
    line = np.array([row_of[vertex] for vertex in edges.ids[:, 1].tolist()], np.int64)
    cov = swapped(np.linalg.inv(edges.information))
    cov = 0.5 * (cov + np.swapaxes(cov, 1, 2))
    by = np.argsort(node, kind="stable")
    z, extent = swapped(edges.value), edges.stretch()
    return _table(LINE.kind, node[by], z[by], cov[by], extent[by], line[by], t)


def _table(
    kind: str,
    node: IntArray,
    z: Array,
    cov: Array,
    extent: Array,
    landmark: IntArray | None,
    t: Array,
) -> Sightings:
    unknown = np.full(len(node), -1)
    truth = unknown if landmark is None else landmark
    quality = np.full(len(node), np.nan)
    return Sightings(kind, node, z, cov, extent, t[node], quality, unknown, truth)
