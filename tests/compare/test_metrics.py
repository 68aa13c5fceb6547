"""Errors of paths, and whether covariances are as large as errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from evo.core import metrics as evo
from evo.core.trajectory import PosePath3D
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from compare.align import rigid_from_lines
from compare.metrics import map_nees, mean_nees, pose_nees, rms, trajectory
from compare.truth import Truth, truth_of
from graphslam.estimate import Estimate
from graphslam.geometry import compose, inverse, line_to_floor, wrap
from graphslam.measurements import Measurements, Odometry
from tests.compare.made import estimate_of, log_with, moved
from tests.worlds import GRID, drive

metres = st.floats(-20.0, 20.0)
motions = st.tuples(metres, metres, st.floats(-np.pi, np.pi)).map(np.array)

DRIVEN, TRUE_POSE = drive(seed=5, nodes=80)
MEASUREMENTS = replace(DRIVEN, start_pose=TRUE_POSE[0])


def noisy_estimate(seed: int = 0) -> Estimate:
    noise = np.random.default_rng(seed).normal(0.0, [0.05, 0.05, 0.02], TRUE_POSE.shape)
    pose = compose(TRUE_POSE, np.cumsum(noise, axis=0) * 0.3)
    match = MEASUREMENTS.sightings["line"].truth
    return estimate_of(MEASUREMENTS, pose, GRID, match)


def truth_from(t: np.ndarray, pose: np.ndarray) -> Truth:
    return truth_of(log_with(t, pose, None), MEASUREMENTS)


TRUTH = truth_from(MEASUREMENTS.t, TRUE_POSE)


def to_evo(pose: np.ndarray) -> PosePath3D:
    matrices = np.tile(np.eye(4), (len(pose), 1, 1))
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    matrices[:, :2, :2] = np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)
    matrices[:, :2, 3] = pose[:, :2]
    return PosePath3D(poses_se3=list(matrices))


def evo_ape(estimate: PosePath3D, truth: PosePath3D, relation: evo.PoseRelation) -> evo.APE:
    ape = evo.APE(relation)
    ape.process_data((truth, estimate))
    return ape


# ---- path --------------------------------------------------------------------------------------


def test_aligned_errors_are_evos_absolute_pose_errors() -> None:
    estimate = noisy_estimate()
    ours = trajectory(estimate, TRUTH)
    truth, path = to_evo(TRUE_POSE), to_evo(estimate.pose)
    path.align(truth, correct_scale=False)
    position = evo_ape(path, truth, evo.PoseRelation.translation_part)
    heading = evo_ape(path, truth, evo.PoseRelation.rotation_angle_deg)
    assert ours is not None
    assert ours.aligned_rmse_m == pytest.approx(position.get_statistic(evo.StatisticsType.rmse))
    assert ours.aligned_final_error_m == pytest.approx(position.error[-1])
    assert ours.aligned_heading_rmse_deg == pytest.approx(
        heading.get_statistic(evo.StatisticsType.rmse), rel=1e-6
    )


def test_unaligned_errors_are_evos_after_its_alignment_to_the_origin() -> None:
    estimate = noisy_estimate()
    estimate = replace(estimate, pose=np.vstack([TRUE_POSE[:1], estimate.pose[1:]]))
    elsewhere = compose(np.array([3.0, -1.0, 2.0]), TRUE_POSE)
    ours = trajectory(estimate, truth_from(MEASUREMENTS.t, elsewhere))
    truth, path = to_evo(elsewhere), to_evo(estimate.pose)
    path.align_origin(truth)
    position = evo_ape(path, truth, evo.PoseRelation.translation_part)
    heading = evo_ape(path, truth, evo.PoseRelation.rotation_angle_deg)
    assert ours is not None
    assert ours.rmse_m == pytest.approx(position.get_statistic(evo.StatisticsType.rmse))
    assert ours.final_error_m == pytest.approx(position.error[-1])
    assert ours.heading_rmse_deg == pytest.approx(
        heading.get_statistic(evo.StatisticsType.rmse), rel=1e-6
    )


@settings(max_examples=30, deadline=None)
@given(motions)
def test_aligned_errors_do_not_change_when_the_estimate_is_moved(motion: np.ndarray) -> None:
    estimate = noisy_estimate()
    before, after = (trajectory(e, TRUTH) for e in (estimate, moved(estimate, motion)))
    assert before is not None
    assert after is not None
    for name in ("aligned_rmse_m", "aligned_final_error_m", "aligned_heading_rmse_deg"):
        assert getattr(after, name) == pytest.approx(getattr(before, name), rel=1e-6)


@settings(max_examples=30, deadline=None)
@given(motions)
def test_no_error_changes_when_the_truth_is_moved(motion: np.ndarray) -> None:
    estimate = noisy_estimate()
    before = trajectory(estimate, TRUTH)
    after = trajectory(estimate, truth_from(MEASUREMENTS.t, compose(motion, TRUE_POSE)))
    assert before is not None
    assert after is not None
    for name in ("rmse_m", "final_error_m", "heading_rmse_deg", "aligned_rmse_m"):
        assert getattr(after, name) == pytest.approx(getattr(before, name), rel=1e-6)


def test_the_truth_itself_has_no_error() -> None:
    match = MEASUREMENTS.sightings["line"].truth
    figures = trajectory(estimate_of(MEASUREMENTS, TRUE_POSE, GRID, match), TRUTH)
    assert figures is not None
    for name in ("rmse_m", "final_error_m", "heading_rmse_deg", "aligned_rmse_m"):
        assert getattr(figures, name) < 1e-9


def test_nodes_outside_the_true_path_are_counted_and_not_scored() -> None:
    estimate = noisy_estimate()
    inside = slice(0, 60)
    figures = trajectory(estimate, truth_from(MEASUREMENTS.t[inside], TRUE_POSE[inside]))
    assert figures is not None
    assert (figures.nodes, figures.nodes_outside) == (60, 20)
    assert figures.final_error_m == pytest.approx(
        np.hypot(*(estimate.pose[59] - TRUE_POSE[59])[:2])
    )


def test_true_poses_between_recorded_times_are_interpolated() -> None:
    still = Measurements(
        np.array([0.0, 0.5, 1.0]),
        np.zeros(3),
        1e-6 * np.eye(3),
        Odometry(np.zeros((2, 3)), np.broadcast_to(np.eye(3), (2, 3, 3))),
    )
    pose = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]])
    estimate = estimate_of(still, pose, np.zeros((0, 2)), np.zeros(0, int))
    truth = truth_of(log_with(np.array([0.0, 1.0]), pose[[0, 2]], None), still)
    figures = trajectory(estimate, truth)
    assert figures is not None
    assert figures.rmse_m < 1e-12


def test_a_true_path_that_begins_late_is_put_where_odometry_has_led() -> None:
    measurements, true_pose = drive(seed=5, nodes=80, noise=0.0)
    late = slice(30, None)
    match = measurements.sightings["line"].truth
    estimate = estimate_of(measurements, true_pose, GRID, match)
    elsewhere = compose(np.array([5.0, 5.0, 1.0]), true_pose)
    truth = truth_of(log_with(measurements.t[late], elsewhere[late], None), measurements)
    figures = trajectory(estimate, truth)
    assert figures is not None
    assert figures.nodes_outside == 30
    assert figures.rmse_m < 1e-9


def test_without_a_true_path_there_are_no_path_errors() -> None:
    assert trajectory(noisy_estimate(), truth_of(None, MEASUREMENTS)) is None


def test_a_true_path_of_another_time_scores_nothing() -> None:
    assert trajectory(noisy_estimate(), truth_from(MEASUREMENTS.t + 1e3, TRUE_POSE)) is None


def test_a_robot_that_stays_where_it_is_gets_figures() -> None:
    nowhere = np.zeros_like(TRUE_POSE)
    match = np.full(MEASUREMENTS.sighting_count, -1)
    estimate = estimate_of(
        MEASUREMENTS, nowhere + np.array([1.0, 0.0, 0.0]), np.zeros((0, 2)), match
    )
    figures = trajectory(estimate, truth_from(MEASUREMENTS.t, nowhere))
    assert figures is not None
    assert figures.aligned_rmse_m < 1e-12
    assert figures.truth_T_estimate[2] == 0.0


def test_the_root_mean_square_of_nothing_is_not_a_number() -> None:
    assert np.isnan(rms(np.zeros(0)))
    assert rms(np.array([3.0, -4.0])) == pytest.approx(np.sqrt(12.5))


# ---- consistency -------------------------------------------------------------------------------


def random_covariance(rng: np.random.Generator, size: int) -> np.ndarray:
    root = rng.normal(size=(size, size))
    return 1e-4 * (root @ root.T + 0.1 * np.eye(size))


def assert_mean_is_one(values: list[float], freedom: int) -> None:
    """The mean of ``values``, each chi-square over its degrees of freedom, lies in 99.9 %."""
    total = freedom * len(values)
    low, high = chi2.ppf([0.0005, 0.9995], total) / total
    assert low < np.mean(values) < high


def test_pose_nees_is_one_on_average_for_errors_drawn_from_the_covariance() -> None:
    rng = np.random.default_rng(7)
    nodes = len(TRUE_POSE)
    values = []
    for _ in range(60):
        cov = np.array([random_covariance(rng, 3) for _ in range(nodes)])
        error = np.einsum("nij,nj->ni", np.linalg.cholesky(cov), rng.standard_normal((nodes, 3)))
        pose = TRUE_POSE + error
        pose[:, 2] = wrap(pose[:, 2])
        estimate = replace(noisy_estimate(), pose=pose, cov_floor=cov)
        values.append(pose_nees(estimate, TRUTH, TRUE_POSE[0]))
    assert_mean_is_one(values, 3 * (nodes - 1))


def test_pose_nees_grows_with_the_square_of_what_the_covariance_understates() -> None:
    estimate = noisy_estimate()
    nees = pose_nees(estimate, TRUTH, TRUE_POSE[0])
    boasting = replace(estimate, cov_floor=estimate.cov_floor / 9.0)
    assert pose_nees(boasting, TRUTH, TRUE_POSE[0]) == pytest.approx(9.0 * nees)


def test_pose_nees_leaves_out_the_first_node() -> None:
    estimate = noisy_estimate()
    cov = estimate.cov_floor.copy()
    cov[0] *= 1e-12
    nees = pose_nees(estimate, TRUTH, TRUE_POSE[0])
    assert pose_nees(replace(estimate, cov_floor=cov), TRUTH, TRUE_POSE[0]) == nees


@pytest.mark.parametrize(
    ("off", "defined"),
    [([5e-6, 0.0, 0.0], True), ([2e-5, 0.0, 0.0], False), ([0.0, 0.0, 2 * np.pi], True)],
)
def test_pose_nees_needs_a_true_path_that_begins_at_the_start(
    off: list[float], defined: bool
) -> None:
    assert np.isfinite(pose_nees(noisy_estimate(), TRUTH, TRUE_POSE[0] + off)) == defined


def test_pose_nees_is_not_defined_without_a_known_start_or_a_true_path() -> None:
    late = truth_from(MEASUREMENTS.t[1:], TRUE_POSE[1:])
    assert np.isnan(pose_nees(noisy_estimate(), TRUTH, None))
    assert np.isnan(pose_nees(noisy_estimate(), late, TRUE_POSE[0]))
    assert np.isnan(pose_nees(noisy_estimate(), truth_of(None, MEASUREMENTS), TRUE_POSE[0]))


def test_nees_of_a_singular_covariance_is_not_defined() -> None:
    assert np.isnan(mean_nees(np.ones((1, 3)), np.zeros((1, 3, 3))))
    assert np.isnan(mean_nees(np.zeros((0, 3)), np.zeros((0, 3, 3))))
    assert np.isnan(map_nees(np.ones((2, 2)), GRID[:2], np.zeros((4, 4)))[0])


@pytest.mark.parametrize(("lines", "rank"), [(GRID, 3), (GRID[:4], 2)])
def test_map_nees_is_one_on_average_whatever_frame_was_chosen(lines: np.ndarray, rank: int) -> None:
    rng = np.random.default_rng(11)
    cov = random_covariance(rng, 2 * len(lines))
    root = np.linalg.cholesky(cov)
    normals = np.column_stack([np.cos(lines[:, 1]), np.sin(lines[:, 1])])
    values = []
    for _ in range(300):
        error = (root @ rng.standard_normal(len(cov))).reshape(-1, 2)
        shift = rng.normal(size=3)
        error += np.column_stack([normals @ shift[:2], np.full(len(lines), shift[2])])
        nees, freedom = map_nees(error, lines, cov)
        assert freedom == 2 * len(lines) - rank
        values.append(nees)
    assert_mean_is_one(values, 2 * len(lines) - rank)


def test_map_nees_is_the_minimum_over_rigid_motions() -> None:
    rng = np.random.default_rng(13)
    cov, error = random_covariance(rng, 16), rng.normal(size=(8, 2))
    J = np.zeros((8, 2, 3))
    J[:, 0, 0], J[:, 0, 1], J[:, 1, 2] = np.cos(GRID[:, 1]), np.sin(GRID[:, 1]), 1.0
    J = J.reshape(16, 3)
    information = np.linalg.inv(cov)
    g = -np.linalg.solve(J.T @ information @ J, J.T @ information @ error.ravel())
    left = error.ravel() + J @ g
    nees, freedom = map_nees(error, GRID, cov)
    assert nees * freedom == pytest.approx(left @ information @ left)


def test_one_line_alone_has_no_map_nees() -> None:
    nees, freedom = map_nees(np.ones((1, 2)), GRID[:1], np.eye(2))
    assert np.isnan(nees)
    assert freedom == 0


def test_parallel_lines_named_by_twins_leave_one_direction_open() -> None:
    """Files print angles with few decimals: 0 and 3.14159265 are parallel all the same."""
    lines = np.array([[1.0, 0.0], [2.0, 3.14159265], [3.0, 0.0]])
    assert map_nees(np.zeros((3, 2)), lines, np.eye(6))[1] == 4


def test_a_small_motion_of_a_map_is_no_error_to_map_nees() -> None:
    motion = np.array([1e-4, -2e-4, 1e-4])
    difference = line_to_floor(GRID, motion) - GRID
    nees, _ = map_nees(difference, GRID, 1e-6 * np.eye(16))
    assert nees < 1e-6
    off = rigid_from_lines(line_to_floor(GRID, motion), np.zeros(8), GRID, np.zeros(3))
    np.testing.assert_allclose(compose(off, motion), np.zeros(3), atol=1e-9)
    np.testing.assert_allclose(inverse(off), motion, atol=1e-9)
