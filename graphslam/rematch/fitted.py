"""A minimum with all that second thoughts about its matches need to know."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graphslam.geometry import Array
from graphslam.landmarks import labels_seen, stretches_seen, used_sightings
from graphslam.measurements import IntArray, Sightings
from graphslam.models import MODELS
from graphslam.smoother.problem import Minimum, Problem

UNMATCHED = -1


@dataclass(frozen=True, slots=True)
class Fitted:
    """A problem at its minimum, with covariances and seen stretches.

    Attributes:
        problem: the matches, with path and map at the minimum.
        cost: of the minimum.
        minimum: what the engine found.
        cov_pose: (N, 3, 3) covariances of the poses, floor frame.
        cov_joint: (3 + L, 3 + L) of last pose and landmarks, floor frame.
        offsets: (M + 1,) where each landmark's parameters begin in ``cov_joint``.
        extent: (M, 2) stretch of each landmark that was seen, m; NaN where unknown.
        node: (K,) node of each sighting over all tables in order.
        label: (M,) what sensors tell each landmark apart by; -1 for none.
    """

    problem: Problem
    minimum: Minimum
    cov_pose: Array
    cov_joint: Array
    offsets: IntArray
    extent: Array
    node: IntArray
    label: IntArray

    @staticmethod
    def of(problem: Problem, minimum: Minimum) -> Fitted:
        """Returns a problem that was minimised, moved to its minimum.

        Raises:
            UnderConstrained: the measurements do not determine every pose and landmark.
        """
        problem = replace(problem, pose=minimum.pose, params=minimum.params)
        cov_pose, cov_joint = minimum.covariances()
        return Fitted(
            problem,
            minimum,
            cov_pose,
            cov_joint,
            (3 + np.cumsum([0, *problem.dims()])).astype(np.int64),
            stretches_seen(problem.measurements, problem.pose, problem.params, problem.match),
            nodes_of(problem),
            labels_seen(problem.measurements, problem.match, len(problem.kinds)),
        )

    def landmark_cov(self, rows: IntArray, others: IntArray, dim: int) -> Array:
        """Returns the covariances (k, dim, dim) between landmarks ``rows`` and ``others``."""
        along = np.arange(dim)
        i = self.offsets[rows][:, None] + along
        j = self.offsets[others][:, None] + along
        return np.asarray(self.cov_joint[i[:, :, None], j[:, None, :]])

    def of_kind(self, kind: str) -> IntArray:
        """Returns the landmarks of one kind."""
        return self.problem.of_kind(kind)


def nodes_of(problem: Problem) -> IntArray:
    """Returns the node (K,) of each sighting over all tables in order."""
    tables = [table.node for _, table in problem.measurements.tables()]
    return np.concatenate([np.zeros(0, np.int64), *tables])


def of_landmark_kinds(problem: Problem) -> NDArray[np.bool_]:
    """Returns for each sighting (K,) whether its kind has landmarks, as a writable array."""
    out = np.zeros(len(problem.match), bool)
    for first, table in problem.measurements.tables():
        out[first : first + len(table)] = MODELS[table.kind].dim_landmark > 0
    return out


def table_of(problem: Problem, kind: str) -> tuple[int, Sightings]:
    """Returns the sightings of one kind, and the number of the first among all."""
    for first, table in problem.measurements.tables():
        if table.kind == kind:
            return first, table
    raise KeyError(kind)


def stretch_on(problem: Problem, sightings: IntArray, landmark: int) -> Array:
    """Returns the stretch (2,) that sightings saw, laid along a landmark, m; NaN where unknown.

    Args:
        problem: path and map to lay them with.
        sightings: (k,) numbers over all tables, of the landmark's kind.
        landmark: on which they are laid; it need not be theirs.
    """
    model = MODELS[problem.kinds[landmark]]
    first, table = table_of(problem, model.kind)
    rows = np.asarray(sightings) - first
    params = np.repeat(problem.params[[landmark], : model.dim_landmark], len(rows), axis=0)
    pose = problem.pose[table.node[rows]]
    seen = model.extent_on_landmark(pose, params, table.z[rows], table.extent[rows])
    if not np.isfinite(seen).any():
        return np.full(2, np.nan)
    return np.array([np.nanmin(seen[:, 0]), np.nanmax(seen[:, 1])])


def stretches_by_sighting(problem: Problem) -> Array:
    """Returns the stretch (K, 2) that each sighting saw of its landmark, m; NaN where unknown."""
    seen = np.full((len(problem.match), 2), np.nan)
    for used in used_sightings(problem.measurements, problem.match, problem.params):
        if used.model.dim_landmark:
            table, rows = used.table, used.rows
            seen[used.index] = used.model.extent_on_landmark(
                problem.pose[table.node[rows]], used.params, table.z[rows], table.extent[rows]
            )
    return seen


def sightings_of(match: IntArray, count: int) -> list[IntArray]:
    """Returns the sightings of each of so many landmarks, in order."""
    order = np.argsort(match, kind="stable")
    return np.split(order, np.searchsorted(match[order], np.arange(count + 1)))[1:-1]


def partition(match: IntArray) -> IntArray:
    """Returns matches (K,) with landmarks numbered as they are met: alike for the same groups."""
    landmarks, first, place = np.unique(match, return_index=True, return_inverse=True)
    rank = np.empty(len(landmarks), np.int64)
    left_out = int(np.sum(landmarks == UNMATCHED))
    first[:left_out] = -1
    rank[np.argsort(first, kind="stable")] = np.arange(len(landmarks)) - left_out
    return np.asarray(rank[place])


def renumbered(problem: Problem, match: IntArray) -> Problem:
    """Returns the problem under other matches, without the landmarks that nobody sees any more.

    Known landmarks stay, seen or not. Weights start from 1 again.

    Args:
        problem: path and map.
        match: (K,) landmark of each sighting in the problem's numbering; -1 leaves it out.
    """
    seen = np.bincount(match[match >= 0], minlength=len(problem.kinds)) > 0
    keep = np.flatnonzero(seen | problem.fixed)
    new = np.full(len(problem.kinds) + 1, UNMATCHED)
    new[keep] = np.arange(len(keep))
    return replace(
        problem,
        match=new[match],
        kinds=tuple(problem.kinds[m] for m in keep),
        fixed=problem.fixed[keep],
        params=problem.params[keep],
        weight=np.ones(len(match)),
    )
