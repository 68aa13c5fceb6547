"""The floor plan of walls: what several scans saw, with doors left open."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from compare.config import RunConfig
from compare.opening import suited
from compare.verdict_methods import alarms
from compare.walls import plan_layers, wall_parts
from frontend.log import open_log
from graphslam.baseline import dead_reckoning
from graphslam.estimate import LOOP_DOUBTED, LOOP_OPEN
from graphslam.measurements import LandmarkMap, Measurements, Odometry, Sightings


def test_a_wall_is_drawn_where_two_scans_saw_it_and_a_door_stays_open():
    extent = np.array([[0.0, 1.0], [0.5, 2.0], [0.7, 1.8], [5.0, 6.0], [5.1, 5.9]])
    count = len(extent)
    none = np.full(count, -1)
    lines = Sightings(
        "line", np.arange(count), np.tile([2.0, 0.0], (count, 1)),
        np.tile(1e-4 * np.eye(2), (count, 1, 1)), extent, np.arange(count, dtype=float),
        np.ones(count), none, none,
    )  # fmt: skip
    still = Odometry(np.zeros((count - 1, 3)), np.tile(1e-6 * np.eye(3), (count - 1, 1, 1)))
    measurements = Measurements(
        np.arange(count, dtype=float), np.zeros(3), 1e-12 * np.eye(3), still, {"line": lines}
    )
    wall = LandmarkMap(
        np.array([0]), ("line",), np.array([[2.0, 0.0]]), np.array([[0.0, 6.0]]), np.array([count])
    )
    estimate = replace(
        dead_reckoning(measurements), map=wall, cov_joint=1e-6 * np.eye(5),
        match=np.zeros(count, np.int64), used=np.ones(count, bool), method="loops",
    )  # fmt: skip
    parts, landmark = wall_parts(measurements, estimate)
    assert landmark.tolist() == [0, 0]
    assert parts[:, :, 0] == pytest.approx(2.0)
    assert parts[:, :, 1] == pytest.approx(np.array([[0.5, 1.8], [5.1, 5.9]]))
    record = SimpleNamespace(measurements=measurements, estimates={"loops": estimate})
    walls = plan_layers(record, "loops")[0]  # type: ignore[arg-type]
    assert np.array(walls.polylines) == pytest.approx(parts)
    assert walls.labels == ("0", "")


def test_a_laser_has_its_own_methods_unless_others_are_chosen(tmp_path: Path):
    scan = "FLASER 2 1 1 0 0 0 {n} 0 0 {n} host 0\n"
    path = tmp_path / "run.clf"
    path.write_text("".join(scan.format(n=n) for n in range(3)))
    log = open_log(path)
    assert suited(RunConfig(), log).methods == RunConfig().laser_methods
    chosen = RunConfig(methods=("odometry", "ekf"))
    assert suited(chosen, log) is chosen


def test_loops_that_stay_open_are_told():
    method = SimpleNamespace(
        method="loops", counts={LOOP_OPEN + "too few walls agree": 2}, converged=True, iterations=3
    )
    [told] = alarms([method])  # type: ignore[list-item]
    assert told.startswith("loops left 2 places open")
    assert "too few walls agree" in told


def test_loops_that_are_closed_but_in_doubt_are_told():
    also = "shifted in x by 1.50 m it also fits"
    method = SimpleNamespace(
        method="smoother", counts={LOOP_DOUBTED + also: 1}, converged=True, iterations=3
    )
    [told] = alarms([method])  # type: ignore[list-item]
    assert told.startswith("smoother closed one loop as its first estimate did, but in doubt")
    assert also in told
