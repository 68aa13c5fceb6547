"""From logs to measurements."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from frontend.config import ExtractConfig
from frontend.extract import extract, extraction_warnings
from frontend.log import UNKNOWN_WHEELS, Log, open_log
from frontend.log_parts import PoseTrack
from frontend.truth import LARGEST_OFFSET, LARGEST_TURN, nearest_line, true_lines
from graphslam.errors import BadConfig, BadLog
from graphslam.geometry import compose, line_to_robot, twin
from graphslam.measurements import Measurements
from graphslam.models.wheels import increments_from_wheels
from tests.frontend.small_logs import CAMERA, LOG_TOML, write_log

WITH_CAMERA = LOG_TOML + CAMERA
SIGHTINGS = "t,rho,alpha\n0,1,0\n0.5,1,0\n0.5,0.3,1.5\n2.5,1,0.02\n"


def png(width: int = 32, height: int = 24, grey: int = 120) -> bytes:
    """Returns a plain grey image file."""
    return cv2.imencode(".png", np.full((height, width), grey, np.uint8))[1].tobytes()


def images(*times: float, **files: bytes) -> dict[str, str | bytes]:
    """Returns a log's files with the image ``a.png`` at each time, unless ``files`` replaces it."""
    rows = "".join(f"{t},a.png\n" for t in times)
    return {"log_toml": WITH_CAMERA, "images_csv": "t,file\n" + rows, "a_png": png(), **files}


def extracted(folder: Path, config: ExtractConfig | None = None) -> Measurements:
    return extract(open_log(folder), config)


# ---- nodes ------------------------------------------------------------------------------------


def test_nodes_are_the_distinct_times_of_images_even_without_a_line(tmp_path: Path):
    measurements = extracted(write_log(tmp_path, **images(0, 0.25, 1, 3)))
    assert measurements.t.tolist() == [0, 0.25, 1, 3]
    assert len(measurements.sightings["line"]) == 0


def test_images_of_two_cameras_at_one_time_make_one_node(tmp_path: Path):
    rear = CAMERA.replace("[camera]", '[cameras.rear]\nlooks_at = "floor"')
    files = images(0)
    files["log_toml"] = WITH_CAMERA + rear
    files["images_csv"] = "t,file,camera\n0,a.png,floor\n0,a.png,rear\n1,a.png,rear\n"
    assert extracted(write_log(tmp_path, **files)).t.tolist() == [0, 1]


def test_without_images_nodes_are_the_distinct_times_of_all_sightings(tmp_path: Path):
    folder = write_log(
        tmp_path, sightings_csv=SIGHTINGS, tags_csv="t,x,y,theta\n0.5,0.25,0,0\n1,0.5,0,0\n"
    )
    measurements = extracted(folder)
    assert measurements.t.tolist() == [0, 0.5, 1, 2.5]
    assert measurements.sightings["line"].node.tolist() == [0, 1, 1, 3]
    assert measurements.sightings["pose_fix"].node.tolist() == [1, 2]


def test_image_times_stay_nodes_beside_sightings_and_images_are_not_opened(tmp_path: Path):
    files = {**images(0, 1, 2), "sightings_csv": "t,rho,alpha\n1,1,0\n1.5,1,0\n"}
    files["a_png"] = b"no image"
    measurements = extracted(write_log(tmp_path, **files))
    assert measurements.t.tolist() == [0, 1, 1.5, 2]
    assert dict(measurements.rejected) == {}
    assert measurements.sightings["line"].source.tolist() == [-1, -1]


def test_without_any_sensor_the_odometry_times_are_the_nodes(tmp_path: Path):
    measurements = extracted(write_log(tmp_path))
    assert measurements.t.tolist() == [0, 1, 2, 3]
    assert dict(measurements.sightings) == {}


def test_nodes_outside_the_wheel_record_are_dropped_and_counted(tmp_path: Path):
    sightings = "t,rho,alpha\n-1,1,0\n-1,1,1\n0,1,0\n3,1,0.5\n3.5,1,0\n"
    folder = write_log(tmp_path, sightings_csv=sightings, tags_csv="t,x,y,theta\n4,0,0,0\n")
    log = open_log(folder)
    measurements = extract(log)
    assert measurements.t.tolist() == [0, 3]
    assert dict(measurements.rejected) == {
        "node outside the wheel record": 3,
        "line outside the wheel record": 3,
        "pose fix outside the wheel record": 1,
    }
    assert (
        "nodes outside the wheel record that were dropped: 3"
        in extraction_warnings(log, measurements)[0]
    )


