"""The linear algebra of a growing Kalman filter: a pose, then landmarks, one joint covariance."""

# mypy: disallow-untyped-decorators=False, disallow-untyped-calls=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

from graphslam.errors import UnderConstrained
from graphslam.geometry import Array, wrap
from graphslam.measurements import IntArray

ROOT_TWO_PI = math.sqrt(2.0 * math.pi)

FEW = 4
"""Products that one pass over the covariance takes away."""


@njit(cache=True, fastmath={"contract"})
def _subtract_products(P, W):  # type: ignore[no-untyped-def]
    """Subtracts ``W' W`` from ``P`` (n, n) in place; W (r, n) has a multiple of `FEW` rows.

    One pass over P takes `FEW` rows of W, two rows of P at a time: memory is what it waits for.
    """
    n = len(P)
    for q in range(0, len(W), FEW):
        w0, w1, w2, w3 = W[q], W[q + 1], W[q + 2], W[q + 3]
        for i in range(0, n - 1, 2):
            a, b = P[i], P[i + 1]
            a0, a1, a2, a3 = w0[i], w1[i], w2[i], w3[i]
            b0, b1, b2, b3 = w0[i + 1], w1[i + 1], w2[i + 1], w3[i + 1]
            for j in range(n):
                x0, x1, x2, x3 = w0[j], w1[j], w2[j], w3[j]
                a[j] -= a0 * x0 + a1 * x1 + a2 * x2 + a3 * x3
                b[j] -= b0 * x0 + b1 * x1 + b2 * x2 + b3 * x3
        if n % 2:
            i = n - 1
            for j in range(n):
                P[i, j] -= w0[i] * w0[j] + w1[i] * w1[j] + w2[i] * w2[j] + w3[i] * w3[j]


