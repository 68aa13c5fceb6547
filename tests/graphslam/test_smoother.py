from __future__ import annotations

import sys
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from scipy.stats import chi2

from graphslam.config import EkfConfig, MatchingConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.errors import BadMeasurements, UnderConstrained
from graphslam.geometry import compose, line_to_robot, twin, wrap
from graphslam.models.line import LINE
from graphslam.smoother import (
    build_graph,
    check_factor,
    landmark_key,
    odometry_factor,
    optimise,
    pose_key,
    residual_factor,
    sighting_factor,
    smooth,
    start_factor,
)
from tests.graphslam.differences import central_differences
from tests.graphslam.test_ekf import pose_fixes
from tests.graphslam.test_line_model import AWKWARD, random_cases
from tests.worlds import GRID, drive

COV = np.array([[0.01, 0.002], [0.002, 0.003]])


def values_of(pose: np.ndarray, line: np.ndarray) -> gtsam.Values:
    values = gtsam.Values()
    values.insert(pose_key(0), gtsam.Pose2(*pose))
    values.insert(landmark_key(0), np.array(line))
    return values


# ---- factors ----------------------------------------------------------------------------------


@pytest.mark.parametrize("case", [*AWKWARD.values(), *random_cases(15)])
def test_line_factor_jacobians_equal_differences_on_the_manifold(case: tuple) -> None:
    pose, line, z = (np.array(v, float) for v in case)
    check = check_factor(sighting_factor(LINE, z, COV, 0, 0), values_of(pose, line))
    assert check.ok, check.max_error


