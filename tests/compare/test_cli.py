"""The command line as users run it: exit codes, what is printed where, what is imported when."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, get_args

import pytest

from compare.cli import main, parse
from compare.config import Method, RunConfig, field_docs, load_config, to_toml
from compare.methods import METHODS, run_methods
from graphslam.config import EkfConfig, MatchingConfig, SmootherConfig
from graphslam.errors import BadConfig, UnderConstrained
from tests.compare.tiny_log import write_tiny_log
from tests.worlds import drive

HEAVY = ("numpy", "scipy", "numba", "cv2", "gtsam", "matplotlib", "jinja2")
SCENARIO = """format = "graphslam-scenario/1"
name = "short"
speed = 0.5
path = [{ forward = 0.5 }]

[[lines]]
rho = 0.3
alpha_deg = 0.0

[robot]
wheel_radius_left = 0.04
wheel_radius_right = 0.04
wheel_base = 0.2

[camera]
image_size = [64, 48]
rate = 4.0
view_width = 1.0
view_near = 0.2
view_far = 1.5
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_log(tmp_path_factory.mktemp("logs") / "tiny")


def error_line(capsys: pytest.CaptureFixture[str]) -> str:
    """Returns standard error, which must be one line of ours."""
    captured = capsys.readouterr().err
    assert captured.startswith("graphslam: error: ")
    assert captured.count("\n") == 1
    return captured


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["config"], ["--version"]])
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    program = (
        "import sys; from compare.cli import main; code = main(sys.argv[1:]); "
        f"print('loaded', [n for n in {HEAVY!r} if n in sys.modules]); sys.exit(code)"
    )
    command = [sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.endswith("loaded []\n")
    assert len(done.stdout.splitlines()) > 1


def test_run_prints_the_figures_the_verdict_and_where_the_report_is(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(log), "--out", str(tmp_path / "out")]) == 0
    captured = capsys.readouterr()
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    printed = " ".join(captured.out.split())
    assert " ".join(metrics["verdict"][0].split()) in printed
    for name in ("odometry", "ekf", "smoother"):
        assert name in printed
    assert captured.out.endswith(f"{tmp_path / 'out' / 'report.html'}\n")
    assert captured.err == ""


def test_results_go_to_a_folder_named_after_the_log(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(log), "--methods", "odometry"]) == 0
    assert (tmp_path / "results" / "tiny" / "report.html").is_file()


def test_flags_override_the_file_which_overrides_defaults(log: Path, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        "[extract]\nevery = 3\nto_s = 5.0\n[ekf.matching]\ngate = 9.0\ngate_new = 70.0\n"
    )
    flags = ["--config", str(file), "--to", "4", "--ekf.matching.gate", "11", "--matching", "known"]
    assert main(["run", str(log), *flags, "--methods", "ekf", "--out", str(tmp_path / "out")]) == 0
    info = json.loads((tmp_path / "out" / "run.json").read_text())
    assert info["methods"] == ["ekf"]
    assert {k: info["config"]["extract"][k] for k in ("from_s", "to_s", "every")} == {
        "from_s": None,
        "to_s": 4.0,
        "every": 3,
    }
    matching = info["config"]["ekf"]["matching"]
    assert matching["gate"] == 11.0
    assert matching["gate_new"] == 70.0
    assert matching["method"] == "known"
    assert matching["nearest_angle_deg"] == MatchingConfig().nearest_angle_deg
    assert info["nodes"] == 14  # of 0.0 to 4.0 s at 10 Hz every third


def test_how_to_match_has_short_flags_which_a_file_can_set_and_a_flag_take_back(
    tmp_path: Path,
) -> None:
    given = parse(["run", "log", "--matching", "jcbb", "--robust", "gnc", "--rematch"]).settings
    smoother = SmootherConfig(robust="gnc", rematch=True)
    ekf = EkfConfig(MatchingConfig(method="jcbb"))
    assert given == replace(RunConfig(), ekf=ekf, smoother=smoother)
    file = tmp_path / "mine.toml"
    file.write_text("[smoother]\nrematch = true\nrobust = 'huber'\n")
    settings = parse(["run", "log", "--config", str(file), "--no-rematch"]).settings
    assert settings == replace(RunConfig(), smoother=SmootherConfig(robust="huber"))