def test_a_log_whose_clocks_have_nothing_in_common_is_refused(tmp_path: Path):
    folder = write_log(tmp_path, sightings_csv="t,rho,alpha\n100,1,0\n")
    with pytest.raises(BadLog, match=r"odometry lasts from t = 0 s to 3 s, .* one clock"):
        extracted(folder)


def test_a_part_of_the_log_can_be_chosen_in_its_own_time(tmp_path: Path):
    folder = write_log(tmp_path, **images(0, 0.5, 1, 1.5, 2, 2.5, 3))
    chosen = extracted(folder, ExtractConfig(from_s=0.5, to_s=2.5, every=2))
    assert chosen.t.tolist() == [0.5, 1.5, 2.5]
    assert dict(chosen.rejected) == {}
    with pytest.raises(
        BadConfig, match=r"nothing of .* lies between from_s = 7\.0 and to_s = None"
    ):
        extracted(folder, ExtractConfig(from_s=7.0))


def test_sightings_at_nodes_that_were_not_chosen_are_left_out_uncounted(tmp_path: Path):
    folder = write_log(tmp_path, sightings_csv=SIGHTINGS)
    measurements = extracted(folder, ExtractConfig(every=2))
    assert measurements.t.tolist() == [0, 2.5]
    assert measurements.sightings["line"].node.tolist() == [0, 1]
    assert dict(measurements.rejected) == {}


# ---- odometry ---------------------------------------------------------------------------------


def test_increments_come_from_wheel_angles_interpolated_at_the_nodes(tmp_path: Path):
    log = open_log(write_log(tmp_path, **images(0, 0.5, 2.25)))
    measurements = extract(log)
    np.testing.assert_allclose(measurements.odometry.increment[0], [0.25, 0, 0], atol=1e-12)
    assert log.wheels is not None
    assert log.robot is not None
    increment, cov = increments_from_wheels(
        log.wheels.t, log.wheels.angle, measurements.t, log.robot
    )
    np.testing.assert_array_equal(measurements.odometry.increment, increment)
    np.testing.assert_array_equal(measurements.odometry.cov, cov)
    np.testing.assert_array_equal(measurements.odometry.wheel_angle, log.wheels.angle)