@pytest.mark.parametrize("case", random_cases(25))
def test_line_factor_equals_gtsams_plane_factor_restricted_to_the_floor(case: tuple) -> None:
    """OrientedPlane3Factor's angle residual is sin(d_alpha) and its distance is -rho."""
    pose, line, z = (np.array(v, float) for v in case)
    unit = gtsam.noiseModel.Unit.Create(3)

    def plane(v: np.ndarray) -> np.ndarray:
        return np.array([np.cos(v[1]), np.sin(v[1]), 0.0, -v[0]])

    e, J_pose, J_line = LINE.residual(pose, line, z)
    near = z if abs(wrap(line[1] - pose[2] - z[1])) <= np.pi / 2 else twin(z)
    sign = 1.0 if near is z else -1.0
    factor = gtsam.OrientedPlane3Factor(plane(near), unit, pose_key(0), landmark_key(0))

    def plane_error(v: np.ndarray) -> np.ndarray:
        values = gtsam.Values()
        rotation = gtsam.Rot3.Rz(v[2])
        values.insert(pose_key(0), gtsam.Pose3(rotation, np.array([v[0], v[1], 0.0])))
        values.insert(landmark_key(0), gtsam.OrientedPlane3(plane(v[3:])))
        return factor.unwhitenedError(values)

    def ours(v: np.ndarray) -> np.ndarray:
        return LINE.residual(v[:3], v[3:], z)[0]

    at = np.concatenate([pose, line])
    theirs = plane_error(at)
    axis = int(np.argmax(np.abs(theirs[:2])))
    turn = np.sign(theirs[axis] * np.sin(e[1])) if abs(e[1]) > 1e-9 else 1.0
    assert theirs[axis] == pytest.approx(turn * np.sin(e[1]), abs=1e-9)
    assert theirs[1 - axis] == pytest.approx(0.0, abs=1e-9)
    assert theirs[2] == pytest.approx(-sign * e[0], abs=1e-9)
    J_theirs = central_differences(plane_error, at)
    J_ours = np.hstack([J_pose, J_line])
    np.testing.assert_allclose(J_theirs[axis], turn * np.cos(e[1]) * J_ours[1], atol=1e-6)
    np.testing.assert_allclose(J_theirs[2], -sign * J_ours[0], atol=1e-6)
    np.testing.assert_allclose(J_ours, central_differences(ours, at), atol=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_odometry_factor_equals_differences_and_gtsams_between_to_first_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = rng.uniform([-5, -5, -np.pi], [5, 5, np.pi])
    increment = rng.normal(0, 0.4, 3)
    cov = np.diag([0.01, 0.02, 0.005])
    values = gtsam.Values()
    values.insert(pose_key(0), gtsam.Pose2(*pose))
    for size, tolerance in ((1e-1, 2e-2), (1e-3, 2e-6)):
        error = size * rng.standard_normal(3)
        moved = gtsam.Pose2(*compose(pose, increment + error))
        values.insert_or_assign(pose_key(1), moved)
        ours = odometry_factor(0, increment, cov)
        theirs = gtsam.BetweenFactorPose2(
            pose_key(0), pose_key(1), gtsam.Pose2(*increment), gtsam.noiseModel.Unit.Create(3)
        )
        assert check_factor(ours, values).ok
        plain = np.array(theirs.unwhitenedError(values))
        c, s = np.cos(increment[2]), np.sin(increment[2])
        turned = np.array([c * plain[0] - s * plain[1], s * plain[0] + c * plain[1], plain[2]])
        np.testing.assert_allclose(ours.unwhitenedError(values), turned, atol=tolerance)


def test_start_factor_jacobians_equal_differences() -> None:
    factor = start_factor(np.array([1.0, 2.0, 3.0]), np.diag([0.1, 0.2, 0.3]))
    assert check_factor(factor, values_of(np.array([1.1, 1.9, -3.1]), GRID[0])).ok


def test_check_factor_finds_a_wrong_jacobian() -> None:
    def wrong(pose: np.ndarray, line: np.ndarray) -> tuple:
        e, J_pose, J_line = LINE.residual(pose, line, np.array([1.0, 0.5]))
        return e, J_pose, J_line * np.array([1.0, -1.0])  # as SantanaSLAM (27) prints it

    keys = [pose_key(0), landmark_key(0)]
    factor = residual_factor(keys, [True, False], [3, 2], wrong, COV)
    check = check_factor(factor, values_of(np.array([1.0, 2.0, 0.3]), np.array([2.0, 0.8])))
    assert not check.ok
    assert check.max_error > 0.1


@pytest.mark.parametrize("shapes", [((3, 3), (2, 2)), ((2, 2), (2, 2)), ((2, 3), (2, 3))])
def test_wrong_jacobian_shapes_are_refused_before_gtsam_sees_them(shapes: tuple) -> None:
    def wrong(pose: np.ndarray, line: np.ndarray) -> tuple:
        return np.zeros(2), np.ones(shapes[0]), np.ones(shapes[1])

    keys = [pose_key(0), landmark_key(0)]
    factor = residual_factor(keys, [True, False], [3, 2], wrong, COV)
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(factor)
    values = values_of(np.zeros(3), GRID[0])
    for evaluate in (graph.linearize, graph.error):
        with pytest.raises(BadMeasurements, match="promised"):
            evaluate(values)


# ---- the estimator ----------------------------------------------------------------------------


def test_filter_and_smoother_agree_where_both_are_linearised_at_one_point() -> None:
    measurements, _ = drive(0, 150, start_sigma=0.01)
    at = run_ekf(measurements)
    filtered = run_ekf(measurements, linearise_at=at)
    smoothed = smooth(measurements, at, linearise_at=at)
    sigma = np.sqrt(np.diag(smoothed.cov_joint))
    last = filtered.pose[-1] - smoothed.pose[-1]
    assert np.max(np.abs(last / sigma[:3])) < 1e-9
    d_map = (filtered.map.params - smoothed.map.params).ravel()
    assert np.max(np.abs(d_map / sigma[3:])) < 1e-9
    d_cov = (filtered.cov_joint - smoothed.cov_joint) / np.outer(sigma, sigma)
    assert np.max(np.abs(d_cov)) < 1e-9
    # and they are not trivially the same: the point is off the optimum, the paths differ
    assert np.max(np.abs(at.pose[-1] - smoothed.pose[-1]) / sigma[:3]) > 1e-3
    assert np.max(np.abs(filtered.pose[50] - smoothed.pose[50])) > 1e-4


def test_agreement_holds_with_a_second_kind_of_sighting_and_linearisation_far_off() -> None:
    measurements, truth = drive(5, 80, start_sigma=0.05)
    fixes = pose_fixes(measurements, truth, 7, 0.05)
    both = replace(measurements, sightings={**measurements.sightings, "pose_fix": fixes})
    at = run_ekf(both, EkfConfig(MatchingConfig(method="known")))
    moved = replace(at, pose=at.pose + np.array([0.05, -0.03, 0.02]))
    filtered = run_ekf(both, linearise_at=moved)
    smoothed = smooth(both, moved, linearise_at=moved)
    sigma = np.sqrt(np.diag(smoothed.cov_joint))
    assert np.max(np.abs((filtered.pose[-1] - smoothed.pose[-1]) / sigma[:3])) < 1e-9
    d_cov = (filtered.cov_joint - smoothed.cov_joint) / np.outer(sigma, sigma)
    assert np.max(np.abs(d_cov)) < 1e-9


def test_without_noise_the_smoother_returns_the_truth() -> None:
    measurements, truth = drive(0, noise=0.0)
    estimate = smooth(measurements, run_ekf(measurements))
    np.testing.assert_allclose(estimate.pose[:, :2], truth[:, :2], atol=1e-8)
    order = np.lexsort(np.round(estimate.map.params, 6).T)
    np.testing.assert_allclose(estimate.map.params[order], GRID, atol=1e-8)
    assert estimate.cost < 1e-10
    assert estimate.converged


def test_covariances_equal_gtsams_marginals() -> None:
    measurements, _ = drive(1, 40, start_sigma=0.01)
    initial = run_ekf(measurements)
    estimate = smooth(measurements, initial)
    problem = build_graph(measurements, initial.match, initial)
    solution = optimise(problem.graph, problem.values, SmootherConfig())
    marginals = gtsam.Marginals(problem.graph, solution.values)
    keys = [pose_key(39), *(landmark_key(n) for n in range(len(estimate.map)))]
    joint = marginals.jointMarginalCovariance(gtsam.KeyVector(keys))
    theta = solution.values.atPose2(keys[0]).theta()
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]]
    own = turn @ joint.at(keys[0], keys[0]) @ turn.T
    np.testing.assert_allclose(estimate.cov_joint[:3, :3], own, rtol=1e-6)
    np.testing.assert_allclose(estimate.cov_floor[-1], own, rtol=1e-6)
    for n, key in enumerate(keys[1:]):
        sign = np.sign(solution.values.atVector(key)[0])
        flip = np.diag([sign, 1.0])
        at = slice(3 + 2 * n, 5 + 2 * n)
        cross = turn @ joint.at(keys[0], key) @ flip
        np.testing.assert_allclose(
            estimate.cov_joint[at, at], flip @ joint.at(key, key) @ flip, rtol=1e-6
        )
        np.testing.assert_allclose(estimate.cov_joint[:3, at], cross, rtol=1e-5, atol=1e-12)


