"""How far odometry may be off between any two nodes of a path."""

from __future__ import annotations

import numpy as np

from graphslam.association import mahalanobis
from graphslam.geometry import Array, between, rotation, wrap
from graphslam.line_maps.alignment import Alignment
from graphslam.measurements import IntArray, Odometry
from graphslam.models.odometry import transition


class Spread:
    """Covariances of poses relative to each other, by odometry alone: whatever was matched.

    Attributes:
        pose: (N, 3) path, floor frame.
        total: (N, 3, 3) sums of all increments' covariances, each as a motion about the origin of
            the floor frame.
        slips: (N, 3, 3) the same sums if the robot slipped at every node.
    """

    def __init__(self, pose: Array, odometry: Odometry, slip: Array | None = None) -> None:
        """Sums up what odometry may be off by along a path.

        Args:
            pose: (N, 3) path, floor frame.
            odometry: increments and their covariances.
            slip: (3,) standard deviations, m, m, rad, of a slip that may have happened once between
                any two nodes, nobody knows where; None for none.
        """
        self.pose = pose
        _, Q, _ = transition(pose[:-1], pose[1:], odometry.increment, odometry.cov)
        A = _about(-pose[1:, :2])
        self.total = _summed(A @ Q @ _T(A))
        once = np.zeros(3) if slip is None else slip
        self.slips = _summed(A @ np.diag(np.square(once)) @ _T(A))

    def cov(self, i: IntArray, j: IntArray) -> Array:
        """Returns the covariances (..., 3, 3) of nodes j as seen from nodes i, floor frame."""
        A = _about(self.pose[j, :2])
        early, late = np.minimum(i, j), np.maximum(i, j)
        between = np.maximum(late - early, 1)[..., None, None]
        once = (self.slips[late] - self.slips[early]) / between
        return np.asarray(A @ (self.total[late] - self.total[early] + once) @ _T(A))

    def relative(self, i: int, j: int) -> tuple[Array, Array]:
        """Returns the pose (3,) of node j in the frame of node i, and its covariance (3, 3)."""
        turn = np.eye(3)
        turn[:2, :2] = rotation(-self.pose[i, 2])
        cov = turn @ self.cov(np.asarray(i), np.asarray(j)) @ turn.T
        return between(self.pose[i], self.pose[j]), np.asarray(cov)

    def apart(self, i: IntArray, j: IntArray, reach: float) -> Array:
        """Returns by how many standard deviations nodes (k,) are farther apart than ``reach``, m.

        Taken along the straight way between them; 0 where they are no farther apart.
        """
        way = self.pose[j, :2] - self.pose[i, :2]
        length = np.hypot(way[:, 0], way[:, 1])
        toward = way / np.maximum(length, 1e-9)[:, None]
        variance = np.einsum("ka,kab,kb->k", toward, self.cov(i, j)[:, :2, :2], toward)
        beyond = np.maximum(length - reach, 0.0)
        return np.asarray(beyond / np.sqrt(np.maximum(variance, 1e-12)))

    def distance(self, i: int, j: int, alignment: Alignment) -> float:
        """Returns the squared Mahalanobis distance of a motion between nodes from odometry's."""
        motion, cov = self.relative(i, j)
        e = alignment.motion - motion
        return float(mahalanobis(np.array([e[0], e[1], wrap(e[2])]), cov + alignment.cov))


def _summed(covs: Array) -> Array:
    return np.concatenate([np.zeros((1, 3, 3)), np.cumsum(covs, axis=0)])


def _T(A: Array) -> Array:
    return np.asarray(np.swapaxes(A, -1, -2))


def _about(lever: Array) -> Array:
    """Returns (..., 3, 3) what a small motion is at a point ``lever`` (..., 2) away."""
    out = np.broadcast_to(np.eye(3), (*lever.shape[:-1], 3, 3)).copy()
    out[..., 0, 2], out[..., 1, 2] = -lever[..., 1], lever[..., 0]
    return out
