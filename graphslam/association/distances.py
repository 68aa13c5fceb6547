"""How well sightings fit landmarks, pair by pair, as shares of the gates.

Distances are taken from residuals in the frame of the sighting, modulo the twin, never from (rho,
alpha) at the origin, where a line's rho is mostly lever arm. A landmark is known along a stretch
only: the farther from it a sighting lies, the less of the gate is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import gammainccinv

from graphslam.arrays import AnyArray
from graphslam.config import MatchingConfig
from graphslam.geometry import Array
from graphslam.measurements import IntArray
from graphslam.models.base import Model


@dataclass(frozen=True, slots=True)
class Compatibility:
    """How far sightings lie from landmarks, pair by pair.

    Attributes:
        match: (k, M) distances as shares of the gate: a pair may be a match up to 1.
        new: (k, M) the same of the second, wider gate: a sighting is new beyond 1 of all landmarks.
    """

    match: Array
    new: Array

    def among(self, possible: AnyArray) -> Compatibility:
        """Returns the same with pairs out of reach that are not ``possible`` (k, M)."""
        if possible.all():
            return self
        apart = np.where(possible, 0.0, np.inf)
        return Compatibility(self.match + apart, self.new + apart)


def same_label(label: IntArray, of_landmark: IntArray) -> AnyArray:
    """Returns (k, M) whether sightings (k,) and landmarks (M,) have one label, or one has none."""
    return labels_agree(label[:, None], of_landmark[None, :])


def labels_agree(a: IntArray, b: IntArray) -> AnyArray:
    """Returns (...) whether two labels (...) are one, or one of them is none."""
    return np.asarray((a == b) | (a < 0) | (b < 0))


def gate_for(gate: float, dim: int) -> float:
    """Returns the chi-square quantile in ``dim`` dimensions that ``gate`` is in two."""
    return float(2.0 * gammainccinv(dim / 2.0, math.exp(-gate / 2.0)))


def mahalanobis(e: Array, S: Array) -> Array:
    """Returns ``e' inv(S) e`` (...) of residuals (..., d) with covariances (..., d, d)."""
    if e.shape[-1] == 2:  # written out: a solver takes ten times as long for many tiny systems
        a, b, c = S[..., 0, 0], 0.5 * (S[..., 0, 1] + S[..., 1, 0]), S[..., 1, 1]
        x, y = e[..., 0], e[..., 1]
        return np.asarray(x * x / a + (y - b / a * x) ** 2 / (c - b * b / a))
    return np.asarray(np.einsum("...i,...i->...", e, np.linalg.solve(S, e[..., None])[..., 0]))


def compatibility(
    e: Array,
    S: Array,
    angular: tuple[bool, ...],
    config: MatchingConfig,
    gap: Array | float = 0.0,
) -> Compatibility:
    """Returns how well sightings fit landmarks, by the gates of a configuration.

    Args:
        e: (k, M, d) residuals of every sighting against every landmark, frame of the sighting.
        S: (k, M, d, d) their covariances; `nearest` has no use for them.
        angular: (d,) which entries of ``e`` are angles.
        config: method and gates.
        gap: (k, M) metres along the landmark between what was seen and what is known of it; see
            `stretch_gap`.

    Source: "nearest" is SantanaSLAM section 3.3, compared modulo the twin and in the frame of the
    sighting (as printed, half of all views start a second landmark).
    """
    beyond = np.asarray(gap) / config.gap_m
    if config.method == "nearest":
        angle = math.radians(config.nearest_angle_deg)
        limits = np.where(angular, angle, config.nearest_distance_m)
        share = np.max(np.abs(e) / limits, axis=-1) + beyond
        return Compatibility(share, share)
    dim, distance = e.shape[-1], mahalanobis(e, S)
    return Compatibility(
        distance / gate_for(config.gate, dim) + beyond,
        distance / gate_for(config.gate_new, dim) + beyond,
    )


def stretch_gap(
    model: Model, pose: Array, landmark: Array, known: Array, z: Array, extent: Array
) -> Array:
    """Returns how far (n,) seen stretches lie from known ones, m along the landmark; 0 if unknown.

    Args:
        model: of the sightings.
        pose: (n, 3) where the sightings were made, floor frame.
        landmark: (n, l) landmarks they are compared with, floor frame.
        known: (n, 2) stretches of those landmarks, m; NaN where unknown.
        z: (n, d) sightings.
        extent: (n, 2) stretches seen, in the sighting's own coordinate, m; NaN where unknown.
    """
    seen = model.extent_on_landmark(pose, landmark, z, extent)
    between = np.fmax(seen[:, 0] - known[:, 1], known[:, 0] - seen[:, 1])
    return np.asarray(np.fmax(between, 0.0))
