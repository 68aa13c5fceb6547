from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from graphslam.baseline import dead_reckoning
from graphslam.config import EkfConfig, MatchingConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.errors import BadConfig, BadMeasurements, UnderConstrained
from graphslam.geometry import is_canonical, twin, wrap
from graphslam.measurements import Measurements, Sightings
from graphslam.models.line import LINE
from tests.worlds import GRID, drive


def pose_fixes(
    measurements: Measurements, truth: np.ndarray, every: int, sigma: float
) -> Sightings:
    node = np.arange(0, len(truth), every)
    count = len(node)
    rng = np.random.default_rng(0)
    return Sightings(
        "pose_fix",
        node,
        truth[node] + sigma * rng.standard_normal((count, 3)),
        np.broadcast_to(sigma**2 * np.eye(3), (count, 3, 3)),
        np.full((count, 2), np.nan),
        measurements.t[node],
        np.full(count, np.nan),
        np.full(count, -1),
        np.full(count, -1),
    )


def test_without_noise_the_filter_returns_the_truth() -> None:
    measurements, truth = drive(0, noise=0.0)
    estimate = run_ekf(measurements)
    np.testing.assert_allclose(estimate.pose[:, :2], truth[:, :2], atol=1e-9)
    assert np.max(np.abs(wrap(estimate.pose[:, 2] - truth[:, 2]))) < 1e-9
    order = np.lexsort(np.round(estimate.map.params, 6).T)
    np.testing.assert_allclose(estimate.map.params[order], GRID, atol=1e-9)


def test_every_true_line_becomes_one_landmark_though_half_are_seen_as_twins() -> None:
    for seed in range(5):
        estimate = run_ekf(drive(seed, 400)[0])
        assert len(estimate.map) == len(GRID)
        assert np.all(estimate.map.params[:, 0] >= 0)


def test_naming_sightings_by_their_twins_changes_nothing() -> None:
    measurements, _ = drive(3, 120)
    table = measurements.sightings["line"]
    cov = table.cov.copy()
    cov[:, 0, 1] *= -1
    cov[:, 1, 0] *= -1
    other = replace(table, z=twin(table.z), cov=cov, extent=-table.extent[:, ::-1])
    a, b = run_ekf(measurements), run_ekf(replace(measurements, sightings={"line": other}))
    np.testing.assert_allclose(b.pose, a.pose, atol=1e-12)
    np.testing.assert_allclose(b.map.params, a.map.params, atol=1e-12)
    np.testing.assert_allclose(b.map.extent, a.map.extent, atol=1e-9)


def test_errors_are_as_large_as_the_filter_says() -> None:
    """Mean NEES of the last pose over 40 seeds, inside the 99.9 % band of its chi-square law."""
    nees = []
    for seed in range(40):
        measurements, truth = drive(seed, 80, odometry_sigma=(0.003, 0.003, 0.003))
        estimate = run_ekf(measurements)
        error = estimate.pose[-1] - truth[-1]
        error[2] = wrap(error[2])
        nees.append(error @ np.linalg.solve(estimate.cov_floor[-1], error))
    low, high = chi2.ppf([0.0005, 0.9995], 3 * len(nees))
    assert low < np.sum(nees) < high


def test_dead_reckoning_errors_are_as_large_as_it_says() -> None:
    nees = []
    for seed in range(40):
        measurements, truth = drive(seed, 80)
        estimate = dead_reckoning(measurements)
        error = estimate.pose[-1] - truth[-1]
        error[2] = wrap(error[2])
        nees.append(error @ np.linalg.solve(estimate.cov_floor[-1], error))
    low, high = chi2.ppf([0.0005, 0.9995], 3 * len(nees))
    assert low < np.sum(nees) < high


def test_a_new_line_carries_the_poses_uncertainty_and_its_correlation() -> None:
    measurements, _ = drive(1, 1, start_sigma=0.1)
    estimate = run_ekf(measurements, EkfConfig(confirm_after=1))
    table, P, count = measurements.sightings["line"], 0.01 * np.eye(3), len(estimate.map)
    assert count >= 2
    J_pose, J_z = np.zeros((2 * count, 3)), np.zeros((2 * count, 2 * count))
    for row in range(count):
        line, by_pose, by_z = LINE.initialise(measurements.start_pose, table.z[row], table.cov[row])
        flip = np.diag([1.0 if is_canonical(line) else -1.0, 1.0])
        at = slice(2 * row, 2 * row + 2)
        J_pose[at], J_z[at, at] = flip @ by_pose, flip @ by_z
    R = np.kron(np.eye(count), table.cov[0])
    np.testing.assert_allclose(
        estimate.cov_joint[3:, 3:], J_pose @ P @ J_pose.T + J_z @ R @ J_z.T, atol=1e-12
    )
    np.testing.assert_allclose(estimate.cov_joint[3:, :3], J_pose @ P, atol=1e-12)


def test_known_matching_and_gated_matching_agree_on_an_easy_drive() -> None:
    measurements, _ = drive(2, 200)
    gated = run_ekf(measurements)
    known = run_ekf(measurements, EkfConfig(MatchingConfig(method="known")))
    assert known.used.all()
    np.testing.assert_allclose(known.pose, gated.pose, atol=0.01)
    assert len(known.map) == len(gated.map) == len(GRID)


def test_a_sensor_without_landmarks_is_fused_without_the_filter_knowing_it() -> None:
    measurements, truth = drive(4, 150)
    fixes = pose_fixes(measurements, truth, 10, 0.02)
    only = replace(measurements, sightings={"pose_fix": fixes})
    both = replace(measurements, sightings={**measurements.sightings, "pose_fix": fixes})
    estimate = run_ekf(only)
    assert len(estimate.map) == 0
    assert estimate.used.all()
    assert np.abs(estimate.pose[-1, :2] - truth[-1, :2]).max() < 0.05
    assert np.trace(run_ekf(both).cov_floor[-1]) < np.trace(estimate.cov_floor[-1])


