"""Where along the way a method becomes surer than it should be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compare.comparison import compare
from compare.consistency import (
    SHARES,
    Consistency,
    band,
    consistency,
    innovations,
    mean_of,
    overconfidence,
    pooled,
    sampled,
    surprise,
)
from compare.truth import truth_of
from graphslam.baseline import dead_reckoning
from graphslam.config import EkfConfig, MatchingConfig
from graphslam.ekf import run_ekf
from graphslam.measurements import Measurements
from tests.compare.made import log_with
from tests.worlds import GRID, drive

DISTANCE = np.arange(1, 201) / 10.0


def curve(runs: int = 1, **columns: np.ndarray) -> Consistency:
    nees = np.ones((len(DISTANCE), 4))
    for name, values in columns.items():
        nees[:, ("x", "y", "heading", "pose").index(name)] = values
    return Consistency(DISTANCE, nees, runs)


def test_a_factor_a_state_and_a_distance_are_named() -> None:
    found = overconfidence(curve(heading=np.where(DISTANCE < 12.0, 1.0, 16.0)))
    assert found is not None
    assert (found.state, found.factor) == ("heading", pytest.approx(4.0))
    assert found.from_m == pytest.approx(12.0, abs=0.1)
    assert str(found) == "overconfident by a factor 4 in heading after 12 m"


def test_a_short_excursion_is_not_overconfidence() -> None:
    assert overconfidence(curve(x=np.where(np.abs(DISTANCE - 5.0) < 0.5, 16.0, 1.0))) is None


def test_many_runs_show_what_one_cannot() -> None:
    factor = np.where(DISTANCE < 4.0, 1.0, 2.0)
    assert overconfidence(curve(1, y=factor)) is None
    found = overconfidence(curve(100, y=factor))
    assert found is not None
    assert found.state == "y"
    assert found.factor == pytest.approx(np.sqrt(2.0))


def test_the_band_narrows_with_the_runs_and_holds_its_share() -> None:
    low, high = band(3, 1)
    assert (low, high) == (pytest.approx(0.0719, rel=1e-2), pytest.approx(3.116, rel=1e-3))
    squares = np.random.default_rng(1).chisquare(3, (2000, 50)).mean(axis=1) / 3
    low, high = band(3, 50)
    assert np.mean((squares > low) & (squares < high)) == pytest.approx(0.95, abs=0.015)


def test_errors_of_a_run_are_held_against_its_own_covariance() -> None:
    measurements, truth = drive(3, 120)
    measurements = replace(measurements, start_pose=truth[0])
    log = log_with(measurements.t, truth, GRID)
    estimate = dead_reckoning(measurements)
    found = consistency(estimate, truth_of(log, measurements))
    assert found is not None
    error = estimate.pose[-1, 0] - truth[-1, 0]
    assert found.nees[-1, 0] == pytest.approx(error**2 / estimate.cov_floor[-1, 0, 0])
    few = sampled(found, 10)
    np.testing.assert_allclose(few.nees[-1], found.nees[-1])
    both = mean_of([few, few])
    assert both.runs == 2
    np.testing.assert_allclose(both.nees, few.nees)


def test_a_filter_that_is_told_too_little_noise_is_called_overconfident() -> None:
    measurements, truth = drive(3, 200)
    measurements = replace(measurements, start_pose=truth[0])
    table, odometry = measurements.sightings["line"], measurements.odometry
    bold = replace(
        measurements,
        sightings={"line": replace(table, cov=table.cov / 100.0)},
        odometry=replace(odometry, cov=odometry.cov / 100.0),
    )
    judged = compare(log_with(bold.t, truth, GRID), bold, [run_ekf(bold)])
    found = judged["ekf"].overconfidence
    assert found is not None
    assert 3.0 < found.factor < 30.0


def told(measurements: Measurements, factor: float) -> Measurements:
    """Returns measurements that state ``factor`` times the standard deviations of sightings."""
    table = measurements.sightings["line"]
    return replace(measurements, sightings={"line": replace(table, cov=factor**2 * table.cov)})


def test_innovations_of_an_honest_filter_are_chi_square_and_need_no_truth() -> None:
    known = EkfConfig(MatchingConfig(method="known"))
    runs, surprised = [], 0
    for seed in range(8):
        measurements, _ = drive(seed, 150)
        found = innovations(run_ekf(measurements, known), measurements.driven(), SHARES)
        assert found is not None
        assert found.distance[-1] == pytest.approx(measurements.driven()[-1])
        surprised += surprise(found) is not None
        runs.append(found)
    whole = pooled(runs)
    low, high = band(float(whole.freedom.sum()))
    assert low < whole.total < high
    inside = [
        band(f)[0] < nis < band(f)[1] for nis, f in zip(whole.nis, whole.freedom, strict=True)
    ]
    assert sum(inside) >= SHARES - 3
    assert surprised <= 1
    assert innovations(dead_reckoning(measurements), measurements.driven(), SHARES) is None


def test_a_filter_that_sees_worse_than_it_was_told_is_surprised_from_the_start() -> None:
    measurements, _ = drive(0, 150)
    known = EkfConfig(MatchingConfig(method="known"))
    bold = told(measurements, 0.5)
    found = innovations(run_ekf(bold, known), bold.driven(), SHARES)
    assert found is not None
    said = surprise(found)
    assert said is not None
    assert 1.6 < said.factor < 2.1
    assert said.from_m < 0.25 * found.distance[-1]
    assert said.nis > said.limit > 1.0


def test_a_node_counts_its_innovations_jointly() -> None:
    """Sightings of one node share its pose's error: their own NIS do not simply add up."""
    measurements, _ = drive(2, 60)
    estimate = run_ekf(measurements, EkfConfig(MatchingConfig(method="known")))
    table = measurements.sightings["line"]
    assert estimate.innovation is not None
    counted = np.bincount(table.node[np.isfinite(estimate.nis)], minlength=60)
    np.testing.assert_array_equal(estimate.innovation[:, 1], 2 * counted)
    own = np.bincount(table.node, np.nan_to_num(estimate.nis), 60)
    alone = counted == 1
    np.testing.assert_allclose(estimate.innovation[alone, 0], own[alone], rtol=1e-9)
    assert not np.allclose(estimate.innovation[counted > 1, 0], own[counted > 1], rtol=1e-3)
