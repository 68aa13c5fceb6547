"""Videos and scans.npz in log folders: what is read, and what is refused."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from frontend.extract import extract
from frontend.images import read_bgr, read_grey
from frontend.log import open_log
from graphslam.errors import BadLog
from tests.frontend.small_logs import CAMERA, LOG_TOML, WHEELS, write_log

VIDEO_TOML = LOG_TOML.replace("\n[robot]", '\nvideo = "x.avi"\n[robot]', 1) + CAMERA
FRAMES = 12


def write_video(folder: Path, name: str = "x.avi") -> Path:
    """Writes frames whose grey level says their number."""
    folder.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(folder / name), cv2.VideoWriter_fourcc(*"MJPG"), 4, (32, 24))
    for number in range(FRAMES):
        writer.write(np.full((24, 32, 3), 20 * number, np.uint8))
    writer.release()
    return folder / name


# ---- video ------------------------------------------------------------------------------------


def test_frames_are_those_that_the_table_names_in_any_order_of_asking(tmp_path: Path):
    write_video(tmp_path)
    rows = "t,frame\n0.5,1\n1,4\n2,5\n2.5,11\n"
    log = open_log(write_log(tmp_path, log_toml=VIDEO_TOML, video_csv=rows))
    assert log.images is not None
    assert log.images.t.tolist() == [0.5, 1, 2, 2.5]
    for row, frame in [(3, 11), (0, 1), (2, 5), (1, 4), (1, 4), (3, 11)]:
        grey = read_grey(log.images.file[row])
        assert grey is not None
        assert grey.shape == (24, 32)
        assert abs(float(grey.mean()) - 20 * frame) < 3
        colours = read_bgr(log.images.file[row])
        assert colours is not None
        assert colours.shape == (24, 32, 3)
        assert np.abs(colours.mean(axis=(0, 1)) - 20 * frame).max() < 3
    assert log.images.name(0, tmp_path) == "x.avi frame 1"
    assert len({image.digest for image in log.images.file}) == 4  # type: ignore[union-attr]
    assert len(extract(log).t) == 4


def test_without_a_table_the_videos_own_times_count_and_a_warning_says_so(tmp_path: Path):
    write_video(tmp_path)
    log = open_log(write_log(tmp_path, log_toml=VIDEO_TOML))
    assert log.images is not None
    np.testing.assert_allclose(log.images.t, np.arange(FRAMES) / 4, atol=1e-3)
    assert any("the video's own times count" in warning for warning in log.warnings)


def test_frames_beyond_the_end_are_unreadable_images(tmp_path: Path):
    write_video(tmp_path)
    rows = "t,frame\n0.5,1\n1,40\n"
    measurements = extract(open_log(write_log(tmp_path, log_toml=VIDEO_TOML, video_csv=rows)))
    assert measurements.rejected["image that cannot be read"] == 1


def test_the_digest_of_a_log_changes_with_its_video(tmp_path: Path):
    video = write_video(tmp_path)
    folder = write_log(tmp_path, log_toml=VIDEO_TOML, video_csv="t,frame\n0.5,1\n")
    before = open_log(folder).digest
    data = bytearray(video.read_bytes())
    data[-3] ^= 1
    video.write_bytes(data)
    assert open_log(folder).digest != before


@pytest.mark.parametrize(
    ("files", "told"),
    [
        ({"video_csv": "t,frame\n0,3\n1,2\n"}, "video.csv:3: frame = 2 is not after"),
        ({"video_csv": "t,frame\n0,-1\n"}, "video.csv:2: frame = -1 is negative"),
        ({"video_csv": "t,frame\n0,0.5\n"}, "frame = 0.5 is not a whole number"),
        ({"x_avi": b"no video"}, "x.avi: is no video that can be decoded.*ffmpeg"),
        ({"images_csv": "t,file\n0,a.png\n", "a_png": b"x"}, "images.csv is there too"),
        ({"log_toml": VIDEO_TOML.replace("x.avi", "../x.avi")}, "is no file in the log folder"),
        ({"log_toml": LOG_TOML, "video_csv": "t,frame\n0,0\n"}, "belongs to a video; name it"),
    ],
)
def test_what_is_wrong_with_a_video_is_told(tmp_path: Path, files: dict[str, Any], told: str):
    write_video(tmp_path / "log")
    write_video(tmp_path)
    with pytest.raises(BadLog, match=told):
        open_log(write_log(tmp_path / "log", **{"log_toml": VIDEO_TOML, **files}))


# ---- scans ------------------------------------------------------------------------------------

SCANS: dict[str, Any] = {
    "t": [0.5, 1.0, 2.0],
    "ranges": np.arange(12.0).reshape(3, 4),
    "angle_min": -1.0,
    "angle_step": [0.1, 0.2, 0.3],
}


def packed(**changes: Any) -> bytes:
    stream = io.BytesIO()
    arrays = {k: v for k, v in {**SCANS, **changes}.items() if v is not None}
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def test_scans_are_read_and_their_times_are_the_nodes(tmp_path: Path):
    content = packed(sensor_pose=[0.2, 0.0, 0.1], range_max=9.0, duration=0.02)
    log = open_log(write_log(tmp_path, scans_npz=content))
    assert log.scans is not None
    scan = log.scans.place[2].scan()
    assert scan is not None
    assert scan.ranges.tolist() == [8, 9, 10, 11]
    assert (scan.angle_min, scan.angle_step, scan.range_min, scan.range_max) == (-1, 0.3, 0, 9)
    assert scan.duration == 0.02
    assert log.scans.sensor_pose.tolist() == [0.2, 0.0, 0.1]
    assert log.has_walls()
    assert extract(log).t.tolist() == [0.5, 1.0, 2.0]


def huge() -> bytes:
    """Returns an archive whose array claims 8 TB."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
    )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("ranges.npy", head.getvalue())
    return stream.getvalue()


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"nothing", "is not an .npz that can be read"),
        (b"", "is not an .npz that can be read"),
        (packed()[:200], "is not an .npz that can be read"),
        (packed(ranges=None), "array 'ranges' is missing"),
        (packed(range=[1.0]), "'range' is not a known array"),
        (packed(ranges=np.array([{}, {}], dtype=object)), "holds no plain numbers"),
        (packed(t=[2.0, 1.0, 3.0]), "runs backwards"),
        (packed(t=[0.0, np.nan, 3.0]), "holds NaN"),
        (packed(t=[1.0]), r"t has shape \(1,\)"),
        (packed(angle_min=[1.0, 2.0]), "angle_min must be one number or one for each scan"),
        (packed(sensor_pose=[1.0]), "sensor_pose must be x, y and heading"),
        (huge(), "takes the file beyond 1024 MiB"),
    ],
)
def test_what_is_wrong_with_scans_is_told(tmp_path: Path, content: bytes, told: str):
    with pytest.raises(BadLog, match=told):
        open_log(write_log(tmp_path, scans_npz=content, wheels_csv=WHEELS))
