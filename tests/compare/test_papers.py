"""`graphslam papers`: on shortened drives, the whole command; its report; going on where it was."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare import errata, papers_experiments
from compare.cli import main
from compare.papers_experiments import LOC_1, SLAM, Experiment, judge_seed
from compare.papers_flaws import Flaws, miscalibrated, simulate_flawed
from compare.report_papers_tables import ROWS
from frontend.simulate import Scenario, load_scenario
from frontend.simulate.scenario import Motion
from frontend.simulate.view import camera_of
from graphslam.geometry import interpolate_poses, line_to_robot, nearest_twin
from graphslam.printed import ERRATA

SHORT = (Motion(forward=2.4), Motion(turn_deg=180.0), Motion(forward=2.4))
FEW_ERRATA = ("loc-29-heading", "slam-27-landmark")


def shortened(name: str) -> Scenario:
    """Returns a scenario of the papers whose robot only drives there and back, and fast."""
    scenario = load_scenario(name)
    speed = 0.4 if scenario.camera.image_size[0] == 640 else 0.2
    return replace(scenario, path=SHORT, speed=speed, turn_rate_deg=60.0)


@pytest.fixture(scope="module")
def patched() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(papers_experiments, "load_scenario", shortened)
        few = {name: ERRATA[name] for name in FEW_ERRATA}
        patch.setattr(errata, "ERRATA", few)
        yield


@pytest.fixture(scope="module")
def folder(patched: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("papers") / "out"
    assert main(["papers", "--runs", "2", "--jobs", "1", "--errata", "--out", str(out)]) == 0
    return out


def test_the_command_writes_one_report_with_every_table(folder: Path) -> None:
    report = (folder / "report.html").read_text(encoding="utf-8")
    for name in ("experiment-1", "experiment-2", "slam", "why", "errata", "timings"):
        assert f'id="{name}"' in report
    for rows in ROWS.values():
        for row in rows:
            assert row.label in report, row.label
    assert "http://" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", report)
    for name in FEW_ERRATA:
        assert report.count(name) == 2  # what it costs, and what it is
        assert ERRATA[name].effect in report
    assert f"{ERRATA['slam-27-landmark'].paper} (27)" in report


def test_the_figures_of_the_report_are_kept_as_numbers(folder: Path) -> None:
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    exact = metrics["without_images"]["experiment-1, exact"]
    assert exact["ekf.final_error_m"]["runs"] == 2
    assert exact["odometry.final_error_m"]["median"] > exact["ekf.final_error_m"]["median"]
    assert set(metrics["errata"]) == set(FEW_ERRATA)
    assert metrics["errata"]["slam-27-landmark"]["printed"]["pose_nees"] > 100.0
    filmed = metrics["through_images"]
    assert set(filmed) == {"experiment-1", "experiment-2", "slam"}
    for plot in ("final-errors", "noise-law", "slam-identified", "experiment-1-trajectories"):
        assert (folder / "plots" / f"{plot}.csv").is_file()


def test_what_goes_through_images_is_seen_by_the_papers_detector(folder: Path) -> None:
    for key, edges in (("experiment-1", "canny"), ("slam", "global")):
        detector = json.loads((folder / key / "run.json").read_text())["config"]["extract"]
        assert detector["detector"]["method"] == "hough"
        assert detector["detector"]["sigma_law"] == "paper"
        assert detector["detector"]["binarise"] == edges
        assert (folder / key / "report.html").is_file()


def test_what_is_there_is_used_again_and_the_same_comes_out(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("was made already")

    before = {p: p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
    monkeypatch.setattr("compare.papers.film", never)
    monkeypatch.setattr("compare.papers.judge_seed", never)
    again = ["papers", "--runs", "2", "--jobs", "1", "--errata", "--out", str(folder)]
    assert main(again) == 0
    assert {p: p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()} == before
    printed = capsys.readouterr().out
    assert "What each misprint costs: medians over 2 seeds" in printed
    assert "slam-27-landmark" in printed
    assert str(folder / "report.html") in printed


def test_a_folder_of_something_else_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["papers", "--out", str(tmp_path)]) == 1
    assert "give another --out" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


# ---- what is right and what is wrong in a run ---------------------------------------------------


@pytest.mark.parametrize("experiment", [LOC_1, SLAM], ids=lambda e: e.key)
def test_a_run_is_judged_by_everything_that_the_tables_show(
    patched: None, experiment: Experiment
) -> None:
    values = judge_seed(experiment, "exact", 0)
    for row in ROWS[experiment.key]:
        assert row.ours in values, row.label


def test_a_calibration_errs_by_what_it_is_told_to() -> None:
    camera = camera_of(load_scenario("santana-loc-1").camera)
    said = miscalibrated(camera, 0.015, np.random.default_rng(0))
    pixel = np.stack(np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 479, 9)), -1).reshape(-1, 2)
    off = np.hypot(*(said.pixel_to_floor(pixel) - camera.pixel_to_floor(pixel)).T)
    assert off.mean() == pytest.approx(0.015, rel=0.01)


def test_held_noise_stays_while_a_line_is_in_view_and_an_erring_map_errs() -> None:
    scenario = shortened("santana-loc-1")
    log, held = simulate_flawed(scenario, Flaws(held=1.0), 0)
    _, fresh = simulate_flawed(scenario, Flaws(), 0)
    scatter = {}
    for name, m in {"held": held, "fresh": fresh}.items():
        table = m.sightings["line"]
        t = m.t[table.node]
        first = (table.truth == table.truth[0]) & (t < t[0] + 5.0)
        pose = interpolate_poses(t[first], log.truth.t, log.truth.pose)
        line = log.map.params[table.truth[0], :2]
        error = nearest_twin(table.z[first], line_to_robot(line, pose)) - line_to_robot(line, pose)
        scatter[name] = np.std(error[:, 1])
    assert scatter["held"] < 0.1 * scatter["fresh"]
    _, erring = simulate_flawed(scenario, Flaws(map_rho_m=0.01, map_alpha_deg=0.5), 0)
    off = nearest_twin(erring.known.params[:, :2], log.map.params[:, :2]) - log.map.params[:, :2]
    assert 0.005 < np.std(off[:, 0]) < 0.02
    assert 0.25 < np.degrees(np.std(off[:, 1])) < 1.0
