"""A point on the floor plan (a cone, a beacon) of which only the direction is seen."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from graphslam.compiled import guvectorize
from graphslam.geometry import Array, wrap

SURE_RANGE = 0.06
"""A point is started once its largest standard deviation is this share of its distance: with 0.12
the filter is linearised so far off that some runs are overconfident and map a point twice."""
LEAST_PARALLAX = math.radians(4.0)
"""Directions to a point must differ by this before its distance is believed at all."""
MOST_SWING = math.radians(12.0)
"""Between two sightings of a point not started yet its direction turns by less than this."""
REFINEMENTS = 6


@guvectorize(
    ["void(f8[:], f8[:], f8[:], f8[:], f8[:,:], f8[:,:])"],
    "(p),(l),(d)->(d),(d,p),(d,l)",
)
def bearing_residual(pose, landmark, z, e, J_e_pose, J_e_landmark):  # type: ignore[no-untyped-def]
    """Returns the residual of a bearing and its Jacobians, wrapped.

    ``e = wrap(atan2(l_y - y, l_x - x) - theta - z)``. On the point itself the direction is not
    defined: it is taken as the heading, and the Jacobians by the position as 0.

    Args:
        pose: (..., 3) floor frame, m and rad.
        landmark: (..., 2) the point ``(x, y)``, floor frame, m.
        z: (..., 1) direction in the robot frame, rad, counter-clockwise from its x axis.

    Returns:
        ``e`` (..., 1) rad, prediction - measurement; ``J_e_pose`` (..., 1, 3) and ``J_e_landmark``
        (..., 1, 2) for additive changes in the floor frame.

    Source: Kato eqs. (1), (2) with atan2, and x - W where (2) prints x + W.
    """
    dx, dy = landmark[0] - pose[0], landmark[1] - pose[1]
    squared = dx * dx + dy * dy
    inverse = 1.0 / squared if squared > 0.0 else 0.0
    e[0] = wrap(math.atan2(dy, dx) - pose[2] - z[0])
    J_e_landmark[0, 0], J_e_landmark[0, 1] = -dy * inverse, dx * inverse
    J_e_pose[0, 0], J_e_pose[0, 1], J_e_pose[0, 2] = dy * inverse, -dx * inverse, -1.0


@njit(cache=True)
def bearing_kernel(x, y, theta, landmark, z, e, J_e_pose, J_e_landmark):  # type: ignore[no-untyped-def]
    """Fills `bearing_residual` of one sighting; see `graphslam.models.base.Compiled`."""
    bearing_residual(np.array((x, y, theta)), landmark, z, e, J_e_pose, J_e_landmark)


@dataclass(frozen=True, slots=True)
class BearingModel:
    """Points seen as directions; see `base.Model` and, for how they start, `base.Delayed`."""

    kind: str = "bearing"
    dim_z: int = 1
    dim_landmark: int = 2
    angular: tuple[bool, ...] = (True,)
    noun: tuple[str, str] = ("point", "points")

    @property
    def kernel(self) -> Callable[..., None]:
        """`bearing_kernel`."""
        return bearing_kernel

    def residual(self, pose: Array, landmark: Array, z: Array) -> tuple[Array, Array, Array]:
        """Returns `bearing_residual`."""
        e, J_e_pose, J_e_landmark = bearing_residual(pose, landmark, z)
        return e, J_e_pose, J_e_landmark

    def initialise(self, pose: Array, z: Array, cov: Array) -> None:
        """Returns None: one direction fixes no point. See `initialise_from`."""
        return None

    def initialise_from(
        self, pose: Array, pose_cov: Array | None, z: Array, cov: Array
    ) -> Array | None:
        """Returns the point (2,) where directions cross, or None while their parallax is small.

        The rays' least-squares crossing, refined by Gauss-Newton on the directions. It is believed
        once it lies in front of every ray and its largest standard deviation, noise of the poses
        included, is below `SURE_RANGE` of its distance from the last pose.

        Args:
            pose: (k, 3) where the sightings were made, floor frame.
            pose_cov: (3 k, 3 k) covariance of those poses relative to the last, or None: exact.
            z: (k, 1) directions, rad.
            cov: (k, 1, 1) their covariances, rad².
        """
        direction = pose[:, 2] + z[:, 0]
        turned = wrap(direction - direction[0])
        if np.ptp(turned) < LEAST_PARALLAX:
            return None
        normal = np.column_stack([-np.sin(direction), np.cos(direction)])
        point = np.linalg.lstsq(normal, np.sum(normal * pose[:, :2], axis=1), rcond=None)[0]
        S = np.diag(cov[:, 0, 0])
        for _ in range(REFINEMENTS):
            e, J_pose, J = self.residual(pose, point, z)
            if pose_cov is not None:
                J_all = np.zeros((len(z), 3 * len(z)))
                for i, row in enumerate(J_pose[:, 0]):
                    J_all[i, 3 * i : 3 * i + 3] = row
                S = np.diag(cov[:, 0, 0]) + J_all @ pose_cov @ J_all.T
            weighted = np.linalg.solve(S, J[:, 0])
            information = J[:, 0].T @ weighted
            if not np.linalg.cond(information) < 1e12:
                return None
            point = point - np.linalg.solve(information, weighted.T @ e[:, 0])
        e = self.residual(pose, point, z)[0]
        distance = math.hypot(*(point - pose[-1, :2]))
        sigma = 1.0 / math.sqrt(np.linalg.eigvalsh(information)[0])
        in_front = bool(np.all(np.abs(e) < 0.5 * math.pi))
        return point if in_front and sigma < SURE_RANGE * distance else None

    def unlike(self, pose: Array, z: Array, new_pose: Array, new_z: Array) -> float:
        """Returns how far two directions differ on the floor, as a share of `MOST_SWING`."""
        turn = wrap(pose[2] + z[0] - new_pose[2] - new_z[0])
        return float(abs(turn)) / MOST_SWING

    def canonical(self, landmark: Array, extent: Array) -> tuple[Array, Array, Array]:
        """Returns the input: a point has one name."""
        return landmark, extent, np.tile(np.eye(2), (len(landmark), 1, 1))

    def extent_on_landmark(self, pose: Array, landmark: Array, z: Array, extent: Array) -> Array:
        """Returns NaN: a point has no stretch."""
        return np.full((len(z), 2), np.nan)


BEARING = BearingModel()
