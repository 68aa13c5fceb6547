"""Odometry alone: the baseline of every comparison."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from graphslam.estimate import Estimate, Unobserved
from graphslam.geometry import Array, rotation, wrap
from graphslam.information import unobserved_directions
from graphslam.landmarks import empty_map
from graphslam.measurements import Measurements
from graphslam.models.odometry import transition


def integrate(start: Array, increment: Array) -> Array:
    """Returns the poses (N, 3) that increments (N-1, 3) lead to from ``start`` (3,)."""
    theta = start[2] + np.concatenate([[0.0], np.cumsum(increment[:, 2])])
    steps = (rotation(theta[:-1]) @ increment[:, :2, None])[..., 0]
    position = start[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.column_stack([position, wrap(theta)])


def carried(pose: Array, start_cov: Array, increment: Array, noise: Array) -> tuple[Array, Array]:
    """Returns the poses (N, 3) that increments lead to, and their covariances (N, 3, 3).

    Args:
        pose: (3,) where they begin, floor frame.
        start_cov: (3, 3) its covariance, floor frame.
        increment: (N-1, 3) motions, each in the frame of the pose before it.
        noise: (N-1, 3, 3) their covariances, same frames.

    Source: SantanaSLAM eq. (2).
    """
    path = integrate(pose, increment)
    F, Q, _ = transition(path[:-1], path[1:], increment, noise)
    cov = np.empty((len(path), 3, 3))
    cov[0] = start_cov
    for i in range(len(F)):
        cov[i + 1] = F[i] @ cov[i] @ F[i].T + Q[i]
    return path, 0.5 * (cov + np.swapaxes(cov, 1, 2))


def propagate(measurements: Measurements) -> tuple[Array, Array]:
    """Returns dead-reckoned poses (N, 3) and their covariances (N, 3, 3), floor frame."""
    odometry, start = measurements.odometry, measurements.start_pose
    return carried(start, measurements.start_cov, odometry.increment, odometry.cov)


def dead_reckoning(measurements: Measurements) -> Estimate:
    """Returns the path by odometry alone, with its covariance and no map."""
    pose, cov = propagate(measurements)
    unobserved = unobserved_directions(np.zeros((2, 2)), cov[-1], cov[-1])
    return path_alone("odometry", measurements, pose, cov, unobserved=unobserved)


def path_alone(
    method: str,
    measurements: Measurements,
    pose: Array,
    cov: Array,
    used: Array | None = None,
    unobserved: tuple[Unobserved, ...] = (),
    counts: Mapping[str, int] | None = None,
) -> Estimate:
    """Returns the estimate of a method that looks back at nothing and maps nothing.

    Args:
        method: its name.
        measurements: what it was estimated from.
        pose: (N, 3) at the nodes, floor frame.
        cov: (N, 3, 3) their covariances, floor frame.
        used: (K,) which sightings it rests on; None for none of them.
        unobserved: directions that they do not fix.
        counts: what happened to sightings, by name.
    """
    count = measurements.sighting_count
    return Estimate(
        method=method,
        causal=True,
        t=measurements.t,
        pose=pose,
        cov_floor=cov,
        map=empty_map(),
        cov_joint=cov[-1],
        match=np.full(count, -1),
        used=np.zeros(count, bool) if used is None else used,
        nis=np.full(count, np.nan),
        weight=np.ones(count),
        unobserved=unobserved,
        counts=counts or {},
    )
