"""The end of every estimator: the map under its one name, and what the data left open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from graphslam.arrays import AnyArray
from graphslam.baseline import carried, propagate
from graphslam.estimate import Stretch, Unobserved
from graphslam.geometry import Array
from graphslam.information import position_information, unobserved_directions
from graphslam.landmarks import finish_map
from graphslam.measurements import IntArray, LandmarkMap, Measurements

GAP_M = 5.0
"""A way without any sighting that counts is named from this length on, m."""


@dataclass(frozen=True, slots=True)
class Ending:
    """What estimators of all kinds return alike.

    Attributes:
        map: canonical.
        cov_joint: (3 + L, 3 + L) covariance of last pose and map, floor frame.
        unobserved: directions of the last pose and parts of the way that the sightings do not fix.
    """

    map: LandmarkMap
    cov_joint: Array
    unobserved: tuple[Unobserved, ...]


def end(
    measurements: Measurements,
    pose: Array,
    cov: Array,
    kinds: Sequence[str],
    params: Array,
    match: IntArray,
    used: AnyArray,
    cov_joint: Array,
) -> Ending:
    """Returns map, joint covariance, and what the sightings do not fix.

    Args:
        measurements: what the estimate was made from.
        pose: (N, 3) its path, floor frame.
        cov: (N, 3, 3) covariances of the path, floor frame.
        kinds: (M,) kind of each landmark.
        params: (M, l) estimated parameters, padded with NaN, not yet canonical.
        match: (K,) landmark of each sighting, -1 where it has none.
        used: (K,) whether each sighting counts.
        cov_joint: (3 + L, 3 + L) covariance of last pose and ``params``, floor frame.
    """
    landmarks, joint = finish_map(measurements, pose, kinds, params, match, cov_joint)
    information = position_information(measurements, pose, landmarks, match)
    _, cov_odometry = propagate(measurements)
    directions = unobserved_directions(information, joint[:3, :3], cov_odometry[-1])
    gaps = ways_without_sightings(measurements, pose, cov, used)
    return Ending(landmarks, joint, (*directions, *gaps))


def ways_without_sightings(
    measurements: Measurements, pose: Array, cov: Array, used: AnyArray
) -> tuple[Unobserved, ...]:
    """Returns the ways of `GAP_M` and more on which no sighting counts, both ends of the run too.

    There the position is odometry's. None where no sighting counts at all: then the whole position
    is not observed, and said to be.

    Args:
        measurements: sightings and odometry.
        pose: (N, 3) floor frame.
        cov: (N, 3, 3) its covariances, floor frame.
        used: (K,) whether each sighting counts.
    """
    nodes = [table.node[used[first : first + len(table)]] for first, table in measurements.tables()]
    seen = np.unique(np.concatenate([np.zeros(0, np.int64), *nodes]))
    if not len(seen):
        return ()
    ends = np.unique(np.concatenate([[0], seen, [len(pose) - 1]]))
    driven = measurements.driven()
    long = np.flatnonzero(np.diff(driven[ends]) >= GAP_M)
    return tuple(_way(measurements, pose, cov, driven, *ends[k : k + 2]) for k in long)


def _way(
    measurements: Measurements, pose: Array, cov: Array, driven: Array, first: int, last: int
) -> Unobserved:
    t = measurements.t - measurements.t[0]
    stretch = Stretch(
        from_s=float(t[first]),
        to_s=float(t[last]),
        from_m=float(driven[first]),
        to_m=float(driven[last]),
        from_xy=(float(pose[first, 0]), float(pose[first, 1])),
        to_xy=(float(pose[last, 0]), float(pose[last, 1])),
        poses=int(last - first) - 1,
    )
    increment, noise = measurements.odometry.increment, measurements.odometry.cov
    _, drift = carried(pose[first], np.zeros((3, 3)), increment[first:last], noise[first:last])
    spread = np.trace(cov[first : last + 1, :2, :2], axis1=1, axis2=2)
    sigma, sigma_odometry = float(spread.max()), float(np.trace(drift[-1, :2, :2]))
    return Unobserved("way", (0.0, 0.0), math.sqrt(sigma), math.sqrt(sigma_odometry), stretch)
