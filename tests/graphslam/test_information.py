from __future__ import annotations

import numpy as np
import pytest

from graphslam.ekf import run_ekf
from graphslam.information import position_information
from graphslam.smoother import smooth
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