def test_an_equals_sign_names_the_config_file_too(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[ekf]\nlost_after = 7\n")
    settings = parse(["run", "log", f"--config={file}"]).settings
    assert settings == replace(RunConfig(), ekf=EkfConfig(lost_after=7))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["run", "extract", "simulate", "report", "config"]),
        (["fly"], ["fly"]),
        (["run"], ["needs a log"]),
        (["run", "log", "--methods", "magic"], ["magic", "odometry", "ekf", "smoother"]),
        (["run", "log", "--ekf.matching.gaet", "3"], ["--ekf.matching.gaet"]),
        (["run", "log", "--every", "often"], ["often"]),
        (["extract", "log"], ["--out"]),
        (["simulate", "sample"], ["--out"]),
    ],
)
def test_wrong_usage_exits_with_2_and_names_what_is_wrong(
    arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert all(word in captured.err for word in words)
    assert "Traceback" not in captured.err
    assert captured.out == ""


def test_a_log_that_cannot_be_used_is_one_line_and_exit_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(tmp_path / "nowhere")]) == 1
    assert "nowhere: does not exist" in error_line(capsys)


def test_an_unknown_key_in_the_config_file_is_one_line_with_the_nearest_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[ekf.matching]\ngaet = 9.0\n")
    assert main(["run", "log", "--config", str(file)]) == 1
    line = error_line(capsys)
    assert "mine.toml" in line
    assert "ekf.matching.gaet" in line
    assert "'gate'" in line


def test_a_value_that_cannot_be_used_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "log", "--every", "0"]) == 1
    assert "every = 0" in error_line(capsys)


def test_a_foreign_folder_is_refused_in_one_line(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "precious.txt").write_text("mine")
    assert main(["run", str(log), "--out", str(tmp_path)]) == 1
    assert "--out" in error_line(capsys)
    assert [p.name for p in tmp_path.iterdir()] == ["precious.txt"]


def test_a_folder_that_cannot_be_written_is_one_line(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["extract", str(log), "--out", str(tmp_path / "file" / "out")]) == 1
    assert f"{tmp_path / 'file'}" in error_line(capsys)


