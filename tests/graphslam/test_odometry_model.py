from __future__ import annotations

import numpy as np
import pytest

from graphslam.errors import BadConfig
from graphslam.geometry import compose
from graphslam.models.odometry import odometry_residual, transition
from graphslam.models.wheels import (
    DifferentialDrive,
    increments_from_poses,
    increments_from_wheels,
    wheel_increment,
)
from tests.graphslam.differences import central_differences

DRIVE = DifferentialDrive(0.042, 0.042, 0.2)
UNEQUAL = DifferentialDrive(0.042, 0.043, 0.2)
ROTATIONS = {
    "curve": [1.0, 2.0],
    "equal wheels": [1.5, 1.5],
    "still wheels": [0.0, 0.0],
    "turn on the spot": [-1.0, 1.0],
    "backwards": [-1.0, -2.0],
    "nearly equal": [1.0, 1.0 + 1e-9],
    "at the switch of the series": [0.0, 2e-3 * 0.2 / 0.042 + 1e-12],
}


@pytest.mark.parametrize("drive", [DRIVE, UNEQUAL])
@pytest.mark.parametrize("rotation", ROTATIONS.values(), ids=ROTATIONS)
def test_wheel_jacobian_equals_differences(rotation: list, drive: DifferentialDrive) -> None:
    at = np.array(rotation)
    _, V = wheel_increment(at, drive)
    numeric = central_differences(lambda v: wheel_increment(v, drive)[0], at, 1e-5)
    np.testing.assert_allclose(V, numeric, atol=1e-9)


def test_increment_equals_the_printed_arc_of_santana_slam_8() -> None:
    left, right = 1.0, 2.5
    length = 0.042 * (left + right) / 2
    turn = 0.042 * (right - left) / 0.2
    theta = 0.7
    x = length / turn * (np.sin(theta + turn) - np.sin(theta))
    y = -length / turn * (np.cos(theta + turn) - np.cos(theta))
    pose = compose(np.array([0.0, 0.0, theta]), wheel_increment(np.array([left, right]), DRIVE)[0])
    np.testing.assert_allclose(pose, [x, y, theta + turn], atol=1e-12)
    wrong = np.array([x, -y])  # erratum of SantanaLoc (9), (12): plus in y
    assert np.linalg.norm(pose[:2] - wrong) > 0.01


def test_jacobian_equals_the_printed_v_of_santana_slam_16_away_from_its_singularity() -> None:
    left, right, r, b = 1.0, 2.5, 0.042, 0.2
    V1 = r * (right + left) / (2 * (right - left))
    V2, V3 = -b * left / (right - left) ** 2, b * right / (right - left) ** 2
    beta = r * (right - left) / b
    printed = np.array(
        [
            [V1 * np.cos(beta) + V2 * np.sin(beta), -V1 * np.cos(beta) + V3 * np.sin(beta)],
            [
                V1 * np.sin(beta) - V2 * (np.cos(beta) - 1),
                -V1 * np.sin(beta) - V3 * (np.cos(beta) - 1),
            ],
            [r / b, -r / b],
        ]
    )
    _, V = wheel_increment(np.array([left, right]), DRIVE)
    np.testing.assert_allclose(V[:, ::-1], printed, atol=1e-12)


def test_jacobian_is_finite_where_the_printed_v_is_not() -> None:
    """Erratum of SantanaSLAM (16): wrong by a factor of 20 at a difference of 1e-8 rad."""
    _, exact = wheel_increment(np.array([1.0, 1.0]), DRIVE)
    for difference in (1e-6, 1e-8, 1e-12):
        _, V = wheel_increment(np.array([1.0, 1.0 + difference]), DRIVE)
        np.testing.assert_allclose(V, exact, atol=1e-6)


def test_straight_motion_is_not_the_printed_limit() -> None:
    """Erratum of SantanaLoc (14): printed turn * cos where length * cos is right."""
    increment, _ = wheel_increment(np.array([2.0, 2.0]), DRIVE)
    np.testing.assert_allclose(increment, [2 * 0.042, 0.0, 0.0], atol=1e-15)


# ---- noise ------------------------------------------------------------------------------------