def test_the_optimum_does_not_depend_on_the_start() -> None:
    measurements, _ = drive(2, 100)
    initial = run_ekf(measurements)
    good = smooth(measurements, initial)
    problem = build_graph(measurements, initial.match)  # from dead reckoning
    solution = optimise(problem.graph, problem.values, SmootherConfig())
    assert solution.converged
    assert solution.cost == pytest.approx(good.cost, rel=1e-8)


def test_smoothing_beats_the_filter_on_the_path_and_its_errors_are_as_large_as_it_says() -> None:
    nees, rmse = [], []
    for seed in range(20):
        measurements, truth = drive(seed, 100, odometry_sigma=(0.01, 0.01, 0.01), reach=0.3)
        filtered = run_ekf(measurements, EkfConfig(MatchingConfig(method="known")))
        smoothed = smooth(measurements, filtered)
        paths = (filtered.pose, smoothed.pose)
        rmse.append([np.sqrt(np.mean((p - truth)[:, :2] ** 2)) for p in paths])
        error = smoothed.pose[50] - truth[50]
        error[2] = wrap(error[2])
        nees.append(error @ np.linalg.solve(smoothed.cov_floor[50], error))
    mean_filter, mean_smoother = np.mean(rmse, axis=0)
    assert mean_smoother < 0.9 * mean_filter
    low, high = chi2.ppf([0.0005, 0.9995], 3 * len(nees))
    assert low < np.sum(nees) < high


