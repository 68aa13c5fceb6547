"""A straight line on the floor, ``(rho, alpha)``, seen from the robot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from graphslam import geometry
from graphslam.compiled import guvectorize
from graphslam.geometry import Array, predict_line, wrap


@guvectorize(
    ["void(f8[:], f8[:], f8[:], f8[:], f8[:,:], f8[:,:])"],
    "(p),(l),(d)->(d),(d,p),(d,l)",
)
def line_residual(pose, landmark, z, e, J_e_pose, J_e_landmark):  # type: ignore[no-untyped-def]
    """Returns the residual of a line sighting and its Jacobians, modulo the twin.

    ``e = (sign * rho_hat - rho_z, wrap(alpha_hat - alpha_z))`` where the sign and the half turn are
    those of the twin whose angle is nearer to the measured one.

    Args:
        pose: (..., 3) floor frame, m and rad.
        landmark: (..., 2) ``(rho, alpha)``, floor frame; need not be canonical.
        z: (..., 2) ``(rho, alpha)``, robot frame; need not be canonical.

    Returns:
        ``e`` (..., 2) m and rad, prediction - measurement; ``J_e_pose`` (..., 2, 3) and
        ``J_e_landmark`` (..., 2, 2) for additive changes in the floor frame.

    Source: SantanaSLAM eqs. (25), (26) in the robot frame; (27) with the landmark block corrected:
    printed ``[[1, 0], [0, -1]]``, right ``[[s, s (x sin a - y cos a)], [0, 1]]``; SantanaLoc (29),
    (30) print a third entry in the rho row where 0 is right.
    """
    x, y, alpha = pose[0], pose[1], landmark[1]
    c, s = math.cos(alpha), math.sin(alpha)
    rho_hat, alpha_hat = predict_line(x, y, pose[2], landmark[0], alpha)
    sign, d_alpha = 1.0, wrap(alpha_hat - z[1])
    if abs(d_alpha) > 0.5 * math.pi:
        sign, d_alpha = -1.0, wrap(d_alpha + math.pi)
    e[0], e[1] = sign * rho_hat - z[0], d_alpha
    J_e_pose[0, 0], J_e_pose[0, 1], J_e_pose[0, 2] = -sign * c, -sign * s, 0.0
    J_e_pose[1, 0], J_e_pose[1, 1], J_e_pose[1, 2] = 0.0, 0.0, -1.0
    J_e_landmark[0, 0], J_e_landmark[0, 1] = sign, sign * (x * s - y * c)
    J_e_landmark[1, 0], J_e_landmark[1, 1] = 0.0, 1.0


@njit(cache=True)
def line_kernel(x, y, theta, landmark, z, e, J_e_pose, J_e_landmark):  # type: ignore[no-untyped-def]
    """Fills `line_residual` of one sighting; see `graphslam.models.base.Compiled`."""
    line_residual(np.array((x, y, theta)), landmark, z, e, J_e_pose, J_e_landmark)


@dataclass(frozen=True, slots=True)
class LineModel:
    """Floor lines as landmarks; see `graphslam.models.base.Model`."""

    kind: str = "line"
    dim_z: int = 2
    dim_landmark: int = 2
    angular: tuple[bool, ...] = (False, True)
    noun: tuple[str, str] = ("line", "lines")
    linear_in: tuple[int, ...] = (0,)

    @property
    def kernel(self) -> Callable[..., None]:
        """`line_kernel`."""
        return line_kernel

    def residual(self, pose: Array, landmark: Array, z: Array) -> tuple[Array, Array, Array]:
        """Returns `line_residual`."""
        e, J_e_pose, J_e_landmark = line_residual(pose, landmark, z)
        return e, J_e_pose, J_e_landmark

    def initialise(self, pose: Array, z: Array, cov: Array) -> tuple[Array, Array, Array]:
        """Returns the floor line of one sighting with its Jacobians: a line needs no second view.

        Source: SantanaSLAM eq. (25) solved for the landmark.
        """
        line = geometry.line_to_floor(z, pose)
        c, s = math.cos(line[1]), math.sin(line[1])
        along = float(-pose[0] * s + pose[1] * c)  # the robot's own position along the line
        J_pose = np.array([[c, s, along], [0.0, 0.0, 1.0]])
        J_z = np.array([[1.0, along], [0.0, 1.0]])
        return line, J_pose, J_z

    def canonical(self, landmark: Array, extent: Array) -> tuple[Array, Array, Array]:
        """Returns lines with rho >= 0, alpha in (-pi, pi]; a flipped extent is (-max, -min)."""
        line = np.column_stack([landmark[:, 0], wrap(landmark[:, 1])]).reshape(-1, 2)
        keep = geometry.is_canonical(line)
        J = np.zeros((len(line), 2, 2))
        J[:, 0, 0] = np.where(keep, 1.0, -1.0)
        J[:, 1, 1] = 1.0
        line = np.where(keep[:, None], line, geometry.twin(line))
        return line, np.where(keep[:, None], extent, -extent[:, ::-1]), J

    def ends(self, line: Array, extent: Array) -> Array:
        """Returns both ends (..., 2, 2) of stretches (..., 2) of lines (..., 2)."""
        return geometry.points_on_line(line[..., None, :], extent)

    def extent_on_landmark(self, pose: Array, landmark: Array, z: Array, extent: Array) -> Array:
        """Returns both ends of the seen stretch, projected on the landmark."""
        ends = geometry.points_on_line(z[:, None, :], extent)
        floor = geometry.transform_points(pose[:, None, :], ends)
        return np.sort(geometry.position_along(landmark[:, None, :], floor), axis=1)


LINE = LineModel()
