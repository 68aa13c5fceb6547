"""Landmarks that one sighting cannot start, in filter and smoother, known and unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from graphslam.config import EkfConfig, MatchingConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.estimate import Estimate
from graphslam.geometry import wrap
from graphslam.measurements import Measurements
from graphslam.smoother import build_graph, landmark_key, optimise, smooth
from graphslam.waiting import NOT_YET
from tests.worlds import CONES, bearing_drive, drive

KNOWN = EkfConfig(MatchingConfig(method="known"))


def nees(estimate: Estimate, truth: np.ndarray) -> float:
    e = estimate.pose[1:] - truth[1:]
    e[:, 2] = wrap(e[:, 2])
    return (
        float(np.mean(np.einsum("ni,nij,nj->n", e, np.linalg.inv(estimate.cov_floor[1:]), e))) / 3
    )


def mapped(estimate: Estimate, points: np.ndarray = CONES, within: float = 0.5) -> list[int]:
    """Returns the true point of each landmark of the map, -1 where none is near."""
    gaps = np.linalg.norm(estimate.map.params[:, None, :2] - points, axis=2)
    return np.where(gaps.min(axis=1) < within, gaps.argmin(axis=1), -1).tolist()


def test_filter_and_smoother_agree_where_landmarks_waited_for_their_start() -> None:
    measurements, _ = bearing_drive(0, 120, start_sigma=0.01)
    at = run_ekf(measurements, KNOWN)
    filtered = run_ekf(measurements, linearise_at=at)
    smoothed = smooth(measurements, at, linearise_at=at)
    assert len(filtered.map) == len(CONES)
    assert np.array_equal(filtered.match >= 0, at.match >= 0)
    order = [int(filtered.match[at.match == m][0]) for m in range(len(at.map))]
    sigma = np.sqrt(np.diag(smoothed.cov_joint))
    last = wrap(filtered.pose[-1] - smoothed.pose[-1]) / sigma[:3]
    assert np.max(np.abs(last)) < 1e-8
    d_map = (filtered.map.params[order] - smoothed.map.params).ravel() / sigma[3:]
    assert np.max(np.abs(d_map)) < 1e-8
    d_cov = (filtered.cov_floor[-1] - smoothed.cov_floor[-1]) / np.outer(sigma[:3], sigma[:3])
    assert np.max(np.abs(d_cov)) < 1e-8


def test_without_noise_both_give_the_truth() -> None:
    measurements, truth = bearing_drive(0, noise=0.0)
    filtered = run_ekf(measurements)
    smoothed = smooth(measurements, filtered)
    assert sorted(mapped(filtered)) == list(range(len(CONES)))
    np.testing.assert_allclose(smoothed.pose[:, :2], truth[:, :2], atol=1e-6)
    order = np.argsort(mapped(smoothed))
    np.testing.assert_allclose(smoothed.map.params[order], CONES, atol=1e-5)


@pytest.mark.parametrize("known", [True, False])
def test_errors_are_as_large_as_both_say_and_every_point_is_mapped_once(known: bool) -> None:
    figures = []
    for seed in range(4):
        measurements, truth = bearing_drive(seed, 150, known=known)
        filtered = run_ekf(measurements)
        smoothed = smooth(measurements, filtered)
        assert sorted(mapped(smoothed)) == list(range(len(CONES)))
        figures.append([nees(filtered, truth), nees(smoothed, truth)])
    for mean in np.mean(figures, axis=0):
        assert 0.6 < mean < 1.5


def test_a_landmark_never_seen_from_aside_waits_to_the_end_and_is_counted() -> None:
    far = np.vstack([CONES[:3], [[500.0, 0.0]]])
    measurements, _ = bearing_drive(1, 60, points=far, bearing_sigma=0.02)
    estimate = run_ekf(measurements)
    table = measurements.sightings["bearing"]
    assert 3 not in mapped(estimate, far)
    assert not estimate.used[table.truth == 3].any()
    assert estimate.counts[NOT_YET] > 0
    assert estimate.cov_joint.shape == (3 + 2 * len(estimate.map),) * 2


def test_a_label_keeps_apart_what_lies_in_one_direction() -> None:
    pair = np.vstack([CONES[:3], CONES[:3] + np.array([0.06, 0.05])])
    labels = np.array([0, 0, 0, 1, 1, 1])
    measurements, _ = bearing_drive(2, 150, points=pair, labels=labels)
    estimate = run_ekf(measurements)
    table = measurements.sightings["bearing"]
    matched = estimate.match >= 0
    assert matched.sum() > 0.85 * len(matched)  # some wait for parallax
    assert np.array_equal(estimate.map.label[estimate.match[matched]], table.label[matched])
    bare = replace(measurements, sightings={"bearing": replace(table, label=-1 + 0 * table.label)})
    assert run_ekf(bare).used.sum() < estimate.used.sum()


def test_labels_and_waiting_kinds_are_saved(tmp_path) -> None:  # type: ignore[no-untyped-def]
    measurements, _ = bearing_drive(3, 40, labels=np.arange(len(CONES)), known=True)
    measurements.save(tmp_path / "m.npz")
    again = Measurements.load(tmp_path / "m.npz")
    assert np.array_equal(again.sightings["bearing"].label, measurements.sightings["bearing"].label)
    assert np.array_equal(again.known.label, np.arange(len(CONES)))
    estimate = run_ekf(again)
    estimate.save(tmp_path / "e.npz")
    assert np.array_equal(Estimate.load(tmp_path / "e.npz").map.label, np.arange(len(CONES)))


def test_a_graph_starts_points_from_several_sightings() -> None:
    measurements, _ = bearing_drive(4, 100)
    table = measurements.sightings["bearing"]
    built = build_graph(measurements, table.truth)
    solution = optimise(built.graph, built.values, SmootherConfig())
    assert solution.converged
    points = [solution.values.atVector(landmark_key(n)) for n in range(len(CONES))]
    np.testing.assert_allclose(points[:5], CONES[:5], atol=0.15)


@pytest.mark.parametrize("engine", ["gtsam", "chain"])
def test_lines_and_points_together_are_no_worse_than_either(engine: str) -> None:
    lines, truth = drive(0, 120, reach=0.3)
    points, _ = bearing_drive(0, 120)
    tables = {"line": lines.sightings["line"], "bearing": points.sightings["bearing"]}
    sigma, error = {}, {}
    for names in (("line",), ("bearing",), ("line", "bearing")):
        m = replace(lines, sightings={name: tables[name] for name in names})
        estimate = smooth(m, run_ekf(m), SmootherConfig(engine=engine))
        sigma[names] = np.sqrt(np.trace(estimate.cov_floor[1:, :2, :2], axis1=1, axis2=2))
        error[names] = np.sqrt(np.mean((estimate.pose - truth)[:, :2] ** 2))
    both = sigma.pop(("line", "bearing"))
    assert all(np.all(both < alone) for alone in sigma.values())
    assert error[("line", "bearing")] < 2.0 * np.sqrt(np.mean(both**2))
    assert error[("line", "bearing")] < max(error.values())