def wavy_run(readings: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns a 2 m run with turns of both senses, a stop and a reversal, at any rate."""
    t = np.linspace(0.0, 8.0, 8 * readings + 1)
    speed = np.interp(t, [0, 1, 4, 4.5, 5, 6, 7, 8], [0, 8, 8, 0, 0, -4, 6, 8])
    turn = 3.0 * np.sin(1.3 * t) * (np.abs(speed) > 0)
    dt = t[1] - t[0]
    left, right = (np.concatenate([[0], np.cumsum((speed + s * turn)[:-1] * dt)]) for s in (-1, 1))
    return t, np.column_stack([left, right])


def chained(t: np.ndarray, angle: np.ndarray, nodes: np.ndarray, drive: DifferentialDrive):
    """Returns the covariance of the whole run, node increments composed like a filter does."""
    increment, cov = increments_from_wheels(t, angle, nodes, drive)
    pose, P = np.zeros(3), np.zeros((3, 3))
    for u, Q in zip(increment, cov, strict=True):
        there = compose(pose, u)
        F, Q_floor, _ = transition(pose, there, u, Q)
        pose, P = there, F @ P @ F.T + Q_floor
    return pose, P


@pytest.mark.parametrize("slip", [(0.002, 0.002, 0.005), (0.004, 0.001, 0.003)])
def test_a_run_cut_four_ways_keeps_its_covariance(slip: tuple) -> None:
    drive = DifferentialDrive(0.042, 0.042, 0.2, slip=slip, floor=(0.0, 0.0))
    t, angle = wavy_run(20)
    whole_pose, whole = chained(t, angle, t[[0, -1]], drive)
    scale = np.sqrt(np.outer(np.diag(whole), np.diag(whole)))
    for nodes in (t[::40], [*t[::7][:-1], t[-1]], t):
        pose, cov = chained(t, angle, np.unique(np.array(nodes)), drive)
        np.testing.assert_allclose(pose, whole_pose, atol=1e-9)
        assert np.max(np.abs(cov - whole) / scale) < 1e-9
    # the same motion read more finely: every reading (at most 5 cm) cut in four
    fine_t = np.unique(np.concatenate([t[:-1] + f * np.diff(t) for f in (0, 0.25, 0.5, 0.75)]))
    fine_t = np.append(fine_t, t[-1])
    fine = np.column_stack([np.interp(fine_t, t, c) for c in angle.T])
    assert np.max(np.abs(np.diff(angle, axis=0))) * 0.042 <= 0.05
    _, cov = chained(fine_t, fine, fine_t[[0, -1]], drive)
    assert np.max(np.abs(cov - whole) / scale) < 0.01


def test_a_node_between_two_readings_splits_the_reading() -> None:
    drive = DifferentialDrive(0.042, 0.042, 0.2, slip=(0, 0, 0), floor=(0.0, 0.0))
    t, angle = np.array([0.0, 1.0]), np.array([[0.0, 0.0], [1.0, 1.0]])
    increment, cov = increments_from_wheels(t, angle, np.array([0.0, 0.25, 1.0]), drive)
    np.testing.assert_allclose(increment[:, 0], [0.25 * 0.042, 0.75 * 0.042])
    np.testing.assert_allclose(cov[1, 2, 2] / cov[0, 2, 2], 3.0)


def test_paper_law_has_std_proportional_to_the_whole_rotation_between_nodes() -> None:
    drive = DifferentialDrive(0.042, 0.042, 0.2, law="paper", slip=(0, 0, 0), floor=(0.0, 0.0))
    t = np.linspace(0, 1, 21)
    angle = np.column_stack([2.0 * t, 3.0 * t])
    _, cov = increments_from_wheels(t, angle, np.array([0.0, 1.0]), drive)
    _, V = wheel_increment(np.array([2.0, 3.0]), drive)
    M = np.diag([(0.03 * 2.0) ** 2, (0.03 * 3.0) ** 2])  # SantanaSLAM (17)
    np.testing.assert_allclose(cov[0], V @ M @ V.T, atol=1e-12)


def test_laws_differ_in_kind_when_a_step_is_cut_in_ten() -> None:
    """Erratum of SantanaLoc (20): variance, not standard deviation, proportional to rotation."""
    t = np.linspace(0, 1, 11)
    angle = np.column_stack([2.0 * t, 2.0 * t])
    total = {}
    for law in ("distance", "paper"):
        drive = DifferentialDrive(0.042, 0.042, 0.2, law=law, slip=(0, 0, 0), floor=(0.0, 0.0))
        one, ten = (chained(t, angle, nodes, drive)[1][2, 2] for nodes in (t[[0, -1]], t))
        total[law] = ten / one
    assert total["distance"] == pytest.approx(1.0)
    assert total["paper"] == pytest.approx(0.1)


def test_slip_and_floor_act_under_both_laws_and_keep_the_covariance_definite() -> None:
    t = np.array([0.0, 1.0, 2.0])
    angle = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0]])
    for law in ("distance", "paper"):
        drive = DifferentialDrive(0.042, 0.042, 0.2, law=law)
        _, cov = increments_from_wheels(t, angle, t, drive)
        assert np.linalg.eigvalsh(cov[0])[0] > 1e-8
        np.testing.assert_allclose(cov[1], drive.floor_covariance, atol=1e-18)


def test_slip_counts_metres_and_half_the_base_times_the_turn() -> None:
    drive = DifferentialDrive(
        0.1, 0.1, 0.4, noise_left=0.0, noise_right=0.0, slip=(0.0, 0.0, 0.01), floor=(0.0, 0.0)
    )
    t = np.array([0.0, 1.0])
    _, straight = increments_from_wheels(t, np.array([[0.0, 0.0], [10.0, 10.0]]), t, drive)
    assert straight[0, 2, 2] == pytest.approx(1e-4 * 1.0)
    _, spin = increments_from_wheels(t, np.array([[0.0, 0.0], [-10.0, 10.0]]), t, drive)
    assert spin[0, 2, 2] == pytest.approx(1e-4 * 1.0)  # 5 rad times half of 0.4 m


def test_poses_of_the_same_odometry_give_the_same_increments_and_noise() -> None:
    t, angle = wavy_run(20)
    poses = np.array(
        [np.zeros(3)]
        + [increments_from_wheels(t, angle, np.array([0.0, s]), DRIVE)[0][0] for s in t[1:]]
    )
    nodes = t[::10]
    from_wheels = increments_from_wheels(t, angle, nodes, DRIVE)
    from_poses = increments_from_poses(t, poses, nodes, DRIVE)
    np.testing.assert_allclose(from_poses[0], from_wheels[0], atol=1e-9)
    np.testing.assert_allclose(from_poses[1], from_wheels[1], atol=1e-9)


def test_impossible_drives_are_refused_with_the_name_of_the_value() -> None:
    for change in ({"wheel_base": 0.0}, {"law": "papers"}, {"slip": (0.1, -1.0, 0.0)}):
        with pytest.raises(BadConfig, match=next(iter(change)).split("_")[0]):
            DifferentialDrive(
                **{"wheel_radius_left": 1, "wheel_radius_right": 1, "wheel_base": 1} | change
            )


# ---- residual ---------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_residual_jacobians_equal_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose_i = rng.uniform([-5, -5, -np.pi], [5, 5, np.pi])
    increment = rng.normal(0, 0.5, 3)
    pose_j = compose(pose_i, increment + rng.normal(0, 0.1, 3))
    _, J_i, J_j = odometry_residual(pose_i, pose_j, increment)
    by_i = central_differences(lambda v: odometry_residual(v, pose_j, increment)[0], pose_i)
    by_j = central_differences(lambda v: odometry_residual(pose_i, v, increment)[0], pose_j)
    np.testing.assert_allclose(J_i, by_i, atol=1e-8)
    np.testing.assert_allclose(J_j, by_j, atol=1e-8)


def test_residual_wraps_across_pi() -> None:
    e, _, _ = odometry_residual(
        np.array([0.0, 0.0, 3.1]), np.array([0.0, 0.0, -3.1]), np.array([0.0, 0.0, 0.05])
    )
    assert e[2] == pytest.approx(2 * np.pi - 6.2 - 0.05)


def test_transition_is_the_printed_g_of_santana_slam_15() -> None:
    pose, increment = np.array([1.0, 2.0, 0.7]), np.array([0.5, 0.1, 0.3])
    there = compose(pose, increment)
    F, Q, offset = transition(pose, there, increment, np.diag([0.04, 0.01, 0.02]))
    numeric = central_differences(lambda v: compose(v, increment), pose)
    np.testing.assert_allclose(F, numeric, atol=1e-8)
    np.testing.assert_allclose(offset, 0.0, atol=1e-12)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    np.testing.assert_allclose(Q[:2, :2], turn @ np.diag([0.04, 0.01]) @ turn.T, atol=1e-12)