def test_being_rejected_throughout_is_called_lost_and_widens_the_covariance() -> None:
    measurements, _ = drive(0, 120)
    table = measurements.sightings["line"]
    late = table.node >= 60
    z = table.z + late[:, None] * np.array([0.12, 0.0])  # between the gates: neither old nor new
    shifted = replace(measurements, sightings={"line": replace(table, z=z)})
    config = EkfConfig(MatchingConfig(gate_new=1e9))
    estimate = run_ekf(shifted, config)
    assert estimate.counts["lost: most sightings rejected for several nodes"] >= 1
    still = run_ekf(shifted, replace(config, lost_after=0))
    assert "lost: most sightings rejected for several nodes" not in still.counts


def test_an_estimate_of_other_measurements_is_refused_as_linearisation() -> None:
    measurements, _ = drive(0, 50)
    other = run_ekf(drive(0, 60)[0])
    with pytest.raises(BadMeasurements, match="other measurements"):
        run_ekf(measurements, linearise_at=other)


def test_a_log_without_sightings_gives_dead_reckoning() -> None:
    measurements, _ = drive(0, 80)
    blind = run_ekf(measurements.without_sightings())
    plain = dead_reckoning(measurements)
    np.testing.assert_allclose(blind.pose, plain.pose, atol=1e-12)
    np.testing.assert_allclose(blind.cov_floor, plain.cov_floor, atol=1e-15)
    assert {u.quantity for u in blind.unobserved} == {"position", "heading"}


def test_sightings_that_are_left_out_are_counted_by_reason() -> None:
    measurements, _ = drive(2, 80)
    table = measurements.sightings["line"]
    truth = np.where(table.truth == 1, -1, table.truth)
    unnamed = replace(measurements, sightings={"line": replace(table, truth=truth)})
    known = run_ekf(unnamed, EkfConfig(MatchingConfig(method="known")))
    assert known.counts == {"sighting without a true landmark": int(np.sum(truth < 0))}
    assert np.all(known.used == (truth >= 0))
    narrow = run_ekf(measurements, EkfConfig(MatchingConfig(gate=0.5)))
    assert narrow.counts["sighting between the gates"] > 0
    reasons = [name for name in narrow.counts if "sighting" in name and "lost:" not in name]
    assert sum(narrow.counts[name] for name in reasons) == np.sum(~narrow.used)


def test_known_matching_is_never_lost_among_sightings_without_a_true_landmark() -> None:
    measurements, _ = drive(2, 80)
    table = measurements.sightings["line"]
    clutter = (table.node >= 20) & (table.node < 50)
    truth = np.where(clutter, -1, table.truth)
    config = EkfConfig(MatchingConfig(method="known"))
    with_rows = replace(measurements, sightings={"line": replace(table, truth=truth)})
    without = replace(measurements, sightings={"line": table.select(~clutter)})
    a, b = run_ekf(with_rows, config), run_ekf(without, config)
    np.testing.assert_array_equal(a.pose, b.pose)
    np.testing.assert_array_equal(a.cov_floor, b.cov_floor)


def test_a_pose_fix_corrects_the_pose_before_lines_of_its_node_start_landmarks() -> None:
    for seed in range(4):
        measurements, truth = drive(seed, 40, lines=GRID[[0, 4]], start_sigma=0.3, reach=4.0)
        fixes = pose_fixes(measurements, truth, 1, 0.01)
        both = replace(measurements, sightings={**measurements.sightings, "pose_fix": fixes})
        assert len(run_ekf(both).map) == 2


def test_a_start_beyond_what_numbers_hold_is_an_error_in_words() -> None:
    measurements, _ = drive(0, 30)
    hopeless = replace(measurements, start_cov=1e30 * np.eye(3))
    with pytest.raises(UnderConstrained, match="less uncertain start"):
        run_ekf(hopeless)


@pytest.mark.parametrize(
    ("config", "values"),
    [
        (MatchingConfig, {"method": "knwon"}),
        (MatchingConfig, {"gate": -1.0}),
        (MatchingConfig, {"gate": float("nan")}),
        (MatchingConfig, {"gate": 100.0, "gate_new": 1.0}),
        (MatchingConfig, {"nearest_angle_deg": 0.0}),
        (MatchingConfig, {"nearest_distance_m": -0.1}),
        (EkfConfig, {"lost_after": -1}),
        (SmootherConfig, {"max_iterations": 0}),
        (SmootherConfig, {"tolerance": 0.0}),
    ],
)
def test_settings_that_mean_nothing_are_refused_by_name(config: type, values: dict) -> None:
    with pytest.raises(BadConfig, match=next(reversed(values))):
        config(**values)


def test_the_filter_remembers_what_it_knew_of_each_landmark_and_when() -> None:
    estimate = run_ekf(drive(1, 120)[0])
    history = estimate.map_variance
    assert history is not None
    assert history.shape == (120, 2 * len(estimate.map))
    np.testing.assert_allclose(history[-1], np.diag(estimate.cov_joint)[3:], rtol=1e-12)
    for column in history.T:
        known = np.flatnonzero(np.isfinite(column))
        np.testing.assert_array_equal(known, np.arange(known[0], 120))  # once known, always known
        assert np.all(np.diff(column[known]) <= 1e-12 * column[known[0]])  # a still landmark


def test_a_history_too_large_to_keep_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("graphslam.ekf_result.LARGEST_HISTORY", 100)
    assert run_ekf(drive(1, 40)[0]).map_variance is None
