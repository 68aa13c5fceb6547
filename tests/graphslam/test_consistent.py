"""Filters that do not learn what no sighting tells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from graphslam.config import EkfConfig, MatchingConfig
from graphslam.consistent import run_first_estimates, run_robot_centred
from graphslam.ekf import run_ekf
from graphslam.estimate import Estimate
from graphslam.geometry import wrap
from graphslam.measurements import LandmarkMap, Measurements
from graphslam.models.line import LINE
from tests.worlds import CONES, GRID, bearing_drive, drive

KNOWN = EkfConfig(matching=MatchingConfig(method="known"))
Run = Callable[[Measurements, EkfConfig | None], Estimate]
BOTH = pytest.mark.parametrize(
    "run", [run_first_estimates, run_robot_centred], ids=["fej", "robot"]
)


def heading_sigma(run: Run, start_sigma: float) -> float:
    """Returns sigma of the last heading after laps whose start is unknown by ``start_sigma``."""
    noisy = (0.02, 0.02, 0.05)
    measurements, _ = drive(2, 250, odometry_sigma=noisy, start_sigma=1e-6, reach=0.5)
    unsure = replace(measurements, start_cov=np.diag([1e-6, 1e-6, start_sigma**2]))
    return float(np.sqrt(run(unsure, KNOWN).cov_floor[-1, 2, 2]))


@BOTH
def test_without_noise_the_truth_comes_out(run: Run) -> None:
    measurements, truth = drive(0, 120, noise=0.0)
    estimate = run(measurements, None)
    np.testing.assert_allclose(estimate.pose, truth, atol=1e-9)
    assert len(estimate.map) == len(GRID)


@BOTH
def test_where_all_is_nearly_linear_it_is_the_filter(run: Run) -> None:
    small = {"odometry_sigma": (1e-5,) * 3, "sighting_sigma": (1e-5, 1e-5), "start_sigma": 1e-6}
    measurements, _ = drive(1, 100, **small)  # type: ignore[arg-type]
    ours, filtered = run(measurements, None), run_ekf(measurements)
    np.testing.assert_allclose(ours.pose, filtered.pose, atol=1e-8)
    np.testing.assert_allclose(ours.cov_joint, filtered.cov_joint, rtol=1e-3, atol=1e-15)
    np.testing.assert_array_equal(ours.match, filtered.match)


@BOTH
def test_no_sighting_tells_where_the_floor_lies(run: Run) -> None:
    start = 0.3
    assert heading_sigma(run, start) > start  # odometry's own error comes on top
    assert heading_sigma(run_ekf, start) < 0.95 * start


def test_a_sighting_is_exactly_linear_in_what_the_robot_sees() -> None:
    """One sure sighting puts its line just there, however far off the line was thought to be."""
    measurements, _ = drive(3, 2, sighting_sigma=(0.2, 0.3), noise=1.0, start_sigma=1e-6)
    table = measurements.sightings["line"]
    cov = np.where((table.node == 1)[:, None, None], 1e-12 * np.eye(2), table.cov)
    sure = replace(measurements, sightings={"line": replace(table, cov=cov)})
    estimate = run_robot_centred(sure, KNOWN)
    rows = np.flatnonzero((table.node == 1) & (estimate.match >= 0))
    e, _, _ = LINE.residual(
        estimate.pose[1], estimate.map.params[estimate.match[rows]], table.z[rows]
    )
    assert len(rows) >= 2
    np.testing.assert_allclose(e, 0.0, atol=1e-6)


@BOTH
def test_on_a_known_map_it_localises(run: Run) -> None:
    measurements, truth = drive(4, 150)
    count = len(GRID)
    known = LandmarkMap(
        np.arange(count), ("line",) * count, GRID, np.full((count, 2), np.nan), np.zeros(count, int)
    )
    estimate = run(replace(measurements, known=known), None)
    assert np.hypot(*(estimate.pose - truth)[:, :2].T).max() < 0.05
    np.testing.assert_array_equal(estimate.map.params, run_ekf(
        replace(measurements, known=known)
    ).map.params)  # fmt: skip


def test_first_estimates_start_what_one_sighting_cannot() -> None:
    """Points seen by direction only: each waits for parallax, and the errors are as claimed."""
    nees = []
    for seed in range(3):
        measurements, truth = bearing_drive(seed, 150)
        estimate = run_first_estimates(measurements)
        gaps = np.linalg.norm(estimate.map.params[:, None, :2] - CONES, axis=2)
        assert sorted(gaps.argmin(axis=1).tolist()) == list(range(len(CONES)))
        e = estimate.pose[1:] - truth[1:]
        e[:, 2] = wrap(e[:, 2])
        inverse = np.linalg.inv(estimate.cov_floor[1:])
        nees.append(np.mean(np.einsum("ni,nij,nj->n", e, inverse, e)) / 3.0)
    assert 0.5 < np.mean(nees) < 1.5


def test_bearings_too_leave_the_floor_where_it_lies() -> None:
    start, sigma = 0.3, {}
    for run in (run_first_estimates, run_ekf):
        measurements, _ = bearing_drive(2, 250, odometry_sigma=(0.02, 0.02, 0.05))
        unsure = replace(measurements, start_cov=np.diag([1e-6, 1e-6, start**2]))
        sigma[run] = float(np.sqrt(run(unsure, KNOWN).cov_floor[-1, 2, 2]))
    assert sigma[run_first_estimates] > start > sigma[run_ekf]
