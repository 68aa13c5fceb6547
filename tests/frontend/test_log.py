"""Log folders: what is read from them, and what is refused."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import frontend
from frontend.log import open_log
from frontend.log_parts import Wheels
from frontend.readers import folder, folder_tables
from frontend.readers.point_tables import LAMP_COV, LAMP_SIGMA
from graphslam.errors import BadLog
from graphslam.models.wheels import DifferentialDrive
from tests.frontend.small_logs import CAMERA, LOG_TOML, WHEELS, write_log

FORMAT = 'format = "graphslam-log/1"\n'
WITH_CAMERA = LOG_TOML + CAMERA
DOCS = Path(__file__).resolve().parents[2] / "docs" / "log-format.md"


# ---- what is read -----------------------------------------------------------------------------


def test_a_recorded_log_is_read_whole(shared_data: Path):
    log = open_log(shared_data / "logs" / "square")
    assert log.name == "square"
    assert log.robot == DifferentialDrive(0.042, 0.042, 0.2)
    assert log.wheels is not None
    assert log.wheels.angle.shape == (1388, 2)
    assert log.images is not None
    assert len(log.images.t) == 278
    assert log.images.file[277].name == "000277.jpg"
    assert log.images_of("floor").tolist() == list(range(278))
    assert log.cameras["floor"].image_size == (320, 240)
    assert log.truth is not None
    np.testing.assert_allclose(log.truth.pose[0], [0.253707, 0.200449, 0.208420], atol=1e-6)
    assert log.map is not None
    assert len(log.map) == 26
    assert np.all(log.map.params[:, 0] >= 0)
    assert not log.start_given
    assert log.warnings == ()


def test_the_example_in_the_documentation_opens_as_it_stands(tmp_path: Path):
    text = DOCS.read_text(encoding="utf-8")
    examples = re.findall(r"<!-- example: (\S+) -->\n```\w+\n(.*?)```", text, re.DOTALL)
    assert {name for name, _ in examples} == {"log.toml", "wheels.csv", "sightings.csv"}
    for name, content in examples:
        (tmp_path / name).write_text(content, encoding="utf-8")
    log = open_log(tmp_path)
    assert log.name == "by hand"
    assert log.warnings == ()
    measurements = frontend.extract(log)
    np.testing.assert_allclose(measurements.odometry.increment, [[0.5, 0.0, 0.0]], atol=1e-4)
    assert len(measurements.sightings["line"]) == 4


def test_the_documentation_names_every_file_and_column():
    text = DOCS.read_text(encoding="utf-8")
    words = [*folder.USED, *folder_tables.LINE_COV, *folder_tables.POSE_COV, *LAMP_COV]
    assert [word for word in words if f"`{word}`" not in text and f"### {word}" not in text] == []


def test_settings_of_robot_start_and_name_arrive(tmp_path: Path):
    settings = (
        FORMAT
        + 'name = "corridor 3"\n[robot]\nwheel_radius_left = 0.04\nwheel_radius_right = 0.05\n'
        + 'wheel_base = 1\nnoise_left = 0.1\nlaw = "paper"\nslip = [0, 0, 0]\n'
        + "[start]\npose = [1, 2, 3]\nsigma = [0.1, 0, 0]\n"
    )
    log = open_log(write_log(tmp_path / "x", log_toml=settings))
    drive = DifferentialDrive(0.04, 0.05, 1.0, 0.1, 0.03, "paper", (0.0, 0.0, 0.0))
    assert (log.name, log.robot) == ("corridor 3", drive)
    assert log.start_given
    assert log.start_pose.tolist() == [1.0, 2.0, 3.0]
    assert log.start_sigma.tolist() == [0.1, 0.0, 0.0]


def test_what_settings_leave_out_has_its_documented_default(tmp_path: Path):
    log = open_log(write_log(tmp_path / "my log"))
    assert log.name == "my log"
    assert not log.start_given
    assert log.start_pose.tolist() == log.start_sigma.tolist() == [0.0, 0.0, 0.0]
    assert dict(log.cameras) == {}
    parts = (log.odometry, log.images, log.sightings, log.pose_fixes, log.truth, log.map)
    assert parts == (None,) * 6


def test_sightings_without_covariance_take_the_documented_noise(tmp_path: Path):
    folder = write_log(tmp_path, sightings_csv="t,rho,alpha\n1,0.5,1\n1,-0.5,4\n2,1,0\n")
    given = open_log(folder).sightings
    assert given is not None
    expected = np.diag([0.005**2, math.radians(0.5) ** 2])
    np.testing.assert_allclose(given.cov, np.stack([expected] * 3))
    np.testing.assert_array_equal(given.z, [[0.5, 1.0], [-0.5, 4.0], [1.0, 0.0]])
    assert np.isnan(given.extent).all()
    assert given.truth.tolist() == [-1, -1, -1]
    assert given.t_received.tolist() == [1.0, 1.0, 2.0]


def test_sightings_with_every_column_arrive(tmp_path: Path):
    folder = write_log(
        tmp_path,
        sightings_csv="t_received,line,t,rho,alpha,cov_rr,cov_ra,cov_aa,s_min,s_max\n"
        "1.5,7,1,0.5,1,4e-4,-1e-4,1e-4,-0.5,0.25\n2,-1,2,0.5,1,4e-4,0,1e-4,,\n",
        map_csv="line,rho,alpha\n7,1,0\n",
    )
    given = open_log(folder).sightings
    assert given is not None
    np.testing.assert_array_equal(given.cov[0], [[4e-4, -1e-4], [-1e-4, 1e-4]])
    np.testing.assert_array_equal(given.extent, [[-0.5, 0.25], [np.nan, np.nan]])
    assert given.truth.tolist() == [7, -1]
    assert given.truth.dtype == np.int64
    assert given.t_received.tolist() == [1.5, 2.0]


def test_a_table_of_sightings_may_be_empty(tmp_path: Path):
    folder = write_log(tmp_path, sightings_csv="t,rho,alpha\n", tags_csv="t,x,y,theta\n")
    log = open_log(folder)
    assert log.sightings is not None
    assert log.sightings.cov.shape == (0, 2, 2)
    assert log.pose_fixes is not None
    assert log.pose_fixes.cov.shape == (0, 3, 3)


def test_tags_take_their_covariance_or_the_documented_one(tmp_path: Path):
    folder = write_log(tmp_path, tags_csv="t,x,y,theta\n1,2,3,0.5\n")
    fixes = open_log(folder).pose_fixes
    assert fixes is not None
    np.testing.assert_allclose(fixes.cov[0], np.diag([1e-4, 1e-4, math.radians(2.0) ** 2]))
    write_log(
        tmp_path,
        tags_csv="t,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt\n1,2,3,0.5,6,1,2,7,3,8\n",
    )
    fixes = open_log(folder).pose_fixes
    assert fixes is not None
    np.testing.assert_array_equal(fixes.cov[0], [[6, 1, 2], [1, 7, 3], [2, 3, 8]])


def test_ground_truth_is_seen_from_above(tmp_path: Path):
    half = 0.5 * 2.5
    rows = f"# t x y z\n0 1 2 9 0 0 {math.sin(half):.12f} {math.cos(half):.12f}\n"
    tilted = f"1 1 2 9 {math.sin(0.05):.9f} 0 0 {-math.cos(0.05):.9f}\n"
    truth = open_log(write_log(tmp_path, groundtruth_tum=rows + tilted)).truth
    assert truth is not None
    np.testing.assert_allclose(truth.pose, [[1, 2, 2.5], [1, 2, 0]], atol=1e-9)


def test_map_lines_are_made_canonical_with_their_extent(tmp_path: Path):
    rows = "line,rho,alpha,s_min,s_max\n4,-1,0,-1,3\n2,1,0.5,,\n"
    lines = open_log(write_log(tmp_path, map_csv=rows)).map
    assert lines is not None
    assert lines.id.tolist() == [4, 2]
    np.testing.assert_allclose(lines.params, [[1.0, math.pi], [1.0, 0.5]])
    np.testing.assert_array_equal(lines.extent, [[-3.0, 1.0], [np.nan, np.nan]])
    assert lines.sightings.tolist() == [0, 0]


def test_the_map_that_a_run_writes_is_a_map(tmp_path: Path):
    rows = "line,rho,alpha,cov_rr,cov_ra,cov_aa,s_min,s_max,sightings\n0,1,0,1e-6,0,1e-6,-1,1,20\n"
    lines = open_log(write_log(tmp_path, map_csv=rows)).map
    assert lines is not None
    assert lines.sightings.tolist() == [0]


def test_images_of_several_cameras_keep_their_row_numbers(tmp_path: Path):
    settings = (
        WITH_CAMERA
        + CAMERA.replace("[camera]", '[cameras.rear]\nlooks_at = "floor"')
        + CAMERA.replace("[camera]", '[cameras.up]\nlooks_at = "ceiling"')
    )
    rows = "t,file,camera\n0,a.png,up\n0,a.png,floor\n0,a.png,rear\n1,a.png,rear\n"
    log = open_log(write_log(tmp_path, log_toml=settings, images_csv=rows, a_png=b"x"))
    assert sorted(log.cameras) == ["floor", "rear", "up"]
    assert sorted(log.looking_at("floor")) == ["floor", "rear"]
    assert log.images is not None
    assert log.images.camera == ("up", "floor", "rear", "rear")
    assert log.images_of("floor").tolist() == [1, 2, 3]
    assert log.images_of("ceiling").tolist() == [0]
    assert log.warnings == ()


def test_cameras_floor_is_what_camera_is_short_for(tmp_path: Path):
    short = open_log(write_log(tmp_path / "a", log_toml=WITH_CAMERA)).cameras["floor"]
    long = WITH_CAMERA.replace("[camera]", "[cameras.floor]")
    full = open_log(write_log(tmp_path / "b", log_toml=long)).cameras["floor"]
    np.testing.assert_array_equal(short.homography, full.homography)


def test_foreign_odometry_needs_no_robot(tmp_path: Path):
    rows = "t,x,y,theta\n0,0,0,0\n1,1,0,0.5\n"
    folder = write_log(tmp_path, log_toml=FORMAT, wheels_csv=None, odometry_csv=rows)
    log = open_log(folder)
    assert log.robot is None
    assert log.wheels is None
    assert log.odometry is not None
    write_log(
        folder,
        log_toml=FORMAT + "[robot]\nslip = [0.1, 0, 0]\n",
        wheels_csv=None,
        odometry_csv=rows,
    )
    robot = open_log(folder).robot
    assert robot is not None
    assert (robot.slip, robot.noise_left, robot.wheel_base) == ((0.1, 0.0, 0.0), 0.0, 0.2)


def test_columns_are_read_only(tmp_path: Path):
    log = open_log(write_log(tmp_path))
    assert log.wheels is not None
    with pytest.raises(ValueError, match="read-only"):
        log.wheels.angle[0, 0] = 1.0


# ---- digest -----------------------------------------------------------------------------------


def test_the_digest_changes_with_what_is_used_and_with_nothing_else(tmp_path: Path):
    files = {"log_toml": WITH_CAMERA, "images_csv": "t,file\n0,a.png\n", "a_png": b"one"}
    digest = open_log(write_log(tmp_path / "a", **files)).digest
    assert re.fullmatch("[0-9a-f]{64}", digest)
    same = write_log(tmp_path / "b", **files, notes_txt=b"unused")
    assert open_log(same).digest == digest
    for name, content in (
        ("a_png", b"two"),
        ("images_csv", "t,file\n0.5,a.png\n"),
        ("log_toml", WITH_CAMERA + "\n"),
        ("wheels_csv", WHEELS + "4,40,40\n"),
        ("map_csv", "line,rho,alpha\n"),
    ):
        changed = write_log(tmp_path / name, **{**files, name: content})
        assert open_log(changed).digest != digest


# ---- warnings ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("files", "warning"),
    [
        ({}, "no images that are searched, sightings.csv, bearings.csv, lamps.csv or tags.csv"),
        (
            {"odometry_csv": "t,x,y,theta\n0,0,0,0\n1,0,0,0\n"},
            "odometry.csv: not used, because wheels.csv is there",
        ),
        (
            {
                "sightings_csv": "t,rho,alpha\n0,1,1\n",
                "images_csv": "t,file\n0,a.png\n",
                "a_png": b"x",
            },
            "sightings.csv: images are not searched for lines",
        ),
    ],
)
def test_what_is_usable_but_hardly_meant_gives_a_warning(
    tmp_path: Path, files: dict[str, str], warning: str
):
    warnings = open_log(write_log(tmp_path, **files)).warnings
    assert [w for w in warnings if warning in w]


def test_other_files_are_ignored(tmp_path: Path):
    folder = write_log(tmp_path, sightings_csv="t,rho,alpha\n", readme_md="x", other_csv=b"\x00")
    assert open_log(folder).warnings == ()


# ---- errors -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ("", 'no format line; this version reads `format = "graphslam-log/1"`'),
        ('format = "graphslam-log/2"\nnew = 1\n', "format = 'graphslam-log/2'; this version reads"),
        ("format = 1\n", "format = 1; this version reads"),
        ("format = \n", "log.toml:1: is not valid TOML"),
        (FORMAT + "wheel_base = 1\n", "wheel_base is not a known key; known: format, name, robot"),
        (FORMAT + "[robt]\n", "robt is not a known key; did you mean 'robot'?"),
        (
            LOG_TOML + "noise_lft = 1\n",
            "robot.noise_lft is not a known key; did you mean 'noise_left'",
        ),
        (
            LOG_TOML.replace("0.2", '"0.2"'),
            "robot.wheel_base = '0.2' must be a number; write it with",
        ),
        (
            LOG_TOML.replace("0.2", "1e20"),
            "[robot] wheel_base = 1e+20: is no robot's; write metres",
        ),
        (LOG_TOML + "noise_left = 1e20\n", "[robot] noise or slip = 1e+20: is beyond 1e+09"),
        (LOG_TOML + "[start]\npose = [1e20, 0, 0]\n", "[start] pose or sigma is beyond 1e+09"),
        (LOG_TOML.replace("0.2", "0"), "[robot] wheel_base = 0.0: must be a positive length"),
        (LOG_TOML.replace("0.2", "nan"), "robot.wheel_base = nan must be finite"),
        (LOG_TOML.replace("0.2", "1e400"), "robot.wheel_base = inf must be finite"),
        (LOG_TOML + 'law = "papr"\n', "robot.law = 'papr' is not known; write one of 'distance'"),
        (LOG_TOML + "slip = [1, 2]\n", "robot.slip has 2 entries, not 3"),
        (LOG_TOML + "noise_left = -1\n", "[robot] noise_left, noise_right, slip and floor must be"),
        (LOG_TOML + "floor = [0, 0]\n", "robot.floor is not a known key"),
        (FORMAT, "[robot] is missing; wheels.csv needs its wheel_radius_left"),
        (FORMAT + "[robot]\nwheel_base = 1\n", "[robot] wheel_radius_left is missing; add"),
        (FORMAT + "robot = 3\n", "robot = 3 must be a table"),
        (FORMAT + "name = 3\n", "name = 3 must be a text"),
        (FORMAT + 'name = "../x"\n', "name = '../x': becomes the name of a folder"),
        (FORMAT + 'name = "a/b"\n', "name = 'a/b': becomes the name of a folder"),
        (FORMAT + 'name = " "\n', "name = ' ': becomes the name of a folder"),
        (FORMAT + 'name = "a\\u0000"\n', "becomes the name of a folder"),
        (LOG_TOML + "[start]\n", "start.pose is missing"),
        (LOG_TOML + "[start]\npose = [1, 2]\n", "start.pose has 2 entries, not 3"),
        (LOG_TOML + "[start]\npose = [1, 2, inf]\n", "start.pose[2] = inf must be finite"),
        (
            LOG_TOML + "[start]\npose = [1, 2, 3]\nsigma = [0, 5000, 0]\n",
            "[start] sigma = [0.0, 5000.0, 0.0]: at most 1000 m and pi",
        ),
        (
            LOG_TOML + "[start]\npose = [1, 2, 3]\nsigma = [0, -1, 0]\n",
            "[start] sigma = [0.0, -1.0, 0.0]: standard deviations are not negative",
        ),
        (
            WITH_CAMERA.replace("[camera]", "[camra]"),
            "camra is not a known key; did you mean 'camera",
        ),
        (WITH_CAMERA + "fov = 1\n", "camera.fov is not a known key; known: image_size"),
        (WITH_CAMERA.replace("[32, 24]", "[32]"), "camera.image_size has 1 entries, not 2"),
        (WITH_CAMERA.replace("[32, 24]", "[32, 0]"), "[camera] camera 'floor': image_size"),
        (
            WITH_CAMERA.replace("[32, 24]", "[32.5, 24]"),
            "camera.image_size[0] = 32.5 must be a whole",
        ),
        (WITH_CAMERA.replace("20.0, 0.0, 30", "0.0, 0.0, 0"), "homography cannot be inverted"),
        (WITH_CAMERA.replace("[0.0, 0.0, 1.0]", "[0.0]"), "camera.homography[2] has 1 entries"),
        (WITH_CAMERA + "distortion = [0.1, 0, 0, 0]\n", "distortion needs the camera matrix"),
        (
            WITH_CAMERA + "[cameras.floor]\n",
            "has [camera] and [cameras.floor], which mean the same",
        ),
        (LOG_TOML + "[cameras.rear]\n", "cameras.rear.looks_at is missing; add `looks_at"),
        (
            LOG_TOML + '[cameras.rear]\nlooks_at = "flor"\n',
            "cameras.rear.looks_at = 'flor' is not known; did you mean 'floor'?",
        ),
        (LOG_TOML + '[cameras.rear]\nlooks_at = "floor"\n', "cameras.rear.image_size is missing"),
        ("cameras = {a = 3}\n" + LOG_TOML, "cameras.a must be a table"),
        ("cameras = 3\n" + LOG_TOML, "cameras = 3 must be a table"),
    ],
)
def test_wrong_settings_are_refused_with_file_key_and_cure(
    tmp_path: Path, settings: str, message: str
):
    write_log(tmp_path, log_toml=settings)
    with pytest.raises(BadLog) as error:
        open_log(tmp_path)
    assert str(error.value).startswith(str(tmp_path / "log.toml"))
    assert message in str(error.value)


IMAGES = {"log_toml": WITH_CAMERA, "a_png": b"x"}


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (
            {"wheels_csv": "t,left,right\n0,0,0\n"},
            "wheels.csv: has 1 rows of data and needs at least 2",
        ),
        ({"wheels_csv": "t,left,right\n"}, "wheels.csv: has 0 rows"),
        ({"wheels_csv": ""}, "wheels.csv:1: is empty"),
        (
            {"wheels_csv": "t,left,rigth\n0,0,0\n"},
            "wheels.csv:1: 'rigth' is not a known column; did",
        ),
        ({"wheels_csv": "t,left\n0,0\n"}, "wheels.csv:1: column 'right' is missing"),
        ({"wheels_csv": WHEELS + "3,1,1\n"}, "wheels.csv:6: t = 3 repeats the time above"),
        ({"wheels_csv": WHEELS + "2,1,1\n"}, "wheels.csv:6: t = 2 runs backwards"),
        ({"wheels_csv": WHEELS + "4,nan,1\n"}, "wheels.csv:6: left = 'nan' is not finite"),
        ({"wheels_csv": WHEELS + "4,1\n"}, "wheels.csv:6: has 2 cells where 3 are expected"),
        ({"wheels_csv": b"\xff\xfe\x00\x01"}, "wheels.csv:1: is not UTF-8 text"),
        ({"odometry_csv": "t,x,y,theta\n0,0,0,0\n0,1,0,0\n"}, "odometry.csv:3: t = 0 repeats"),
        ({"sightings_csv": "t,rho,alpha\n1,1,1\n0,1,1\n"}, "sightings.csv:3: t = 0 runs backwards"),
        (
            {"sightings_csv": "t,rho,alpha\n1,1,90\n"},
            "sightings.csv:2: alpha = 90 is beyond two full",
        ),
        (
            {"sightings_csv": "t,rho,alpha,cov_rr\n1,1,1,1\n"},
            "sightings.csv:1: column 'cov_ra' is missing; cov_rr, cov_ra, cov_aa come together",
        ),
        (
            {"sightings_csv": "t,rho,alpha,cov_rr,cov_ra,cov_aa\n1,1,1,1,0,1\n1,1,1,1,2,1\n"},
            "sightings.csv:3: cov_rr = 1, cov_ra = 2, cov_aa = 1 is no covariance; give every",
        ),
        (
            {"sightings_csv": "t,rho,alpha,cov_rr,cov_ra,cov_aa\n1,1,1,0,0,1\n"},
            "sightings.csv:2: cov_rr = 0, cov_ra = 0, cov_aa = 1 is no covariance",
        ),
        (
            {"sightings_csv": "t,rho,alpha,s_min,s_max\n1,1,1,2,1\n"},
            "sightings.csv:2: s_min = 2 is beyond s_max = 1; exchange them",
        ),
        (
            {"sightings_csv": "t,rho,alpha,s_min,s_max\n1,1,1,2,\n"},
            "sightings.csv:2: has one of s_min and s_max; write both, or none",
        ),
        (
            {"sightings_csv": "t,rho,alpha,line\n1,1,1,-2\n"},
            "sightings.csv:2: line = -2 is not a line",
        ),
        (
            {"sightings_csv": "t,rho,alpha,line\n1,1,1,0.5\n"},
            "sightings.csv:2: line = 0.5 is not a w",
        ),
        (
            {"sightings_csv": "t,rho,alpha,line\n1,1,1,3\n", "map_csv": "line,rho,alpha\n2,1,1\n"},
            "sightings.csv:2: line = 3 is not in map.csv; add it there, or write -1",
        ),
        (
            {"sightings_csv": "t,rho,alpha,t_received\n1,1,1,0.5\n"},
            "sightings.csv:2: t_received = 0.5 is before t = 1",
        ),
        ({"tags_csv": "t,x,y,theta\n1,1,1,1\n0,1,1,1\n"}, "tags.csv:3: t = 0 runs backwards"),
        (
            {
                "tags_csv": "t,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt\n"
                "1,1,1,1,1,2,0,1,0,1\n"
            },
            "tags.csv:2: cov_xx = 1, cov_xy = 2",
        ),
        ({"groundtruth_tum": "0 0 0 0 0 0 0\n"}, "groundtruth.tum:1: has 7 cells where 8"),
        (
            {"groundtruth_tum": "0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n"},
            "groundtruth.tum:2: t = 0 repeats",
        ),
        (
            {"groundtruth_tum": "# c\n0 0 0 0 0 0 0 1.1\n"},
            "groundtruth.tum:2: the quaternion 0 0 0 1.1",
        ),
        (
            {"groundtruth_tum": "0 0 0 0 0 0 0 0\n"},
            "groundtruth.tum:1: the quaternion 0 0 0 0 has not",
        ),
        ({"groundtruth_tum": "# only a comment\n"}, "groundtruth.tum: has 0 rows"),
        ({"map_csv": "line,rho,alpha\n1,1,1\n1,2,1\n"}, "map.csv:3: line = 1 is there twice"),
        ({"map_csv": "line,rho,alpha\n-1,1,1\n"}, "map.csv:2: line = -1 is negative"),
        (
            {"map_csv": "line,rho,alpha\n1,1,-180\n"},
            "map.csv:2: alpha = -180 is beyond two full turns",
        ),
        ({**IMAGES, "images_csv": "t,file\n"}, "images.csv: has 0 rows"),
        (
            {**IMAGES, "images_csv": "t,file\n0,b.png\n"},
            "images.csv:2: there is no image file 'b.png'",
        ),
        (
            {**IMAGES, "images_csv": "t,file\n0,\n"},
            "images.csv:2: file is empty; write the image's",
        ),
        ({**IMAGES, "images_csv": "t,file\n0,.\n"}, "images.csv:2: there is no image file '.'"),
        ({**IMAGES, "images_csv": "t,file\n0,a\0b\n"}, "images.csv:"),
        ({**IMAGES, "images_csv": f"t,file\n0,{'a' * 5000}\n"}, "images.csv:2: 'aaa"),
        (
            {**IMAGES, "images_csv": "t,file\n0,a.png\n0,a.png\n"},
            "images.csv:3: t = 0 repeats an image",
        ),
        (
            {**IMAGES, "images_csv": "t,file\n1,a.png\n0,a.png\n"},
            "images.csv:3: t = 0 runs backwards",
        ),
        (
            {**IMAGES, "images_csv": "t,file,camera\n0,a.png,flor\n"},
            "images.csv:2: log.toml describes no camera 'flor'; did you mean 'floor'?",
        ),
        (
            {"images_csv": "t,file\n0,a.png\n", "a_png": b"x"},
            "images.csv:2: log.toml describes no camera 'floor'; describe it there as [camera]",
        ),
    ],
)
def test_wrong_tables_are_refused_with_file_line_and_cure(
    tmp_path: Path, files: dict[str, str | bytes], message: str
):
    write_log(tmp_path, **files)
    with pytest.raises(BadLog) as error:
        open_log(tmp_path)
    assert str(error.value).startswith(str(tmp_path))
    assert message in str(error.value)
    assert len(str(error.value)) < len(str(tmp_path)) + 300


@pytest.mark.parametrize(
    "text", ["../x.png", "..", "images/../../x.png", "link.png", "linked/x.png"]
)
def test_an_image_outside_the_folder_is_refused(tmp_path: Path, text: str):
    (tmp_path / "x.png").write_bytes(b"secret")
    folder = write_log(tmp_path / "log", log_toml=WITH_CAMERA, images_csv=f"t,file\n0,{text}\n")
    (folder / "images").mkdir()
    (folder / "link.png").symlink_to(tmp_path / "x.png")
    (folder / "linked").symlink_to(tmp_path)
    with pytest.raises(BadLog, match=r"images\.csv:2: .* leaves the log folder; move the image"):
        open_log(folder)


@pytest.mark.parametrize("text", ["{}/log/a.png", "C:\\a.png", "\\\\server\\share\\a.png"])
def test_an_absolute_path_is_refused_even_inside_the_folder(tmp_path: Path, text: str):
    folder = write_log(
        tmp_path / "log",
        log_toml=WITH_CAMERA,
        images_csv=f"t,file\n0,{text.format(tmp_path)}\n",
        a_png=b"x",
    )
    with pytest.raises(
        BadLog, match=r"images\.csv:2: .* is an absolute path; write it from the log"
    ):
        open_log(folder)


def test_links_inside_the_folder_are_followed_and_circles_refused(tmp_path: Path):
    folder = write_log(
        tmp_path, log_toml=WITH_CAMERA, images_csv="t,file\n0,link.png\n", a_png=b"x"
    )
    (folder / "link.png").symlink_to("a.png")
    log = open_log(folder)
    assert log.images is not None
    assert log.images.file == (folder.resolve() / "a.png",)
    (folder / "link.png").unlink()
    (folder / "link.png").symlink_to("link.png")
    with pytest.raises(BadLog, match=r"images\.csv:2"):
        open_log(folder)


def test_a_log_folder_reached_by_a_link_is_the_same_log(tmp_path: Path):
    folder = write_log(
        tmp_path / "log", log_toml=WITH_CAMERA, images_csv="t,file\n0,a.png\n", a_png=b"x"
    )
    (tmp_path / "link").symlink_to(folder)
    assert open_log(tmp_path / "link").digest == open_log(folder).digest


@pytest.mark.parametrize("name", ["wheels.csv", "images.csv", "groundtruth.tum", "map.csv"])
def test_a_folder_in_place_of_a_file_is_refused(tmp_path: Path, name: str):
    write_log(tmp_path, log_toml=WITH_CAMERA, wheels_csv=None)
    (tmp_path / name).mkdir()
    if name != "wheels.csv":
        (tmp_path / "wheels.csv").write_text(WHEELS)
    with pytest.raises(BadLog, match=rf"{re.escape(name)}: is not a file; put a text file there"):
        open_log(tmp_path)


def test_a_broken_link_in_place_of_a_file_is_refused(tmp_path: Path):
    write_log(tmp_path)
    (tmp_path / "map.csv").symlink_to("nowhere")
    with pytest.raises(BadLog, match=r"map\.csv: does not exist"):
        open_log(tmp_path)


def test_a_log_without_odometry_is_refused(tmp_path: Path):
    write_log(tmp_path, wheels_csv=None)
    with pytest.raises(BadLog, match=r"has neither wheels\.csv nor odometry\.csv; add one"):
        open_log(tmp_path)


def test_what_is_no_log_is_refused_saying_what_is_accepted(tmp_path: Path):
    accepted = r"give a folder with a log\.toml in it"
    with pytest.raises(BadLog, match=rf"nothing: does not exist; {accepted}"):
        open_log(tmp_path / "nothing")
    with pytest.raises(BadLog, match=rf"this folder has no log\.toml; {accepted}"):
        open_log(tmp_path)
    write_log(tmp_path)
    with pytest.raises(BadLog, match=rf"log\.toml: is a file of the log .*; {accepted}"):
        open_log(tmp_path / "log.toml")
    with pytest.raises(BadLog, match=rf"wheels\.csv: is not a log; {accepted}"):
        open_log(str(tmp_path / "wheels.csv"))
    with pytest.raises(BadLog, match="check the path"):
        open_log("x" * 5000)
    (tmp_path / "log.toml").unlink()
    (tmp_path / "log.toml").mkdir()
    with pytest.raises(BadLog, match=r"log\.toml: is not a file"):
        open_log(tmp_path)


def test_columns_of_different_lengths_do_not_make_a_log():
    with pytest.raises(BadLog, match=r"Wheels\.angle has shape \(2, 2\); expected \(3, 2\)"):
        Wheels(np.arange(3.0), np.zeros((2, 2)))
    with pytest.raises(BadLog, match=r"Wheels\.angle holds NaN"):
        Wheels(np.arange(2.0), np.full((2, 2), np.nan))


# ---- the package ------------------------------------------------------------------------------


def test_exports_are_functions_whatever_was_imported_before():
    code = (
        "import frontend.extract, frontend.log, frontend.camera, frontend.simulate\n"
        "from frontend import extract, open_log, Camera, simulate, load_scenario\n"
        "assert all(map(callable, (extract, open_log, Camera, simulate, load_scenario)))\n"
        "assert callable(frontend.extract) and frontend.extract is extract\n"
        "from frontend.extract import extraction_warnings\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_importing_the_package_imports_nothing_heavy():
    code = (
        "import sys, frontend\n"
        "assert not {'cv2', 'numpy', 'numba'} & set(sys.modules)\n"
        "from frontend import open_log, extract\n"
        "assert 'cv2' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_unknown_export_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nothing_like_this"):
        _ = frontend.nothing_like_this
    assert "open_log" in dir(frontend)


# ---- bearings and landmarks -------------------------------------------------------------------

BEARINGS = "t,bearing,sigma,landmark,label\n0,1.5,0.01,0,7\n0,-1.5,0.01,1,-1\n1,9,0.02,-1,7\n"
LANDMARKS = "landmark,kind,x,y,label\n0,bearing,0,0,7\n1,bearing,1,0,-1\n"


def test_bearings_and_landmarks_become_sightings_of_known_points(tmp_path: Path):
    log = open_log(write_log(tmp_path, bearings_csv=BEARINGS, landmarks_csv=LANDMARKS))
    measurements = frontend.extract(log)
    table = measurements.sightings["bearing"]
    assert table.node.tolist() == [0, 0, 1]
    np.testing.assert_allclose(table.z[:, 0], [1.5, -1.5, 9 - 2 * np.pi])
    np.testing.assert_allclose(table.cov[:, 0, 0], [1e-4, 1e-4, 4e-4])
    assert table.label.tolist() == [7, -1, 7]
    assert table.truth.tolist() == [0, 1, -1]
    assert measurements.known.kind == ("bearing", "bearing")
    assert measurements.known.label.tolist() == [7, -1]


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"bearings_csv": "t,bearing,sigma\n0,90,1\n"}, "csv:2: bearing = 90 is beyond two"),
        ({"bearings_csv": "t,bearing,sigma\n0,1,0\n"}, "csv:2: sigma = 0 is not positive"),
        (
            {"bearings_csv": "t,bearing,sigma,landmark\n0,1,1,5\n", "landmarks_csv": LANDMARKS},
            "csv:2: landmark = 5 is no bearing in landmarks.csv",
        ),
        ({"landmarks_csv": "landmark,kind,x,y\n0,beering,1,1\n"}, "did you mean 'bearing'"),
        (
            {"landmarks_csv": "landmark,kind,x,y\n3,bearing,1,1\n3,bearing,2,1\n"},
            "csv:3: landmark = 3 is there twice",
        ),
    ],
)
def test_bearings_and_landmarks_that_are_wrong_say_where(tmp_path: Path, files: dict, message: str):
    with pytest.raises(BadLog, match=re.escape(message)):
        open_log(write_log(tmp_path, **files))


LAMPS = "t,x,y,phi,landmark,t_received\n0,0.5,0.1,1.5,4,0.1\n1,0.2,-0.1,-1.5,-1,1.5\n"
MIXED = "landmark,kind,x,y,phi\n0,bearing,0,0,\n4,lamp,1,0,1.5\n"


def test_lamps_and_their_landmarks_arrive_with_their_delay(tmp_path: Path):
    log = open_log(write_log(tmp_path, lamps_csv=LAMPS, landmarks_csv=MIXED))
    measurements = frontend.extract(log)
    table = measurements.sightings["lamp"]
    assert table.node.tolist() == [0, 1]
    np.testing.assert_allclose(table.z, [[0.5, 0.1, 1.5], [0.2, -0.1, -1.5]])
    np.testing.assert_allclose(np.sqrt(table.cov[0].diagonal()), LAMP_SIGMA)
    assert table.truth.tolist() == [4, -1]
    assert table.t_received.tolist() == [0.1, 1.5]
    assert measurements.known.kind == ("bearing", "lamp")
    np.testing.assert_array_equal(measurements.known.params, [[0, 0, np.nan], [1, 0, 1.5]])


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"lamps_csv": "t,x,y,phi\n0,1,1,90\n"}, "csv:2: phi = 90 is beyond two"),
        ({"lamps_csv": "t,x,y,phi,t_received\n1,1,1,1,0\n"}, "csv:2: t_received = 0 is before"),
        (
            {"lamps_csv": "t,x,y,phi,landmark\n0,1,1,1,0\n", "landmarks_csv": MIXED},
            "csv:2: landmark = 0 is no lamp in landmarks.csv",
        ),
        ({"landmarks_csv": "landmark,kind,x,y\n0,lamp,1,1\n"}, "csv:2: phi is missing"),
        (
            {"landmarks_csv": "landmark,kind,x,y,phi\n0,bearing,1,1,2\n"},
            "csv:2: phi = 2, but only a lamp has an axis",
        ),
    ],
)
def test_lamps_that_are_wrong_say_where(tmp_path: Path, files: dict, message: str):
    with pytest.raises(BadLog, match=re.escape(message)):
        open_log(write_log(tmp_path, **files))
