"""`graphslam play`: any log as a page, as a video, and in a window; and several sensors at once."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from compare.cli import main
from compare.config import RunConfig
from compare.play import make_show, write_show
from frontend import film
from frontend.extract import extract
from frontend.film import FPS, TITLE, Player, has_window, play_in_window
from frontend.log import open_log
from frontend.screen import SIZE, Screen
from frontend.show import Show
from frontend.simulate import Scenario, load_scenario, simulate, simulate_log
from frontend.simulate.floor import LineGrid
from frontend.simulate.sensors import CameraSpec, SightingSpec
from graphslam import dead_reckoning, run_ekf, smooth
from graphslam.errors import BadConfig
from graphslam.fixes import follow_fixes
from graphslam.geometry import interpolate_poses, wrap
from graphslam.measurements import Measurements


def both_cameras() -> Scenario:
    """The work space with lines on its floor, and a robot with a camera of its own."""
    scenario = load_scenario("atali")
    assert scenario.overhead is not None
    return replace(
        scenario,
        repeat=1,
        mess=None,
        sightings=SightingSpec(sigma_rho=0.002, sigma_alpha_deg=0.2),
        camera=CameraSpec((160, 120), 2.0, view_width=0.5, view_near=0.12, view_far=0.6),
        grids=(LineGrid(0.0, 0.15, (0.31, 0.29, 0.33, 0.3, 0.32)), LineGrid(90.0, 0.1, (0.3,) * 5)),
        overhead=replace(scenario.overhead, image_size=(320, 240), rate=4.0),
    )


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = both_cameras()
    return simulate(
        replace(scenario, path=scenario.path[:2]), tmp_path_factory.mktemp("play") / "both", seed=2
    )


@pytest.fixture(scope="module")
def show(log: Path) -> Show:
    return make_show(log)


def page_data(page: Path) -> dict[str, Any]:
    found = re.search(r'id="play-data">(.*?)</script>', page.read_text("utf-8"), re.DOTALL)
    assert found is not None
    return dict(json.loads(found.group(1)))


# ---- what is shown ----------------------------------------------------------------------------


def test_a_show_has_the_paths_and_the_images_of_all_cameras(log: Path, show: Show) -> None:
    assert [track.name for track in show.tracks] == ["odometry", "fixes", "ekf", "smoother"]
    assert show.cameras == ("floor", "overhead")
    assert len(show.shots) == len(open_log(log).images.t)
    floor, above = ([shot for shot in show.shots if shot.camera == name] for name in show.cameras)
    assert max(len(shot.marks) for shot in floor) >= 2
    seen = [shot for shot in above if shot.note.startswith("x ")]
    assert len(seen) > 0.7 * len(above)
    hidden = [shot for shot in above if not shot.note.startswith("x ")]
    assert all("overhead image" in shot.note for shot in hidden)
    assert not any(mark.used for shot in hidden for mark in shot.marks)
    assert show.truth is not None
    ekf = next(track for track in show.tracks if track.name == "ekf")
    assert np.abs(ekf.pose[:, :2] - show.truth).max() < 0.02


def test_marks_lie_on_the_tags_that_the_image_shows(show: Show) -> None:
    screen = Screen(show)
    shot = next(s for s in show.shots if s.camera == "overhead" and s.marks)
    picture = screen._image(shot.number)
    assert picture is not None
    for mark, blue_over_green in zip(shot.marks[:2], (True, False), strict=True):
        u, v = np.round(mark.points[0]).astype(int)
        blue, green, _ = picture[v, u].astype(int)
        assert (blue > green) == blue_over_green


def test_a_moment_shows_only_what_was_known_then(show: Show) -> None:
    screen = Screen(show)
    first, last = screen.at(float(show.t[0])), screen.at(float(show.t[-1]))
    assert first.shape == last.shape == (SIZE[1], SIZE[0], 3)
    orange = np.array([0, 94, 213])  # odometry's path
    drawn = [np.count_nonzero(np.all(p[:500, 640:] == orange, axis=2)) for p in (first, last)]
    assert drawn[0] < 0.5 * drawn[1]
    assert np.array_equal(screen.at(float(show.t[0])), first)


# ---- as a file --------------------------------------------------------------------------------


def test_the_page_is_whole_by_itself_and_the_same_each_time(show: Show, tmp_path: Path) -> None:
    page = tmp_path / "deep" / "show.html"
    write_show(show, page, 2.0)
    text = page.read_text("utf-8")
    assert "http" not in text.replace("http-equiv", "").replace("http://www.w3.org", "")
    script = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)[-1]
    digest = base64.b64encode(sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in text
    data = page_data(page)
    assert data["speed"] == 2.0
    assert '<option value="2.0" selected>' in text
    assert len(data["t"]) == len(data["tracks"][0]["x"]) == len(show.t)
    assert [track["name"] for track in data["tracks"]] == [t.name for t in show.tracks]
    jpeg = np.frombuffer(base64.b64decode(data["frames"][0]["jpeg"]), np.uint8)
    size = cv2.imdecode(jpeg, cv2.IMREAD_COLOR).shape[1::-1]
    assert list(size) == data["frames"][0]["size"]
    assert not list(page.parent.glob(".*"))
    again = tmp_path / "again.html"
    write_show(show, again, 2.0)
    assert again.read_bytes() == page.read_bytes()


@pytest.mark.parametrize("ending", [".mp4", ".avi", ".webm"])
def test_a_video_has_a_picture_for_each_of_its_moments(
    show: Show, tmp_path: Path, ending: str
) -> None:
    out = tmp_path / f"show{ending}"
    write_show(show, out, 8.0)
    video, pictures = cv2.VideoCapture(str(out)), []
    while True:
        whole, picture = video.read()
        if not whole:
            break
        pictures.append(picture)
    assert len(pictures) == 1 + int(np.ceil((show.t[-1] - show.t[0]) / 8.0 * FPS))
    expected = Screen(show).at(float(show.t[-1]), "x 8")
    assert np.abs(pictures[-1].astype(int) - expected).mean() < 6.0


def test_the_command_writes_a_page_where_there_is_no_window(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    log = simulate(load_scenario("santana-slam"), tmp_path / "lines", images=False)
    assert main(["play", str(log), "--to", "20", "--methods", "odometry", "ekf"]) == 0
    page = tmp_path / "results" / "santana-slam-play.html"
    assert capsys.readouterr().out.strip() == str(page.relative_to(tmp_path))
    data = page_data(page)
    assert data["frames"] == data["cameras"] == []
    assert [track["name"] for track in data["tracks"]] == ["odometry", "ekf"]
    assert len(data["tracks"][1]["lines"]) > 1
    assert 'id="play-images"' not in page.read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--out", "show.gif"), "a show is a page (.html) or a video (.mp4, .avi, .webm)"),
        (("--out", "."), "a show is a page"),
        (("--speed", "0"), "speed = 0.0: must be from 0.001 to 10000"),
        (("--out", "show.mp4", "--speed", "0.001"), "play it faster (--speed)"),
    ],
)
def test_what_cannot_be_played_is_told(
    log: Path, arguments: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["play", str(log), *arguments]) == 1
    assert told in " ".join(capsys.readouterr().err.split())


# ---- in a window ------------------------------------------------------------------------------


def test_the_player_pauses_seeks_and_changes_its_speed() -> None:
    player = Player(10.0, 20.0, 2.0)
    player.advance(1.0)
    assert player.t == 12.0
    player.press(ord(" "))
    player.advance(1.0)
    assert player.t == 12.0
    player.press(ord("."))
    assert player.t == 13.0
    player.press(65361)
    player.press(ord("+"))
    player.press(ord(" "))
    player.advance(1.0)
    assert player.t == 16.0
    player.advance(9.0)
    assert player.t == 20.0
    assert player.paused
    player.press(ord(" "))
    assert player.t == 10.0
    player.press(ord("-"))
    assert player.speed == 2.0
    player.press(27)
    assert player.over


def test_the_window_shows_moment_after_moment_until_it_is_closed(
    show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[np.ndarray] = []
    slide: list[Any] = []
    keys = iter([-1, ord(" "), -1, -1, ord("q")])
    fakes = {
        "namedWindow": lambda *_: None,
        "resizeWindow": lambda *_: None,
        "createTrackbar": lambda *given: slide.append(given[-1]),
        "setTrackbarPos": lambda _name, _title, value: slide[0](value),
        "imshow": lambda title, picture: shown.append(picture) if title == TITLE else None,
        "waitKeyEx": lambda _: next(keys),
        "getWindowProperty": lambda *_: 1.0,
        "destroyWindow": lambda _: shown.append(np.zeros(0)),
    }
    for name, fake in fakes.items():
        monkeypatch.setattr(film.cv2, name, fake)
    play_in_window(show, 1.0)
    *pictures, closed = shown
    assert len(pictures) == 5
    assert not len(closed)
    assert np.array_equal(pictures[2], pictures[4])  # paused; the slider set by us moves nothing
    slide[0](10 * round(show.t[-1] - show.t[0]))


def test_there_is_a_window_only_with_a_display_and_an_opencv_that_has_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(film.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(film.cv2, "getBuildInformation", lambda: "  GUI:   QT5\n")
    assert not has_window()
    monkeypatch.setenv("DISPLAY", ":0")
    assert has_window()
    monkeypatch.setattr(film.cv2, "getBuildInformation", lambda: "  GUI:   NONE\n")
    assert not has_window()


# ---- several sensors --------------------------------------------------------------------------


def rmse(log, measurements: Measurements, estimate) -> tuple[float, float]:
    off = estimate.pose - interpolate_poses(measurements.t, log.truth.t, log.truth.pose)
    off[:, 2] = wrap(off[:, 2])
    return float(np.mean(np.sum(off[:, :2] ** 2, axis=1))), float(np.mean(off[:, 2] ** 2))


def test_floor_lines_and_overhead_poses_of_one_log_are_fused() -> None:
    scenario = both_cameras()
    sums: dict[str, np.ndarray] = {}
    for seed in range(4):
        log = simulate_log(scenario, seed)
        measurements = extract(log)
        assert set(measurements.sightings) == {"line", "pose_fix"}
        for kinds in (("line",), ("pose_fix",), ("line", "pose_fix")):
            tables = {kind: measurements.sightings[kind] for kind in kinds}
            part = replace(measurements, sightings=tables)
            ekf = run_ekf(part)
            for name, estimate in (("ekf", ekf), ("smoother", smooth(part, ekf))):
                key = f"{name} {'+'.join(kinds)}"
                sums[key] = sums.get(key, 0.0) + np.array(rmse(log, part, estimate))
    for name in ("ekf", "smoother"):
        both = sums[f"{name} line+pose_fix"]
        for alone in ("line", "pose_fix"):
            assert np.all(both < 1.02 * sums[f"{name} {alone}"]), (name, alone)
        assert both[0] < 0.9 * sums[f"{name} pose_fix"][0]


def test_filter_and_smoother_beat_camera_and_odometry_and_are_honest() -> None:
    """A slice of benchmarks/overhead.py."""
    nees: dict[str, list[float]] = {"ekf": [], "smoother": []}
    for seed in range(5):
        log = simulate_log(load_scenario("atali"), seed)
        measurements = extract(log)
        ekf = run_ekf(measurements)
        made = {"ekf": ekf, "smoother": smooth(measurements, ekf)}
        limits = [
            rmse(log, measurements, estimate)
            for estimate in (follow_fixes(measurements), dead_reckoning(measurements))
        ]
        for name, estimate in made.items():
            assert np.all(np.array(rmse(log, measurements, estimate)) < np.min(limits, axis=0))
            true = interpolate_poses(measurements.t, log.truth.t, log.truth.pose)
            off = estimate.pose - true
            off[:, 2] = wrap(off[:, 2])
            chi = np.einsum("ki,kij,kj->k", off, np.linalg.inv(estimate.cov_floor), off)
            nees[name].append(float(np.mean(chi[1:]) / 3.0))
    for name, values in nees.items():
        assert 0.8 < np.mean(values) < 1.25, name


def test_the_method_fixes_is_what_the_camera_tells_alone() -> None:
    log = simulate_log(load_scenario("atali"), 3)
    measurements = extract(log)
    fixes = measurements.sightings["pose_fix"]
    alone = follow_fixes(measurements)
    assert np.allclose(alone.pose[fixes.node][:, :2], fixes.z[:, :2], atol=1e-12)
    assert np.allclose(alone.cov_floor[fixes.node], fixes.cov, rtol=1e-9)
    assert alone.used.all()
    result = make_show_methods(measurements)
    assert result == {"fixes"}


def make_show_methods(measurements: Measurements) -> set[str]:
    """Returns which methods of a run succeed that asks for fixes alone."""
    from compare.methods import run_methods

    config = RunConfig(methods=("fixes",))
    estimates, failed = run_methods(measurements, config, lambda _, work: work())
    none, why = run_methods(measurements.without_sightings(), config, lambda _, work: work())
    assert not failed
    assert not none
    assert "tags.csv" in str(why["fixes"])
    return set(estimates)


def test_a_wrong_ending_is_refused_before_anything_is_drawn(show: Show, tmp_path: Path) -> None:
    with pytest.raises(BadConfig, match="name it so"):
        write_show(show, tmp_path / "show.gif", 1.0)
