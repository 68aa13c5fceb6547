"""Covariances of poses and landmarks from the factorised system, floor frame."""

from __future__ import annotations

import numpy as np
import scipy.sparse

from graphslam.geometry import Array
from graphslam.measurements import IntArray
from graphslam.smoother.chain.chunks import POSE
from graphslam.smoother.chain.fronts import solve_chain
from graphslam.smoother.chain.inverse import columns, pose_marginals
from graphslam.smoother.chain.linearise import carried_poses
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
    """Returns joint covariances (k, 3 + l, 3 + l) of poses and landmarks, 0 for fixed landmarks."""
    width = int(system.dims[landmark].max(initial=0))
    out = np.zeros((len(node), POSE + width, POSE + width))
    cov, with_first = all_poses(system, pose)
    out[:, :POSE, :POSE] = cov[node]
    G, first = carried_poses(pose, pose[0]), _selected(system, np.arange(POSE))
    moved = carried_landmarks(system, pose) if len(system.var_of) else np.zeros((0, 0, POSE))
    x, step = np.empty((system.scalars, width)), np.empty((len(pose), POSE))
    everything = np.ones(len(system.symbolic.parent), bool)
    for m in np.unique(landmark[system.var_of[landmark] >= 0]):
        chosen, dim = np.flatnonzero(landmark == m), system.dims[m]
        own, of_first = system.scalar_of[m, :dim], moved[m, :dim]
        x = np.zeros((len(x), dim))
        x[own, np.arange(dim)] = 1.0
        columns(system.symbolic, system.panel, x, everything)
        with_map = x[:POSE]  # of the first pose's change and the landmark
        mixed = of_first @ with_map
        own_cov = x[own] + mixed + mixed.T + of_first @ first @ of_first.T
        i = node[chosen]
        both = with_first[i] @ of_first.T + G[i] @ (with_map + first @ of_first.T)
        for q in range(dim):
            column = np.ascontiguousarray(x[:, q])
            solve_chain(
                system.chunks,
                system.linear,
                system.chain,
                column,
                0.0,
                system.symbolic.var_at,
                step,
            )
            both[:, :, q] += step[i]
        out[chosen, POSE : POSE + dim, POSE : POSE + dim] = own_cov
        out[chosen, :POSE, POSE : POSE + dim] = both
        out[chosen, POSE : POSE + dim, :POSE] = np.swapaxes(both, 1, 2)
    return out
