"""A pose given directly in the floor frame: a start, an overhead camera, a survey."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graphslam.geometry import Array, wrap


@dataclass(frozen=True, slots=True)
class PoseFixModel:
    """A sensor that reads ``(x, y, theta)`` itself and has no landmarks; see `base.Model`."""

    kind: str = "pose_fix"
    dim_z: int = 3
    dim_landmark: int = 0
    angular: tuple[bool, ...] = (False, False, True)
    noun: tuple[str, str] = ("pose", "poses")

    def residual(self, pose: Array, landmark: Array, z: Array) -> tuple[Array, Array, Array]:
        """Returns ``pose - z`` with the angle wrapped, and the identity as its Jacobian.

        Source: Atali section 4, the measurement y = C x with C = I.
        """
        e = np.asarray(pose, float) - z
        e[..., 2] = wrap(e[..., 2])
        J_e_pose = np.broadcast_to(np.eye(3), (*e.shape, 3)).copy()
        return e, J_e_pose, np.zeros((*e.shape, 0))

    def initialise(self, pose: Array, z: Array, cov: Array) -> None:
        """Returns None: this sensor has no landmarks."""
        return None

    def canonical(self, landmark: Array, extent: Array) -> tuple[Array, Array, Array]:
        """Returns the (empty) input."""
        return landmark, extent, np.zeros((len(landmark), 0, 0))

    def extent_on_landmark(self, pose: Array, landmark: Array, z: Array, extent: Array) -> Array:
        """Returns NaN: a pose has no stretch."""
        return np.full((len(z), 2), np.nan)


POSE_FIX = PoseFixModel()
