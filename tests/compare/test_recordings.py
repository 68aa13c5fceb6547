"""`graphslam export` of recordings: folders, bags, and a run as a Rerun recording."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare.batch_inputs import find_logs
from compare.cli import main
from compare.config import RunConfig
from compare.interchange.recording import export_recording
from compare.opening import open_as
from compare.run import run_opened
from frontend.log import Log, open_log
from frontend.readers.bag_collect import collect
from frontend.readers.robot_toml import read_robot_file
from frontend.simulate import load_scenario, simulate
from frontend.simulate.scenario import Motion
from frontend.survey import survey
from tests.compare.tiny_log import write_tiny_log
from tests.frontend.recordings import Bag, short_log, write_folder

STILL = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(short_log(6.0), tmp_path_factory.mktemp("export") / "log")


def same(ours: Log, theirs: Log) -> None:
    assert ours.images is not None
    assert theirs.images is not None
    assert ours.wheels is not None
    assert theirs.wheels is not None
    assert ours.truth is not None
    assert theirs.truth is not None
    assert np.array_equal(ours.images.t, theirs.images.t)
    assert np.array_equal(ours.wheels.t, theirs.wheels.t)
    assert np.array_equal(ours.wheels.angle, theirs.wheels.angle)
    np.testing.assert_allclose(ours.truth.pose, theirs.truth.pose, atol=1e-12)
    assert ours.robot == theirs.robot
    assert np.array_equal(ours.cameras["floor"].homography, theirs.cameras["floor"].homography)
    assert np.array_equal(ours.start_pose, theirs.start_pose)
    assert ours.map is not None
    assert theirs.map is not None
    assert np.array_equal(ours.map.params, theirs.map.params)


@pytest.mark.parametrize("to", ["mcap", "rosbag1", "rosbag2"])
def test_a_log_goes_to_a_bag_and_back_by_commands(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], to: str
):
    bag, back, robot = tmp_path / "drive.bag", tmp_path / "back", tmp_path / "drive.robot.toml"
    if to == "rosbag2":
        bag = tmp_path / "drive"
    assert main(["export", str(folder), "--to", to, "--out", str(bag)]) == 0
    written = capsys.readouterr().out.split()
    assert written == [str(bag), str(robot), str(tmp_path / "drive.map.csv")]
    same(open_log(bag, robot), open_log(folder))
    words = ["export", str(bag), "--robot", str(robot), "--to", "folder", "--out", str(back)]
    assert main(words) == 0
    same(open_log(back), open_log(folder))
    for image in sorted((folder / "images").iterdir()):
        assert (back / "images" / image.name).read_bytes() == image.read_bytes()
    assert main(words) == 1
    assert "exists already" in capsys.readouterr().err


def test_odometry_and_scans_go_to_a_folder_and_back(tmp_path: Path):
    with Bag(tmp_path / "x.bag", 1) as bag:
        for k in range(10):
            bag.odometry(1 + 0.1 * k, 0.1 * k)
            bag.transform(1 + 0.1 * k, "base_link", "laser", (0.2, 0.0, 0.0), STILL)
            bag.scan(1 + 0.1 * k, np.array([k, 2.0, np.inf, 4.0, 5.0]))
    folder, again = tmp_path / "folder", tmp_path / "again.mcap"
    assert main(["export", str(tmp_path / "x.bag"), "--to", "folder", "--out", str(folder)]) == 0
    assert main(["export", str(folder), "--to", "mcap", "--out", str(again)]) == 0
    first, last = open_log(tmp_path / "x.bag"), open_log(again, tmp_path / "again.robot.toml")
    for log in (open_log(folder), last):
        assert log.scans is not None
        assert first.scans is not None
        assert log.odometry is not None
        assert first.odometry is not None
        assert np.array_equal(log.scans.t, first.scans.t)
        np.testing.assert_allclose(log.scans.sensor_pose, [0.2, 0.0, 0.0])
        np.testing.assert_allclose(log.odometry.pose, first.odometry.pose, atol=1e-12)
        ours, theirs = log.scans.place[7].scan(), first.scans.place[7].scan()
        assert ours is not None
        assert theirs is not None
        assert np.array_equal(ours.ranges, theirs.ranges)
        assert (ours.angle_min, ours.angle_step) == (theirs.angle_min, theirs.angle_step)
        assert ours.duration == pytest.approx(theirs.duration)


def test_what_no_bag_holds_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    folder = write_tiny_log(tmp_path / "log")
    assert main(["export", str(folder), "--to", "mcap", "--out", str(tmp_path / "x.mcap")]) == 0
    assert "sightings are left out: no message of a bag holds them" in capsys.readouterr().err


def test_bearings_and_lamps_that_a_bag_cannot_hold_are_told(tmp_path: Path) -> None:
    for name, part in (("three-cones", "bearings"), ("four-lamps", "lamps")):
        scenario = replace(load_scenario(name), path=(Motion(forward=0.5),), repeat=1)
        log = open_log(simulate(scenario, tmp_path / name, images=False))
        _, notes = export_recording(log, "mcap", tmp_path / f"{name}.mcap")
        assert notes == (f"{part} are left out: no message of a bag holds them",)


def test_a_run_becomes_a_rerun_recording_with_everything_on_one_timeline(
    folder: Path, tmp_path: Path
):
    if importlib.util.find_spec("rerun") is None:
        pytest.skip("the extra `view` is not installed: pip install 'floorline-slam[view]'")
    assert main(["run", str(folder), "--out", str(tmp_path / "run")]) == 0
    out = tmp_path / "run.rrd"
    assert main(["export", str(tmp_path / "run"), "--to", "rerun", "--out", str(out)]) == 0
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "print", str(out)],
        capture_output=True,
        text=True,
        check=True,
    )
    told = done.stdout + done.stderr
    for entity in (
        "/camera/image",
        "/camera/image/lines",
        "/floor/truth/path",
        "/floor/truth/map",
        "/floor/ekf/path",
        "/floor/smoother/map",
        "/floor/smoother/pose",
        "/floor/smoother/ellipse_95_percent",
        "/floor/lines_seen_from_smoother",
        "/sigma_x_m/ekf",
    ):
        assert entity in told, entity


def test_without_rerun_the_cure_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setitem(sys.modules, "rerun", None)
    folder = write_tiny_log(tmp_path / "log")
    assert main(["run", str(folder), "--out", str(tmp_path / "run")]) == 0
    words = ["export", str(tmp_path / "run"), "--to", "rerun", "--out", str(tmp_path / "x.rrd")]
    assert main(words) == 1
    assert "pip install 'floorline-slam[view]'" in capsys.readouterr().err


def test_a_real_bag_runs_and_keeps_to_its_truth(shared_data: Path, tmp_path: Path):
    bag = shared_data / "agv" / "jarvis_circular_path_fast.bag"
    config = RunConfig(methods=("odometry",))
    run_opened(open_as(bag, config), tmp_path / "run", config, report=False)
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["methods"]["odometry"]["trajectory"]["aligned_rmse_m"] <= 0.05
    (tmp_path / "robot.toml").write_text(survey(collect(bag)).proposal)
    proposed = read_robot_file(tmp_path / "robot.toml")
    assert proposed.topics.truth == "/pose_ground_truth"
    assert proposed.frames.robot == "base_footprint"
    assert proposed.laser is not None
    assert proposed.laser.pose == (0.895, 0.0, 0.0)


def test_a_batch_finds_bags_beside_log_folders(folder: Path, tmp_path: Path):
    (tmp_path / "logs").mkdir()
    write_tiny_log(tmp_path / "logs" / "c")
    for name, to in (("a.bag", "rosbag1"), ("b", "rosbag2")):
        words = ["export", str(folder), "--to", to, "--out", str(tmp_path / "logs" / name)]
        assert main(words) == 0
    assert [log.name for log in find_logs([tmp_path / "logs"])] == ["a", "b", "c"]
