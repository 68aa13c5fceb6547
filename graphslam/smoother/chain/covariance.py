"""Covariances of poses and landmarks from the factorised system, floor frame."""

from __future__ import annotations

import numpy as np
import scipy.sparse

from graphslam.geometry import Array
from graphslam.measurements import IntArray
from graphslam.smoother.chain.chunks import POSE
from graphslam.smoother.chain.inverse import columns, pivots_of, pose_marginals
from graphslam.smoother.chain.linearise import carried_poses
from graphslam.smoother.chain.pair_columns import pair_columns
from graphslam.smoother.chain.system import System, carried_landmarks

COLUMNS = 64
"""Columns of the inverse that are solved for at a time."""


def all_poses(system: System, pose: Array) -> tuple[Array, Array]:
    """Returns covariances of all poses (N, 3, 3), and with the first one's change (N, 3, 3).

    The second is that of each pose's change beyond the first one's (see `linearise`).
    """
    cov, with_first = np.empty((len(pose), POSE, POSE)), np.empty((len(pose), POSE, POSE))
    pose_marginals(
        system.symbolic, system.chunks, system.linear, system.panel, system.chain, cov, with_first
    )
    G = carried_poses(pose, pose[0])
    mixed = with_first @ np.swapaxes(G, 1, 2)
    cov += mixed + np.swapaxes(mixed, 1, 2)
    cov += G @ _selected(system, np.arange(POSE)) @ np.swapaxes(G, 1, 2)
    return 0.5 * (cov + np.swapaxes(cov, 1, 2)), with_first


def last_and_map(system: System, pose: Array) -> Array:
    """Returns the covariance (3 + L, 3 + L) of last pose and landmarks, 0 for fixed ones."""
    symbolic, nodes = system.symbolic, len(pose)
    last = symbolic.var_at[system.separators] + np.arange(POSE)
    axis = np.arange(system.scalar_of.shape[1])
    place = system.scalar_of[axis < system.dims[:, None]]  # (L,), -1 for fixed landmarks
    free = np.flatnonzero(place >= 0)
    at = np.concatenate([np.arange(POSE), last[: POSE if nodes > 1 else 0], place[free]])
    Z = _selected(system, at.astype(np.int64))
    T = np.zeros((POSE + len(place), len(at)))
    T[:POSE, :POSE] = carried_poses(pose, pose[0])[-1]
    if nodes > 1:
        T[:POSE, POSE : 2 * POSE] = np.eye(POSE)
    if len(free):
        moved = carried_landmarks(system, pose)
        T[POSE:, :POSE] = moved[axis < system.dims[:, None]]
        T[POSE + free, len(at) - len(free) + np.arange(len(free))] = 1.0
    return _symmetric(_congruent(T, Z))


def _congruent(T: Array, Z: Array) -> Array:
    """Returns ``T Z T'``; T has few entries in a row."""
    few = scipy.sparse.csr_array(T)
    return np.asarray(few @ (few @ Z).T)


def _symmetric(cov: Array) -> Array:
    return 0.5 * (cov + cov.T)


def _selected(system: System, at: IntArray) -> Array:
    """Returns the inverse's entries (k, k) between the scalars ``at``."""
    symbolic = system.symbolic
    needed = _fronts_above(system, at)
    out = np.empty((len(at), len(at)))
    for begin in range(0, len(at), COLUMNS):
        part = at[begin : begin + COLUMNS]
        x = np.zeros((system.scalars, len(part)))
        x[part, np.arange(len(part))] = 1.0
        columns(symbolic, system.panel, x, needed)
        out[:, begin : begin + len(part)] = x[at]
    return out


def _fronts_above(system: System, at: IntArray) -> Array:
    symbolic = system.symbolic
    variable = np.searchsorted(symbolic.var_at, at, side="right") - 1
    needed = np.zeros(len(symbolic.parent), bool)
    needed[symbolic.var_front[variable]] = True
    for s in np.arange(len(needed)):
        if needed[s] and symbolic.parent[s] >= 0:
            needed[symbolic.parent[s]] = True
    return needed


def pairs(system: System, pose: Array, node: IntArray, landmark: IntArray) -> Array:
    """Returns joint covariances (k, 3 + l, 3 + l) of poses and landmarks, 0 for fixed landmarks.

    Each landmark costs what stands above it and above the chunks asked for in the tree of fronts,
    not the length of the chain.
    """
    width = int(system.dims[landmark].max(initial=0))
    out = np.zeros((len(node), POSE + width, POSE + width))
    cov, with_first = all_poses(system, pose)
    out[:, :POSE, :POSE] = cov[node]
    order = np.lexsort((node, landmark))
    order = order[system.var_of[landmark[order]] >= 0]
    if not len(order):
        return out
    i, m = node[order], landmark[order]
    column = np.empty((len(order), POSE, width))  # of each pose beyond the first, with its landmark
    own, with_map = np.empty((len(order), width, width)), np.empty((len(order), POSE, width))
    pair_columns(
        system.symbolic,
        system.chunks,
        system.linear,
        system.panel,
        system.chain,
        (i, system.var_of[m], m),
        column,
        own,
        with_map,
    )
    G, first = carried_poses(pose, pose[0]), _selected(system, np.arange(POSE))
    moved = carried_landmarks(system, pose)[m, :width]
    moved_t = np.swapaxes(moved, 1, 2)
    mixed = moved @ with_map
    own += mixed + np.swapaxes(mixed, 1, 2) + moved @ first @ moved_t
    both = column + with_first[i] @ moved_t + G[i] @ (with_map + first @ moved_t)
    there = np.arange(width) < system.dims[m][:, None]  # landmarks of fewer parameters
    both = np.where(there[:, None, :], both, 0.0)
    own = np.where(there[:, None, :] & there[:, :, None], own, 0.0)
    out[order, POSE:, POSE:] = own
    out[order, :POSE, POSE:] = both
    out[order, POSE:, :POSE] = np.swapaxes(both, 1, 2)
    return out


def log_det(system: System) -> float:
    """Returns the logarithm of the determinant of the factorised system's inverse.

    However poses and landmarks are written, as they are or beyond the first pose's change, it is
    the same: one follows from the other by a triangular matrix of ones on the diagonal.
    """
    pivots = pivots_of(system.symbolic, system.panel)
    inside = np.ones(len(system.chain), bool)
    inside[system.chunks.bound] = False
    total = np.log(pivots).sum() + np.log(system.chain[inside][:, [0, 2, 5]]).sum()
    return float(-2.0 * total)
