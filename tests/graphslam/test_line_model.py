from __future__ import annotations

import numpy as np
import pytest

from graphslam.geometry import line_to_robot, twin, wrap
from graphslam.models.line import LINE
from tests.graphslam.differences import central_differences

AWKWARD = {
    "alpha at pi": ([1.0, 2.0, 0.3], [2.0, np.pi], [0.9, np.pi - 0.31]),
    "alpha at minus pi": ([1.0, 2.0, 0.3], [2.0, -np.pi + 1e-9], [-2.9, 0.31]),
    "rho near zero": ([0.0, 0.0, 0.0], [1e-12, 0.7], [1e-3, 0.72]),
    "robot on the line": ([1.0, 0.5, 1.0], [1.0, 0.0], [0.0, -1.0]),
    "robot across the line": ([3.0, 0.5, 2.0], [1.0, 0.0], [2.0, -2.0 + np.pi]),
    "heading at pi": ([0.2, -0.4, np.pi], [1.5, -1.2], [1.1, 1.9]),
}


def random_cases(count: int = 40) -> list[tuple]:
    rng = np.random.default_rng(5)
    cases = []
    for _ in range(count):
        pose = rng.uniform([-5, -5, -np.pi], [5, 5, np.pi])
        line = rng.uniform([-4, -np.pi], [4, np.pi])
        z = line_to_robot(line, pose) + rng.normal(0, [0.05, 0.1])
        cases.append((pose, line, twin(z) if rng.random() < 0.5 else z))
    return cases


@pytest.mark.parametrize("case", [*AWKWARD.values(), *random_cases()])
def test_jacobians_equal_central_differences(case: tuple) -> None:
    pose, line, z = (np.array(v, float) for v in case)
    _, J_pose, J_line = LINE.residual(pose, line, z)
    by_pose = central_differences(lambda v: LINE.residual(v, line, z)[0], pose)
    by_line = central_differences(lambda v: LINE.residual(pose, v, z)[0], line)
    np.testing.assert_allclose(J_pose, by_pose, atol=1e-7)
    np.testing.assert_allclose(J_line, by_line, atol=1e-7)


@pytest.mark.parametrize("case", random_cases())
def test_naming_the_landmark_by_its_twin_changes_nothing(case: tuple) -> None:
    pose, line, z = (np.array(v, float) for v in case)
    e, J_pose, _ = LINE.residual(pose, line, z)
    e_twin, J_pose_twin, _ = LINE.residual(pose, twin(line), z)
    np.testing.assert_allclose(e_twin, e, atol=1e-12)
    np.testing.assert_allclose(J_pose_twin, J_pose, atol=1e-12)


@pytest.mark.parametrize("case", random_cases())
def test_naming_the_sighting_by_its_twin_only_changes_the_sign_of_rho(case: tuple) -> None:
    pose, line, z = (np.array(v, float) for v in case)
    e, _, _ = LINE.residual(pose, line, z)
    e_twin, _, _ = LINE.residual(pose, line, twin(z))
    np.testing.assert_allclose(e_twin, [-e[0], e[1]], atol=1e-12)


def test_prediction_equals_the_printed_sensor_models_in_the_papers_frame() -> None:
    """SantanaSLAM (25) and (26): frame M has y forward, alpha_M = alpha_robot + pi/2."""
    x, y, theta = 0.7, -1.1, 0.4
    rho, alpha = 2.0, 0.9
    model_25 = (rho - x * np.cos(alpha) - y * np.sin(alpha), alpha - theta + np.pi / 2)
    model_26 = (-rho + x * np.cos(alpha) + y * np.sin(alpha), alpha - theta - np.pi / 2)
    for rho_m, alpha_m in (model_25, model_26):
        z = np.array([rho_m, alpha_m - np.pi / 2])
        e, _, _ = LINE.residual(np.array([x, y, theta]), np.array([rho, alpha]), z)
        np.testing.assert_allclose(e, 0.0, atol=1e-12)


def test_landmark_block_is_not_the_printed_one() -> None:
    """Erratum of SantanaSLAM (27): printed [[1, 0], [0, -1]] for the landmark."""
    pose, line = np.array([0.7, -1.1, 0.4]), np.array([2.0, 0.9])
    _, _, J_line = LINE.residual(pose, line, line_to_robot(line, pose))
    lever = pose[0] * np.sin(line[1]) - pose[1] * np.cos(line[1])
    np.testing.assert_allclose(J_line, [[1.0, lever], [0.0, 1.0]], atol=1e-12)


def test_rho_does_not_depend_on_the_heading() -> None:
    """Erratum of SantanaLoc (29), (30): printed -(x sin a - y cos a) in the rho row."""
    pose, line = np.array([0.7, -1.1, 0.4]), np.array([2.0, 0.9])
    for z in (line_to_robot(line, pose), twin(line_to_robot(line, pose))):
        _, J_pose, _ = LINE.residual(pose, line, z)
        assert J_pose[0, 2] == 0.0


def test_new_landmark_explains_its_sighting_and_its_jacobians_equal_differences() -> None:
    pose, z = np.array([1.0, -2.0, 2.8]), np.array([-0.4, 1.3])
    line, J_pose, J_z = LINE.initialise(pose, z, np.eye(2))
    np.testing.assert_allclose(LINE.residual(pose, line, z)[0], 0.0, atol=1e-12)
    by_pose = central_differences(lambda v: LINE.initialise(v, z, np.eye(2))[0], pose)
    by_z = central_differences(lambda v: LINE.initialise(pose, v, np.eye(2))[0], z)
    np.testing.assert_allclose(J_pose, by_pose, atol=1e-8)
    np.testing.assert_allclose(J_z, by_z, atol=1e-8)


def test_canonical_lines_keep_their_points_and_turn_their_covariance() -> None:
    lines = np.array([[-1.0, 0.3], [2.0, 4.0], [0.0, 2.0]])
    extent = np.array([[0.1, 0.5], [-1.0, 1.0], [0.0, 2.0]])
    named, stretch, J = LINE.canonical(lines, extent)
    assert np.all(named[:, 0] >= 0)
    assert np.all(np.abs(named[:, 1]) <= np.pi)
    np.testing.assert_allclose(stretch, [[-0.5, -0.1], [-1.0, 1.0], [-2.0, 0.0]])
    np.testing.assert_allclose(J[:, 0, 0], [-1.0, 1.0, -1.0])


def test_seen_stretch_lands_where_the_points_are() -> None:
    pose = np.array([[1.0, 1.0, np.pi / 2]])
    line = np.array([[2.0, np.pi / 2]])  # y = 2: one metre ahead of a robot looking along y
    for z, extent in (([1.0, 0.0], [-0.2, 0.5]), ([-1.0, np.pi], [-0.5, 0.2])):
        got = LINE.extent_on_landmark(pose, line, np.array([z]), np.array([extent]))
        # s of the floor line points to -x: the robot's left (+0.5) is floor x = 0.5, s = -0.5
        np.testing.assert_allclose(got, [[-1.2, -0.5]], atol=1e-12)


def test_the_nearer_twin_is_chosen_on_both_sides_of_a_quarter_turn() -> None:
    pose, line = np.zeros(3), np.array([1.0, 0.0])
    for off in (np.pi / 2 - 1e-6, np.pi / 2 + 1e-6):
        e, _, _ = LINE.residual(pose, line, np.array([1.0, off]))
        assert abs(e[1]) <= np.pi / 2 + 1e-12
        assert abs(wrap(2 * (e[1] + off))) < 1e-9
