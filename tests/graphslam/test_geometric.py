"""Geometric correction: what lines fix by trigonometry, and how well it says it knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graphslam.baseline import dead_reckoning
from graphslam.ekf import run_ekf
from graphslam.errors import BadMeasurements
from graphslam.geometric import geometric_correction
from graphslam.geometry import compose, line_to_robot, twin, wrap
from graphslam.measurements import Measurements, Odometry, Sightings
from tests.graphslam.test_localisation import map_of, on_known_map, path_rmse
from tests.worlds import drive

ACROSS = np.array([[3.0, 0.0], [2.0, np.pi / 2]])
TRUE = np.array([2.2, 1.5, 0.4])
OFF = np.array([0.05, -0.04, 0.03])


def one_look(lines: np.ndarray, name=lambda z: z) -> Measurements:
    """Returns two nodes; odometry ends `OFF` the true pose, from which the lines are seen."""
    start = np.array([2.0, 1.4, 0.3])
    increment = compose(np.array([0.0, 0.0, -0.3]), (TRUE + OFF - start) * [1, 1, 0])
    increment[2] = TRUE[2] + OFF[2] - start[2]
    z = name(line_to_robot(lines, TRUE))
    count = len(lines)
    table = Sightings(
        "line",
        np.ones(count, int),
        z,
        np.broadcast_to(np.diag([1e-4, 1e-4]), (count, 2, 2)),
        np.full((count, 2), np.nan),
        np.ones(count),
        np.ones(count),
        np.ones(count, int),
        np.arange(count),
    )
    odometry = Odometry(increment[None], np.diag([0.01, 0.01, 0.01])[None])
    sightings = {"line": table}
    known = map_of(ACROSS)
    return Measurements(np.arange(2.0), start, 1e-12 * np.eye(3), odometry, sightings, known)


@pytest.mark.parametrize("name", [lambda z: z, twin], ids=["as seen", "by the twins"])
def test_two_lines_of_different_direction_fix_the_pose(name) -> None:
    estimate = geometric_correction(one_look(ACROSS, name))
    np.testing.assert_allclose(estimate.pose[-1], TRUE, atol=1e-12)
    assert np.max(np.abs(estimate.cov_floor[-1] - np.diag([1e-4, 1e-4, 0.5e-4]))) < 1e-7


def test_one_line_corrects_the_heading_and_the_distance_across_it_only() -> None:
    estimate = geometric_correction(one_look(ACROSS[:1]))
    np.testing.assert_allclose(estimate.pose[-1], TRUE + OFF * [0, 1, 0], atol=1e-12)
    variances = np.diag(estimate.cov_floor[-1])
    np.testing.assert_allclose(variances, [1e-4, 0.01, 1e-4], rtol=1e-3)


def test_two_parallel_lines_fix_no_more_than_one() -> None:
    lines = np.array([[3.0, 0.0], [1.5, 0.0]])
    measurements = replace(one_look(lines), known=map_of(lines))
    np.testing.assert_allclose(
        geometric_correction(measurements).pose[-1], TRUE + OFF * [0, 1, 0], atol=1e-12
    )


def test_without_a_line_it_is_odometry() -> None:
    measurements, _ = on_known_map(0)
    measurements = measurements.without_sightings()
    odometry, estimate = dead_reckoning(measurements), geometric_correction(measurements)
    np.testing.assert_allclose(estimate.pose, odometry.pose, atol=1e-9)
    np.testing.assert_allclose(estimate.cov_floor, odometry.cov_floor, rtol=1e-6, atol=1e-14)


def test_its_errors_are_as_large_as_it_says_and_larger_than_the_filters() -> None:
    nees, filtered, corrected = [], [], []
    for seed in range(40):
        measurements, truth = on_known_map(seed, nodes=100)
        estimate = geometric_correction(measurements)
        error = estimate.pose - truth
        error[:, 2] = wrap(error[:, 2])
        solved = np.linalg.solve(estimate.cov_floor[1:], error[1:, :, None])[..., 0]
        nees.append(np.mean(np.sum(error[1:] * solved, axis=1)) / 3)
        corrected.append(path_rmse(estimate, truth))
        filtered.append(path_rmse(run_ekf(measurements), truth))
    assert 0.8 < np.mean(nees) < 1.2
    assert np.median(filtered) < np.median(corrected)


def test_it_says_who_it_is_and_that_it_is_causal() -> None:
    estimate = geometric_correction(on_known_map(1, nodes=30)[0])
    assert estimate.method == "geometric"
    assert estimate.causal
    assert estimate.used.any()


def test_it_refuses_to_run_without_known_lines() -> None:
    with pytest.raises(BadMeasurements, match="known lines"):
        geometric_correction(drive(0, nodes=10)[0])
