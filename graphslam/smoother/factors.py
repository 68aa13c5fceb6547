"""The models of this project as GTSAM factors.

A model's Jacobians are with respect to additive changes of the floor-frame pose; a `gtsam.Pose2`
moves in its own frame. The adapter here is the only place that turns one into the other, and it
checks every shape, because GTSAM does not: a wrong one crashes it or gives a wrong optimum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import gtsam
import numpy as np
from numba import njit

from graphslam.errors import BadMeasurements
from graphslam.geometry import Array
from graphslam.models import Model
from graphslam.models.odometry import odometry_residual
from graphslam.models.pose_fix import POSE_FIX

Residual = Callable[..., tuple[Array, ...]]
"""Takes the values of a factor's variables, returns the residual and a Jacobian for each."""


def pose_key(node: int) -> int:
    """Returns the GTSAM key of the pose at a node."""
    return int(gtsam.symbol("x", node))


def landmark_key(landmark: int) -> int:
    """Returns the GTSAM key of a landmark."""
    return int(gtsam.symbol("l", landmark))


def residual_factor(
    keys: Sequence[int],
    is_pose: Sequence[bool],
    dims: Sequence[int],
    residual: Residual,
    cov: Array,
) -> gtsam.CustomFactor:
    """Returns a factor for any residual whose Jacobians are additive in the floor frame.

    Args:
        keys: the variables, in the order of the residual's arguments.
        is_pose: for each variable, whether it is a `gtsam.Pose2` (else a vector).
        dims: for each variable, its dimension.
        residual: called with the variables' values ((3,) for a pose), returns the residual (d,)
            and one Jacobian (d, dim) for each variable.
        cov: (d, d) covariance of the residual.

    Raises:
        BadMeasurements: at evaluation, before GTSAM sees them, when the residual or a Jacobian has
            another shape than promised.
    """
    wanted = [(len(cov), dim) for dim in dims]
    size = (len(cov),)

    def error(factor: Any, values: gtsam.Values, H: list[Array] | None) -> Array:
        arguments = [
            _pose_array(values.atPose2(key)) if pose else values.atVector(key)
            for key, pose in zip(keys, is_pose, strict=True)
        ]
        e, *jacobians = residual(*arguments)
        if e.shape != size or [J.shape for J in jacobians] != wanted:
            shapes = [J.shape for J in jacobians]
            raise BadMeasurements(
                f"a factor returned a residual {e.shape} with Jacobians {shapes}; "
                f"promised {size} with {wanted}"
            )
        if H is not None:
            for n, (J, pose) in enumerate(zip(jacobians, is_pose, strict=True)):
                H[n] = _to_tangent(J, arguments[n][2]) if pose else J
        return e

    noise = gtsam.noiseModel.Gaussian.Covariance(np.asarray(cov, float))
    return gtsam.CustomFactor(noise, list(keys), error)


def sighting_factor(
    model: Model, z: Array, cov: Array, node: int, landmark: int = -1
) -> gtsam.CustomFactor:
    """Returns the factor of one sighting of any kind; ``landmark`` only where the kind has one.

    The residual is the model's: prediction - measurement, modulo the twin.
    """
    if model.dim_landmark:

        def residual(pose: Array, params: Array) -> tuple[Array, ...]:
            return model.residual(pose, params, z)

        keys = [pose_key(node), landmark_key(landmark)]
        return residual_factor(keys, [True, False], [3, model.dim_landmark], residual, cov)

    return fixed_sighting_factor(model, z, cov, node, np.zeros(0))


def fixed_sighting_factor(
    model: Model, z: Array, cov: Array, node: int, params: Array
) -> gtsam.CustomFactor:
    """Returns the factor of one sighting of a known landmark (l,), which is no variable."""

    def residual(pose: Array) -> tuple[Array, ...]:
        e, J_e_pose, _ = model.residual(pose, params, z)
        return e, J_e_pose

    return residual_factor([pose_key(node)], [True], [3], residual, cov)


def odometry_factor(node: int, increment: Array, cov: Array) -> gtsam.CustomFactor:
    """Returns the factor between ``node`` and the next, from a motion in the frame of ``node``."""

    def residual(pose_i: Array, pose_j: Array) -> tuple[Array, ...]:
        e, J_e_i, J_e_j = odometry_residual(pose_i, pose_j, increment)
        return e, J_e_i, J_e_j

    keys = [pose_key(node), pose_key(node + 1)]
    return residual_factor(keys, [True, True], [3, 3], residual, cov)


def start_factor(pose: Array, cov: Array) -> gtsam.CustomFactor:
    """Returns the factor that ties the first pose to the start, a pose fix like any other."""
    return sighting_factor(POSE_FIX, pose, cov, 0)


def _pose_array(pose: gtsam.Pose2) -> Array:
    return np.array((pose.x(), pose.y(), pose.theta()))


@njit(cache=True)
def _to_tangent(J, theta):  # type: ignore[no-untyped-def]
    """Returns a Jacobian (d, 3) by the floor-frame pose as one by the pose's own frame.

    Compiled: it runs twice for each factor that GTSAM linearises, and NumPy takes 20 times as long.
    """
    c, s = math.cos(theta), math.sin(theta)
    out = np.empty(J.shape)
    for k in range(len(J)):
        out[k, 0] = c * J[k, 0] + s * J[k, 1]
        out[k, 1] = c * J[k, 1] - s * J[k, 0]
        out[k, 2] = J[k, 2]
    return out
