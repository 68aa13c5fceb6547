"""Other places on a known map: named where the floor repeats, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graphslam.baseline import integrate
from graphslam.config import ParticleConfig
from graphslam.elsewhere import OTHER_PLACES, Elsewhere, backwards, elsewhere
from graphslam.geometry import Array, inverse
from graphslam.measurements import Measurements
from graphslam.particle import localise_by_particles
from graphslam.region import within
from tests.graphslam.test_localisation import map_of
from tests.worlds import GRID, START, drive

PERIODIC = np.array(
    [(rho, 0.0) for rho in np.arange(-3.0, 7.0, 1.0)]
    + [(rho, np.pi / 2) for rho in np.arange(-2.4, 7.0, 0.8)]
)
"""Lines 1.0 m apart along x and 0.8 m apart along y."""
FEW = ParticleConfig(particles=200, particles_searching=400, start="anywhere")
"""So few that they agree on some place soon, right or not."""


def driven(lines: Array, nodes: int = 60, seed: int = 0) -> tuple[Measurements, Array]:
    measurements, truth = drive(seed, nodes=nodes, lines=lines)
    return replace(measurements, known=map_of(lines)), truth


def others(lines: Array, nodes: int = 60) -> Elsewhere:
    measurements, truth = driven(lines, nodes)
    region = np.array([-3.0, -3.0]), np.array([7.0, 7.0])
    last = truth[-1], 1e-4 * np.eye(3)
    return elsewhere(measurements, 0, last, lambda path: bool(within(region, path).all()), 14.0)


def test_a_floor_that_repeats_has_other_places_a_period_away_and_turned_by_half() -> None:
    found = others(PERIODIC)
    words = "they repeat every 1.000 m along 0° and 0.800 m along 90°, also turned by 180°"
    assert found.reason.endswith(words)
    for shift in ((1.0, 0.0), (0.0, 0.8), (1.0, 0.8)):
        off = np.abs(found.motions - [*shift, 0.0])
        assert np.any((off < [0.02, 0.02, 0.01]).all(axis=1)), shift


def test_a_floor_of_unequal_spacings_has_one_place() -> None:
    found = others(GRID)
    assert not len(found.motions)
    assert not found.reason


def test_odd_lines_leave_only_the_shifts_along_themselves_and_two_directions_none() -> None:
    across, along = [1.4, 0.0], [1.3, np.pi / 2]
    found = others(np.vstack([PERIODIC, across]), nodes=100)
    assert found.reason.endswith("they repeat every 0.800 m along 90°")
    assert not others(np.vstack([PERIODIC, across, along]), nodes=100).reason


def test_lines_of_one_direction_let_the_place_slide() -> None:
    found = others(PERIODIC[:10])
    assert found.slide == pytest.approx([0.0, 1.0])
    assert "any shift along 90° fits" in found.reason
    measurements, truth = driven(PERIODIC[:10])
    vague = replace(measurements, start_cov=np.diag([0.02, 0.0001, 0.01]))
    estimate = localise_by_particles(vague, replace(FEW, start="given"))
    assert estimate.converged  # the start says where along the lines, the lines where across
    assert np.hypot(*(estimate.pose[-1] - truth[-1])[:2]) < 0.1


def test_particles_that_agree_on_a_periodic_floor_say_which_other_places_remain() -> None:
    agreed = 0
    for seed in range(5):
        measurements, truth = driven(PERIODIC, nodes=80, seed=seed)
        estimate = localise_by_particles(measurements, replace(FEW, seed=seed))
        assert not estimate.converged
        assert estimate.unobserved[0].quantity == "position"
        reasons = [reason for reason in estimate.counts if reason.startswith(OTHER_PLACES)]
        agreed += len(reasons)
        assert all("1.000 m along 0° and 0.800 m along 90°" in reason for reason in reasons)
        error = estimate.pose[-1, :2] - truth[-1, :2]
        squared = error @ np.linalg.solve(estimate.cov_floor[-1, :2, :2], error)
        assert squared < 9.21  # 99 %
    assert agreed >= 3


def test_a_start_that_is_known_leaves_no_other_place_on_the_same_floor() -> None:
    measurements, truth = driven(PERIODIC)
    for sigma in (1e-6, 0.15):
        given = replace(measurements, start_cov=sigma**2 * np.diag([1.0, 1.0, 0.1]))
        estimate = localise_by_particles(given, replace(FEW, start="given"))
        assert estimate.converged
        assert np.hypot(*(estimate.pose[-1] - truth[-1])[:2]) < 0.05


def test_a_drive_backwards_is_the_same_drive() -> None:
    measurements, truth = drive(3, nodes=40, noise=0.0)
    back = backwards(measurements, 10, (truth[-1], np.eye(3)))
    path = integrate(back.start_pose, back.odometry.increment)
    np.testing.assert_allclose(path[::-1], truth[10:], atol=1e-9)
    again = backwards(back, 0, (START, np.eye(3)))
    np.testing.assert_allclose(again.odometry.cov, measurements.odometry.cov[10:], atol=1e-12)
    table, first = again.sightings["line"], measurements.sightings["line"].node >= 10
    np.testing.assert_array_equal(
        np.sort(table.z, axis=0), np.sort(measurements.sightings["line"].z[first], axis=0)
    )


def test_an_error_of_odometry_is_as_likely_backwards() -> None:
    measurements, truth = drive(0, nodes=3, noise=0.0)
    rng = np.random.default_rng(1)
    cov = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -0.5], [0.5, -0.5, 2.0]]) * 1e-6
    odometry = replace(measurements.odometry, cov=np.broadcast_to(cov, (2, 3, 3)))
    back = backwards(replace(measurements, odometry=odometry), 0, (truth[-1], np.eye(3)))
    forward = odometry.increment[0] + rng.multivariate_normal(np.zeros(3), cov, 20000)
    spread = np.cov((inverse(forward) - back.odometry.increment[-1]).T)
    np.testing.assert_allclose(spread, back.odometry.cov[-1], rtol=0.05, atol=1e-7)
