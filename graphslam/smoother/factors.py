"""The models of this project as GTSAM factors.

A model's Jacobians are with respect to additive changes of the floor-frame pose; a `gtsam.Pose2`
moves in its own frame. The adapter here is the only place that turns one into the other.

GTSAM checks no shape: a wrong one crashes it or gives a wrong optimum. `residual_factor`, for any
residual, checks at every call. A model that is compiled fills arrays that were made here, in the
right shape, once for all factors of a kind: they lie in GTSAM's own memory, and a call costs a
third.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import gtsam
import numpy as np
from numba import njit

from graphslam.errors import BadMeasurements
from graphslam.geometry import Array
from graphslam.models import Model
from graphslam.models.base import Compiled
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

    return _factor(error, keys, cov)


def sighting_factor(
    model: Model, z: Array, cov: Array, node: int, landmark: int = -1
) -> gtsam.CustomFactor:
    """Returns the factor of one sighting of any kind; ``landmark`` only where the kind has one.

    The residual is the model's: prediction - measurement, modulo the twin.

    Raises:
        BadMeasurements: the sighting or its covariance has another shape than the model's.
    """
    if not model.dim_landmark:
        return fixed_sighting_factor(model, z, cov, node, np.zeros(0))
    pose_at, landmark_at = keys = (pose_key(node), landmark_key(landmark))
    if isinstance(model, Compiled):
        z = _checked(model, z, cov)
        return _factor(_landmark_error(model, pose_at, landmark_at, z), keys, cov)

    def residual(pose: Array, params: Array) -> tuple[Array, ...]:
        return model.residual(pose, params, z)

    return residual_factor(keys, [True, False], [3, model.dim_landmark], residual, cov)


def fixed_sighting_factor(
    model: Model, z: Array, cov: Array, node: int, params: Array
) -> gtsam.CustomFactor:
    """Returns the factor of one sighting of a known landmark (l,), which is no variable.

    Raises:
        BadMeasurements: the sighting or its covariance has another shape than the model's.
    """
    key = pose_key(node)
    if isinstance(model, Compiled):
        _check_landmark(model, params)
        z, params = _checked(model, z, cov), np.array(params, float)
        return _factor(_fixed_error(model, key, params, z), (key,), cov)

    def residual(pose: Array) -> tuple[Array, ...]:
        e, J_e_pose, _ = model.residual(pose, params, z)
        return e, J_e_pose

    return residual_factor([key], [True], [3], residual, cov)


def odometry_factor(node: int, increment: Array, cov: Array) -> gtsam.CustomFactor:
    """Returns the factor between ``node`` and the next, from a motion in the frame of ``node``."""
    i, j = keys = (pose_key(node), pose_key(node + 1))
    return _factor(_odometry_error(i, j, np.array(increment, float)), keys, cov)


def start_factor(pose: Array, cov: Array) -> gtsam.CustomFactor:
    """Returns the factor that ties the first pose to the start, a pose fix like any other."""
    return sighting_factor(POSE_FIX, pose, cov, 0)


def _factor(error: Any, keys: Sequence[int], cov: Array) -> gtsam.CustomFactor:
    noise = gtsam.noiseModel.Gaussian.Covariance(np.asarray(cov, float))
    return gtsam.CustomFactor(noise, list(keys), error)


def _checked(model: Model, z: Array, cov: Array) -> Array:
    """Returns a copy of a sighting whose shape, and its covariance's, are the model's."""
    d = model.dim_z
    if z.shape != (d,) or cov.shape != (d, d):
        raise BadMeasurements(
            f"a sighting of kind {model.kind} has {d} numbers and a covariance {(d, d)}; "
            f"here they are {z.shape} and {cov.shape}"
        )
    return np.array(z, float)


def _check_landmark(model: Compiled, params: Array) -> None:
    size = model.dim_landmark
    if params.shape != (size,):
        raise BadMeasurements(
            f"a landmark of kind {model.kind} has {size} parameters; here it has {len(params)}"
        )


class _Room(threading.local):
    """Where the factors of one shape put what they find, for each thread its own.

    Attributes:
        e: (d,) residual.
        blocks: its Jacobians (d, dim), which lie in ``H``'s memory.
        H: what GTSAM takes over with one assignment; one by one they cost ten times as much.
    """

    def __init__(self, d: int, dims: tuple[int, ...]) -> None:
        self.e = np.zeros(d)
        self.H = gtsam.JacobianVector([np.zeros((d, dim)) for dim in dims])
        self.blocks = tuple(self.H[n] for n in range(len(dims)))
        assert all(np.shares_memory(J, self.H[n]) for n, J in enumerate(self.blocks))


_room = lru_cache(maxsize=None)(_Room)
_ALL = slice(None)


def _landmark_error(model: Compiled, pose: int, landmark: int, z: Array) -> Any:
    """Returns what GTSAM calls for a sighting of a landmark that is a variable."""
    kernel, size = model.kernel, model.dim_landmark
    room = _room(model.dim_z, (3, size))

    def error(factor: Any, values: gtsam.Values, H: Any) -> Array:
        here, params = values.atPose2(pose), values.atVector(landmark)
        if len(params) != size:
            _check_landmark(model, params)
        theta, e, (J_pose, J_landmark) = here.theta(), room.e, room.blocks
        kernel(here.x(), here.y(), theta, params, z, e, J_pose, J_landmark)
        if H is not None:
            _turn(J_pose, theta)
            H[_ALL] = room.H
        return e

    return error


def _fixed_error(model: Compiled, pose: int, params: Array, z: Array) -> Any:
    """Returns what GTSAM calls for a sighting of a known landmark, or of none."""
    kernel, room = model.kernel, _room(model.dim_z, (3,))
    J_landmark = np.zeros((model.dim_z, model.dim_landmark), order="F")  # written, never read

    def error(factor: Any, values: gtsam.Values, H: Any) -> Array:
        here = values.atPose2(pose)
        theta, e, (J_pose,) = here.theta(), room.e, room.blocks
        kernel(here.x(), here.y(), theta, params, z, e, J_pose, J_landmark)
        if H is not None:
            _turn(J_pose, theta)
            H[_ALL] = room.H
        return e

    return error


def _odometry_error(pose_i: int, pose_j: int, increment: Array) -> Any:
    """Returns what GTSAM calls for a motion between two poses."""
    room = _room(3, (3, 3))

    def error(factor: Any, values: gtsam.Values, H: Any) -> Array:
        i, j = values.atPose2(pose_i), values.atPose2(pose_j)
        e, (J_i, J_j) = room.e, room.blocks
        _odometry(i.x(), i.y(), i.theta(), j.x(), j.y(), j.theta(), increment, e, J_i, J_j)
        if H is not None:
            H[_ALL] = room.H
        return e

    return error


@njit(cache=True)
def _odometry(x_i, y_i, theta_i, x_j, y_j, theta_j, increment, e, J_i, J_j):  # type: ignore[no-untyped-def]
    """Fills the residual between two poses and its Jacobians by their own frames."""
    pose_i, pose_j = np.array((x_i, y_i, theta_i)), np.array((x_j, y_j, theta_j))
    odometry_residual(pose_i, pose_j, increment, e, J_i, J_j)
    _turn(J_i, theta_i)
    _turn(J_j, theta_j)


def _pose_array(pose: gtsam.Pose2) -> Array:
    return np.array((pose.x(), pose.y(), pose.theta()))


@njit(cache=True)
def _turn(J, theta):  # type: ignore[no-untyped-def]
    """Turns a Jacobian (d, 3) by the floor-frame pose into one by the pose's own frame."""
    c, s = math.cos(theta), math.sin(theta)
    for k in range(len(J)):
        x, y = J[k, 0], J[k, 1]
        J[k, 0], J[k, 1] = c * x + s * y, c * y - s * x


def _to_tangent(J: Array, theta: float) -> Array:
    """Returns `_turn` of a copy."""
    out = np.array(J, float)
    _turn(out, theta)
    return out
