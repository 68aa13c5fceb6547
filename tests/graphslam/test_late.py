"""Sightings that arrive late, out of order, or too late, in filters and as the robot smooths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graphslam.config import EkfConfig, IncrementalConfig, MatchingConfig
from graphslam.consistent import run_first_estimates, run_robot_centred
from graphslam.ekf import run_ekf
from graphslam.estimate import Estimate
from graphslam.geometry import wrap
from graphslam.late import OUT_OF_ORDER, TOO_LATE, run_naive
from graphslam.measurements import Measurements
from graphslam.smoother import run_fixed_lag, run_isam2, smooth
from tests.worlds import bearing_drive, drive

KNOWN = EkfConfig(MatchingConfig(method="known"))
LATE = EkfConfig(late_s=np.inf)


def delayed(measurements: Measurements, delay: float, spread: float = 0.0) -> Measurements:
    """Returns measurements whose sightings arrive after ``delay`` to ``delay + spread``, s."""
    rng = np.random.default_rng(7)
    tables = {
        kind: replace(
            table,
            t_received=measurements.t[table.node] + delay + spread * rng.random(len(table)),
        )
        for kind, table in measurements.sightings.items()
    }
    return replace(measurements, sightings=tables)


def until(measurements: Measurements, node: int) -> Measurements:
    """Returns what is known at a node: later motion and all that has not arrived is cut off."""
    tables = {}
    for kind, table in measurements.sightings.items():
        there = (table.t_received <= measurements.t[node]) & (table.node <= node)
        tables[kind] = table.select(there)
        arrived = measurements.t[tables[kind].node]
        tables[kind] = replace(tables[kind], t_received=arrived)
    odometry = replace(
        measurements.odometry,
        increment=measurements.odometry.increment[:node],
        cov=measurements.odometry.cov[:node],
    )
    return replace(measurements, t=measurements.t[: node + 1], odometry=odometry, sightings=tables)


def assert_same_end(late: Estimate, in_order: Estimate) -> None:
    np.testing.assert_array_equal(late.match, in_order.match)
    np.testing.assert_array_equal(late.used, in_order.used)
    np.testing.assert_allclose(late.nis, in_order.nis, atol=1e-9)
    np.testing.assert_allclose(late.pose[-1], in_order.pose[-1], atol=1e-9)
    np.testing.assert_allclose(late.map.params, in_order.map.params, atol=1e-9)
    np.testing.assert_allclose(late.cov_joint, in_order.cov_joint, rtol=1e-9, atol=1e-15)
    assert late.counts.keys() - {OUT_OF_ORDER} == in_order.counts.keys()


@pytest.mark.parametrize("run", [run_ekf, run_first_estimates, run_robot_centred])
@pytest.mark.parametrize(("delay", "spread"), [(0.1, 0.0), (0.15, 0.0), (0.02, 0.6)])
def test_in_the_end_it_makes_no_difference_when_sightings_came(run, delay, spread) -> None:  # type: ignore[no-untyped-def]
    measurements, _ = drive(1, 120)
    assert_same_end(run(delayed(measurements, delay, spread), LATE), run(measurements, LATE))


def test_landmarks_that_wait_for_their_start_may_be_seen_late_too() -> None:
    measurements, _ = bearing_drive(0, 80)
    assert_same_end(run_ekf(delayed(measurements, 0.05, 0.4)), run_ekf(measurements))


def test_at_every_node_the_filter_knows_what_has_arrived_and_nothing_else() -> None:
    measurements, _ = drive(2, 60)
    late = delayed(measurements, 0.05, 0.5)
    estimate = run_ekf(late, KNOWN)
    for node in (0, 1, 7, 20, 21, 44, 58):
        then = run_ekf(until(late, node), KNOWN)
        np.testing.assert_allclose(estimate.pose[node], then.pose[-1], atol=1e-9)
        np.testing.assert_allclose(estimate.cov_floor[node], then.cov_floor[-1], rtol=1e-8)
    assert estimate.counts[OUT_OF_ORDER] > 0


def test_what_comes_too_late_is_left_out_and_counted() -> None:
    measurements, _ = drive(3, 60)
    table = measurements.sightings["line"]
    received = np.where(np.arange(len(table)) % 5 == 0, table.t_received + 3.0, table.t_received)
    late = replace(measurements, sightings={"line": replace(table, t_received=received)})
    estimate = run_ekf(late, EkfConfig(late_s=1.0))
    assert estimate.counts[TOO_LATE] == np.sum(received > table.t_received)
    assert not estimate.used[received > table.t_received].any()
    kept = replace(measurements, sightings={"line": table.select(received == table.t_received)})
    np.testing.assert_array_equal(estimate.pose, run_ekf(kept).pose)


def test_the_variances_of_landmarks_over_time_are_those_at_the_nodes() -> None:
    measurements, _ = drive(1, 60)
    late, in_order = run_ekf(delayed(measurements, 0.3)), run_ekf(measurements)
    assert late.map_variance.shape == in_order.map_variance.shape
    np.testing.assert_allclose(late.map_variance, in_order.map_variance, atol=1e-12)


def test_a_filter_that_ignores_delays_is_worse_the_faster_the_robot() -> None:
    """The drive goes 1 m/s: 0.2 s late is 0.2 m off."""
    ratio = []
    for seed in range(6):
        measurements, truth = drive(seed, 150)
        late = delayed(measurements, 0.2)
        errors = [
            np.sqrt(np.mean(np.square(estimate.pose[:, :2] - truth[:, :2])))
            for estimate in (run_naive(late, KNOWN), run_ekf(late, KNOWN))
        ]
        ratio.append(errors[0] / errors[1])
    assert min(ratio) > 1.5
    on_time, _ = drive(0, 60)
    np.testing.assert_array_equal(run_naive(on_time).pose, run_ekf(on_time).pose)


def test_the_naive_filter_tells_of_each_sighting_what_became_of_it() -> None:
    measurements, _ = drive(0, 60)
    estimate = run_naive(delayed(measurements, 0.05, 0.4), KNOWN)
    assert estimate.method == "ekf-naive"
    table = measurements.sightings["line"]
    named = estimate.match >= 0
    of = {int(m): set(table.truth[estimate.match == m]) for m in np.unique(estimate.match[named])}
    assert all(len(identities) == 1 for identities in of.values())
    assert named.sum() > 0.9 * len(table)


def test_smoothing_as_it_drives_takes_late_sightings_where_they_were_made() -> None:
    measurements, _ = drive(4, 80)
    late = delayed(measurements, 0.05, 0.3)
    at = run_ekf(late, KNOWN)
    smoothed = smooth(measurements, at)
    sigma = np.sqrt(np.diag(smoothed.cov_floor[-1]))
    causal = run_isam2(late, at, IncrementalConfig(relinearise=1e-4))
    assert np.max(np.abs(wrap(causal.pose[-1] - smoothed.pose[-1])) / sigma) < 0.05
    lagged = run_fixed_lag(late, at, IncrementalConfig(lag_s=2.0))
    assert np.max(np.abs(wrap(lagged.pose[-1] - smoothed.pose[-1])) / sigma) < 0.5
    # with a window shorter than the delay nothing is left to correct
    short = run_fixed_lag(delayed(measurements, 1.0), at, IncrementalConfig(lag_s=0.3))
    assert short.counts[TOO_LATE] > 0.8 * len(measurements.sightings["line"])
