"""What the data determines, and what it leaves open."""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg

from graphslam.estimate import Unobserved
from graphslam.geometry import Array
from graphslam.landmarks import used_sightings
from graphslam.measurements import IntArray, LandmarkMap, Measurements

UNOBSERVED_RATIO = 0.9
"""A direction whose posterior sigma is above this part of odometry's own is not observed."""
ONE_DIRECTION = math.sin(math.radians(5.0)) ** 2
"""Ratio of the position information's eigenvalues below which all sightings point one way."""

KNOWN_SIGMA = 1e-5
"""Below this odometry itself knows the quantity (a pose just after a known start), m or rad."""


def position_information(
    measurements: Measurements, pose: Array, landmarks: LandmarkMap, match: IntArray
) -> Array:
    """Returns the information (2, 2), 1/m^2, that sightings hold on position, landmarks given.

    Args:
        measurements: the sightings.
        pose: (N, 3) where to linearise, floor frame.
        landmarks: the map to linearise at.
        match: (K,) landmark of each sighting, -1 where it is not used.
    """
    total = np.zeros((2, 2))
    for used in used_sightings(measurements, match, landmarks.params):
        table, rows = used.table, used.rows
        _, J, _ = used.model.residual(pose[table.node[rows]], used.params, table.z[rows])
        J = J[:, :, :2]
        total += np.einsum("kai,kab,kbj->ij", J, np.linalg.inv(table.cov[rows]), J)
    return total


def unobserved_directions(
    information: Array, cov_last: Array, cov_odometry: Array
) -> tuple[Unobserved, ...]:
    """Returns the directions of the last pose that the sightings do not fix.

    A direction of the position is unobserved where its posterior sigma is above `UNOBSERVED_RATIO`
    of odometry's own, or where it is the one that all sightings leave open (`ONE_DIRECTION`): lines
    of one direction correct the heading, and with it shrink odometry's error along themselves
    without ever measuring it.

    Args:
        information: (2, 2) as by `position_information`.
        cov_last: (3, 3) posterior covariance of the last pose, floor frame.
        cov_odometry: (3, 3) the same of odometry alone.
    """
    found = []
    ratios, vectors = scipy.linalg.eigh(cov_last[:2, :2], cov_odometry[:2, :2])
    if ratios[0] > UNOBSERVED_RATIO**2:
        worst = [math.sqrt(np.linalg.eigvalsh(c[:2, :2])[1]) for c in (cov_last, cov_odometry)]
        found.append(Unobserved("position", (0.0, 0.0), worst[0], worst[1]))
    elif ratios[1] > UNOBSERVED_RATIO**2:
        axis = vectors[:, 1] / np.linalg.norm(vectors[:, 1])
        found.append(_position(axis, cov_last, cov_odometry))
    strength, axes = np.linalg.eigh(information)
    if not found and strength[1] > 0 and strength[0] < ONE_DIRECTION * strength[1]:
        found.append(_position(axes[:, 0], cov_last, cov_odometry))
    found = [entry for entry in found if entry.sigma_odometry > KNOWN_SIGMA]
    sigma, sigma_odometry = math.sqrt(cov_last[2, 2]), math.sqrt(cov_odometry[2, 2])
    if sigma > UNOBSERVED_RATIO * sigma_odometry and sigma_odometry > KNOWN_SIGMA:
        found.append(Unobserved("heading", (0.0, 0.0), sigma, sigma_odometry))
    return tuple(found)


def _position(direction: Array, cov_last: Array, cov_odometry: Array) -> Unobserved:
    x, y = float(direction[0]), float(direction[1])
    sigmas = [math.sqrt(direction @ cov[:2, :2] @ direction) for cov in (cov_last, cov_odometry)]
    return Unobserved("position", (x, y), sigmas[0], sigmas[1])
