"""Known landmarks: the filter and the graph localise on a map that stays where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graphslam.config import EkfConfig, MatchingConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.geometry import wrap
from graphslam.measurements import LandmarkMap
from graphslam.smoother import smooth
from graphslam.smoother.engine_gtsam import minimise
from graphslam.smoother.problem import state_problem
from tests.worlds import GRID, drive

KNOWN = EkfConfig(matching=MatchingConfig(method="known"))


def map_of(lines: np.ndarray) -> LandmarkMap:
    count = len(lines)
    return LandmarkMap(
        np.arange(count),
        ("line",) * count,
        lines,
        np.full((count, 2), np.nan),
        np.zeros(count, int),
    )


def on_known_map(seed: int, lines: np.ndarray = GRID, **options):
    measurements, truth = drive(seed, **options)
    return replace(measurements, known=map_of(lines)), truth


def path_rmse(estimate, truth) -> float:
    return float(np.sqrt(np.mean((estimate.pose[:, :2] - truth[:, :2]) ** 2)))


def test_a_known_map_stays_where_it_is_and_has_no_covariance():
    measurements, _ = on_known_map(0)
    for estimate in (filtered := run_ekf(measurements), smooth(measurements, filtered)):
        np.testing.assert_allclose(estimate.map.params, GRID, atol=1e-12)
        assert len(estimate.map) == len(GRID)
        assert not estimate.cov_joint[3:].any()
        assert not estimate.cov_joint[:, 3:].any()
        assert np.linalg.eigvalsh(estimate.cov_joint[:3, :3])[0] > 0


def test_a_known_map_makes_the_path_better_than_an_unknown_one():
    better = 0
    for seed in range(6):
        measurements, truth = on_known_map(seed)
        known = path_rmse(run_ekf(measurements), truth)
        better += known < path_rmse(run_ekf(replace(measurements, known=None)), truth)
    assert better >= 5


def test_without_noise_localisation_gives_the_truth():
    measurements, truth = on_known_map(1, noise=0.0)
    for estimate in (filtered := run_ekf(measurements), smooth(measurements, filtered)):
        np.testing.assert_allclose(estimate.pose, truth, atol=1e-6)


def test_filter_and_graph_agree_on_a_known_map_at_a_common_linearisation():
    measurements, truth = on_known_map(2)
    at = smooth(measurements, run_ekf(measurements, KNOWN))
    filtered = run_ekf(measurements, linearise_at=at)
    smoothed = smooth(measurements, at, linearise_at=at)
    np.testing.assert_allclose(filtered.pose[-1], smoothed.pose[-1], atol=1e-9)
    np.testing.assert_allclose(filtered.cov_joint, smoothed.cov_joint, atol=1e-11)
    assert path_rmse(smoothed, truth) < path_rmse(filtered, truth)


def test_localisation_is_consistent():
    nees = []
    for seed in range(30):
        measurements, truth = on_known_map(seed, nodes=60)
        estimate = run_ekf(measurements)
        error = estimate.pose - truth
        error[:, 2] = wrap(error[:, 2])
        solved = np.linalg.solve(estimate.cov_floor[1:], error[1:, :, None])[..., 0]
        nees.append(np.mean(np.sum(error[1:] * solved, axis=1)) / 3)
    assert 0.8 < np.mean(nees) < 1.2


def test_sightings_of_no_known_landmark_are_dropped_and_counted():
    measurements, _ = on_known_map(3, lines=GRID[:6])
    estimate = run_ekf(measurements)
    assert len(estimate.map) == 6
    assert estimate.counts["sighting of no known landmark"] > 0


def test_a_known_map_is_extended_where_asked_for():
    measurements, _ = on_known_map(3, lines=GRID[:6])
    filtered = run_ekf(measurements, EkfConfig(extend_map=True))
    smoothed = smooth(measurements, filtered)
    for estimate in (filtered, smoothed):
        assert len(estimate.map) == len(GRID)
        np.testing.assert_array_equal(estimate.map.id[:6], np.arange(6))
        assert not estimate.cov_joint[3:15].any()
        assert (np.diag(estimate.cov_joint)[15:] > 0).all()
    found = estimate.map.params[6:]
    for line in GRID[6:]:
        assert np.min(np.abs(found[:, 0] - line[0])) < 0.05


@pytest.mark.parametrize("known", [None, GRID[:5]])
def test_pair_covariances_are_blocks_of_the_joint_covariance(known):
    measurements, _ = drive(4, nodes=50)
    if known is not None:
        measurements = replace(measurements, known=map_of(known))
    filtered = run_ekf(measurements, EkfConfig(extend_map=True))
    problem = state_problem(measurements, filtered.match, filtered)
    minimum = minimise(problem, SmootherConfig())
    cov, joint = minimum.covariances()
    landmarks = np.arange(len(problem.kinds))
    pairs = minimum.pair_covariances(np.full(len(landmarks), len(cov) - 1), landmarks)
    for m, pair in enumerate(pairs):
        at = np.r_[0:3, 3 + 2 * m : 5 + 2 * m]
        np.testing.assert_allclose(pair, joint[np.ix_(at, at)], atol=1e-12)


def test_a_weight_of_zero_switches_a_sighting_off():
    measurements, _ = drive(5, nodes=50)
    filtered = run_ekf(measurements, KNOWN)
    match = filtered.match.copy()
    weight = np.ones(len(match))
    off = np.flatnonzero(np.isfinite(filtered.nis))[::3]
    weight[off] = 0.0
    weighted = minimise(
        state_problem(measurements, match, filtered, weight=weight), SmootherConfig()
    )
    match[off] = -1
    without = minimise(state_problem(measurements, match, filtered), SmootherConfig())
    np.testing.assert_allclose(weighted.pose, without.pose, atol=1e-9)
    assert weighted.cost == pytest.approx(without.cost, rel=1e-9)


def test_half_the_weight_is_twice_the_covariance():
    measurements, _ = drive(6, nodes=40)
    filtered = run_ekf(measurements, KNOWN)
    table = measurements.sightings["line"]
    half = np.full(len(table), 0.5)
    vague = replace(measurements, sightings={"line": replace(table, cov=2.0 * table.cov)})
    weighted = minimise(
        state_problem(measurements, filtered.match, filtered, weight=half), SmootherConfig()
    )
    stated = minimise(state_problem(vague, filtered.match, filtered), SmootherConfig())
    np.testing.assert_allclose(weighted.pose, stated.pose, atol=1e-9)
    np.testing.assert_allclose(weighted.covariances()[1], stated.covariances()[1], atol=1e-12)
