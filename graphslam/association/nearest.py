"""Matching one node's sightings to landmarks: by gate, by fixed thresholds, or by known identity.

All three are one assignment over a table of distances, and differ only in the distance. Distances
are taken from residuals in the frame of the sighting, modulo the twin, never from (rho, alpha) at
the origin, where a line's rho is mostly lever arm.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammainccinv

from graphslam.config import MatchingConfig
from graphslam.geometry import Array
from graphslam.measurements import IntArray

NEW = -2
DROPPED = -1


def gate_for(gate: float, dim: int) -> float:
    """Returns the chi-square quantile in ``dim`` dimensions that ``gate`` is in two."""
    return float(2.0 * gammainccinv(dim / 2.0, math.exp(-gate / 2.0)))


def mahalanobis(e: Array, S: Array) -> Array:
    """Returns ``e' inv(S) e`` (...) of residuals (..., d) with covariances (..., d, d)."""
    return np.asarray(np.einsum("...i,...i->...", e, np.linalg.solve(S, e[..., None])[..., 0]))


def match(
    e: Array,
    S: Array,
    truth: IntArray,
    identity: IntArray,
    angular: tuple[bool, ...],
    config: MatchingConfig,
) -> IntArray:
    """Returns for each sighting of a node (k,) its landmark's row, `NEW`, or `DROPPED`.

    Args:
        e: (k, M, d) residuals of every sighting against every landmark, frame of the sighting.
        S: (k, M, d, d) their covariances.
        truth: (k,) true identity of each sighting, -1 unknown; used by "known" only.
        identity: (M,) true identity that each landmark was started with; used by "known" only.
        angular: (d,) which entries of ``e`` are angles.
        config: method and thresholds.

    Source: "nearest" is SantanaSLAM section 3.3, compared modulo the twin and in the frame of the
    sighting (as printed, half of all views start a second landmark).
    """
    if config.method == "known":
        return _match_known(truth, identity)
    if config.method == "nearest":
        angle = math.radians(config.nearest_angle_deg)
        limits = np.where(angular, angle, config.nearest_distance_m)
        return assign(np.max(np.abs(e) / limits, axis=-1), 1.0, 1.0)
    dim = e.shape[-1]
    return assign(mahalanobis(e, S), gate_for(config.gate, dim), gate_for(config.gate_new, dim))


def _match_known(truth: IntArray, identity: IntArray) -> IntArray:
    same = truth[:, None] == identity[None, :]
    found = (
        np.where(same.any(axis=1), same.argmax(axis=1), NEW) if len(identity) else truth * 0 + NEW
    )
    return np.where(truth < 0, DROPPED, found)


def assign(distance: Array, gate: float, gate_new: float) -> IntArray:
    """Returns for each sighting (k,) its landmark, `NEW`, or `DROPPED`.

    The nearest pair is taken first; each landmark takes one sighting. A sighting that is left over
    starts a landmark only where it lies beyond ``gate_new`` of *every* landmark; one in between, or
    second on a landmark that is taken, is dropped.

    Args:
        distance: (k, M) distances.
        gate: largest distance of a match.
        gate_new: distance from all landmarks beyond which a sighting is new.
    """
    result = np.full(len(distance), NEW)
    if distance.shape[1]:
        result[distance.min(axis=1) <= gate_new] = DROPPED
    pairs = np.argwhere(distance <= gate)
    taken: set[int] = set()
    for row, landmark in pairs[np.argsort(distance[tuple(pairs.T)], kind="stable")]:
        if result[row] < 0 and landmark not in taken:
            result[row] = landmark
            taken.add(int(landmark))
    return result
