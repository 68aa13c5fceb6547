"""A lamp on the ceiling, or any mark with a place and an axis: ``(x, y, phi)``, phi modulo pi."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from graphslam.compiled import guvectorize
from graphslam.geometry import Array, compose_jacobians, wrap


@guvectorize(
    ["void(f8[:], f8[:], f8[:], f8[:], f8[:,:], f8[:,:])"],
    "(p),(l),(d)->(d),(d,p),(d,l)",
)
def lamp_residual(pose, landmark, z, e, J_e_pose, J_e_landmark):  # type: ignore[no-untyped-def]
    """Returns the residual of a lamp's sighting and its Jacobians, the axis modulo pi.

    Place and axis of the lamp in the robot frame, minus what was seen; of the two directions of the
    axis that nearer to the measured one.

    Args:
        pose: (..., 3) floor frame, m and rad.
        landmark: (..., 3) ``(x, y, phi)``, floor frame, m and rad, under the lamp.
        z: (..., 3) the same in the robot frame.

    Returns:
        ``e`` (..., 3) m, m and rad, prediction - measurement; ``J_e_pose`` and ``J_e_landmark``
        (..., 3, 3) for additive changes in the floor frame.

    Source: Bellini eqs. (6), (7) for the lamp instead of the pose that follows from it; (7) prints
    a plain difference where the angle is known modulo pi.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = landmark[0] - pose[0], landmark[1] - pose[1]
    x, y = c * dx + s * dy, -s * dx + c * dy
    e[0], e[1] = x - z[0], y - z[1]
    e[2] = 0.5 * wrap(2.0 * (landmark[2] - pose[2] - z[2]))
    J_e_pose[0, 0], J_e_pose[0, 1], J_e_pose[0, 2] = -c, -s, y
    J_e_pose[1, 0], J_e_pose[1, 1], J_e_pose[1, 2] = s, -c, -x
    J_e_pose[2, 0], J_e_pose[2, 1], J_e_pose[2, 2] = 0.0, 0.0, -1.0
    J_e_landmark[0, 0], J_e_landmark[0, 1], J_e_landmark[0, 2] = c, s, 0.0
    J_e_landmark[1, 0], J_e_landmark[1, 1], J_e_landmark[1, 2] = -s, c, 0.0
    J_e_landmark[2, 0], J_e_landmark[2, 1], J_e_landmark[2, 2] = 0.0, 0.0, 1.0


@njit(cache=True)
def lamp_kernel(x, y, theta, landmark, z, e, J_e_pose, J_e_landmark):  # type: ignore[no-untyped-def]
    """Fills `lamp_residual` of one sighting; see `graphslam.models.base.Compiled`."""
    lamp_residual(np.array((x, y, theta)), landmark, z, e, J_e_pose, J_e_landmark)


@dataclass(frozen=True, slots=True)
class LampModel:
    """Lamps as landmarks; see `base.Model`. A round lamp has an axis of unknown direction: state it
    with a large variance."""

    kind: str = "lamp"
    dim_z: int = 3
    dim_landmark: int = 3
    angular: tuple[bool, ...] = (False, False, True)
    noun: tuple[str, str] = ("lamp", "lamps")

    @property
    def kernel(self) -> Callable[..., None]:
        """`lamp_kernel`."""
        return lamp_kernel

    def residual(self, pose: Array, landmark: Array, z: Array) -> tuple[Array, Array, Array]:
        """Returns `lamp_residual`."""
        e, J_e_pose, J_e_landmark = lamp_residual(pose, landmark, z)
        return e, J_e_pose, J_e_landmark

    def initialise(self, pose: Array, z: Array, cov: Array) -> tuple[Array, Array, Array]:
        """Returns the lamp of one sighting, floor frame: it needs no second view."""
        return compose_jacobians(pose, z)

    def canonical(self, landmark: Array, extent: Array) -> tuple[Array, Array, Array]:
        """Returns lamps with phi in (-pi/2, pi/2]."""
        named = np.array(landmark, float).reshape(-1, 3)
        named[:, 2] = 0.5 * wrap(2.0 * named[:, 2])
        return named, extent, np.tile(np.eye(3), (len(named), 1, 1))

    def extent_on_landmark(self, pose: Array, landmark: Array, z: Array, extent: Array) -> Array:
        """Returns NaN: how far a lamp reaches is not estimated."""
        return np.full((len(z), 2), np.nan)


LAMP = LampModel()