def test_metres_driven_count_a_way_out_and_back_between_two_nodes(tmp_path: Path):
    log = open_log(write_log(tmp_path, **images(0, 1)))
    t = np.array([0.0, 0.5, 1.0, 2.0])
    angle = np.array([[0.0, 0.0], [10.0, 10.0], [0.0, 0.0], [5.0, 5.0]])  # rad
    wheels = replace(log.wheels, t=t, angle=angle)
    odometry = extract(replace(log, wheels=wheels)).odometry
    assert log.robot is not None
    radius = log.robot.wheel_radius_left
    np.testing.assert_allclose(odometry.increment[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(odometry.metres, [20.0 * radius])
    poses = np.column_stack([angle[:, 0] * radius, np.zeros((4, 2))])
    foreign = replace(log, wheels=None, odometry=PoseTrack(t, poses))
    np.testing.assert_allclose(extract(foreign).odometry.metres, [20.0 * radius])


def test_poses_of_the_wheels_give_the_same_increments_as_the_wheels(tmp_path: Path):
    folder = write_log(tmp_path / "wheels", **images(0, 1, 2, 3))
    wheels = extracted(folder)
    poses = [np.array([3.0, -1.0, 2.0])]  # a frame of its own
    for increment in wheels.odometry.increment:
        poses.append(compose(poses[-1], increment))
    rows = "".join(
        f"{t:g},{p[0]!r},{p[1]!r},{p[2]!r}\n" for t, p in enumerate(np.array(poses).tolist())
    )
    files = {**images(0, 1, 2, 3), "wheels_csv": None, "odometry_csv": "t,x,y,theta\n" + rows}
    foreign = extracted(write_log(tmp_path / "poses", **files))
    np.testing.assert_allclose(foreign.odometry.increment, wheels.odometry.increment, atol=1e-12)
    np.testing.assert_allclose(foreign.odometry.cov, wheels.odometry.cov, rtol=1e-9)
    assert foreign.odometry.wheel_t is None


def test_poses_of_unknown_wheels_take_slip_only(tmp_path: Path):
    folder = write_log(
        tmp_path,
        log_toml='format = "graphslam-log/1"\n',
        wheels_csv=None,
        odometry_csv="t,x,y,theta\n0,0,0,0\n1,4,0,0\n",
    )
    cov = extracted(folder).odometry.cov[0]
    slip, floor = UNKNOWN_WHEELS.slip, UNKNOWN_WHEELS.floor
    np.testing.assert_allclose(cov[0, 0], 4 * slip[0] ** 2 + floor[0] ** 2)
    np.testing.assert_allclose(cov[2, 2], 4 * slip[2] ** 2 + floor[1] ** 2)


# ---- start ------------------------------------------------------------------------------------


def test_the_start_is_the_origin_known_where_the_log_gives_none(tmp_path: Path):
    measurements = extracted(write_log(tmp_path, sightings_csv=SIGHTINGS))
    assert measurements.start_pose.tolist() == [0, 0, 0]
    np.testing.assert_allclose(measurements.start_cov, 1e-12 * np.eye(3))


def test_the_start_of_the_log_is_used_with_its_sigma_held_above_a_millionth(tmp_path: Path):
    start = "[start]\npose = [1, 2, 3]\nsigma = [0.1, 1e-9, 0]\n"
    log = open_log(write_log(tmp_path, log_toml=LOG_TOML + start, sightings_csv=SIGHTINGS))
    measurements = extract(log)
    assert measurements.start_pose.tolist() == [1, 2, 3]
    np.testing.assert_allclose(measurements.start_cov, np.diag([1e-2, 1e-12, 1e-12]))
    assert not [w for w in extraction_warnings(log, measurements) if "[start]" in w]
    later = extract(log, ExtractConfig(from_s=0.5))
    warning = "[start] counts as the pose at t = 0.5 s, the first node used"
    assert [w for w in extraction_warnings(log, later) if w.startswith(warning)]


# ---- sightings of the log ---------------------------------------------------------------------


def test_sightings_of_the_log_arrive_as_they_stand(tmp_path: Path):
    rows = (
        "t,rho,alpha,cov_rr,cov_ra,cov_aa,s_min,s_max,line,t_received\n"
        "0,1,0.1,4e-4,1e-5,1e-4,-1,1,5,0\n1,-2,0.2,4e-4,0,1e-4,,,-1,1.5\n"
    )
    table = extracted(write_log(tmp_path, sightings_csv=rows)).sightings["line"]
    np.testing.assert_array_equal(table.z, [[1, 0.1], [-2, 0.2]])
    np.testing.assert_array_equal(table.cov[0], [[4e-4, 1e-5], [1e-5, 1e-4]])
    np.testing.assert_array_equal(table.extent, [[-1, 1], [np.nan, np.nan]])
    assert table.t_received.tolist() == [0, 1.5]
    assert table.truth.tolist() == [5, -1]
    assert np.isnan(table.quality).all()


def test_extracted_sightings_written_as_a_log_are_extracted_again(
    tmp_path: Path, shared_data: Path
):
    log = open_log(shared_data / "logs" / "square")
    part = extract(log, ExtractConfig(to_s=10.0))
    table = part.sightings["line"]
    rows = np.column_stack(
        [
            part.t[table.node],
            table.z,
            table.cov[:, [0, 0, 1], [0, 1, 1]],
            table.extent,
            table.truth,
            table.t_received,
        ]
    )
    header = "t,rho,alpha,cov_rr,cov_ra,cov_aa,s_min,s_max,line,t_received"
    folder = write_log(
        tmp_path,
        wheels_csv=(shared_data / "logs" / "square" / "wheels.csv").read_bytes(),
        log_toml=(shared_data / "logs" / "square" / "log.toml").read_bytes(),
    )
    np.savetxt(folder / "sightings.csv", rows, "%.17g", ",", header=header, comments="")
    again = extracted(folder).sightings["line"]
    for name in ("z", "cov", "extent", "t_received", "truth"):
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name))


