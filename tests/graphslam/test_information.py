from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from frontend.simulate import load_scenario, simulate_measurements
from frontend.simulate.scenario import Motion
from graphslam.ekf import run_ekf
from graphslam.information import position_information
from graphslam.smoother import smooth
from graphslam.smoother.bound import cramer_rao
from tests.worlds import GRID, drive

DIRECTIONS = {"across x": 0.0, "across y": 90.0, "slanted": 35.0}


def parallel_lines(direction_deg: float) -> np.ndarray:
    rho = np.arange(-4.0, 5.0, 0.9)
    return np.column_stack([rho, np.full(len(rho), np.radians(direction_deg))])


@pytest.mark.parametrize("normal_deg", DIRECTIONS.values(), ids=DIRECTIONS)
def test_lines_of_one_direction_leave_the_position_along_them_unobserved(normal_deg: float) -> None:
    measurements, _ = drive(0, 200, lines=parallel_lines(normal_deg))
    filtered = run_ekf(measurements)
    for estimate in (filtered, smooth(measurements, filtered)):
        (unobserved,) = estimate.unobserved
        assert unobserved.quantity == "position"
        angle = np.degrees(np.arctan2(unobserved.direction[1], unobserved.direction[0]))
        off = (angle - (normal_deg + 90.0) + 90.0) % 180.0 - 90.0
        assert abs(off) < 1.5
        assert "not observed" in str(unobserved)


def test_lines_of_two_directions_leave_nothing_unobserved() -> None:
    measurements, _ = drive(0, 200)
    assert run_ekf(measurements).unobserved == ()


def test_position_information_is_that_of_the_lines_normals() -> None:
    measurements, truth = drive(0, 40, noise=0.0)
    estimate = run_ekf(measurements)
    information = position_information(measurements, truth, estimate.map, estimate.match)
    normals = GRID[measurements.sightings["line"].truth, 1]
    vectors = np.column_stack([np.cos(normals), np.sin(normals)])
    np.testing.assert_allclose(information, vectors.T @ vectors / 0.01**2, rtol=1e-6, atol=1e-4)


def test_where_no_direction_is_observed_the_position_is_named_once() -> None:
    measurements, _ = drive(0, 60)
    found = run_ekf(measurements.without_sightings()).unobserved
    assert [u.quantity for u in found] == ["position", "heading"]
    assert str(found[0]).startswith("the position is not observed")


def test_a_pose_that_the_start_itself_fixes_is_not_called_unobserved() -> None:
    measurements, _ = drive(0, 1, reach=0.0)
    assert run_ekf(measurements).unobserved == ()


def test_along_the_lines_the_covariance_is_that_of_odometry_with_the_lines_as_a_compass() -> None:
    """Where a robot drives straight across parallel lines, their distances tell nothing along."""
    there = Motion(forward=5.0), Motion(turn_deg=180.0), Motion(forward=5.0)
    scenario = replace(load_scenario("one-direction"), path=there)
    measurements = simulate_measurements(scenario, 2)
    table = measurements.sightings["line"]
    far = np.array(table.cov)
    far[:, 0, 0] *= 1e10  # a line seen so is a compass and nothing else
    compass = replace(measurements, sightings={"line": replace(table, cov=far)})
    full = smooth(measurements, run_ekf(measurements))
    turned = cramer_rao(compass, full.match, full.pose, full.map.params)
    (unobserved,) = full.unobserved
    along = np.array(unobserved.direction)
    assert abs(along[1]) > np.cos(np.radians(1.0))
    sigmas = [np.sqrt(along @ c[-1, :2, :2] @ along) for c in (full.cov_floor, turned.cov_floor)]
    assert unobserved.sigma == pytest.approx(sigmas[0])
    assert sigmas[0] == pytest.approx(sigmas[1], rel=0.02)
    across = np.array([along[1], -along[0]])
    assert np.sqrt(across @ full.cov_floor[-1, :2, :2] @ across) < 0.2 * sigmas[0]
