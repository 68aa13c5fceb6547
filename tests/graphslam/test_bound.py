"""The Cramer-Rao bound: what no estimator undercuts, and the smoother reaches."""

from __future__ import annotations

import numpy as np
import pytest

from graphslam.config import SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.geometry import wrap
from graphslam.smoother import smooth
from graphslam.smoother.bound import cramer_rao
from tests.worlds import GRID, drive


@pytest.mark.parametrize("engine", ["gtsam", "chain"])
def test_at_the_smoothed_estimate_it_is_the_smoothers_own_covariance(engine: str) -> None:
    measurements, _ = drive(1, 60)
    smoothed = smooth(measurements, run_ekf(measurements), SmootherConfig(tolerance=1e-14))
    at = smoothed.match, smoothed.pose, smoothed.map.params
    bound = cramer_rao(measurements, *at, engine=engine)  # type: ignore[arg-type]
    np.testing.assert_allclose(bound.cov_floor, smoothed.cov_floor, rtol=1e-4, atol=1e-12)
    np.testing.assert_allclose(bound.cov_joint, smoothed.cov_joint, rtol=1e-3, atol=1e-10)
    np.testing.assert_allclose(bound.pose, smoothed.pose)


def test_what_was_measured_does_not_enter() -> None:
    bounds = []
    for seed in (1, 2):
        measurements, truth = drive(seed, 60, start_sigma=0.0 + 1e-9)
        identity = measurements.sightings["line"].truth
        names, matches = np.unique(identity, return_inverse=True)
        bounds.append(cramer_rao(measurements, matches, truth, GRID[names]))
    np.testing.assert_allclose(bounds[0].cov_floor, bounds[1].cov_floor, rtol=1e-4, atol=1e-12)


def test_the_smoothers_errors_are_as_large_as_the_bound_says() -> None:
    runs, squared = 15, []
    for seed in range(runs):
        measurements, truth = drive(seed, 60)
        smoothed = smooth(measurements, run_ekf(measurements))
        error = (smoothed.pose - truth)[1:]
        error[:, 2] = wrap(error[:, 2])
        identity = measurements.sightings["line"].truth
        names, matches = np.unique(identity, return_inverse=True)
        bound = cramer_rao(measurements, matches, truth, GRID[names])
        variance = np.trace(bound.cov_floor[1:, :2, :2], axis1=1, axis2=2).mean()
        squared.append((error[:, :2] ** 2).sum(axis=1).mean() / variance)
    # the mean of 15 path errors, each of some ten independent stretches, scatters by about a tenth
    assert np.sqrt(np.mean(squared)) == pytest.approx(1.0, abs=0.25)
