"""The replay: what the page's script is given, and thumbnails with lines where the lines are."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compare.plots_points import ELLIPSE_SCALE
from compare.record import Record
from compare.replay import Frames, take_frames
from compare.report import rebuild_report
from compare.report_quality import worst_residuals
from compare.report_replay import replay_json
from compare.run import RunResult, run_log
from frontend.images import thumbnail
from frontend.log import open_log
from frontend.simulate import load_scenario, simulate
from graphslam.errors import BadMeasurements
from graphslam.geometry import distance_from_line
from tests.compare.tiny_log import write_tiny_log

SCENARIO = """format = "graphslam-scenario/1"
name = "short"
speed = 0.3
path = [{ forward = 1.2 }, { turn_deg = 60.0 }]

[[grids]]
alpha_deg = 5.0
first = 0.4
spacings = [0.5, 0.55, 0.5]

[[grids]]
alpha_deg = 95.0
first = -0.6
spacings = [0.5, 0.55, 0.5]

[robot]
wheel_radius_left = 0.042
wheel_radius_right = 0.042
wheel_base = 0.2

[camera]
image_size = [240, 180]
rate = 4.0
view_width = 0.9
view_near = 0.2
view_far = 1.2

[groove]
width = 0.008
contrast = -95.0
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    folder = tmp_path_factory.mktemp("replay")
    (folder / "short.toml").write_text(SCENARIO)
    log = simulate(load_scenario(folder / "short.toml"), folder / "log", seed=0)
    return run_log(log, folder / "out")


@pytest.fixture(scope="module")
def record(result: RunResult) -> Record:
    return Record.load(result.folder)


@pytest.fixture(scope="module")
def replay(record: Record) -> dict[str, Any]:
    return json.loads(replay_json(record))


def test_every_moment_has_pose_and_ellipse_of_each_method(
    record: Record, replay: dict[str, Any]
) -> None:
    nodes = len(record.measurements.t)
    assert replay["node"] == list(range(nodes))
    assert [m["name"] for m in replay["methods"]] == list(record.estimates)
    for method in replay["methods"]:
        estimate = record.estimates[method["name"]]
        assert np.allclose(method["x"], estimate.pose[:, 0], atol=6e-5)
        assert np.allclose(method["theta"], np.degrees(estimate.pose[:, 2]), atol=6e-3)
        angle = np.radians(method["angle"])
        along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        cov = estimate.cov_floor[:, :2, :2]
        variance = np.einsum("ni,nij,nj->n", along, cov, along)
        assert np.allclose(method["half"][0], ELLIPSE_SCALE * np.sqrt(variance), atol=2e-5)
        assert (np.array(method["half"][0]) >= method["half"][1]).all()


def test_lines_appear_with_the_first_node_that_used_them(
    record: Record, replay: dict[str, Any]
) -> None:
    estimate, table = record.estimates["ekf"], record.measurements.sightings["line"]
    lines = {line[0]: line for line in replay["methods"][1]["lines"]}
    assert set(lines) == set(estimate.map.id.tolist())
    for row, name in enumerate(estimate.map.id.tolist()):
        assert lines[name][1] == table.node[(estimate.match == row) & estimate.used].min()
        ends = np.array(lines[name][2:]).reshape(2, 2)
        assert np.abs(distance_from_line(estimate.map.params[row], ends)).max() < 2e-3


def test_lines_over_a_thumbnail_lie_on_the_dark_grooves(result: RunResult, record: Record) -> None:
    import cv2

    frames = record.frames
    assert frames is not None
    assert len(frames.node) == len(record.measurements.t)
    darker = []
    for i in range(len(frames.node)):
        image = cv2.imdecode(np.frombuffer(frames.jpeg[i], np.uint8), cv2.IMREAD_GRAYSCALE)
        assert image.shape[::-1] == tuple(frames.size[i])
        for a, b in frames.ends[frames.frame == i]:
            place = a + np.linspace(0.1, 0.9, 30)[:, None] * (b - a)
            column, row = np.floor(place).astype(int).T
            inside = (column >= 0) & (row >= 0) & (column < image.shape[1]) & (row < image.shape[0])
            darker.append(np.mean(image[row[inside], column[inside]]) < np.mean(image) - 5.0)
    assert len(darker) > 40
    assert np.mean(darker) > 0.95


def test_frames_say_what_each_method_took_their_lines_for(
    record: Record, replay: dict[str, Any]
) -> None:
    frames, estimate = record.frames, record.estimates["smoother"]
    assert frames is not None
    told = [line[6] for frame in replay["frames"] for line in frame["lines"]]
    expected = np.where(estimate.used, np.append(estimate.map.id, -1)[estimate.match], -1)
    assert told == expected[frames.sighting].tolist()
    assert [frame["at"] for frame in replay["frames"]] == frames.node.tolist()
    assert replay["frames"][0]["name"].startswith("images/")


