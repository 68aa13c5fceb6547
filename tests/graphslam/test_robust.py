"""Robust kernels: wrong matches and slips cost their own weight, not the estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graphslam.config import EkfConfig, MatchingConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.errors import BadConfig
from graphslam.measurements import Measurements
from graphslam.smoother import smooth
from graphslam.smoother.fit import odometry_fit, sighting_fit
from tests.worlds import GRID, drive

PLAIN = SmootherConfig(engine="chain")
GNC, HUBER = replace(PLAIN, robust="gnc"), replace(PLAIN, robust="huber")
SLIPPING = replace(GNC, robust_odometry=True)
KNOWN = EkfConfig(matching=MatchingConfig(method="known"))


def with_wrong_matches(
    measurements: Measurements, share: float, seed: int
) -> tuple[Measurements, np.ndarray]:
    """Returns measurements some of whose true lines are others, and which."""
    table, rng = measurements.sightings["line"], np.random.default_rng(seed)
    wrong = rng.random(len(table)) < share
    other = (table.truth + rng.integers(1, len(GRID), len(table))) % len(GRID)
    truth = np.where(wrong, other, table.truth)
    return replace(measurements, sightings={"line": replace(table, truth=truth)}), wrong


def path_rmse(estimate, truth) -> float:
    return float(np.sqrt(np.mean(np.sum((estimate.pose[:, :2] - truth[:, :2]) ** 2, axis=1))))


@pytest.mark.parametrize("robust", ["cauchy", "gnc"])
def test_a_robust_kernel_does_as_well_as_if_the_wrong_matches_were_known(robust):
    for seed in range(2):
        measurements, truth = drive(seed, nodes=150)
        spoilt, wrong = with_wrong_matches(measurements, 0.07, seed)
        table = spoilt.sightings["line"]
        without = {"line": replace(table, truth=np.where(wrong, -1, table.truth))}
        told = replace(spoilt, sightings=without)
        best = path_rmse(smooth(told, run_ekf(told, KNOWN), PLAIN), truth)
        start = run_ekf(spoilt, KNOWN)
        estimate = smooth(spoilt, start, SmootherConfig(engine="chain", robust=robust))
        assert path_rmse(smooth(spoilt, start, PLAIN), truth) > 5 * best
        assert path_rmse(estimate, truth) < best + 0.003  # a right one in a thousand goes, too
        off = estimate.weight < 0.5
        assert off[wrong].mean() > 0.95
        assert off[~wrong].mean() < 0.01


def test_huber_reduces_what_wrong_matches_cost():
    measurements, truth = drive(0, nodes=150)
    spoilt, wrong = with_wrong_matches(measurements, 0.07, 0)
    start = run_ekf(spoilt, KNOWN)
    plain, estimate = smooth(spoilt, start, PLAIN), smooth(spoilt, start, HUBER)
    assert path_rmse(estimate, truth) < 0.3 * path_rmse(plain, truth)
    assert estimate.weight[wrong].max() < estimate.weight[~wrong].mean()


def test_without_outliers_gnc_changes_nothing_that_matters():
    measurements, _ = drive(3, nodes=100)
    start = run_ekf(measurements, KNOWN)
    plain, robust = (
        smooth(measurements, start),
        smooth(measurements, start, SmootherConfig("gtsam", "gnc")),
    )
    assert (robust.weight > 0.5).mean() > 0.99
    assert np.max(np.abs(plain.pose[:, :2] - robust.pose[:, :2])) < 0.02


def test_robust_odometry_survives_a_slip():
    measurements, truth = drive(4, nodes=150)
    increment = measurements.odometry.increment.copy()
    increment[70, 0] += 0.5
    slipped = replace(measurements, odometry=replace(measurements.odometry, increment=increment))
    start = run_ekf(slipped, KNOWN)
    plain = smooth(slipped, start, PLAIN)
    estimate = smooth(slipped, start, SLIPPING)
    clean = path_rmse(smooth(measurements, run_ekf(measurements, KNOWN), PLAIN), truth)
    assert path_rmse(estimate, truth) < 1.3 * clean < path_rmse(plain, truth)


def test_a_slip_and_wrong_matches_are_told_apart():
    measurements, truth = drive(4, nodes=150)
    increment = measurements.odometry.increment.copy()
    increment[70, 0] += 0.3
    slipped = replace(measurements, odometry=replace(measurements.odometry, increment=increment))
    spoilt, wrong = with_wrong_matches(slipped, 0.07, 4)
    estimate = smooth(spoilt, run_ekf(spoilt, KNOWN), SLIPPING)
    clean = path_rmse(smooth(measurements, run_ekf(measurements, KNOWN), PLAIN), truth)
    assert path_rmse(estimate, truth) < 1.3 * clean
    assert (estimate.weight[wrong] < 0.5).mean() > 0.95
    assert (estimate.weight[~wrong] < 0.5).mean() < 0.02
    assert estimate.counts["increment of odometry switched off as a slip"] <= 2


def test_what_is_switched_off_is_counted_and_not_used():
    measurements, _ = drive(1, nodes=80)
    spoilt, _ = with_wrong_matches(measurements, 0.1, 1)
    estimate = smooth(spoilt, run_ekf(spoilt, KNOWN), GNC)
    off = estimate.weight == 0
    assert off.any()
    assert not estimate.used[off].any()
    assert estimate.counts == {"sighting switched off by the robust kernel": int(off.sum())}


def test_two_sightings_that_contradict_each_other_leave_their_landmark_determined():
    measurements, _ = drive(2, nodes=40)
    table = measurements.sightings["line"]
    rows = np.flatnonzero(table.truth == np.bincount(table.truth).argmax())[[0, -1]]
    truth = np.where(table.truth == table.truth[rows[0]], -1, table.truth)
    truth[rows] = table.truth[rows]
    z = table.z.copy()
    z[rows[0], 0] += 5.0
    spoilt = replace(measurements, sightings={"line": replace(table, truth=truth, z=z)})
    estimate = smooth(spoilt, run_ekf(spoilt, KNOWN), GNC)
    assert np.isfinite(estimate.cov_joint).all()
    assert estimate.used[rows].any()


def test_the_fit_is_what_the_cost_is_made_of():
    measurements, _ = drive(5, nodes=60)
    estimate = smooth(measurements, run_ekf(measurements, KNOWN))
    sightings, dim = sighting_fit(measurements, estimate.pose, estimate.map.params, estimate.match)
    odometry = odometry_fit(measurements, estimate.pose)
    assert 0.5 * (np.nansum(sightings) + odometry.sum()) == pytest.approx(estimate.cost, rel=1e-3)
    assert set(dim[np.isfinite(sightings)]) == {2}


def test_unknown_kernels_are_refused():
    with pytest.raises(BadConfig, match=r"smoother\.robust"):
        SmootherConfig(robust="tukey")
    with pytest.raises(BadConfig, match=r"smoother\.robust_gate"):
        SmootherConfig(robust_gate=0.0)
    with pytest.raises(BadConfig, match="needs a kernel"):
        SmootherConfig(robust_odometry=True)