# ---- truth ------------------------------------------------------------------------------------


def world(tmp_path: Path, sightings: str) -> Log:
    truth = "0 1 1 0 0 0 0 1\n2 3 1 0 0 0 0 1\n"  # two metres along x, at y = 1
    lines = "line,rho,alpha\n3,4,0\n8,-2,-1.5707963267948966\n"  # x = 4 and y = 2
    return open_log(
        write_log(tmp_path, groundtruth_tum=truth, map_csv=lines, sightings_csv=sightings)
    )


@pytest.mark.parametrize(
    ("row", "line"),
    [
        ("0,3,0", 3),
        ("1,2,0", 3),
        ("1,-2,3.141592653589793", 3),  # the twin
        ("1,1,1.5707963267948966", 8),
        ("1,-1,-1.5707963267948966", 8),
        ("1,2.019,0", 3),
        ("1,2.021,0", -1),
        ("1,2,0.0261", 3),  # 1.4955 degrees
        ("1,2,0.0263", -1),
        ("2.5,0.5,0", -1),  # after the last true pose
    ],
)
def test_the_true_line_is_the_nearest_within_the_bounds_from_the_true_pose(
    tmp_path: Path, row: str, line: int
):
    log = world(tmp_path, f"t,rho,alpha\n{row}\n")
    assert extract(log).sightings["line"].truth.tolist() == [line]


def test_the_offset_is_taken_at_the_middle_of_the_seen_stretch(tmp_path: Path):
    # turned by 0.02 rad about the point 1 m along the line: there, and only there, it lies on it
    rho = 2.0 + 1.0 * 0.02
    rows = f"t,rho,alpha,s_min,s_max\n1,{rho},0.02,0.5,1.5\n1,{rho},0.02,-1.5,-0.5\n"
    assert extract(world(tmp_path, rows)).sightings["line"].truth.tolist() == [3, -1]


def test_the_logs_own_true_lines_are_not_touched(tmp_path: Path):
    rows = "t,rho,alpha,line\n0,3,0,8\n1,2,0,-1\n"
    assert extract(world(tmp_path, rows)).sightings["line"].truth.tolist() == [8, -1]


def test_without_true_poses_or_map_no_true_line_is_known(tmp_path: Path):
    log = world(tmp_path, "t,rho,alpha\n0,3,0\n")
    assert extract(replace(log, truth=None)).sightings["line"].truth.tolist() == [-1]
    assert extract(replace(log, map=None)).sightings["line"].truth.tolist() == [-1]


def test_true_lines_of_many_sightings_agree_with_one_at_a_time(tmp_path: Path):
    rng = np.random.default_rng(3)
    lines = np.column_stack([rng.uniform(0, 5, 300), rng.uniform(-math.pi, math.pi, 300)])
    pose = np.column_stack([rng.uniform(-2, 2, (2000, 2)), rng.uniform(-4, 4, 2000)])
    seen = rng.integers(300, size=2000)
    z = line_to_robot(lines[seen], pose) + rng.normal(0, [0.01, 0.01], (2000, 2))
    z = np.where(rng.random(2000)[:, None] < 0.5, z, twin(z))
    together = nearest_line(lines, pose, z, np.zeros(2000))
    alone = [nearest_line(lines, pose[[k]], z[[k]], np.zeros(1))[0] for k in range(0, 2000, 50)]
    assert together[::50].tolist() == alone
    hit = together >= 0
    assert hit.mean() > 0.7
    turn = np.abs(np.angle(np.exp(2j * (lines[together, 1] - pose[:, 2] - z[:, 1])))) / 2
    assert turn[hit].max() <= LARGEST_TURN + 1e-12
    assert LARGEST_OFFSET == 0.020


# ---- warnings ---------------------------------------------------------------------------------


def warned(tmp_path: Path, sightings: str) -> tuple[str, ...]:
    log = open_log(write_log(tmp_path, sightings_csv=sightings))
    return extraction_warnings(log, extract(log))


def test_no_line_seen_gives_a_warning(tmp_path: Path):
    assert [w for w in warned(tmp_path, "t,rho,alpha\n") if "no line was seen" in w]


