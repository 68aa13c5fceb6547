"""What `inspect` tells about good logs, and what it finds in logs with one defect each."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from frontend.camera import Camera
from frontend.inspect import Inspection, inspect
from frontend.log import open_log
from frontend.moves import moves_of
from frontend.overlay import WIDTH, contact_sheet, draw_lines, write_picture
from frontend.sample import SAMPLE
from frontend.simulate import load_scenario, simulate
from frontend.simulate.scenario import Motion
from frontend.turning import check_turns
from frontend.view import view_of
from tests.frontend.small_logs import CAMERA, LOG_TOML, write_log

PATH = (
    Motion(forward=0.9),
    Motion(turn_deg=90.0),
    Motion(forward=0.6),
    Motion(turn_deg=-90.0),
    Motion(forward=0.6),
    Motion(arc_deg=120.0, radius=0.4),
    Motion(forward=0.6),
    Motion(turn_deg=-60.0),
    Motion(forward=0.9),
)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    sample = load_scenario("sample")
    assert sample.camera is not None
    scenario = replace(sample, path=PATH, camera=replace(sample.camera, rate=4.0))
    return simulate(scenario, tmp_path_factory.mktemp("logs") / "good", seed=1)


@pytest.fixture
def log(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good, tmp_path / "log"))


def rows_of(path: Path) -> np.ndarray:
    return np.loadtxt(path, delimiter=",", skiprows=1)


def change_wheels(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    rows = change(rows_of(folder / "wheels.csv"))
    np.savetxt(
        folder / "wheels.csv", rows, "%.12g", delimiter=",", header="t,left,right", comments=""
    )


def change_image_times(folder: Path, change: Callable[[float], float | None]) -> None:
    path = folder / "images.csv"
    head, *rows = path.read_text().splitlines()
    changed = [(change(float(t)), file) for t, file in (row.split(",") for row in rows)]
    lines = [head, *(f"{t:.9f},{file}" for t, file in changed if t is not None)]
    path.write_text("\n".join(lines) + "\n")


def change_truth(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    path = folder / "groundtruth.tum"
    np.savetxt(path, change(np.loadtxt(path)), "%.12f")


def change_setting(folder: Path, key: str, value: object) -> None:
    path = folder / "log.toml"
    lines = path.read_text().splitlines()
    assert any(line.startswith(f"{key} = ") for line in lines)
    changed = [f"{key} = {value}" if line.startswith(f"{key} = ") else line for line in lines]
    path.write_text("\n".join(changed) + "\n")


def change_homography(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    homography = open_log(folder).cameras["floor"].homography
    change_setting(folder, "homography", change(homography).tolist())


def found(folder: Path) -> list[str]:
    """Returns the findings as texts; each must have all its parts."""
    findings = inspect(open_log(folder)).findings
    assert all(f.about and f.found and f.reason and f.cure for f in findings)
    return [f"{f.about}: {f.found}; {f.reason}; {f.cure}" for f in findings]


def has(texts: list[str], *words: str) -> bool:
    """Returns whether one text holds all the words."""
    return any(all(word in text for word in words) for text in texts)


# ---- good logs --------------------------------------------------------------------------------


def test_a_simulated_log_is_told_as_it_is_and_nothing_looks_wrong(good: Path) -> None:
    told = inspect(open_log(good))
    assert told.findings == ()
    assert told.warnings == ()
    assert told.images == len((good / "images.csv").read_text().splitlines()) - 1
    assert len(told.frames) == SAMPLE
    assert all(frame.readable for frame in told.frames)
    assert np.mean([len(frame.z) for frame in told.frames]) > 2.0
    assert told.driven_m == pytest.approx(3.6 + np.radians(120) * 0.4, rel=0.03)
    assert np.degrees(told.turned_rad) == pytest.approx(360.0, rel=0.05)
    assert np.degrees(told.net_turn_rad) == pytest.approx(60.0, abs=15.0)
    assert told.speed_mps[0] == pytest.approx(0.3, rel=0.05)
    assert told.wheel_rate.max() == pytest.approx(0.3 / 0.042, rel=0.4)
    rates = {source.file: source.rate_hz for source in told.sources}
    assert rates == pytest.approx({"wheels.csv": 20.0, "images.csv": 4.0, "groundtruth.tum": 20.0})
    assert all(source.overlap == 1.0 for source in told.sources)
    assert [need.missing for need in told.needs] == [()] * 6
    assert told.turns is not None
    assert told.turns.agree > 0.8


@pytest.mark.parametrize("name", ["square", "free"])
def test_nothing_looks_wrong_in_recorded_logs(shared_data: Path, name: str) -> None:
    told = inspect(open_log(shared_data / "logs" / name))
    assert told.findings == ()
    assert {need.purpose for need in told.needs if need.missing} == {"judging consistency"}


def test_what_is_missing_is_told_for_each_purpose(tmp_path: Path) -> None:
    told = inspect(open_log(write_log(tmp_path)))
    missing = {need.purpose: " ".join(need.missing) for need in told.needs}
    assert missing["odometry"] == ""
    assert "images.csv" in missing["ekf"]
    assert missing["smoother"] == missing["ekf"]
    assert missing["judging the path"] == "groundtruth.tum"
    assert missing["judging the map"] == "map.csv"
    assert missing["judging consistency"] == "groundtruth.tum [start] with sigma 0"
    assert told.frames == ()


def test_lines_that_the_log_gives_are_told_without_opening_an_image(tmp_path: Path) -> None:
    rows = "t,rho,alpha\n0,1,0.3\n1,1,0.3\n1,1,1.9\n"
    folder = write_log(tmp_path, sightings_csv=rows, images_csv="t,file\n1,a.png\n", a_png=b"none")
    told = inspect(open_log(folder))
    assert [len(frame.z) for frame in told.frames] == [1, 2]
    assert all(frame.image == -1 and frame.readable for frame in told.frames)


def test_progress_counts_every_image_that_is_searched(log: Path) -> None:
    seen: list[tuple[int, int]] = []
    inspect(open_log(log), progress=lambda done, total: seen.append((done, total)))
    assert [done for done, _ in seen] == list(range(1, seen[-1][1] + 1))


# ---- one defect each --------------------------------------------------------------------------


@pytest.mark.parametrize("shift", [0.3, -0.2])
def test_a_shift_between_the_clocks_is_found_and_measured(log: Path, shift: float) -> None:
    change_image_times(log, lambda t: t + shift + 1.0)
    change_wheels(log, lambda rows: rows + np.array([1.0, 0.0, 0.0]))
    (log / "groundtruth.tum").unlink()
    turns = inspect(open_log(log)).turns
    assert turns is not None
    assert turns.shift_s == pytest.approx(-shift, abs=0.02)
    word = "late" if shift > 0 else "early"
    assert has(found(log), "clock of the images", word, f"add {turns.shift_s:+.2f} s")


def test_clocks_that_no_small_shift_reconciles_are_found(log: Path) -> None:
    change_wheels(log, lambda rows: np.outer(rows[:, 0], [1.0, -1.25, 1.25]))
    assert has(found(log), "lines seen turning", "no shift of the clocks", "one clock")


def test_no_time_in_common_is_found(log: Path) -> None:
    change_image_times(log, lambda t: t + 1000.0)
    assert has(found(log), "images.csv", "no time in common", "one clock")


def test_images_before_the_wheels_are_found(log: Path) -> None:
    change_wheels(log, lambda rows: rows[rows[:, 0] >= 2.0])
    assert has(found(log), "images.csv: 8 of", "before the first row of wheels.csv")


def test_images_after_the_wheels_are_found(log: Path) -> None:
    last = rows_of(log / "wheels.csv")[-1, 0]
    change_wheels(log, lambda rows: rows[rows[:, 0] <= last - 2.0])
    assert has(found(log), "images.csv", "after the last row of wheels.csv")


def test_a_truth_of_another_time_is_found(log: Path) -> None:
    change_truth(log, lambda rows: rows + np.array([1e6, 0, 0, 0, 0, 0, 0, 0]))
    assert has(found(log), "groundtruth.tum: lasts from t = 1000000 s", "one clock")


def test_left_and_right_exchanged_are_found_from_the_lines_alone(log: Path) -> None:
    (log / "groundtruth.tum").unlink()
    change_wheels(log, lambda rows: rows[:, [0, 2, 1]])
    assert has(found(log), "wheels.csv", "left and right are exchanged", "exchange the columns")


def test_left_and_right_exchanged_contradict_the_truth_too(log: Path) -> None:
    change_wheels(log, lambda rows: rows[:, [0, 2, 1]])
    assert has(found(log), "the true turn is -", "left and right may be exchanged")


def test_a_wheel_base_too_small_is_found_from_the_lines_alone(log: Path) -> None:
    (log / "groundtruth.tum").unlink()
    change_setting(log, "wheel_base", 0.16)
    assert has(found(log), "log.toml [robot]", "more than the lines", "measure wheel_base")


def test_radii_that_contradict_the_truth_are_found(log: Path) -> None:
    for side in ("left", "right"):
        change_setting(log, f"wheel_radius_{side}", 0.084)
    assert has(found(log), "log.toml [robot]", "the true distance is 0.5", "measure radii")


def test_radii_in_centimetres_are_found(log: Path) -> None:
    for side in ("left", "right"):
        change_setting(log, f"wheel_radius_{side}", 4.2)
    texts = found(log)
    assert has(texts, "log.toml [robot]: wheel radii 4.2 m", "in metres")
    assert has(texts, "wheels.csv: the robot drives at", "less than 5 m/s")


def test_radii_that_differ_are_found(log: Path) -> None:
    change_setting(log, "wheel_radius_left", 0.050)
    assert has(found(log), "log.toml [robot]", "differ by 19 %")


def test_a_wheel_base_out_of_proportion_is_found(log: Path) -> None:
    change_setting(log, "wheel_base", 20.0)
    assert has(found(log), "log.toml [robot]: wheel_base 20 m is 476 times")


def test_turning_faster_than_robots_do_is_found(log: Path) -> None:
    change_setting(log, "wheel_base", 0.002)
    assert has(found(log), "the robot turns at", "check wheel_base")


def test_a_counter_that_jumps_is_found_with_its_time(log: Path) -> None:
    change_wheels(log, lambda rows: rows + np.where(rows[:, :1] > 5.0, [[0, 500, 500]], 0))
    assert has(found(log), "wheels.csv: 1 readings jump", "after t = 5 s", "unwrap")


def test_wheels_that_never_turn_are_found(log: Path) -> None:
    change_wheels(log, lambda rows: rows * [1, 0, 0])
    assert has(found(log), "wheels.csv: the wheels never turn")


def test_a_jump_of_the_clock_is_told_from_a_gap(log: Path, good: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(good, tmp_path / "other"))
    change_wheels(log, lambda rows: rows + np.where(rows[:, :1] > 2.0, [[20, 0, 0]], 0))
    change_wheels(other, lambda rows: rows[(rows[:, 0] <= 1.0) | (rows[:, 0] > 2.5)])
    assert has(found(log), "wheels.csv: the clock jumps", "t = 2 s")
    assert has(found(other), "wheels.csv: a gap", "t = 1 s")


def test_times_of_arrival_in_bursts_are_found(log: Path) -> None:
    def in_bursts(rows: np.ndarray) -> np.ndarray:
        t = 0.25 * np.floor(rows[:, 0] / 0.25 + 1e-9) + 0.001 * np.arange(len(rows)) % 0.005
        return np.column_stack([np.sort(t), rows[:, 1:]])

    change_wheels(log, in_bursts)
    assert has(found(log), "wheels.csv: uneven times", "arrived")


def test_a_gap_in_the_images_is_found(log: Path) -> None:
    change_image_times(log, lambda t: None if 4.0 < t < 8.0 else t)
    assert has(found(log), "images.csv: 1 gaps", "after t = 4 s, lasts 4 s")


def test_images_that_cannot_be_read_are_found_by_name(log: Path) -> None:
    for path in (log / "images").iterdir():
        path.write_bytes(path.read_bytes()[:40])
    texts = found(log)
    assert has(texts, "000000.jpg", f"{SAMPLE} of {SAMPLE} images", "cannot be read")
    assert not has(texts, "lines: no line")  # nobody could look


def test_a_floor_without_lines_is_found(tmp_path: Path) -> None:
    png = cv2.imencode(".png", np.full((24, 32), 120, np.uint8))[1].tobytes()
    folder = write_log(
        tmp_path, log_toml=LOG_TOML + CAMERA, images_csv="t,file\n0,a.png\n1,b.png\n",
        a_png=png, b_png=png,
    )  # fmt: skip
    assert has(found(folder), "lines: no line in 2 frames", "look at the picture")


def test_lines_of_one_direction_are_found_though_the_robot_turns(tmp_path: Path) -> None:
    rows = "t,rho,alpha\n0,1,0.3\n1,-1,3.44\n2,1,-0.2\n3,-2,2.94\n"
    assert has(found(write_log(tmp_path, sightings_csv=rows)), "lines: one direction only")


# ---- cameras ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda h: h @ np.diag([0.01, 0.01, 1.0]), ("nearest floor in view is 20 m", "centi")),
        (lambda h: h @ np.diag([20.0, 20.0, 1.0]), ("67.3 mm of floor from corner to corner",)),
        (lambda h: h @ np.diag([1.0, -1.0, 1.0]), ("mirrors the floor", "y points left")),
        (
            lambda h: np.array([[1.0, 0, 0], [0, 1.0, 300.0], [0, 0, 1.0]]) @ h,
            ("looks at the horizon", "% of the image are above it"),
        ),
    ],
    ids=["far", "tiny", "mirrored", "horizon"],
)
def test_a_homography_that_cannot_be_is_found(
    log: Path, change: Callable[[np.ndarray], np.ndarray], words: tuple[str, ...]
) -> None:
    change_homography(log, change)
    assert has(found(log), "log.toml camera 'floor'", *words)


def test_a_view_straight_down_is_told_in_metres() -> None:
    homography = np.array([[0.0, -100.0, 50.0], [-100.0, 0.0, 80.0], [0.0, 0.0, 1.0]])
    view = view_of(Camera("floor", "floor", (100, 80), homography), 0.03)
    assert view.area_m2 == pytest.approx(0.8)
    assert view.nearest_m == pytest.approx(0.0, abs=0.006)
    assert view.across_m == pytest.approx(np.hypot(1.0, 0.8))
    assert view.pixel_m == pytest.approx(0.01)
    assert view.usable == 1.0
    assert not view.mirrored


# ---- turning and motion -----------------------------------------------------------------------


def test_a_drive_straight_ahead_tells_nothing_about_clocks() -> None:
    t = np.arange(0.0, 20.0, 0.25)
    lines = [np.array([0.1, 1.6])] * len(t)
    assert check_turns(t, np.zeros(len(t)), t, lines, 0.01) is None


def turning_back_and_forth(t: np.ndarray) -> np.ndarray:
    """Returns a heading that turns this way and that, never twice alike."""
    return 0.6 * np.sin(t) + 0.5 * np.sin(1.7 * t + 1.0)


@pytest.mark.parametrize("factor", [1.0, -1.0, 1.22])
@pytest.mark.parametrize("shift", [0.0, 0.5, -1.3])
def test_shift_and_factor_of_noisy_turns_are_recovered(factor: float, shift: float) -> None:
    rng = np.random.default_rng(1)
    wheel_t, frame_t = np.arange(0.0, 60.0, 0.05), np.arange(0.0, 60.0, 0.25)
    heading = turning_back_and_forth(wheel_t) / factor
    seen = np.array([0.2, 1.7]) - turning_back_and_forth(frame_t + shift)[:, None]
    alphas = list(seen + rng.normal(0.0, 0.005, seen.shape))
    check = check_turns(wheel_t, heading, frame_t, alphas, 0.005)
    assert check is not None
    assert check.shift_s == pytest.approx(shift, abs=0.021)
    assert check.factor == pytest.approx(factor, rel=0.03)
    assert check.agree_best > 0.75


def test_turns_that_are_mere_noise_of_the_wheels_do_not_shrink_the_factor() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 90.0, 0.25)
    truth = np.clip(np.pi / 4 * (t - 40.0), 0.0, np.pi)
    heading = truth + np.cumsum(rng.normal(0.0, 0.01, len(t)))
    alphas = list(np.array([0.2, 1.77]) - truth[:, None])
    check = check_turns(t, heading, t, alphas, 0.009)
    assert check is not None
    assert (check.shift_s, check.factor) == (0.0, 1.0)


def test_moves_follow_wheels_and_foreign_odometry_alike(good: Path, tmp_path: Path) -> None:
    wheels = moves_of(open_log(good))
    rows = np.column_stack([wheels.t, wheels.pose()])
    text = "t,x,y,theta\n" + "\n".join(",".join(map(repr, row)) for row in rows.tolist()) + "\n"
    poses = moves_of(open_log(write_log(tmp_path, wheels_csv=None, odometry_csv=text)))
    for name in ("t", "place", "heading", "length", "turn"):
        np.testing.assert_allclose(getattr(poses, name), getattr(wheels, name), atol=1e-9)


# ---- pictures ---------------------------------------------------------------------------------


def test_lines_are_drawn_over_the_grooves(log: Path) -> None:
    opened = open_log(log)
    frame = inspect(opened).frames[0]
    camera, file = opened.cameras["floor"], opened.images.file[frame.image]  # type: ignore[union-attr]
    grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    canvas = np.zeros((*grey.shape, 3), np.uint8)
    draw_lines(canvas, camera, frame.z, frame.extent, 1.0)
    drawn = canvas.max(axis=2) > 200
    assert np.count_nonzero(drawn) > 100
    assert np.median(grey[drawn]) < np.median(grey) - 20


def test_a_line_without_a_stretch_is_drawn_through_the_view(good: Path) -> None:
    camera = open_log(good).cameras["floor"]
    canvas = np.zeros((240, 320, 3), np.uint8)
    draw_lines(canvas, camera, np.array([[0.5, 0.0]]), np.full((1, 2), np.nan), 1.0)
    across = np.flatnonzero((canvas.max(axis=2) > 200).any(axis=0))
    assert across.min() <= 5
    assert across.max() >= 314


def test_a_contact_sheet_shows_at_most_six_frames(good: Path, tmp_path: Path) -> None:
    opened = open_log(good)
    sheet = contact_sheet(opened, inspect(opened).frames)
    assert sheet is not None
    assert sheet.shape[1] == 2 * WIDTH
    assert sheet.shape[0] == 3 * (480 + 26)
    write_picture(tmp_path / "sheet.png", sheet)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "sheet.png")), sheet)


def test_without_images_there_is_no_contact_sheet(tmp_path: Path) -> None:
    opened = open_log(write_log(tmp_path, sightings_csv="t,rho,alpha\n0,1,0.3\n"))
    told: Inspection = inspect(opened)
    assert contact_sheet(opened, told.frames) is None


def test_an_empty_sightings_file_is_found_and_leaves_filter_and_smoother_without(
    tmp_path: Path,
) -> None:
    log = open_log(write_log(tmp_path, sightings_csv="t,rho,alpha\n"))
    found = inspect(log)
    assert "holds no sighting" in {finding.found for finding in found.findings}
    assert {need.purpose for need in found.needs if need.missing} >= {"ekf", "smoother"}
