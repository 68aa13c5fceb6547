"""CARMEN logs: what is read, in which order, and what is refused with file and line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from frontend.config import ExtractConfig
from frontend.extract import extract
from frontend.log import Log, open_log
from frontend.readers.carmen_messages import MOST_READINGS
from graphslam.errors import BadLog

FLASER = "FLASER 4 1.0 2.0 nan 81.83 9 9 9 {x} 0.0 0.1 {t} host 0.5\n"
ROBOTLASER = (
    "ROBOTLASER1 0 -1.5 3.0 0.5 20.0 0.01 0 3 1.0 1.1 1.2 2 5 6 "
    "1.2 0.5 0.2 1.0 0.5 0.2 0.3 0.1 0.5 0.5 0.0 {t} host 0.5\n"
)


def write(folder: Path, text: str) -> Path:
    path = folder / "run.clf"
    path.write_text(text)
    return path


def flasers(folder: Path, times: list[float]) -> Log:
    lines = [FLASER.format(x=0.1 * n, t=t) for n, t in enumerate(times)]
    return open_log(write(folder, "# a comment\n" + "".join(lines)))


def test_flaser_is_read_in_the_order_of_the_file_and_bad_stamps_are_counted(tmp_path: Path):
    log = flasers(tmp_path, [5.0, 6.0, 5.5, 5.5, 7.0])
    assert log.odometry is not None
    assert log.scans is not None
    assert log.odometry.pose[:, 0].tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert np.all(np.diff(log.odometry.t) > 0)
    assert log.odometry.t == pytest.approx([5.0, 6.0, 6.0, 6.0, 7.0], abs=1e-5)
    assert any("run backwards: 1, that repeat: 1" in text for text in log.warnings)
    scan = log.scans.place[1].scan()
    assert scan is not None
    assert (scan.angle_min, scan.angle_step) == pytest.approx((-np.pi / 2, np.pi / 4))
    assert scan.ranges[3] > scan.range_max  # 81.83 is a code, not a distance


def test_robotlaser_has_its_own_beams_and_place(tmp_path: Path):
    log = open_log(write(tmp_path, "".join(ROBOTLASER.format(t=t) for t in (1.0, 2.0))))
    assert log.scans is not None
    assert log.odometry is not None
    expected = [0.2 * np.cos(0.2), -0.2 * np.sin(0.2), 0.0]
    assert log.scans.sensor_pose == pytest.approx(expected)
    scan = log.scans.place[0].scan()
    assert scan is not None
    assert (scan.angle_min, scan.angle_step, scan.range_max) == (-1.5, 0.5, 20.0)
    assert scan.ranges == pytest.approx([1.0, 1.1, 1.2])
    assert log.odometry.pose[0].tolist() == [1.0, 0.5, 0.2]


def test_param_says_where_the_laser_of_flaser_is(tmp_path: Path):
    text = "PARAM robot_frontlaser_offset 0.3 0 host 0\nPARAM other on 0 host 0\n"
    log = open_log(write(tmp_path, text + FLASER.format(x=0, t=1.0) + FLASER.format(x=1, t=2.0)))
    assert log.scans is not None
    assert log.scans.sensor_pose.tolist() == [0.3, 0.0, 0.0]


def test_odometry_alone_makes_a_log(tmp_path: Path):
    text = "".join(f"ODOM {n} 0 0 0.1 0 0 {n}.5 host 0\n" for n in range(3))
    log = open_log(write(tmp_path, text))
    assert log.scans is None
    assert extract(log).t.tolist() == [0.5, 1.5, 2.5]


def test_what_is_not_used_is_told(tmp_path: Path):
    text = FLASER.format(x=0, t=1.0) + "ODOM 0 0 0 0 0 0 1 host 0\nSYNC x\nWHAT is this\n"
    log = open_log(write(tmp_path, text + FLASER.format(x=1, t=2.0) + "FLASER 4 1.0 2"))
    told = " ".join(log.warnings)
    assert "ODOM (1), SYNC (1)" in told
    assert "'WHAT' (1)" in told
    assert "line 6, the last, is cut off" in told


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("FLASER 4 1.0 2.0\n", "declares 4 readings"),
        ("FLASER many 1.0\n", "number of readings"),
        (f"FLASER {MOST_READINGS + 1} 1.0\n", "declares"),
        ("FLASER -1 1.0\n", "declares -1"),
        ("FLASER 1 x 0 0 0 0 0 0 1 host 0\n", "readings that are no numbers"),
        ("FLASER 1 1.0 0 0 0 nan 0 0 1 host 0\n", "finite"),
        ("FLASER 1 1.0 0 0 0 0 0 0 soon host 0\n", "numbers"),
        ("ODOM 1 2\n", "words"),
        ("FLASER " + "1 " * 600_000 + "\n", "longer than"),
    ],
)
def test_damage_is_an_error_that_names_file_and_line(tmp_path: Path, line: str, told: str):
    path = write(tmp_path, FLASER.format(x=0, t=1.0) + line)
    with pytest.raises(BadLog, match=told) as caught:
        open_log(path)
    assert f"{path}:2:" in str(caught.value)


def test_a_log_without_motion_says_so(tmp_path: Path):
    with pytest.raises(BadLog, match="nothing tells how the robot moved"):
        open_log(write(tmp_path, "PARAM a 1 0 host 0\n"))


def test_a_robot_file_is_refused(tmp_path: Path):
    with pytest.raises(BadLog, match="leave --robot out"):
        open_log(write(tmp_path, FLASER.format(x=0, t=1.0)), tmp_path / "robot.toml")


def test_a_part_of_a_shared_log_gives_walls(shared_data: Path):
    log = open_log(shared_data / "intel" / "intel.clf")
    assert log.scans is not None
    assert len(log.scans.t) == 2726
    t = log.scans.t
    part = extract(log, ExtractConfig(to_s=float(t[20])))
    assert len(part.t) == 21
    assert len(part.sightings["line"]) > 40
