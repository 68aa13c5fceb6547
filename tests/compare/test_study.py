"""`graphslam study` and `graphslam simulate --no-images`, as users run them."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from compare.cli import main
from compare.config import RunConfig
from compare.montecarlo import FILE, SeededRun
from compare.study import Study, judge_seed, study
from compare.study_answers import answers
from compare.study_figures import STUDY_FIGURES
from frontend.log import open_log
from frontend.simulate import NoiseLevel, load_scenario, noisier, simulate_measurements

RUNS = 12


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def files_of(folder: Path) -> dict[str, bytes]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def scenario_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lap of `grid` with one frame a second, so that a run takes a fraction of a second."""
    text = (Path(__file__).parents[2] / "frontend" / "scenarios" / "grid.toml").read_text()
    path = tmp_path_factory.mktemp("scenario") / "lap.toml"
    for old, new in (
        ('name = "grid"', 'name = "lap"'),
        ("repeat = 2", ""),
        ("rate = 4.0", "rate = 1.0"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    path.write_text(text)
    return path


def command(scenario_file: Path, out: Path, *more: str) -> list[str]:
    return [
        "study",
        str(scenario_file),
        "--out",
        str(out),
        "--runs",
        str(RUNS),
        "--jobs",
        "2",
        *more,
    ]


@pytest.fixture(scope="module")
def uninterrupted(
    scenario_file: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, bytes]:
    out = tmp_path_factory.mktemp("study") / "whole"
    assert main(command(scenario_file, out)) == 0
    return files_of(out)


SHOWING_PROGRESS = """
import sys
from pathlib import Path
from compare.study import study
from frontend.simulate import NoiseLevel, load_scenario, noisier, simulate_measurements
show = lambda stage, done, of: print(done, of, flush=True)
study(load_scenario(sys.argv[1]), int(sys.argv[3]), Path(sys.argv[2]), jobs=2, progress=show)
"""


def test_killed_study_goes_on_to_the_same_bytes(
    scenario_file: Path, uninterrupted: dict[str, bytes], tmp_path: Path
) -> None:
    out = tmp_path / "killed"
    program = [sys.executable, "-c", SHOWING_PROGRESS, str(scenario_file), str(out), str(RUNS)]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        shown = [process.stdout.readline().split() for _ in range(5)]
        process.kill()  # somewhere in the runs after the fourth
    assert shown == [[str(done), str(RUNS)] for done in range(5)]
    finished = (out / FILE).read_bytes().count(b"\n") - 1
    assert 4 <= finished < RUNS
    assert not (out / "runs.csv").exists()
    with (out / FILE).open("a") as stream:
        stream.write('{"run": 11, "val')  # a kill may also strike in the middle of a line
    assert main(command(scenario_file, out)) == 0
    assert files_of(out) == uninterrupted


def test_number_of_workers_changes_no_byte(
    scenario_file: Path, uninterrupted: dict[str, bytes], tmp_path: Path
) -> None:
    out = tmp_path / "one"
    assert main(command(scenario_file, out, "--jobs", "1")) == 0
    assert files_of(out) == uninterrupted


def test_tables_hold_each_run_and_method_and_their_summary(
    scenario_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = command(scenario_file, out, "--methods", "odometry", "ekf", "--matching", "known")
    assert main([*arguments, "--runs", "3"]) == 0
    rows = table(out / "runs.csv")
    assert [(row["run"], row["method"]) for row in rows] == [
        (str(run), method) for run in range(3) for method in ("odometry", "ekf")
    ]
    bounds = ["bound_path_m", "bound_final_m", "bound_heading_deg", "bound_map_m"]
    assert list(rows[0])[3:] == [*(figure.name for figure in STUDY_FIGURES), *bounds]
    assert all(float(row["bound_path_m"]) > 0.0 for row in rows)
    filtered = [row for row in rows if row["method"] == "ekf"]
    assert all(float(row["right_share"]) == 1.0 for row in filtered)
    assert all(row["map_nees"] == "" for row in rows if row["method"] == "odometry")
    errors = sorted(float(row["rmse_m"]) for row in filtered)
    summary = {(row["method"], row["figure"]): row for row in table(out / "summary.csv")}
    entry = summary["ekf", "rmse_m"]
    assert float(entry["median"]) == errors[1]
    assert float(entry["mean"]) == pytest.approx(sum(errors) / 3)
    assert float(entry["worst"]) == errors[2]
    assert summary["odometry", "map_nees"]["runs"] == "0"
    lines = [float(row["matched"]) for row in filtered]
    assert float(summary["ekf", "matched"]["worst"]) == min(lines)
    about = json.loads((out / "study.json").read_text())
    assert about["config"]["ekf"]["matching"]["method"] == "known"
    assert (about["scenario"]["name"], about["runs"]) == ("lap", 3)
    printed = capsys.readouterr().out
    assert "lap: 3 of 3 runs" in printed
    assert "pose NEES" in printed
    assert printed.rstrip().endswith("report.html")


def test_other_settings_do_not_go_on_in_the_same_folder(
    scenario_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    few = ["--runs", "1", "--methods", "odometry"]
    assert main(command(scenario_file, out, *few)) == 0
    before = files_of(out)
    assert main(command(scenario_file, out, "--runs", "1", "--methods", "ekf")) == 1
    assert "another scenario, configuration or version; give another --out" in (
        capsys.readouterr().err
    )
    assert files_of(out) == before


def test_foreign_folder_is_refused(
    scenario_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    assert main(command(scenario_file, tmp_path)) == 1
    assert f"holds no {FILE} of ours" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_failed_runs_are_told_and_left_out_of_the_table(
    scenario_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(command(scenario_file, out, "--runs", "2", "--from", "1e6")) == 1
    captured = capsys.readouterr()
    assert "run 0 failed: nothing of lap lies between from_s = 1000000.0" in captured.err
    assert "lap: 0 of 2 runs" in captured.out
    assert table(out / "runs.csv") == []


def test_study_gives_the_same_in_memory_and_writes_nothing_without_a_folder(
    scenario_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scenario, config = load_scenario(scenario_file), RunConfig(methods=("ekf",))
    result = study(scenario, 2, None, config, jobs=2)
    assert result.failed == ()
    for run in result.runs:
        assert run.values["ekf.matched"] == 12
        alone = judge_seed(scenario, config, run.run)
        assert dict(run.values) == pytest.approx(alone, rel=1e-9)
    assert list(tmp_path.iterdir()) == []


# ---- simulate --no-images ----------------------------------------------------------------------


def test_simulate_without_images_writes_a_log_that_run_takes(
    scenario_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / "log", tmp_path / "out"
    assert main(["simulate", str(scenario_file), "--out", str(log), "--no-images"]) == 0
    assert capsys.readouterr().out.strip() == str(log)
    assert sorted(path.name for path in log.iterdir()) == [
        "groundtruth.tum",
        "log.toml",
        "map.csv",
        "sightings.csv",
        "wheels.csv",
    ]
    assert open_log(log).warnings == ()
    assert main(["run", str(log), "--out", str(out), "--methods", "ekf"]) == 0
    metrics = json.loads((out / "metrics.json").read_text())["methods"]["ekf"]
    judged = judge_seed(load_scenario(scenario_file), RunConfig(methods=("ekf",)), 0)
    assert metrics["map"]["matched"] == judged["ekf.matched"] == 12
    assert metrics["pose_nees"] == pytest.approx(judged["ekf.pose_nees"], rel=1e-9)


# ---- levels of noise ---------------------------------------------------------------------------


def test_levels_of_noise_are_judged_apart_and_the_file_runs_again_to_the_same_bytes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a floor where a robot is blind between lines, the right answers are known."""
    out, again = tmp_path / "out", tmp_path / "again"
    methods = ["ekf", "ekf-robot", "smoother"]
    arguments = ["--runs", "3", "--noise", "1", "7.5:4", "--methods", *methods, "--jobs", "2"]
    known = ["--matching", "known"]
    assert main(["study", "narrow-grid", "--out", str(out), *arguments, *known]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    low, high = printed.split("Noise 7.5:4: ", 1)
    assert "Noise 1: smooth: it cuts the error by" in low
    assert re.search(r"the filter is enough for the last pose \([^;]*; from the common start\)"
                     r" and map \([^;]*; after its own rigid motion\)", low)  # fmt: skip
    cut = re.search(r"(\d+)% for the path \([\d.]+ mm against [\d.]+ mm; aligned\)", high)
    assert cut is not None
    assert int(cut[1]) >= 35
    assert "ekf is overconfident by a factor" in high
    nees = {(r["noise"], r["method"]): r for r in table(out / "summary.csv")
            if r["figure"] == "map_start_nees"}  # fmt: skip
    assert (
        float(nees["7.5:4", "ekf"]["mean"]) > 5.0 > 3.0 > float(nees["7.5:4", "ekf-robot"]["mean"])
    )
    near = {(r["noise"], r["method"], r["quantity"]): r for r in table(out / "efficiency.csv")}
    assert float(near["1", "smoother", "path"]["efficiency"]) < 1.4  # of three runs only
    curves = table(out / "consistency.csv")
    assert {row["state"] for row in curves} == {"x", "y", "heading", "pose", "innovation"}
    assert {r["method"] for r in curves if r["state"] == "innovation"} == {"ekf", "ekf-robot"}
    assert main(["study", str(out / "study.json"), "--out", str(again), "--jobs", "2"]) == 0
    assert files_of(again) == files_of(out)


def test_lines_of_one_direction_are_to_be_crossed_before_any_method_is_chosen() -> None:
    said = answers(study(load_scenario("one-direction"), 2, None, jobs=1))
    start = "do neither before adding a second line direction: in 2 of 2 runs no line fixes the"
    assert said[0].startswith(start)
    assert re.search(r"on average (8[89]|9[012])° \(floor frame\)", said[0])


def test_methods_are_compared_by_the_figures_that_a_runs_verdict_compares() -> None:
    """A path that is turned as a whole is no worse along its lines: alignment takes that out."""
    columns = {"rmse_m": (0.134, 0.104), "aligned_rmse_m": (0.048, 0.019),
               "final_error_m": (0.030, 0.027), "map_rmse_m": (0.0096, 0.0094)}  # fmt: skip
    values = {f"{m}.{name}": pair[k] for name, pair in columns.items()
              for k, m in enumerate(("ekf", "smoother"))}  # fmt: skip
    runs = tuple(SeededRun(n, values) for n in range(2))
    (said,) = answers(Study("made", ("ekf", "smoother"), (NoiseLevel(),), runs, ()))
    assert said == (
        "smooth: it cuts the error by 60% for the path (48 mm against 19 mm; aligned); the filter "
        "is enough for the last pose (30 mm against 27 mm; from the common start) and map (9.6 mm "
        "against 9.4 mm; after its own rigid motion). (RMS over 2 runs, the filter's error first; "
        "a difference matters above 20% and 1 mm.)"
    )


def test_a_level_that_is_no_factor_is_refused(
    scenario_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for wrong in ("much", "-1", "1:0"):
        assert main(command(scenario_file, tmp_path / "out", f"--noise={wrong}")) == 1
        assert "one positive factor for all noise, as 2" in capsys.readouterr().err
    file = tmp_path / "study.json"
    file.write_text("{}")
    assert main(["study", str(file), "--out", str(tmp_path / "out")]) == 1
    assert "is no study.json of ours" in capsys.readouterr().err


def test_a_level_multiplies_all_noise_stated_and_drawn() -> None:
    scenario = load_scenario("narrow-grid")
    quiet = simulate_measurements(scenario, 3)
    loud = simulate_measurements(noisier(scenario, NoiseLevel.parse("2:3")), 3)
    stated = [m.sightings["line"].cov for m in (quiet, loud)]
    np.testing.assert_allclose(stated[1], 9.0 * stated[0])
    wheels = [m.odometry.wheel_angle for m in (quiet, loud)]
    assert wheels[0] is not None
    assert wheels[1] is not None
    true = wheels[0] - (wheels[1] - wheels[0])
    exact = simulate_measurements(noisier(scenario, NoiseLevel(1e-9, 1.0)), 3)
    np.testing.assert_allclose(true, exact.odometry.wheel_angle, atol=1e-6)
    assert str(NoiseLevel.parse("2.5:2")) == "2.5:2"
    assert str(NoiseLevel.parse("2")) == "2"
