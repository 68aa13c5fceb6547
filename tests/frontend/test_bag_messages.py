"""What each message of a bag becomes, when it happened, and what robot files say."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from frontend.encodings import bgr_of, grey_of
from frontend.extract import extract
from frontend.log import open_log, with_camera_offset
from frontend.readers.bag_collect import collect
from frontend.readers.robot_toml import read_robot_file
from frontend.survey import survey
from graphslam.errors import BadLog
from tests.frontend.recordings import Bag, short_log, write_folder

STILL = (0.0, 0.0, 0.0, 1.0)
ROBOT = 'format = "graphslam-robot/1"\n'
SIZES = "[robot]\nwheel_radius_left = 0.05\nwheel_radius_right = 0.05\nwheel_base = 0.2\n"
AGV = "agv/jarvis_circular_path_fast.bag"


def robot(folder: Path, text: str) -> Path:
    path = folder / "robot.toml"
    path.write_text(ROBOT + text)
    return path


def drive(bag: Bag, count: int = 20) -> None:
    for k in range(count):
        bag.odometry(1 + 0.1 * k, 0.1 * k)


# ---- messages ---------------------------------------------------------------------------------


@pytest.mark.parametrize("ros", [1, 2])
def test_wheels_are_joints_by_name_and_turns_that_start_anew_are_added_up(tmp_path: Path, ros: int):
    angle = np.linspace(0.0, 14.0, 60)
    with Bag(tmp_path / "x.bag", ros) as bag:
        for k, a in enumerate(angle.tolist()):
            wrapped = float((a + np.pi) % (2 * np.pi) - np.pi)
            bag.joints(0.1 * k, ["arm", "r", "l"], [9.0, -a / 20, wrapped])
    path = robot(tmp_path, SIZES + '[joints]\nleft = "l"\nright = "r"\n')
    log = open_log(tmp_path / "x.bag", path)
    assert log.wheels is not None
    np.testing.assert_allclose(log.wheels.t, 0.1 * np.arange(60), atol=1e-9)
    np.testing.assert_allclose(log.wheels.angle, np.column_stack([angle, -angle / 20]), atol=1e-9)
    assert any("angles start anew at each turn" in warning for warning in log.warnings)


def test_odometry_and_the_laser_come_from_tf_also_upside_down(tmp_path: Path):
    down = (1.0, 0.0, 0.0, 0.0)  # half a turn about x
    with Bag(tmp_path / "x.bag", 1) as bag:
        for k in range(10):
            pose = (0.1 * k, 0.0, 0.0)
            bag.transform(1 + 0.1 * k, "odom", "base_link", pose, STILL)
            bag.transform(1 + 0.1 * k, "base_link", "mast", (0.2, 0.1, 1.0), STILL)
            bag.transform(1 + 0.1 * k, "mast", "laser", (0.1, 0.0, 0.0), down)
            bag.scan(1 + 0.1 * k, np.array([1.0, 2.0, 3.0, 4.0, 5.0]))
    log = open_log(tmp_path / "x.bag")
    assert log.odometry is not None
    assert log.scans is not None
    np.testing.assert_allclose(log.odometry.pose[:, 0], 0.1 * np.arange(10))
    np.testing.assert_allclose(log.scans.sensor_pose, [0.3, 0.1, 0.0], atol=1e-12)
    scan = log.scans.place[3].scan()
    assert scan is not None
    assert (scan.angle_min, scan.angle_step) == (1.0, -0.5)
    assert scan.ranges.tolist() == [1, 2, 3, 4, 5]
    assert scan.duration == pytest.approx(0.04)
    assert log.has_walls()
    assert np.array_equal(extract(log).t, log.scans.t)  # without images, scans are the nodes


def test_a_frame_that_stood_still_at_first_keeps_the_time_it_began_to_move(tmp_path: Path):
    with Bag(tmp_path / "x.bag", 1) as bag:
        for k in range(20):
            bag.transform(0.1 * k, "odom", "base_link", (max(0.0, 0.1 * (k - 10)), 0.0, 0.0), STILL)
    log = open_log(tmp_path / "x.bag")
    assert log.odometry is not None
    at = np.interp([0.5, 1.0, 1.5], log.odometry.t, log.odometry.pose[:, 0])
    np.testing.assert_allclose(at, [0.0, 0.0, 0.5], atol=1e-9)


def test_encodings_become_grey_levels():
    rng = np.random.default_rng(1)
    colour = rng.integers(0, 256, (6, 8, 3), np.uint8)
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)

    def read(data: np.ndarray, encoding: str, step: int, big: bool = False) -> np.ndarray:
        found = grey_of(np.frombuffer(data.tobytes(), np.uint8), encoding, 8, 6, step, big)
        assert found is not None
        return found

    assert np.array_equal(read(colour, "bgr8", 24), grey)
    assert np.array_equal(read(colour[..., ::-1], "rgb8", 24), grey)
    padded = np.concatenate([grey, np.zeros((6, 3), np.uint8)], axis=1)
    assert np.array_equal(read(padded, "mono8", 11), grey)
    deep = grey.astype(np.uint16) << 8
    assert np.array_equal(read(deep, "mono16", 16), grey)
    assert np.array_equal(read(deep.astype(">u2"), "mono16", 16, True), grey)
    red = np.zeros((6, 8), np.uint8)
    red[::2, ::2] = 200  # red pixels of an RGGB mosaic
    bright = read(red, "bayer_rggb8", 8)[2:4, 2:4].mean()
    assert bright == pytest.approx(0.299 * 200, abs=2)
    assert grey_of(np.zeros(10, np.uint8), "mono8", 8, 6, 8, False) is None


def test_encodings_become_colours():
    rng = np.random.default_rng(1)
    colour = rng.integers(0, 256, (6, 8, 3), np.uint8)
    opaque = np.concatenate([colour, np.full((6, 8, 1), 255, np.uint8)], axis=2)

    def read(data: np.ndarray, encoding: str, step: int) -> np.ndarray:
        found = bgr_of(np.frombuffer(data.tobytes(), np.uint8), encoding, 8, 6, step, False)
        assert found is not None
        return found

    assert np.array_equal(read(colour, "bgr8", 24), colour)
    assert np.array_equal(read(colour[..., ::-1], "rgb8", 24), colour)
    assert np.array_equal(read(opaque, "bgra8", 32), colour)
    grey = colour[..., 0]
    assert np.array_equal(read(grey, "mono8", 8), np.repeat(grey[..., None], 3, axis=2))
    red = np.zeros((6, 8), np.uint8)
    red[::2, ::2] = 200
    blue_green_red = read(red, "bayer_rggb8", 8)[2:4, 2:4].mean(axis=(0, 1))
    assert blue_green_red == pytest.approx((0.0, 0.0, 200.0), abs=2)
    assert bgr_of(np.zeros(10, np.uint8), "bgr8", 8, 6, 24, False) is None


# ---- time -------------------------------------------------------------------------------------


def recorded(path: Path, stamp: list[float], received: list[float]) -> Path:
    with Bag(path, 2) as bag:
        for s, r in zip(stamp, received, strict=True):
            bag.odometry(r, r, stamp=s)
    return path


def times(path: Path, robot_file: Path | None = None) -> tuple[np.ndarray, str]:
    log = open_log(path, robot_file)
    assert log.odometry is not None
    return log.odometry.t, " ".join(log.warnings)


def test_a_message_happened_when_its_header_says_or_when_it_was_received_if_asked(tmp_path: Path):
    stamp = [1.0, 1.1, 1.2, 1.3]
    received = [1.05, 1.13, 1.29, 1.31]
    path = recorded(tmp_path / "x", stamp, received)
    assert times(path)[0].tolist() == stamp
    asked = robot(tmp_path, '[time]\nstamp = "receive"\n')
    assert times(path, asked)[0].tolist() == received


def test_headers_without_times_fall_back_to_receiving(tmp_path: Path):
    found, told = times(recorded(tmp_path / "x", [0.0] * 4, [1.0, 1.1, 1.2, 1.3]))
    assert found.tolist() == [1.0, 1.1, 1.2, 1.3]
    assert "hold no times: those of receiving are used" in told


def test_jumps_of_the_stamps_are_taken_out_by_the_other_clock(tmp_path: Path):
    true = 1 + 0.1 * np.arange(40)
    stamp = np.where(np.arange(40) >= 20, true + 3600.0, true)
    found, told = times(recorded(tmp_path / "x", stamp.tolist(), (true + 0.01).tolist()))
    np.testing.assert_allclose(found, true, atol=1e-6)
    assert "clock of its stamps jumps 1 times, at most by +3.6e+03 s" in told


def test_jumps_of_receiving_leave_the_stamps_alone(tmp_path: Path):
    true = 1 + 0.1 * np.arange(40)
    received = np.where(np.arange(40) >= 20, true + 77.0, true)
    found, told = times(recorded(tmp_path / "x", true.tolist(), received.tolist()))
    np.testing.assert_allclose(found, true, atol=1e-9)
    assert "the clock of receiving jumps 1 times" in told


def test_stamps_that_repeat_or_run_back_are_counted_and_left_out(tmp_path: Path):
    stamp = [1.0, 1.1, 1.1, 1.05, 1.2, 1.3]
    found, told = times(recorded(tmp_path / "x", stamp, [1.0, 1.1, 1.12, 1.15, 1.2, 1.3]))
    assert found.tolist() == [1.0, 1.1, 1.2, 1.3]
    assert "2 messages whose times repeat or run back are left out" in told


def test_stamps_of_different_clocks_are_brought_to_that_of_receiving(tmp_path: Path):
    with Bag(tmp_path / "x", 2) as bag:
        for k in range(30):
            bag.odometry(1000 + 0.1 * k, 0.1 * k, stamp=5.0 + 0.1 * k)  # since the robot's start
            bag.scan(1000.01 + 0.1 * k, np.ones(5))
    log = open_log(tmp_path / "x")
    assert log.odometry is not None
    assert log.scans is not None
    np.testing.assert_allclose(log.odometry.t, 1000 + 0.1 * np.arange(30), atol=1e-6)
    np.testing.assert_allclose(log.scans.t, 1000.01 + 0.1 * np.arange(30), atol=1e-6)
    assert "stamps of this bag are of different clocks" in " ".join(log.warnings)


def test_the_cameras_offset_counts_once_wherever_it_is_given(tmp_path: Path):
    folder = write_folder(short_log(3.0), tmp_path / "log")
    plain = open_log(folder)
    assert plain.images is not None
    text = (folder / "log.toml").read_text()
    (folder / "log.toml").write_text(text + "\n[time]\ncamera_offset = 0.25\n")
    log = open_log(folder)
    assert log.images is not None
    np.testing.assert_allclose(log.images.t, plain.images.t + 0.25)
    twice = with_camera_offset(with_camera_offset(log, 0.5), 0.5)
    assert twice.images is not None
    np.testing.assert_allclose(twice.images.t, plain.images.t + 0.75)


# ---- robot files ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('[topics]\nodometry = "/odmo"\n', "no topic '/odmo'.*did you mean '/odom'"),
        ('[topics]\nscans = "/odom"\n', "cannot be scans; it must be sensor_msgs/msg/LaserScan"),
        ('[topics]\nscan = "/odom"\n', "topics.scan is not a known key; did you mean 'scans'"),
        ('[joints]\nleft = "a"\nright = "b"\n', "has no joint 'a'"),
        ('[frames]\nodometry = "world"\nrobot = "r"\n', "tf has no moving frame 'r' in 'world'"),
        ('[time]\nstamp = "heading"\n', "time.stamp"),
        ("[camera]\nimage_size = [4, 4]\n", "camera.homography is missing"),
    ],
)
def test_what_is_wrong_in_a_robot_file_is_told(tmp_path: Path, text: str, told: str):
    with Bag(tmp_path / "x", 2) as bag:
        drive(bag)
    with pytest.raises(BadLog, match=told):
        open_log(tmp_path / "x", robot(tmp_path, text))


def test_a_log_folder_takes_no_robot_file(tmp_path: Path):
    folder = write_folder(short_log(1.0), tmp_path / "log")
    with pytest.raises(BadLog, match="leave --robot out"):
        open_log(folder, robot(tmp_path, ""))


def test_the_proposed_robot_file_is_one_and_says_what_is_missing(tmp_path: Path):
    with Bag(tmp_path / "x", 2) as bag:
        drive(bag)
        for k in range(20):
            t = 1 + 0.1 * k
            bag.joints(t, ["wheel_left_joint", "wheel_right_joint"], [t, t])
            bag.image(t, np.zeros((24, 32), np.uint8))
            bag.scan(t, np.ones(5))
            bag.transform(t, "base_link", "laser", (0.2, 0.0, 0.0), STILL)
        info = bag.type(
            "sensor_msgs/msg/CameraInfo",
            header=bag.header(1.0, "camera"),
            height=24,
            width=32,
            distortion_model="plumb_bob",
            d=np.array([0.1, 0.0, 0.0, 0.0, 0.0]),
            k=np.array([30.0, 0, 16, 0, 30, 12, 0, 0, 1]),
            r=np.zeros(9),
            p=np.zeros(12),
            binning_x=0,
            binning_y=0,
            roi=bag.type(
                "sensor_msgs/msg/RegionOfInterest",
                x_offset=0,
                y_offset=0,
                height=0,
                width=0,
                do_rectify=False,
            ),
        )
        bag.write("/camera_info", "sensor_msgs/msg/CameraInfo", 1.0, info)
    found = survey(collect(tmp_path / "x"))
    assert {row.topic: row.use for row in found.topics} == {
        "/odom": "odometry",
        "/joint_states": "wheels",
        "/image": "images of floor",
        "/scan": "scans",
        "/tf": "",
        "/camera_info": "",
    }
    path = tmp_path / "proposed.toml"
    path.write_text(found.proposal)
    read = read_robot_file(path)
    assert read.topics.images == {"floor": "/image"}
    assert read.joints is not None
    assert read.joints.left == "wheel_left_joint"
    assert read.laser is not None
    assert read.laser.pose == (0.2, 0.0, 0.0)
    assert open_log(tmp_path / "x", path).scans is not None
    assert "# matrix = [[30.0, 0.0, 16.0]" in found.proposal
    assert "# image_size = [32, 24]" in found.proposal
    assert len(found.missing) == 1
    assert "homography" in found.missing[0]


# ---- a real bag -------------------------------------------------------------------------------


def test_a_real_bag_is_read_against_its_truth(shared_data: Path):
    log = open_log(shared_data / AGV)
    assert log.odometry is not None
    assert log.truth is not None
    assert log.scans is not None
    assert (len(log.odometry.t), len(log.truth.t), len(log.scans.t)) == (638, 204, 213)
    np.testing.assert_allclose(log.scans.sensor_pose, [0.895, 0.0, 0.0])
    scan = log.scans.place[100].scan()
    assert scan is not None
    assert len(scan.ranges) == 761
    assert 0.1 < np.median(scan.ranges) < 50.0