def test_worst_residuals_name_and_show_their_frame(record: Record) -> None:
    table = worst_residuals(record)
    assert table is not None
    assert table["pictures"]
    for row in table["rows"]:
        assert row["frame"].startswith("images/")
        assert sum(line["this"] for line in row["picture"]["lines"]) == 1


def test_report_with_images_is_rebuilt_with_the_same_bytes(
    result: RunResult, tmp_path: Path
) -> None:
    folder = shutil.copytree(result.folder, tmp_path / "moved")
    rebuild_report(folder)
    first = (folder / "report.html").read_bytes()
    assert first.count(b"data:image/jpeg;base64,") > 1
    rebuild_report(folder)
    assert (folder / "report.html").read_bytes() == first
    cut = [
        p.read_bytes().split(b"<!-- timings -->")[0]
        for p in (folder / "report.html", result.folder / "report.html")
    ]
    assert cut[0] == cut[1]


def test_thumbnails_survive_their_file_and_damage_is_named(record: Record, tmp_path: Path) -> None:
    assert record.frames is not None
    path = tmp_path / "thumbnails.npz"
    record.frames.save(path)
    again = Frames.load(path)
    assert (again.name, again.jpeg) == (record.frames.name, record.frames.jpeg)
    assert np.array_equal(again.ends, record.frames.ends)
    before = path.read_bytes()
    again.save(path)
    assert path.read_bytes() == before
    path.write_bytes(before[:200])
    with pytest.raises(BadMeasurements, match="thumbnails"):
        Frames.load(path)


def test_long_logs_keep_few_frames_and_the_worst(
    result: RunResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("compare.replay.MOST_FRAMES", 3)
    frames = take_frames(result.log, result.measurements, {})
    assert frames is not None
    assert frames.node.tolist() == [0, (len(result.measurements.t) - 1) // 2, *frames.node[2:]]
    assert frames.node[-1] == len(result.measurements.t) - 1
    more = take_frames(result.log, result.measurements, result.estimates)
    assert more is not None
    assert set(frames.node) < set(more.node)


def test_log_without_images_replays_without_frames(tmp_path: Path) -> None:
    run = run_log(write_tiny_log(tmp_path / "log"), tmp_path / "out")
    assert not (run.folder / "thumbnails.npz").exists()
    replay = json.loads(replay_json(Record.load(run.folder)))
    assert replay["frames"] == []
    assert len(replay["methods"][0]["x"]) == 60
    html = (run.folder / "report.html").read_text()
    assert "replay-slider" in html
    assert "replay-picture" not in html.split("<script", 1)[0]


def test_given_sightings_are_drawn_on_images_of_a_known_camera_only(
    result: RunResult, record: Record, tmp_path: Path
) -> None:
    folder = shutil.copytree(result.log.folder, tmp_path / "log")
    shutil.copy(result.folder / "sightings.csv", folder / "sightings.csv")
    known = run_log(folder, tmp_path / "known")
    frames = Record.load(known.folder).frames
    assert frames is not None
    assert record.frames is not None
    assert np.array_equal(frames.ends, record.frames.ends)
    settings = (folder / "log.toml").read_text()
    before, camera = settings.split("[camera]")
    (folder / "log.toml").write_text(before + camera[camera.index("\n[") :])
    blind = take_frames(open_log(folder), known.measurements, known.estimates)
    assert blind is not None
    assert len(blind.jpeg) == len(frames.jpeg)
    assert len(blind.ends) == 0


def test_replay_data_cannot_end_its_script_element(record: Record) -> None:
    assert record.frames is not None
    name = "</script><script>alert(1)</script>"
    frames = replace(record.frames, name=(name, *record.frames.name[1:]))
    text = replay_json(replace(record, frames=frames))
    assert "<" not in text
    assert json.loads(text)["frames"][0]["name"] == name


def test_thumbnail_is_small_grey_and_none_for_what_is_no_image(
    result: RunResult, tmp_path: Path
) -> None:
    assert result.log.images is not None
    path = result.log.images.file[0]
    small = thumbnail(path, 60)
    assert small is not None
    assert (small.width, small.height) == (60, 45)
    whole = thumbnail(path, 1000)
    assert whole is not None
    assert whole.width == 240
    (tmp_path / "cut.jpg").write_bytes(b"no image")
    assert thumbnail(tmp_path / "cut.jpg", 60) is None


def test_unreadable_image_has_no_thumbnail(result: RunResult, tmp_path: Path) -> None:
    folder = shutil.copytree(result.log.folder, tmp_path / "log")
    log = open_log(folder)
    assert log.images is not None
    log.images.file[0].write_bytes(b"cut off")
    frames = take_frames(log, result.measurements, {})
    assert frames is not None
    assert 0 not in frames.node
    assert len(frames.node) == len(result.measurements.t) - 1