def test_lines_of_one_direction_give_a_warning_twins_and_turns_of_the_robot_included(
    tmp_path: Path,
):
    # between 1 s and 2 s the robot turns by 0.5 rad: lines seen then lie turned the other way
    rows = "t,rho,alpha\n0,1,0.3\n1,-1,3.44\n2,1,-0.2\n3,-2,2.94\n"
    assert [w for w in warned(tmp_path, rows) if "one direction only" in w]


def test_lines_of_two_directions_give_no_warning(tmp_path: Path):
    assert warned(tmp_path, "t,rho,alpha\n0,1,0.3\n1,1,0.3\n1,1,1.9\n") == ()


def test_a_few_misread_lines_do_not_hide_that_there_is_one_direction(tmp_path: Path):
    rows = [f"{t:.2f},1,0.01" for t in np.arange(0, 1, 0.01)] + ["1,1,1.2"]
    warnings = warned(tmp_path, "t,rho,alpha\n" + "\n".join(rows) + "\n")
    assert [w for w in warnings if "one direction only" in w]


# ---- images -----------------------------------------------------------------------------------


@pytest.mark.parametrize("content", [b"", b"no image at all", png()[:100], b"\xff\xd8\xff\xe0cut"])
def test_an_image_that_cannot_be_read_is_counted_and_its_node_stays(tmp_path: Path, content: bytes):
    files = images(0)
    files["images_csv"] = "t,file\n0,a.png\n1,b.png\n"
    log = open_log(write_log(tmp_path, **files, b_png=content))
    measurements = extract(log)
    assert measurements.t.tolist() == [0, 1]
    assert measurements.rejected["image that cannot be read"] == 1
    warnings = extraction_warnings(log, measurements)
    assert [w for w in warnings if "not be read and were left out: 1, first b.png; " in w]


def test_an_image_of_another_size_is_an_error_that_names_it(tmp_path: Path):
    folder = write_log(tmp_path, **images(0, 1, a_png=png(24, 32)))
    with pytest.raises(BadLog, match=r"a\.png: is 24 x 32 pixels, .* image_size = \[32, 24\]"):
        extracted(folder)


def test_progress_is_told_after_every_image(tmp_path: Path):
    told: list[tuple[int, int]] = []
    log = open_log(write_log(tmp_path, **images(0, 1, 2)))
    extract(log, progress=lambda done, of: told.append((done, of)))
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_measurements_do_not_depend_on_the_number_of_workers(tmp_path: Path, shared_data: Path):
    log = open_log(shared_data / "logs" / "free")
    for workers in (1, 3):
        part = extract(log, ExtractConfig(workers=workers, to_s=10.0))
        part.save(tmp_path / f"{workers}.npz")
    assert (tmp_path / "1.npz").read_bytes() == (tmp_path / "3.npz").read_bytes()


def test_lines_in_recorded_images_are_the_true_ones(shared_data: Path):
    log = open_log(shared_data / "logs" / "square")
    measurements = extract(log)
    lines = measurements.sightings["line"]
    assert len(measurements.t) == 278
    assert len(lines) > 2 * 278
    assert np.mean(lines.truth >= 0) > 0.95
    assert np.all(lines.source >= 0)
    np.testing.assert_array_equal(measurements.t[lines.node], lines.t_received)
    assert log.images is not None
    np.testing.assert_array_equal(log.images.t[lines.source], lines.t_received)
    assert extraction_warnings(log, measurements) == ()
    again = true_lines(log, lines.t_received, twin(lines.z), -lines.extent[:, ::-1])
    np.testing.assert_array_equal(again, lines.truth)


def test_every_thins_lines_and_keeps_all_tags(tmp_path: Path):
    lines = "t,rho,alpha\n" + "".join(f"{t},1,0\n" for t in (0, 0.5, 1, 1.5, 2, 2.5))
    tags = "t,x,y,theta\n" + "0.25,0.125,0,0\n0.5,0.25,0,0\n1.25,0.63,0,0.1\n"
    folder = write_log(tmp_path, sightings_csv=lines, tags_csv=tags)
    measurements = extracted(folder, ExtractConfig(every=2))
    line, fix = measurements.sightings["line"], measurements.sightings["pose_fix"]
    assert measurements.t[line.node].tolist() == [0, 1, 2]
    assert measurements.t[fix.node].tolist() == [0.25, 0.5, 1.25]
    assert dict(measurements.rejected) == {}
