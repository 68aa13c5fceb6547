"""Smoothing node by node: what each pose is known as, when, and at the end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compare.metrics import mean_nees
from graphslam.config import EkfConfig, IncrementalConfig, MatchingConfig
from graphslam.ekf import run_ekf
from graphslam.errors import BadConfig, BadMeasurements
from graphslam.estimate import Estimate
from graphslam.geometry import wrap
from graphslam.measurements import Measurements, Odometry
from graphslam.models import MODELS
from graphslam.models.base import PartlyLinear
from graphslam.smoother import run_fixed_lag, run_isam2, smooth
from graphslam.smoother.incremental import LEFT
from graphslam.smoother.updates import thresholds
from tests.worlds import CONES, bearing_drive, drive

KNOWN = EkfConfig(MatchingConfig(method="known"))
SHARP = 1e-6
"""Linearise anew for the least change."""
ENDLESS = 1e6


def until(measurements: Measurements, nodes: int) -> Measurements:
    """Returns the first nodes of a run and what was seen from them."""
    odometry = measurements.odometry
    tables = {
        kind: table.select(table.node < nodes) for kind, table in measurements.sightings.items()
    }
    return replace(
        measurements,
        t=measurements.t[:nodes],
        odometry=Odometry(odometry.increment[: nodes - 1], odometry.cov[: nodes - 1]),
        sightings=tables,
    )


def path_error(estimate: Estimate, other: Estimate) -> float:
    return float(np.sqrt(np.mean((estimate.pose - other.pose)[:, :2] ** 2)))


def assert_alike(cov: np.ndarray, wanted: np.ndarray) -> None:
    """Checks covariances to 2 % of the sigmas: iSAM2 is linearised where its last step began."""
    sigma = np.sqrt(np.diagonal(wanted, axis1=-2, axis2=-1))
    scale = sigma[..., :, None] * sigma[..., None, :]
    np.testing.assert_allclose(cov / scale, wanted / scale, atol=0.02)


@pytest.fixture(scope="module")
def run() -> tuple[Measurements, np.ndarray, Estimate, Estimate]:
    measurements, truth = drive(3, 160)
    filtered = run_ekf(measurements, KNOWN)
    return measurements, truth, filtered, smooth(measurements, filtered)


def test_at_the_end_isam2_is_the_smoother(
    run: tuple[Measurements, np.ndarray, Estimate, Estimate],
) -> None:
    measurements, _, filtered, smoothed = run
    found = run_isam2(measurements, filtered, IncrementalConfig(relinearise=SHARP))
    assert (found.method, found.causal) == ("isam2", True)
    np.testing.assert_allclose(found.pose[-1], smoothed.pose[-1], atol=1e-5)
    np.testing.assert_allclose(found.map.params, smoothed.map.params, atol=1e-5)
    assert_alike(found.cov_joint, smoothed.cov_joint)
    np.testing.assert_array_equal(found.match, smoothed.match)


@pytest.mark.parametrize("node", [40, 99])
def test_each_pose_of_isam2_is_what_smoothing_said_at_its_time(
    run: tuple[Measurements, np.ndarray, Estimate, Estimate], node: int
) -> None:
    measurements, _, filtered, _ = run
    found = run_isam2(measurements, filtered, IncrementalConfig(relinearise=SHARP))
    past = until(measurements, node + 1)
    then = smooth(past, run_ekf(past, KNOWN))
    np.testing.assert_allclose(found.pose[node], then.pose[-1], atol=1e-5)
    assert_alike(found.cov_floor[node], then.cov_floor[-1])


def test_a_longer_lag_brings_the_path_nearer_to_the_smoothers(
    run: tuple[Measurements, np.ndarray, Estimate, Estimate],
) -> None:
    measurements, _, filtered, smoothed = run
    found = [
        run_fixed_lag(measurements, filtered, IncrementalConfig(lag_s=lag, relinearise=SHARP))
        for lag in (0.0, 1.0, ENDLESS)
    ]
    away = [path_error(estimate, smoothed) for estimate in found]
    assert away[0] > 1.05 * away[1] > away[2]
    assert away[2] < 1e-5
    assert_alike(found[2].cov_floor, smoothed.cov_floor)
    for estimate in found:  # what left the window is not lost to the last pose and the map
        np.testing.assert_allclose(estimate.pose[-1], smoothed.pose[-1], atol=1e-3)
        np.testing.assert_allclose(estimate.map.params, smoothed.map.params, atol=5e-3)


def test_errors_are_as_large_as_both_say() -> None:
    nees = []
    for seed in range(6):
        measurements, truth = drive(seed, 120)
        filtered = run_ekf(measurements, KNOWN)
        for method in (run_isam2, run_fixed_lag):
            found = method(measurements, filtered, IncrementalConfig(lag_s=1.0))
            error = found.pose[1:] - truth[1:]
            error[:, 2] = wrap(error[:, 2])
            nees.append(mean_nees(error, found.cov_floor[1:]))
    assert 0.5 < np.mean(nees) < 1.6


@pytest.mark.parametrize("known", [False, True])
def test_landmarks_that_one_sighting_cannot_start_wait(known: bool) -> None:
    labels = np.arange(len(CONES))
    measurements, _ = bearing_drive(1, 80, labels=labels, known=known)
    filtered = run_ekf(measurements, KNOWN)
    smoothed = smooth(measurements, filtered)
    found = run_isam2(measurements, filtered, IncrementalConfig(relinearise=SHARP))
    assert found.map.kind == smoothed.map.kind
    np.testing.assert_allclose(found.map.params, smoothed.map.params, atol=1e-3)
    np.testing.assert_allclose(found.pose[-1], smoothed.pose[-1], atol=1e-4)
    assert not found.counts


def test_what_left_the_window_before_its_landmark_started_is_counted() -> None:
    measurements, _ = bearing_drive(1, 80, labels=np.arange(len(CONES)))
    found = run_fixed_lag(measurements, run_ekf(measurements, KNOWN), IncrementalConfig(lag_s=0.2))
    assert found.counts[LEFT] > 0
    assert np.sum(found.match < 0) >= found.counts[LEFT]


def test_each_node_is_told_once_and_in_order() -> None:
    measurements, _ = drive(1, 20)
    filtered = run_ekf(measurements, KNOWN)
    for method in (run_isam2, run_fixed_lag):
        told: list[int] = []
        method(measurements, filtered, told=told.append)
        assert told == list(range(20))
    told = []
    run_ekf(measurements, KNOWN, told=told.append)
    assert told == list(range(20))


def test_a_run_without_sightings_is_odometry() -> None:
    measurements = drive(1, 20)[0].without_sightings()
    filtered = run_ekf(measurements)
    for method in (run_isam2, run_fixed_lag):
        found = method(measurements, filtered)
        np.testing.assert_allclose(found.pose, filtered.pose, atol=1e-9)
        np.testing.assert_allclose(found.cov_floor, filtered.cov_floor, rtol=1e-6, atol=1e-12)


def test_matches_of_other_measurements_and_impossible_settings_are_refused() -> None:
    with pytest.raises(BadConfig, match="lag_s = -1"):
        IncrementalConfig(lag_s=-1.0)
    with pytest.raises(BadConfig, match="relinearise = 0"):
        IncrementalConfig(relinearise=0.0)
    measurements, _ = drive(1, 20)
    others, _ = drive(1, 30)
    for method in (run_isam2, run_fixed_lag):
        with pytest.raises(BadMeasurements, match="matches has shape"):
            method(measurements, run_ekf(others, KNOWN))


def test_nothing_is_linearised_anew_for_what_a_residual_is_linear_in() -> None:
    lines = thresholds(0.01, ["line"])
    np.testing.assert_array_equal(lines["x"], [0.01, 0.01, 0.01])
    np.testing.assert_array_equal(lines["l"], [np.inf, 0.01])
    np.testing.assert_array_equal(thresholds(0.01, ["line", "bearing"])["l"], [0.01, 0.01])
    assert thresholds(0.01, ["line", "lamp"]) == {}  # of different length: one threshold for all
    assert thresholds(0.01, []) == {}


def test_a_models_jacobians_do_not_change_with_what_it_says_it_is_linear_in() -> None:
    rng = np.random.default_rng(0)
    for model in MODELS.values():
        for parameter in model.linear_in if isinstance(model, PartlyLinear) else ():
            landmark, z = rng.normal(size=model.dim_landmark), rng.normal(size=model.dim_z)
            pose, moved = rng.normal(size=3), landmark.copy()
            moved[parameter] += 100.0
            before = model.residual(pose, landmark, z)[1:]
            after = model.residual(pose, moved, z)[1:]
            for one, other in zip(before, after, strict=True):
                np.testing.assert_array_equal(one, other)
