"""Bags: one log in every format gives the same, and what each message becomes."""

from __future__ import annotations

import re
import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from frontend.extract import extract
from frontend.images import read_grey
from frontend.log import Log, open_log
from frontend.readers.bag_files import files_of
from frontend.readers.bag_parts import Losses
from frontend.write_bag import write_bag
from graphslam.ekf import run_ekf
from graphslam.errors import BadLog
from graphslam.measurements import Measurements
from graphslam.smoother import smooth
from tests.frontend.recordings import (
    FORMATS,
    NAMES,
    Bag,
    short_log,
    write_folder,
    write_robot_file,
)

STILL = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def recorded() -> Log:
    return short_log()


@pytest.fixture(scope="module")
def folder(recorded: Log, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log as a folder, as bags of three formats, and their robot file."""
    out = tmp_path_factory.mktemp("recordings")
    write_folder(recorded, out / "log")
    write_robot_file(recorded, out / "robot.toml")
    for to in FORMATS:
        write_bag(recorded, out / NAMES[to], to)
    return out


@pytest.fixture(scope="module")
def expected(folder: Path) -> Measurements:
    return extract(open_log(folder / "log"))


# ---- one log, every format --------------------------------------------------------------------


@pytest.mark.parametrize("to", FORMATS)
def test_a_bag_gives_the_same_measurements_as_the_log_folder(
    folder: Path, expected: Measurements, to: str
):
    log = open_log(folder / NAMES[to], folder / "robot.toml")
    assert log.warnings == ()
    found = extract(log)
    assert len(expected.sightings["line"]) > 20
    assert np.array_equal(found.t, expected.t)
    assert np.array_equal(found.odometry.increment, expected.odometry.increment)
    assert np.array_equal(found.odometry.cov, expected.odometry.cov)
    for name in ("z", "cov", "extent", "truth", "node"):
        ours, theirs = (getattr(m.sightings["line"], name) for m in (found, expected))
        assert np.array_equal(ours, theirs), name
    assert np.array_equal(found.start_pose, expected.start_pose)


def test_images_without_compression_give_the_same_too(
    recorded: Log, folder: Path, expected: Measurements, tmp_path: Path
):
    write_bag(recorded, tmp_path / "raw.mcap", "mcap", raw=True)
    found = extract(open_log(tmp_path / "raw.mcap", folder / "robot.toml"))
    assert np.array_equal(found.sightings["line"].z, expected.sightings["line"].z)


def test_an_image_of_another_size_is_named_by_its_topic(folder: Path, tmp_path: Path):
    settings = (folder / "robot.toml").read_text()
    wrong = re.sub(r"image_size = .*", "image_size = [64, 48]", settings)
    wrong = re.sub(r"map = .*", "", wrong)
    (tmp_path / "robot.toml").write_text(wrong)
    log = open_log(folder / NAMES["mcap"], tmp_path / "robot.toml")
    said = r"\.mcap: /camera/floor/image message 1: is \d+ x \d+ pixels, but robot.toml says"
    with pytest.raises(BadLog, match=said):
        extract(log)


def test_a_video_gives_the_same_estimates_to_its_codecs_loss(
    recorded: Log, folder: Path, expected: Measurements, tmp_path: Path
):
    log = open_log(write_video_log(recorded, folder / "log", tmp_path / "log", 95))
    found = extract(log)
    assert np.array_equal(found.t, expected.t)
    ours, theirs = smooth(found, run_ekf(found)), smooth(expected, run_ekf(expected))
    assert np.abs(ours.pose - theirs.pose)[:, :2].max() < 0.001
    assert abs(len(ours.map.params) - len(theirs.map.params)) <= 1


def test_bags_give_the_same_estimates_in_the_last_bit(folder: Path, expected: Measurements):
    found = extract(open_log(folder / NAMES["mcap"], folder / "robot.toml"))
    for run in (run_ekf, lambda m: smooth(m, run_ekf(m))):
        ours, theirs = run(found), run(expected)
        assert np.array_equal(ours.pose, theirs.pose)
        assert np.array_equal(ours.map.params, theirs.map.params)


def write_video_log(log: Log, images: Path, out: Path, quality: int) -> Path:
    """Writes a log whose images are the frames of a motion-JPEG video."""
    out.mkdir()
    assert log.images is not None
    size = log.cameras["floor"].image_size
    writer = cv2.VideoWriter(str(out / "x.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, size)
    writer.set(cv2.VIDEOWRITER_PROP_QUALITY, quality)
    for file in sorted((images / "images").iterdir()):
        writer.write(cv2.imread(str(file)))
    writer.release()
    for name in ("wheels.csv", "map.csv", "groundtruth.tum"):
        (out / name).write_bytes((images / name).read_bytes())
    settings = (images / "log.toml").read_text().split("\n", 1)
    (out / "log.toml").write_text(f'{settings[0]}\nvideo = "x.avi"\n{settings[1]}')
    rows = "".join(f"{t:.9f},{frame}\n" for frame, t in enumerate(log.images.t.tolist()))
    (out / "video.csv").write_text("t,frame\n" + rows)
    return out


@pytest.mark.parametrize("to", FORMATS)
def test_every_message_is_the_one_that_rosbags_reads(folder: Path, to: str):
    path = folder / NAMES[to]
    reader = Reader1(path) if to == "rosbag1" else Reader2(path)
    with reader:
        theirs = [(c.topic, t, bytes(data)) for c, t, data in reader.messages()]
    losses, ours = Losses(), []
    for file in files_of(path, losses):
        for m in file.messages(losses, lambda done, size: None):
            ours.append((m.channel.topic, m.received_ns, bytes(m.data)))
            if len(ours) % 50 == 0:
                assert file.read(m.place) == ours[-1][2]
    assert sorted(ours) == sorted(theirs)
    assert not losses.texts()


# ---- size -------------------------------------------------------------------------------------


def test_memory_does_not_grow_with_a_bag_and_its_progress_is_right(tmp_path: Path):
    """Frames of 1 MB, 12 and 48 of them: `benchmarks/bag_streaming.py` does the same with 2 GB."""
    frame = np.arange(1000 * 1000, dtype=np.uint32).astype(np.uint8).reshape(1000, 1000)
    peaks = {}
    for count in (12, 48):
        with Bag(tmp_path / f"x{count}", 2) as bag:
            for k in range(count):
                bag.odometry(0.1 * k, 0.01 * k)
                bag.image(0.1 * k, frame)
        path = tmp_path / f"x{count}" / f"x{count}.mcap"
        told: list[tuple[int, int]] = []
        tracemalloc.start()
        log = open_log(path, robot(tmp_path), lambda done, total: told.append((done, total)))  # noqa: B023
        assert log.images is not None
        for image in log.images.file[:: count // 4]:
            grey = read_grey(image)
            assert grey is not None
            assert np.array_equal(grey, frame)
        peaks[count] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        done = [d for d, _ in told]
        assert {total for _, total in told} == {path.stat().st_size}
        assert done == sorted(done)
        assert done[-1] == path.stat().st_size
        assert 0.3 < np.interp(len(done) / 2, range(len(done)), done) / done[-1] < 0.7
    assert peaks[48] < 1.2 * peaks[12]
    assert peaks[48] < 24e6


def robot(folder: Path) -> Path:
    path = folder / "robot.toml"
    path.write_text(
        'format = "graphslam-robot/1"\n[camera]\nimage_size = [1000, 1000]\n'
        "homography = [[0.0, -500.0, 500.0], [-400.0, 0.0, 1600.0], [2.0, 0.0, 1.0]]\n"
    )
    return path
