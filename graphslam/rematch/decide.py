"""Which landmark every sighting belongs to, decided again with the smoothed covariances."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphslam.association import gate_for, mahalanobis
from graphslam.config import RematchConfig
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Sightings
from graphslam.models import MODELS, Model
from graphslam.rematch.candidates import within_reach
from graphslam.rematch.crowd import by_chance, density_of, most_surprise
from graphslam.rematch.fitted import UNMATCHED, Fitted, of_landmark_kinds
from graphslam.rematch.reach import gap_price

KEEP = 9.0
"""How much better, in squared Mahalanobis distance, another landmark must be than the present."""
CROWDED = 1.0
"""Landmarks within the gate by chance beyond which nearness is no reason to match."""
APART = 0.5
"""Part of `RematchConfig.gap_m` from which on a gap along a landmark lets another one begin."""
LEVERAGE_FLOOR = 1e-9
"""Part of a sighting's noise that is left where the sighting alone made its landmark."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Pairs of a sighting and a landmark that may belong together.

    Attributes:
        sighting: (P,) number over all tables.
        landmark: (P,) row of the map.
        distance: (P,) squared Mahalanobis distance of the sighting from where the landmark would
            be without it, with the price of a gap between the stretches.
        fits: (P,) whether the distance is that of a match.
        beside: (P,) whether it is too short for the sighting to be of a new landmark.
    """

    sighting: IntArray
    landmark: IntArray
    distance: Array
    fits: NDArray[np.bool_]
    beside: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Decision:
    """What became of every sighting.

    Attributes:
        match: (K,) its landmark, -1 where none is near enough or another sighting took it.
        alone: (K,) whether it lies beyond the wide gate of every landmark of its kind, or far along
            it from what was seen of it.
    """

    match: IntArray
    alone: NDArray[np.bool_]


def decide(fitted: Fitted, config: RematchConfig) -> Decision:
    """Returns the landmark of each sighting.

    The nearest pair is taken first; in one node each landmark takes one sighting.
    """
    present = fitted.problem.match
    match = np.full(len(present), UNMATCHED)
    alone = of_landmark_kinds(fitted.problem)
    taken: set[tuple[int, int]] = set()
    for pairs in pairs_by_kind(fitted, config):
        rank = pairs.distance - np.where(present[pairs.sighting] == pairs.landmark, KEEP, 0.0)
        near = np.flatnonzero(pairs.fits)
        for p in near[np.argsort(rank[near], kind="stable")].tolist():
            sighting, landmark = int(pairs.sighting[p]), int(pairs.landmark[p])
            place = (int(fitted.node[sighting]), landmark)
            if match[sighting] == UNMATCHED and place not in taken:
                match[sighting] = landmark
                taken.add(place)
        alone[pairs.sighting[pairs.beside | pairs.fits]] = False
    return Decision(match, alone)


def pairs_by_kind(fitted: Fitted, config: RematchConfig) -> Iterator[Pairs]:
    """Yields for each kind with landmarks the pairs within reach of the wide gate."""
    for first, table in fitted.problem.measurements.tables():
        model = MODELS[table.kind]
        landmarks = fitted.of_kind(table.kind)
        if model.dim_landmark and len(landmarks) and len(table):
            yield _pairs(fitted, model, table, first, landmarks, config)


def _pairs(
    fitted: Fitted,
    model: Model,
    table: Sightings,
    first: int,
    landmarks: IntArray,
    config: RematchConfig,
) -> Pairs:
    problem, dim = fitted.problem, model.dim_landmark
    row, landmark = within_reach(fitted, model, table, landmarks, config)
    pose, params = problem.pose[table.node[row]], problem.params[landmark, :dim]
    e, J_p, J_l = model.residual(pose, params, table.z[row])
    J = np.concatenate([J_p, J_l], axis=-1)
    P = fitted.minimum.pair_covariances(table.node[row], landmark)
    HPHt = J @ P @ np.swapaxes(J, -1, -2)
    own = (problem.match[first + row] == landmark) & (problem.weight[first + row] > 0.5)
    R = table.cov[row]
    S = np.where(own[:, None, None], (1.0 + LEVERAGE_FLOOR) * R - HPHt, R + HPHt)
    S = _definite(S, R)
    gap = _gaps(fitted, model, table, row, landmark)
    distance = mahalanobis(e, S) + gap_price(gap, config)
    distance[~own & (by_chance(density_of(problem, model), S, config) > CROWDED)] = np.inf
    gate, gate_new = (gate_for(gate, model.dim_z) for gate in (config.gate, config.gate_new))
    most = np.where(own, gate, np.minimum(gate, most_surprise(S)))
    beside = (distance <= gate_new) & (gap <= APART * config.gap_m)
    return Pairs(first + row, landmark, distance, distance <= most, beside)


def _gaps(
    fitted: Fitted, model: Model, table: Sightings, row: IntArray, landmark: IntArray
) -> Array:
    """Returns the distance (P,), m, of each seen stretch from the landmark's; 0 where unknown."""
    problem = fitted.problem
    pose, params = problem.pose[table.node[row]], problem.params[landmark, : model.dim_landmark]
    seen = model.extent_on_landmark(pose, params, table.z[row], table.extent[row])
    known = fitted.extent[landmark]
    gap = np.fmax(seen[:, 0], known[:, 0]) - np.fmin(seen[:, 1], known[:, 1])
    unknown = np.isnan(seen[:, 0]) | np.isnan(known[:, 0])
    return np.where(unknown, 0.0, np.maximum(gap, 0.0))


def _definite(S: Array, R: Array) -> Array:
    """Returns symmetric covariances, those with an eigenvalue lost to rounding made definite."""
    S = 0.5 * (S + np.swapaxes(S, -1, -2))
    smallest = np.linalg.eigvalsh(S)[..., 0]
    floor = LEVERAGE_FLOOR * np.linalg.eigvalsh(R)[..., 0]
    lift = np.maximum(floor - smallest, 0.0)
    return np.asarray(S + lift[..., None, None] * np.eye(S.shape[-1]))
