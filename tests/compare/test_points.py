"""Points in maps: judged, written, drawn and read again."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare import compare
from compare.cli import main
from compare.record import Record
from compare.verdict import verdict
from frontend.extract import extract
from frontend.readers.point_tables import read_landmarks
from frontend.simulate import load_scenario, simulate, simulate_log
from graphslam.ekf import run_ekf
from graphslam.estimate import Estimate
from graphslam.measurements import LandmarkMap, Measurements
from graphslam.smoother import smooth


@pytest.fixture(scope="module")
def outdoors() -> tuple[object, Measurements, Estimate]:
    log = simulate_log(replace(load_scenario("cones-outdoors"), repeat=1), seed=1)
    measurements = replace(extract(log), known=None)
    return log, measurements, run_ekf(measurements)


def without(table_map: LandmarkMap, row: int, **change: object) -> LandmarkMap:
    params = table_map.params.copy()
    params[row] = change["params"]  # type: ignore[call-overload]
    return replace(table_map, params=params)


def test_every_cone_is_counted_once_and_its_error_is_as_large_as_claimed(outdoors) -> None:
    log, measurements, estimate = outdoors
    points = compare(log, measurements, [estimate])["ekf"].points
    assert points is not None
    assert (points.true_points_seen, points.matched, points.missed) == (9, 9, 0)
    assert (points.spurious, points.duplicates) == (0, 0)
    assert points.rmse_m <= points.unaligned_rmse_m < 0.5
    assert 0.1 < points.nees < 3.0
    assert sorted(points.points.true_id.tolist()) == list(range(9))


def test_duplicates_spurious_and_missed_points_are_told_apart(outdoors) -> None:
    log, measurements, estimate = outdoors
    rows = [
        int(estimate.match[(measurements.sightings["bearing"].truth == k)].max()) for k in (0, 1)
    ]
    match = estimate.match.copy()
    second = np.flatnonzero(match == rows[1])
    match[second] = -1  # cone 1 is in no map ...
    match[np.flatnonzero(match == rows[0])[:10]] = rows[1]  # ... and its point shows cone 0, too
    changed = replace(estimate, match=match, used=match >= 0)
    points = compare(log, measurements, [changed])["ekf"].points
    assert points is not None
    assert (points.matched, points.missed, points.duplicates) == (8, 1, 1)
    assert points.missed_id == (1,)
    nothing = replace(estimate, match=np.full_like(match, -1), used=match < -1)
    far = without(estimate.map, rows[0], params=[100.0, 100.0])
    lost = compare(log, measurements, [replace(nothing, map=far)])["ekf"].points
    assert lost is not None
    assert lost.spurious >= 1


def test_known_points_are_not_judged(outdoors) -> None:
    log, measurements, _ = outdoors
    known = replace(measurements, known=log.landmarks)
    assert compare(log, known, [run_ekf(known)])["ekf"].points is None


def test_the_verdict_says_what_was_seen_and_how_good_its_map_is(outdoors) -> None:
    log, measurements, filtered = outdoors
    judged = compare(log, measurements, [filtered, smooth(measurements, filtered)])
    assert judged.kinds == ("bearing",)
    texts = verdict(judged)
    assert any(text.startswith("Map of points (RMS distance from the true") for text in texts)
    assert "ekf and smoother: 9 of 9 seen points mapped, none twice, none spurious." in texts
    assert "map of points" in texts[0]
    assert not any("line" in text for text in texts)
    lamps = replace(
        judged["ekf"].points, points=replace(judged["ekf"].points.points, kind=("lamp",) * 9)
    )
    of_lamps = replace(judged, methods=(replace(judged["ekf"], points=lamps),), kinds=("lamp",))
    assert "ekf: 9 of 9 seen lamps mapped, none twice, none spurious." in verdict(of_lamps)


def test_a_run_writes_its_points_for_another_log_and_shows_them(tmp_path: Path) -> None:
    scenario = replace(load_scenario("cones-outdoors"), repeat=1)
    log = simulate(scenario, tmp_path / "log", seed=1, images=False)
    out = tmp_path / "out"
    command = ["run", str(log), "--out", str(out), "--extract.landmarks", "mapped"]
    assert main([*command, "--methods", "odometry", "ekf", "smoother"]) == 0
    record = Record.load(out)
    estimate = record.estimates["smoother"]
    again = read_landmarks(out / "smoother" / "landmarks.csv")
    assert np.array_equal(again.params, estimate.map.params)
    assert np.array_equal(again.label, estimate.map.label)
    assert not (out / "odometry" / "landmarks.csv").exists()
    bearings = (out / "bearings.csv").read_text().splitlines()
    assert bearings[0] == "t,bearing,sigma,label,landmark,t_received"
    assert len(bearings) == 1 + len(record.measurements.sightings["bearing"])
    assert record.metrics["methods"]["smoother"]["points"]["matched"] == 9
    plan = (out / "plots" / "floor-plan.csv").read_text()
    assert plan.count("truth,point,") == 9
    assert plan.count("smoother,point,") == 9
    report = (out / "report.html").read_text()
    assert "<h3>Points</h3>" in report
    assert "point 8" in report
    said = re.sub(r"(?s)<(script|style|svg).*?</\1>", "", report)
    assert not re.search(r"(?i)\bline", said)  # none was seen
    # the map of one run is the known map of another
    (log / "landmarks.csv").write_bytes((out / "smoother" / "landmarks.csv").read_bytes())
    assert main(["run", str(log), "--out", str(tmp_path / "known"), "--methods", "ekf"]) == 0