def test_a_bad_step_is_damped_instead_of_taken() -> None:
    """From a start where plain Gauss-Newton raises the cost, the optimum is still reached."""
    measurements, truth = drive(6, 60)
    initial = run_ekf(measurements)
    optimum = smooth(measurements, initial)
    rng = np.random.default_rng(1)
    bent = truth + rng.normal(0, [0.5, 0.5, 0.6], truth.shape)
    problem = build_graph(measurements, initial.match, replace(initial, pose=bent))
    solution = optimise(problem.graph, problem.values, SmootherConfig(max_iterations=200))
    assert solution.cost == pytest.approx(optimum.cost, rel=1e-6)


def test_running_out_of_iterations_is_said() -> None:
    measurements, _ = drive(2, 60)
    initial = run_ekf(measurements)
    estimate = smooth(measurements, initial, SmootherConfig(max_iterations=1))
    assert not estimate.converged
    assert estimate.iterations == 1


def test_matches_that_do_not_fit_are_refused() -> None:
    measurements, _ = drive(0, 30)
    initial = run_ekf(measurements)
    with pytest.raises(BadMeasurements, match="matches has shape"):
        build_graph(measurements, initial.match[:-1])
    with pytest.raises(BadMeasurements, match="no sighting is matched to landmark"):
        build_graph(measurements, np.where(initial.match == 0, -1, initial.match))
    with pytest.raises(BadMeasurements, match="another path"):
        build_graph(measurements, initial.match, run_ekf(drive(0, 40)[0]))


def test_a_variable_that_nothing_ties_down_is_an_error_in_words() -> None:
    measurements, _ = drive(0, 10)
    initial = run_ekf(measurements)
    problem = build_graph(measurements, initial.match, initial)
    problem.values.insert(pose_key(99), gtsam.Pose2())
    blind = residual_factor(
        [pose_key(99)], [True], [3], lambda pose: (np.zeros(2), np.zeros((2, 3))), COV
    )
    problem.graph.push_back(blind)
    with pytest.raises(UnderConstrained, match=r"do not determine.*x99"):
        optimise(problem.graph, problem.values, SmootherConfig())


def test_the_filter_does_not_need_gtsam() -> None:
    import subprocess

    code = (
        "import sys; sys.modules['gtsam'] = None\n"
        "import graphslam.ekf, graphslam.baseline, frontend\n"
        "assert 'graphslam.smoother' not in sys.modules\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_known_sighting_of_a_line_behind_the_robot_has_no_jump() -> None:
    pose = np.array([2.0, 0.0, np.pi])
    for line in GRID:
        z = line_to_robot(line, pose)
        np.testing.assert_allclose(LINE.residual(pose, line, z)[0], 0.0, atol=1e-12)
        np.testing.assert_allclose(LINE.residual(pose, line, twin(z))[0], 0.0, atol=1e-12)


@pytest.mark.parametrize("sigma", [1.0, 100.0, 1e3])
def test_a_start_that_is_hardly_known_is_no_obstacle(sigma: float) -> None:
    """GTSAM's Cholesky refuses such systems, though they are well determined."""
    measurements, _ = drive(0, 60, odometry_sigma=(2e-4, 2e-4, 2e-4))
    start_cov = np.diag([sigma**2, sigma**2, 0.01])
    vague = replace(measurements, start_cov=start_cov)
    known = run_ekf(vague, EkfConfig(MatchingConfig(method="known")))
    estimate = smooth(vague, known)
    assert estimate.converged
    sigmas = np.sqrt(np.diagonal(estimate.cov_floor[:, :2, :2], axis1=1, axis2=2))
    np.testing.assert_allclose(sigmas, sigma, rtol=0.2)
    assert {u.quantity for u in estimate.unobserved} >= {"position"}
