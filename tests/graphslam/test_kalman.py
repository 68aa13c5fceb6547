"""The filter's linear algebra against the textbook's, written out as the papers print it."""

from __future__ import annotations

import numpy as np

from graphslam.kalman import JointState


def covariance(rng: np.random.Generator, size: int) -> np.ndarray:
    root = rng.standard_normal((size, size))
    return root @ root.T + 0.1 * np.eye(size)


def a_state(rng: np.random.Generator) -> JointState:
    """Returns a pose and two landmarks of two parameters, all correlated."""
    state = JointState(0.1 * rng.standard_normal(3), 0.01 * covariance(rng, 3))
    for _ in range(2):
        state.add(rng.standard_normal(2), rng.standard_normal((2, 3)), 0.01 * covariance(rng, 2))
    return state


def test_a_linear_system_is_filtered_by_the_textbook() -> None:
    """SantanaLoc (2), (3), SantanaSLAM (2), (3), with A = G and C = H of a linear system."""
    rng = np.random.default_rng(0)
    state = a_state(rng)
    mu, Sigma = state.mean.copy(), state.P.copy()
    A, R = np.eye(3) + 0.1 * rng.standard_normal((3, 3)), 0.01 * covariance(rng, 3)
    u = 0.1 * rng.standard_normal(3)
    state.move(A @ state.mean[:3] + u, A, R)
    whole = np.eye(7)
    whole[:3, :3] = A
    mu = whole @ mu + np.r_[u, np.zeros(4)]
    Sigma = whole @ Sigma @ whole.T
    Sigma[:3, :3] += R
    np.testing.assert_allclose(state.mean, mu, atol=1e-14)
    np.testing.assert_allclose(state.P, Sigma, atol=1e-14)

    J_pose, J_landmark = rng.standard_normal((2, 2, 3)), rng.standard_normal((2, 2, 2))
    columns = np.array([[5, 6], [3, 4]])
    cov = np.array([0.01 * covariance(rng, 2) for _ in range(2)])
    C, Q = np.zeros((4, 7)), np.zeros((4, 4))
    for k in range(2):
        C[2 * k : 2 * k + 2, :3] = J_pose[k]
        C[2 * k : 2 * k + 2, columns[k]] = J_landmark[k]
        Q[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = cov[k]
    z = C @ mu + 0.01 * rng.standard_normal(4)
    state.correct((z - C @ mu).reshape(2, 2), J_pose, J_landmark, columns, cov)
    K = Sigma @ C.T @ np.linalg.inv(C @ Sigma @ C.T + Q)
    np.testing.assert_allclose(state.mean, mu + K @ (z - C @ mu), atol=1e-12)
    np.testing.assert_allclose(state.P, (np.eye(7) - K @ C) @ Sigma, atol=1e-12)


def test_landmarks_stand_still_while_the_robot_moves() -> None:
    """SantanaSLAM (12): mean and covariance of the landmarks are as before."""
    rng = np.random.default_rng(1)
    state = a_state(rng)
    mean, P = state.mean.copy(), state.P.copy()
    state.move(np.array([1.0, 2.0, 0.3]), rng.standard_normal((3, 3)), 0.01 * covariance(rng, 3))
    np.testing.assert_array_equal(state.mean[3:], mean[3:])
    np.testing.assert_array_equal(state.P[3:, 3:], P[3:, 3:])
    assert not np.allclose(state.P[:3, 3:], P[:3, 3:])
