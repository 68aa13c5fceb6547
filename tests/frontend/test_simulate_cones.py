"""Scenarios with cones: the log with images and the one without say the same of one world."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare.interchange.recording import export_recording
from compare.replay import take_frames
from frontend.config import ExtractConfig
from frontend.extract import extract
from frontend.image_cones import bearings_in_images
from frontend.log import open_log
from frontend.overlay_frames import write_overlays
from frontend.simulate import (
    NoiseLevel,
    Scenario,
    load_scenario,
    noisier,
    simulate,
    simulate_log,
    simulate_measurements,
)
from frontend.simulate.scenario import Motion
from graphslam.errors import BadConfig
from graphslam.geometry import interpolate_poses
from graphslam.models.bearing import BEARING


@pytest.fixture(scope="module")
def short() -> Scenario:
    whole = load_scenario("three-cones")
    omni = replace(whole.omni, image_size=(320, 240), rate=1.0)
    return replace(whole, omni=omni, repeat=1, path=(Motion(forward=0.3), Motion(turn_deg=60.0)))


def test_images_and_bearings_csv_show_the_same_cones(short: Scenario, tmp_path: Path) -> None:
    log = open_log(simulate(short, tmp_path / "images", seed=3))
    assert log.warnings == ()
    seen = extract(log)
    said = simulate_measurements(short, seed=3)
    assert np.array_equal(seen.t, said.t)
    np.testing.assert_allclose(seen.start_pose, said.start_pose, atol=1e-9)
    a, b = seen.sightings["bearing"], said.sightings["bearing"]
    assert len(a) == len(b) == 3 * len(seen.t)
    for node in range(len(seen.t)):
        one, two = (t.select(t.node == node) for t in (a, b))
        assert sorted(one.truth) == sorted(two.truth) == [0, 1, 2]
        gap = one.z[np.argsort(one.truth), 0] - two.z[np.argsort(two.truth), 0]
        assert np.degrees(np.abs(np.arctan2(np.sin(gap), np.cos(gap)))).max() < 1.0
    assert seen.known is not None
    np.testing.assert_allclose(seen.known.params, [[0, 0], [0, 0.7], [1, 0]])
    assert seen.known.label.tolist() == [0, 1, 1]


def test_a_bag_gives_the_same_bearings_to_the_same_known_cones(
    short: Scenario, tmp_path: Path
) -> None:
    recorded = open_log(simulate(short, tmp_path / "log", seed=3))
    written, notes = export_recording(recorded, "mcap", tmp_path / "drive.mcap")
    assert [path.name for path in written[1:]] == [
        "drive.robot.toml",
        "drive.map.csv",
        "drive.landmarks.csv",
    ]
    assert notes == ()
    log = open_log(written[0], written[1])
    assert log.warnings == ()
    ours, theirs = extract(log), extract(recorded)
    for name in ("z", "cov", "label", "truth", "node"):
        one, two = (getattr(m.sightings["bearing"], name) for m in (ours, theirs))
        assert np.array_equal(one, two), name
    assert ours.known is not None
    assert theirs.known is not None
    assert np.array_equal(ours.known.params, theirs.known.params)
    written[3].write_text(written[3].read_text().replace("bearing,0.0,0.7", "bearing,0.0,0.8"))
    assert open_log(written[0], written[1]).digest != log.digest


def test_thumbnails_and_overlays_show_where_each_cone_was_seen(
    short: Scenario, tmp_path: Path
) -> None:
    log = open_log(simulate(short, tmp_path / "log", seed=3))
    measurements = extract(log)
    frames = take_frames(log, measurements, {})
    assert frames is not None
    assert len(frames.node) == len(measurements.t)
    assert sorted(frames.sighting) == list(range(len(measurements.sightings["bearing"])))
    found = bearings_in_images(log, log.images_of("omni"), ExtractConfig())
    scale = frames.size[0] / log.cameras["omni"].image_size
    for (a, b), pixel in zip(frames.ends, (found.seen.pixel + 0.5) * scale, strict=True):
        along, off = (b - a) / np.linalg.norm(b - a), pixel - a
        assert abs(along[0] * off[1] - along[1] * off[0]) < 0.5  # the stroke goes through the cone
        assert 0.0 < along @ off < np.linalg.norm(b - a)
    told: list[tuple[int, int]] = []
    count = write_overlays(log, measurements, tmp_path / "out", lambda *done: told.append(done))
    assert count == len(told) == len([*(tmp_path / "out").iterdir()]) == len(measurements.t)


def test_folder_and_memory_give_the_same_measurements(short: Scenario, tmp_path: Path) -> None:
    folder = open_log(simulate(short, tmp_path / "log", seed=1, images=False))
    a, b = extract(folder), simulate_measurements(short, seed=1)
    for name in ("z", "cov", "label", "truth", "node", "t_received"):
        one, two = (getattr(m.sightings["bearing"], name) for m in (a, b))
        assert np.array_equal(one, two), name


def test_errors_of_bearings_are_those_stated(short: Scenario) -> None:
    whole = replace(load_scenario("cones-outdoors"), repeat=1)
    log = simulate_log(whole, seed=2)
    assert log.bearings is not None and log.truth is not None and log.landmarks is not None  # noqa: PT018
    pose = interpolate_poses(log.bearings.t, log.truth.t, log.truth.pose)
    point = log.landmarks.params[log.bearings.truth]
    e = BEARING.residual(pose, point, log.bearings.z)[0][:, 0] / np.sqrt(log.bearings.cov[:, 0, 0])
    assert abs(e.mean()) < 0.15
    assert e.std() == pytest.approx(1.0, abs=0.1)
    twice = simulate_log(noisier(whole, NoiseLevel(1.0, 2.0)), seed=2)
    assert twice.bearings is not None
    np.testing.assert_allclose(twice.bearings.cov, 4.0 * log.bearings.cov)


def test_reach_and_misses_leave_cones_out(short: Scenario) -> None:
    assert short.omni is not None
    near = simulate_log(replace(short, omni=replace(short.omni, reach=0.6)), seed=0).bearings
    assert near is not None
    assert 2 not in near.truth[near.t == 0.0]
    half = simulate_log(replace(short, omni=replace(short.omni, miss_rate=0.5)), seed=0).bearings
    every = simulate_log(short, seed=0).bearings
    assert half is not None and every is not None  # noqa: PT018
    assert 0.2 < len(half.t) / len(every.t) < 0.8
    assert set(half.z[:, 0]) <= set(every.z[:, 0])  # what is left has the same noise


def test_cones_without_a_camera_for_them_are_refused(short: Scenario) -> None:
    with pytest.raises(BadConfig, match="cones are what \\[omni\\] sees"):
        replace(short, cones=())
    with pytest.raises(BadConfig, match="camera is missing"):
        replace(short, omni=None, cones=())


def test_the_same_seed_gives_the_same_bytes(short: Scenario, tmp_path: Path) -> None:
    one, two = (simulate(short, tmp_path / name, seed=5) for name in ("a", "b"))
    files = [path.relative_to(one) for path in sorted(one.rglob("*")) if path.is_file()]
    assert any(path.parts[0] == "omni" for path in files)
    for path in files:
        assert (one / path).read_bytes() == (two / path).read_bytes(), path