def test_some_of_several_failing_exits_with_3_and_the_rest_is_done(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, quick = tmp_path / "out", ["--methods", "odometry"]
    assert main(["run", str(log), str(tmp_path / "no"), *quick, "--out", str(out)]) == 3
    assert error_line(capsys).count(str(tmp_path / "no")) == 1
    assert (out / "tiny" / "report.html").is_file()
    assert (out / "index.html").is_file()


def test_all_of_several_failing_exits_with_1(tmp_path: Path) -> None:
    missing = [str(tmp_path / "a"), str(tmp_path / "b")]
    assert main(["run", *missing, "--out", str(tmp_path / "out")]) == 1


def test_an_interrupt_exits_with_130_and_leaves_nothing(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("compare.run.write_report", interrupted)
    assert main(["run", str(log), "--methods", "odometry", "--out", str(tmp_path / "out")]) == 130
    assert list(tmp_path.iterdir()) == []
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("wanted", [False, True])
def test_a_defect_asks_to_be_reported_and_shows_its_traceback_on_request(
    log: Path,
    tmp_path: Path,
    wanted: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("of our own making")

    monkeypatch.setattr("compare.run.run_methods", broken)
    monkeypatch.setenv("GRAPHSLAM_TRACEBACK", "1" if wanted else "0")
    assert main(["run", str(log), "--out", str(tmp_path / "out")]) == 1
    captured = capsys.readouterr().err
    assert "ZeroDivisionError: of our own making" in captured
    assert "GRAPHSLAM_TRACEBACK=1" in captured
    assert "report it" in captured
    assert ("Traceback" in captured) == wanted


def test_extract_prints_what_it_saw(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["extract", str(log), "--out", str(tmp_path / "out"), "--every", "2"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("tiny: 30 nodes, sightings: ")
    assert printed.endswith(f"{tmp_path / 'out'}\n")


def test_report_writes_the_page_again(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(log), "--methods", "odometry", "--out", str(out)]) == 0
    (out / "report.html").unlink()
    capsys.readouterr()
    assert main(["report", str(out)]) == 0
    assert capsys.readouterr().out == f"{out / 'report.html'}\n"
    assert (out / "report.html").is_file()


def test_report_of_mere_measurements_says_to_run(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["extract", str(log), "--out", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    assert main(["report", str(tmp_path / "out")]) == 1
    assert "graphslam run" in error_line(capsys)


def test_simulate_records_a_log_that_run_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "short.toml").write_text(SCENARIO)
    log = tmp_path / "log"
    arguments = ["simulate", str(tmp_path / "short.toml"), "--out", str(log), "--seed", "3"]
    assert main(arguments) == 0
    assert capsys.readouterr().out == f"{log}\n"
    assert main(["run", str(log), "--methods", "odometry", "--out", str(tmp_path / "out")]) == 0


def test_an_unknown_scenario_names_the_nearest_shipped_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "smaple", "--out", str(tmp_path / "log")]) == 1
    assert "sample" in error_line(capsys)


def test_config_prints_every_default_with_its_meaning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config"]) == 0
    printed = capsys.readouterr().out
    tomllib.loads(printed)
    file = tmp_path / "defaults.toml"
    file.write_text(printed)
    assert load_config(file) == RunConfig()
    for name, doc in every_field(RunConfig()):
        assert name in printed
        assert doc.split()[0] in printed


def test_every_setting_has_a_docstring() -> None:
    assert [name for name, doc in every_field(RunConfig()) if not doc] == []


def test_changed_settings_survive_the_way_through_toml(tmp_path: Path) -> None:
    matching = MatchingConfig(method="nearest", gate=9.5)
    config = RunConfig(methods=("ekf", "odometry"), ekf=EkfConfig(matching, lost_after=0))
    file = tmp_path / "mine.toml"
    file.write_text(to_toml(config))
    assert load_config(file) == config


def test_the_methods_of_the_configuration_are_those_there_are() -> None:
    assert tuple(METHODS) == get_args(Method)
    assert set(RunConfig().methods) <= set(METHODS)
    with pytest.raises(BadConfig, match="methods is empty"):
        RunConfig(methods=())
    assert RunConfig(methods=("ekf", "ekf")).methods == ("ekf",)


def test_an_unknown_method_lists_the_known_ones() -> None:
    measurements, _ = drive(1, 5)
    config = RunConfig(methods=("ekf", "magic"))  # type: ignore[arg-type]
    with pytest.raises(BadConfig, match=r"'magic'.*odometry, geometric, ekf, .*smoother"):
        run_methods(measurements, config, lambda name, work: work())


def every_field(config: Any) -> list[tuple[str, str]]:
    """Returns name and docstring of every setting that is not a table, at all depths."""
    found, docs = [], field_docs(type(config))
    for f in fields(config):
        value = getattr(config, f.name)
        found += every_field(value) if is_dataclass(value) else [(f.name, docs.get(f.name, ""))]
    return found


def test_an_unfinished_optimisation_is_said_beside_the_figures(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["run", str(log), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--smoother.max-iterations", "1"]) == 0
    told = capsys.readouterr()
    assert ": smoother did not converge in 1 iterations" in told.err
    assert "did not converge" not in told.out
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["alarms"] == [s for s in metrics["verdict"] if "did not converge" in s]
    assert '<li class="warn">smoother did not converge' in (
        tmp_path / "out" / "report.html"
    ).read_text(encoding="utf-8")


def test_a_method_that_fails_leaves_the_others_their_results(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def undetermined(*_: object) -> None:
        raise UnderConstrained("nothing fixes line 3; look at it")

    failing = {**METHODS, "smoother": replace(METHODS["smoother"], run=undetermined)}
    monkeypatch.setattr("compare.methods.METHODS", failing)
    out = tmp_path / "out"
    assert main(["run", str(log), "--out", str(out)]) == 1
    told = capsys.readouterr().err
    assert "warning: tiny: smoother failed: nothing fixes line 3; look at it" in told
    assert (out / "ekf" / "map.csv").is_file()
    assert not (out / "smoother").exists()
    assert "smoother failed" in (out / "report.html").read_text()
    only = ["run", str(log), "--out", str(tmp_path / "only"), "--methods", "smoother"]
    assert main(only) == 1
    assert error_line(capsys) == "graphslam: error: nothing fixes line 3; look at it\n"
