"""Monte Carlo localisation: from any start it finds the place, or says that it has not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graphslam.baseline import integrate
from graphslam.cloud import Cloud, effective_number, systematic
from graphslam.config import ParticleConfig
from graphslam.ekf import run_ekf
from graphslam.errors import BadConfig, BadMeasurements
from graphslam.geometry import compose, wrap
from graphslam.particle import localise_by_particles
from graphslam.region import region_of
from tests.graphslam.test_localisation import map_of, on_known_map, path_rmse
from tests.worlds import GRID, START, drive, square_drive

FEW = ParticleConfig(particles=500, particles_searching=2000)
ANYWHERE = replace(FEW, start="anywhere")
SAME_SPACING = np.array([(rho, alpha) for alpha in (0.0, np.pi / 2) for rho in range(-4, 9)])


def errors(estimate, truth: np.ndarray) -> np.ndarray:
    error = estimate.pose - truth
    error[:, 2] = wrap(error[:, 2])
    return error


# ---- the cloud ---------------------------------------------------------------------------------


def test_systematic_resampling_keeps_every_particle_by_its_weight() -> None:
    weight = np.array([0.5, 0.25, 0.0, 0.25])
    for offset in (0.0, 0.3, 0.999):
        kept = np.bincount(systematic(weight, 8, offset), minlength=4)
        np.testing.assert_array_equal(kept, [4, 2, 0, 2])


def test_the_effective_number_is_that_of_as_many_equal_particles() -> None:
    assert effective_number(np.zeros(7) + 3.0) == pytest.approx(7)
    assert effective_number(np.array([0.0, 0.0, -np.inf])) == pytest.approx(2)


def test_the_mean_heading_lies_between_the_headings_also_at_pi() -> None:
    pose = np.array([[0.0, 0.0, np.pi - 0.1], [0.0, 0.0, -np.pi + 0.1]])
    mean, cov = Cloud(pose, np.random.default_rng(0)).moments()
    assert abs(wrap(mean[2] - np.pi)) < 1e-12
    assert cov[2, 2] == pytest.approx(0.01)


def test_redrawing_keeps_mean_and_covariance_and_leaves_no_copies() -> None:
    rng = np.random.default_rng(1)
    pose = np.repeat(rng.normal(0, [1.0, 0.1, 0.2], (50, 3)), 400, axis=0)
    cloud = Cloud(pose, rng)
    mean, cov = cloud.moments()
    cloud.redraw()
    assert len(np.unique(cloud.pose[:, 0])) == len(pose)
    np.testing.assert_allclose(cloud.moments()[0], mean, atol=0.01)
    np.testing.assert_allclose(cloud.moments()[1], cov, atol=0.02)


# ---- tracking ----------------------------------------------------------------------------------


def test_from_a_known_start_it_is_as_good_as_the_filter_and_as_honest() -> None:
    nees, ours, filtered = [], [], []
    for seed in range(10):
        measurements, truth = on_known_map(seed, nodes=60)
        estimate = localise_by_particles(measurements, replace(FEW, seed=seed))
        error = errors(estimate, truth)[1:]
        solved = np.linalg.solve(estimate.cov_floor[1:], error[..., None])[..., 0]
        nees.append(np.mean(np.sum(error * solved, axis=1)) / 3)
        ours.append(path_rmse(estimate, truth))
        filtered.append(path_rmse(run_ekf(measurements), truth))
        assert estimate.converged
    assert 0.8 < np.mean(nees) < 1.2
    assert np.mean(ours) < 1.05 * np.mean(filtered)


def test_the_same_seed_gives_the_same_result_and_another_another() -> None:
    measurements, _ = on_known_map(2, nodes=30)
    a, b, c = (localise_by_particles(measurements, replace(FEW, seed=s)) for s in (1, 1, 2))
    np.testing.assert_array_equal(a.pose, b.pose)
    assert not np.array_equal(a.pose, c.pose)


def test_sightings_are_matched_as_the_filter_matches_them() -> None:
    measurements, _ = on_known_map(3, nodes=60)
    estimate, filtered = localise_by_particles(measurements, FEW), run_ekf(measurements)
    assert np.mean(estimate.match == filtered.match) > 0.99
    assert np.nanmean(estimate.nis) / 2 == pytest.approx(1.0, abs=0.25)


def test_known_lines_keep_their_place_and_have_no_covariance() -> None:
    measurements, _ = on_known_map(0, nodes=20)
    estimate = localise_by_particles(measurements, FEW)
    np.testing.assert_allclose(estimate.map.params, GRID, atol=1e-12)
    assert not estimate.cov_joint[3:].any()


# ---- searching ---------------------------------------------------------------------------------


def test_from_an_unknown_start_it_finds_its_place_on_unequal_spacings() -> None:
    right = 0
    for seed in range(50):
        measurements, truth = on_known_map(seed, nodes=26)
        estimate = localise_by_particles(measurements, replace(ANYWHERE, seed=seed))
        at_end = np.hypot(*errors(estimate, truth)[-1, :2])
        right += estimate.converged and at_end < 0.1
    assert right >= 45


def test_where_every_square_looks_alike_it_says_that_it_has_not_found_its_place() -> None:
    for seed in range(4):
        measurements, _ = drive(seed, nodes=30, lines=SAME_SPACING)
        measurements = replace(measurements, known=map_of(SAME_SPACING))
        estimate = localise_by_particles(measurements, replace(ANYWHERE, seed=seed))
        assert not estimate.converged
        assert estimate.counts["node before the particles agreed on one place"] == 30
        assert estimate.unobserved[0].quantity == "position"
        assert np.sqrt(np.trace(estimate.cov_floor[-1, :2, :2])) > 1.0


def test_lines_of_one_direction_leave_it_searching() -> None:
    lines = GRID[:4]
    measurements, _ = drive(0, nodes=40, lines=lines)
    measurements = replace(measurements, known=map_of(lines))
    config = replace(ANYWHERE, region=(-1.0, 5.0, -1.0, 5.0))
    estimate = localise_by_particles(measurements, config)
    assert not estimate.converged
    assert np.sqrt(estimate.cov_floor[-1, 1, 1]) > 1.0


def test_from_a_wrong_start_it_notices_and_recovers() -> None:
    measurements, truth = on_known_map(1, nodes=80)
    wrong = replace(measurements, start_pose=START + np.array([0.6, 0.5, 0.4]))
    estimate = localise_by_particles(wrong, FEW)
    assert estimate.converged
    assert any(reason.startswith("lost") for reason in estimate.counts)
    assert np.hypot(*errors(estimate, truth)[-1, :2]) < 0.05
    assert np.hypot(*errors(run_ekf(wrong), truth)[-1, :2]) > 0.2


def test_a_vague_start_is_searched_around_and_found() -> None:
    right = 0
    for seed in range(6):
        measurements, truth = on_known_map(seed, nodes=26)
        sigma = np.array([0.5, 0.5, 0.5])
        start = START + np.random.default_rng(seed).normal(0, sigma)
        vague = replace(measurements, start_pose=start, start_cov=np.diag(sigma**2))
        estimate = localise_by_particles(vague, replace(FEW, seed=seed))
        right += estimate.converged and np.hypot(*errors(estimate, truth)[-1, :2]) < 0.1
    assert right >= 5


def test_without_sightings_it_is_odometry_with_odometrys_covariance() -> None:
    measurements, _ = on_known_map(0, nodes=40)
    estimate = localise_by_particles(measurements.without_sightings(), replace(FEW, particles=2000))
    path = integrate(START, measurements.odometry.increment)
    assert np.max(np.abs(estimate.pose[:, :2] - path[:, :2])) < 0.02
    # 39 increments of 0.006 rad
    assert np.sqrt(estimate.cov_floor[-1, 2, 2]) == pytest.approx(np.sqrt(39) * 0.006, rel=0.1)


# ---- the region --------------------------------------------------------------------------------


def test_the_region_is_the_box_of_crossings_and_ends() -> None:
    low, high = region_of(map_of(GRID))
    np.testing.assert_allclose(low, [0.4 - 0.5, 0.3 - 0.5])
    np.testing.assert_allclose(high, [4.1 + 0.5, 3.9 + 0.5])
    ended = replace(map_of(GRID[:2]), extent=np.array([[-1.0, 2.0], [0.0, 1.0]]))
    low, high = region_of(ended)
    np.testing.assert_allclose((low, high), [[-0.1, -1.5], [2.0, 2.5]])


def test_lines_that_bound_no_floor_need_a_region() -> None:
    assert region_of(map_of(GRID[:4])) is None
    measurements, _ = drive(0, nodes=5)
    measurements = replace(measurements, known=map_of(GRID[:4]))
    with pytest.raises(BadMeasurements, match=r"particle\.region"):
        localise_by_particles(measurements, ANYWHERE)


def test_it_refuses_to_run_without_a_known_map() -> None:
    with pytest.raises(BadMeasurements, match="known map"):
        localise_by_particles(drive(0, nodes=5)[0])


@pytest.mark.parametrize(
    "wrong",
    [
        {"region": (1.0, 0.0, 0.0, 1.0)},
        {"particles": 5},
        {"particles": 100, "particles_searching": 50},
        {"seed": -1},
        {"resample_below": 0.0},
        {"agree_share": 0.4},
        {"agree_deg": 0.0},
        {"agree_nodes": 0},
        {"start": "nowhere"},
    ],
)
def test_impossible_settings_are_refused(wrong: dict) -> None:
    with pytest.raises(BadConfig, match="particle"):
        ParticleConfig(**wrong)


def test_a_particle_moves_as_a_pose_does() -> None:
    """Without noise the cloud is one point that follows the odometry exactly."""
    measurements, _ = on_known_map(0, nodes=20, noise=0.0)
    tight = replace(measurements.odometry, cov=np.broadcast_to(1e-16 * np.eye(3), (19, 3, 3)))
    exact = replace(measurements, odometry=tight, sightings={}, start_cov=1e-16 * np.eye(3))
    estimate = localise_by_particles(exact, FEW)
    pose = START
    for increment in square_drive(20):
        pose = compose(pose, increment)
    np.testing.assert_allclose(estimate.pose[-1], pose, atol=1e-6)