class JointState:
    """The mean of pose and landmarks and its covariance ``P``, floor frame.

    Both live in buffers that double, so that growing costs nothing on average.

    Attributes:
        size: entries in use; the pose is the first three.
        log_likelihood: of all innovations that corrected the state, log N(innovation; 0, S) summed.
        innovation: (2,) their joint squared norm, innovation' S^-1 innovation summed, and how many
            degrees of freedom they had.
    """

    def __init__(self, pose: Array, cov: Array) -> None:
        self.size = 3
        self.log_likelihood = 0.0
        self.innovation = np.zeros(2)
        self._mean = np.zeros(64)
        self._P = np.zeros((64, 64))
        self.mean[:], self.P[:] = pose, cov

    @property
    def mean(self) -> Array:
        """(n,) pose, then landmark parameters in order of appearance; a writable view."""
        return self._mean[: self.size]

    @property
    def P(self) -> Array:
        """(n, n) covariance; a writable view."""
        return self._P[: self.size, : self.size]

    def symmetric(self) -> Array:
        """Returns P (n, n), symmetric to the last bit."""
        return np.asarray(0.5 * (self.P + self.P.T))

    def deviation(self, pose: Array) -> Array:
        """Returns the mean's pose minus ``pose`` (3,), angle wrapped."""
        difference = self.mean[:3] - pose
        difference[2] = wrap(difference[2])
        return difference

    def move(self, pose: Array, F: Array, Q: Array) -> None:
        """Puts the pose at ``pose`` and its covariance through F (3, 3) and Q (3, 3).

        Source: SantanaSLAM eq. (2), landmarks standing still.
        """
        self.mean[:3] = pose
        self.mean[2] = wrap(self.mean[2])
        P = self.P
        P[:3, 3:] = F @ P[:3, 3:]
        P[3:, :3] = P[:3, 3:].T
        P[:3, :3] = F @ P[:3, :3] @ F.T + Q

    def innovation_covariance(
        self, J_pose: Array, J_landmark: Array, columns: IntArray, cov: Array
    ) -> Array:
        """Returns the covariances (k, M, d, d) of k sightings, each against M landmarks.

        Args:
            J_pose: (k, M, d, 3) Jacobians of the residuals.
            J_landmark: (k, M, d, l) the same by the landmark.
            columns: (M, l) places of the landmarks in the state.
            cov: (k, d, d) covariances of the sightings.
        """
        P_pl = self.P[:3][:, columns].transpose(1, 0, 2)
        P_ll = self.P[columns[:, :, None], columns[:, None, :]]
        cross = J_pose @ P_pl @ np.swapaxes(J_landmark, -1, -2)
        S = J_pose @ self.P[:3, :3] @ np.swapaxes(J_pose, -1, -2)
        S += J_landmark @ P_ll @ np.swapaxes(J_landmark, -1, -2)
        return np.asarray(S + cross + np.swapaxes(cross, -1, -2) + cov[:, None])

    def correct(
        self, innovation: Array, J_pose: Array, J_landmark: Array, columns: IntArray, cov: Array
    ) -> Array:
        """Updates with k sightings in one step; returns their own innovation covariances (k, d, d).

        Args:
            innovation: (k, d) measurement - prediction.
            J_pose: (k, d, 3) Jacobians of the predictions by the pose.
            J_landmark: (k, d, l) the same by each sighting's landmark; l = 0 where it has none.
            columns: (k, l) places of those landmarks in the state.
            cov: (k, d, d) covariances of the sightings.

        Source: SantanaSLAM eq. (3), with H at the predicted mean (eq. (6) prints the last mean).
        """
        count, d = innovation.shape
        HP, HPHt = self._project(J_pose, J_landmark, columns)
        each = np.arange(count)
        HPHt[each, :, each, :] += cov
        own = HPHt[each, :, each, :]
        S = HPHt.reshape(count * d, count * d)
        # S is tiny: its root's inverse costs less than a triangular solve that wakes BLAS threads
        try:
            whiten = np.linalg.inv(np.linalg.cholesky(0.5 * (S + S.T)))
        except np.linalg.LinAlgError:
            raise UnderConstrained(
                "the filter's covariance has lost its definiteness: start and noise differ by more "
                "orders of magnitude than numbers hold; give a less uncertain start, or larger "
                "sigmas to the sightings"
            ) from None
        y = whiten @ innovation.ravel()
        W = np.zeros((-(-count * d // FEW) * FEW, self.size))
        W[: count * d] = whiten @ HP.reshape(count * d, self.size)
        squared = float(y @ y)
        self.log_likelihood += float(np.log(np.diag(whiten) / ROOT_TWO_PI).sum()) - 0.5 * squared
        self.innovation += squared, count * d
        self.mean[:] += y @ W[: count * d]
        self.mean[2] = wrap(self.mean[2])
        _subtract_products(self.P, W)
        return np.asarray(own)

    def joint_innovation_covariance(
        self, J_pose: Array, J_landmark: Array, columns: IntArray, cov: Array
    ) -> Array:
        """Returns the joint covariance (p d, p d) of the residuals of p pairs.

        Args:
            J_pose: (p, d, 3) Jacobians of the residuals.
            J_landmark: (p, d, l) the same by each pair's landmark.
            columns: (p, l) places of those landmarks in the state.
            cov: (p, d, d) covariances of the sightings, taken as independent.
        """
        count, d = J_pose.shape[:2]
        HPHt = self._project(J_pose, J_landmark, columns)[1]
        each = np.arange(count)
        HPHt[each, :, each, :] += cov
        return np.asarray(HPHt.reshape(count * d, count * d))

    def _project(self, J_pose: Array, J_landmark: Array, columns: IntArray) -> tuple[Array, Array]:
        """Returns H P (p, d, n) and H P H' (p, d, p, d) of p stacked predictions.

        H has few entries: only the rows of P are touched that belong to them.
        """
        HP = J_pose @ self.P[:3]
        if columns.shape[1]:
            HP += J_landmark @ self.P[columns]
        HPHt = np.einsum("kij,plj->kipl", HP[:, :, :3], J_pose)
        HPHt += np.einsum("kipj,plj->kipl", HP[:, :, columns], J_landmark)
        return HP, HPHt

    def add(
        self, landmark: Array, J_pose: Array, noise: Array, columns: IntArray | slice = slice(3)
    ) -> int:
        """Adds a landmark with all its correlations; returns its place in the state.

        Args:
            landmark: (l,) parameters.
            J_pose: (l, 3) how they depend on the pose, or (l, c) on the entries ``columns``.
            noise: (l, l) their covariance given these.
            columns: (c,) entries of the state that they depend on; the pose where not given.

        Source: SantanaSLAM section 3.3; P_ll = J_pose P J_pose' + J_z R J_z'.
        """
        old = self.size
        self._grow(old + len(landmark))
        self.mean[old:] = landmark
        cross = J_pose @ self.P[:old, :old][columns]
        self.P[old:, :old], self.P[:old, old:] = cross, cross.T
        self.P[old:, old:] = cross[:, columns] @ J_pose.T + noise
        return old

    def remove(self, first: int, length: int) -> None:
        """Takes ``length`` entries out of the state from place ``first`` on; the rest moves up."""
        last, size = first + length, self.size
        self._mean[first : size - length] = self._mean[last:size].copy()
        self._P[first : size - length] = self._P[last:size].copy()
        self._P[:, first : size - length] = self._P[:, last:size].copy()
        self.size = size - length

    def add_pose_noise(self, Q: Array) -> None:
        """Adds noise of covariance Q (3, 3), independent of everything, to the pose."""
        self.P[:3, :3] += Q

    def _grow(self, size: int) -> None:
        if size > len(self._mean):
            room = max(size, 2 * len(self._mean))
            mean, P = np.zeros(room), np.zeros((room, room))
            mean[: self.size], P[: self.size, : self.size] = self.mean, self.P
            self._mean, self._P = mean, P
        self.size = size
