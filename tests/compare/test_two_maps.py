"""`graphslam compare` and `graphslam merge` as a user runs them."""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from compare.cli import main
from compare.map_files import read_map_file
from compare.merge import merge_maps
from compare.two_maps import compare_maps
from compare.two_maps_relation import relation
from compare.two_maps_sources import open_source, open_sources
from compare.two_maps_words import millimetres, verdict
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.geometry import between, line_to_robot
from tests.compare.tiny_log import write_tiny_log
from tests.worlds import GRID, START


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs and results of two days on one floor; the second day's start is not told."""
    folder = tmp_path_factory.mktemp("home")
    for day, seed in (("monday", 1), ("friday", 2)):
        log = write_tiny_log(folder / "logs" / day, seed, nodes=130, name=day)
        if day == "friday":
            toml = (log / "log.toml").read_text().split("[start]")[0]
            (log / "log.toml").write_text(toml)
        assert main(["run", str(log), "--out", str(folder / "results" / day)]) == 0
    return folder / "results"


def compare(capsys: pytest.CaptureFixture[str], *arguments: Path | str) -> tuple[int, str, str]:
    code = main(["compare", *map(str, arguments)])
    told = capsys.readouterr()
    return code, " ".join(told.out.split()), told.err


# ---- what is compared -------------------------------------------------------------------------


def test_a_run_stands_for_its_smoother_and_a_log_for_its_truth(home: Path) -> None:
    run, method = open_source(home / "monday"), open_source(home / "monday" / "ekf")
    truth = open_source(home.parent / "logs" / "monday")
    assert run.label == "monday (smoother)"
    assert method.label == "monday (ekf)"
    assert (run.certainty, truth.certainty) == ("joint", "exact")
    assert open_source(home / "monday" / "ekf" / "map.csv").certainty == "blocks"
    assert len(truth.map) == len(GRID)
    assert len(truth.t) == 130
    assert open_source(home.parent / "logs" / "monday" / "map.csv").label == truth.label
    path = open_source(home / "monday" / "ekf" / "trajectory.tum")
    assert (len(path.map), len(path.t)) == (0, 130)


def test_what_two_maps_have_in_common_decides_how_they_are_tested(home: Path) -> None:
    monday, ekf, friday, truth, copy = open_sources(
        (
            home / "monday",
            home / "monday" / "ekf",
            home / "friday",
            home.parent / "logs" / "monday",
            home / "monday" / "smoother" / "map.csv",
        )
    )
    assert relation(monday, ekf).same_measurements
    assert not relation(monday, ekf).independent
    assert not relation(monday, copy).independent
    assert relation(monday, friday).independent
    assert not relation(monday, friday).same_log
    assert relation(monday, truth).independent
    assert relation(monday, truth).same_log
    labels = [monday.label, ekf.label, friday.label, truth.label, copy.label]
    assert len(set(labels)) == 5


def test_the_same_floor_on_two_days_agrees_without_being_told_where_it_is(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    code, printed, errors = compare(capsys, home / "monday", home / "friday", "--out", out)
    assert (code, errors) == (0, "")
    assert "The maps agree" in printed
    assert "Found without a start value" in printed
    assert printed.endswith("report.html")
    content = json.loads((out / "comparison.json").read_text())
    [pair] = content["pairs"]
    motion = pair["motion"]
    expected = START  # monday's frame is the floor's own, friday's begins at the start
    assert np.hypot(motion["x_m"] - expected[0], motion["y_m"] - expected[1]) < 0.05
    assert pair["test"]["probability"] > 0.001
    assert pair["independent"]
    assert pair["path"] is None
    rows = (out / "lines.csv").read_text().splitlines()
    assert len(rows) == 1 + pair["alignment"]["matched"]


def test_filter_and_smoother_are_set_against_what_they_claim_and_not_called_independent(
    home: Path, tmp_path: Path
) -> None:
    folder = home / "monday"
    [pair] = compare_maps([folder / "ekf", folder / "smoother"], tmp_path / "out")
    assert pair.tied == "start"
    assert pair.test is not None
    assert pair.test.scale == 2.0
    assert verdict(pair).startswith("The maps are the same")
    assert " p " not in verdict(pair)
    assert pair.path is not None
    assert len(pair.path.t) == 130
    ekf, smoother = (Estimate.load(folder / m / "estimate.npz") for m in ("ekf", "smoother"))
    np.testing.assert_allclose(
        pair.path.difference[:, :2], smoother.pose[:, :2] - ekf.pose[:, :2], atol=1e-12
    )
    page = (tmp_path / "out" / "report.html").read_text()
    assert "correlated" in page
    assert page.count("<svg") == 3
    judged = json.loads((folder / "metrics.json").read_text())["methods"]
    rms = [millimetres(judged[m]["trajectory"]["aligned_rmse_m"]) for m in ("ekf", "smoother")]
    assert f"the paths are off by {rms[0]} and {rms[1]} RMS" in page


def test_a_result_against_the_truth_is_tied_by_the_clock_and_tested_by_its_own_covariance(
    home: Path,
) -> None:
    [pair] = compare_maps([home.parent / "logs" / "friday", home / "friday"])
    assert pair.tied == "path"
    assert pair.test is not None
    assert np.isnan(pair.test.own[0])
    assert pair.test.probability > 0.001
    assert pair.path is not None
    assert pair.alignment is not None
    true = between(np.zeros(3), START)
    np.testing.assert_allclose(pair.motion, true, atol=0.05)


def test_maps_without_covariances_are_measured_and_not_tested(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plans = []
    for name, frame in (("first", np.zeros(3)), ("second", np.array([1.0, 2.0, 0.5]))):
        lines = line_to_robot(GRID, frame)
        rows = [f"{k},{rho!r},{alpha!r}" for k, (rho, alpha) in enumerate(lines.tolist())]
        plans.append(tmp_path / f"{name}.csv")
        plans[-1].write_text("\n".join(["line,rho,alpha", *rows]) + "\n")
    code, printed, _ = compare(capsys, *plans, "--out", tmp_path / "out")
    assert code == 0
    assert "nothing is tested" in printed
    assert "8 lines in common, and no other" in printed
    content = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert content["pairs"][0]["test"]["probability"] is None
    code, printed, _ = compare(capsys, plans[0], home / "monday", "--out", tmp_path / "other")
    assert code == 0
    assert "says nothing about its uncertainty" in printed


def test_several_maps_are_all_held_against_the_first(home: Path, tmp_path: Path) -> None:
    pairs = compare_maps(
        [
            home.parent / "logs" / "monday",
            home / "monday" / "ekf",
            home / "monday",
            home / "friday",
        ],
        tmp_path / "out",
    )
    assert [pair.b.label for pair in pairs] == [
        "monday (ekf)",
        "monday (smoother)",
        "friday (smoother)",
    ]
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count('<section id="pair-') == 3
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    overview = page.split('id="overview"')[1].split("</section>")[0]
    assert [f'href="#pair-{k}"' in overview for k in (1, 2, 3)] == [True] * 3
    assert "χ² / freedom" in overview
    tables = (tmp_path / "out" / "lines.tex").read_text()
    assert tables.count(r"\begin{tabular}") == tables.count(r"\end{tabular}") == 3
    rows = [row.count("&") for row in tables.splitlines() if row.endswith(r"\\")]
    assert set(rows) == {9}
    assert len(rows) == 3 + sum(len(pair.test.matches) for pair in pairs if pair.test is not None)


def test_the_page_needs_no_network_and_is_the_same_each_time(home: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        compare_maps([home / "monday", home / "friday"], tmp_path / name)
    files = sorted(p.relative_to(tmp_path / "one") for p in (tmp_path / "one").rglob("*.*"))
    assert len(files) >= 7
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    page = (tmp_path / "one" / "report.html").read_text()
    outside = re.findall(r'(?:src|href)="(?!#|data:)([^"]+)"', page)
    assert outside == []


def test_a_notebook_shows_the_verdict_both_maps_and_every_line(home: Path) -> None:
    [pair] = compare_maps([home / "monday", home / "friday"])
    assert pair.test is not None
    shown = pair._repr_html_()
    assert verdict(pair) in shown
    assert shown.count("<svg") == 1
    assert shown.count("<tr>") == 1 + len(pair.test.matches)


def test_lines_that_only_one_map_has_are_named(home: Path, tmp_path: Path) -> None:
    rows = (home / "monday" / "smoother" / "map.csv").read_text().splitlines()
    less = tmp_path / "less.csv"
    less.write_text("\n".join([rows[0], *rows[2:]]) + "\n")
    [pair] = compare_maps([home / "monday", less])
    assert pair.a.line_id[pair.only_a].tolist() == [int(rows[1].split(",")[0])]
    assert pair.only_b.tolist() == []


# ---- what is refused --------------------------------------------------------------------------


def test_wrong_use_says_what_is_wrong(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, error = compare(capsys, home / "monday")
    assert code == 2
    assert "at least two" in error
    code, _, error = compare(capsys, home / "monday", home / "nothing", "--out", tmp_path / "o")
    assert code == 1
    assert "nothing" in error
    code, _, error = compare(capsys, home / "monday", home / "monday", "--out", tmp_path / "o")
    assert code == 1
    assert "given twice" in error
    mine = tmp_path / "mine"
    mine.mkdir()
    code, _, error = compare(capsys, home / "monday", home / "friday", "--out", mine)
    assert code == 1
    assert "is no earlier comparison" in error
    code, _, error = compare(
        capsys, home / "monday", home / "friday", "--near", "50", "50", "0", "--out", tmp_path / "o"
    )
    assert code == 1
    assert "--near" in error


def test_no_common_line_is_an_answer(home: Path, tmp_path: Path) -> None:
    lone = tmp_path / "lone.csv"
    lone.write_text("line,rho,alpha,s_min,s_max\n0,1.0,0.5,0.0,0.0\n")
    [pair] = compare_maps([home / "monday", lone], tmp_path / "out")
    assert pair.alignment is None
    assert "not maps of one floor" in verdict(pair)
    assert (tmp_path / "out" / "report.html").is_file()


# ---- merging ----------------------------------------------------------------------------------


def test_merged_maps_are_surer_than_either_and_keep_their_joint_covariance(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "floor.csv"
    arguments = ["merge", str(home / "monday"), str(home / "friday"), "--out", str(out)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "from both maps" in printed
    table, whole = read_map_file(out), read_map_file(tmp_path / "floor.npz")
    assert not table.joint
    assert whole.joint
    np.testing.assert_array_equal(table.landmarks.params, whole.landmarks.params)
    for row in range(len(table.landmarks)):
        np.testing.assert_allclose(table.landmark_cov(row), whole.landmark_cov(row))
    parent = open_source(home / "monday")
    shared = np.isin(table.landmarks.id, parent.line_id)
    assert shared.all()
    before = np.diagonal(parent.map.cov)
    assert np.all(np.diagonal(whole.cov) < before)
    told = json.loads((tmp_path / "floor.json").read_text())
    assert len(told["logs"]) == 2
    assert main(arguments) == 0  # an earlier merged map is replaced


@pytest.mark.parametrize(
    ("a", "b", "out", "said"),
    [
        ("monday/ekf", "monday/smoother", "m.csv", "count them twice"),
        ("monday", "friday", "m.txt", "ends in .csv"),
        ("monday", "monday/ekf/trajectory.tum", "m.csv", "no lines to merge"),
        ("monday", "friday", "mine.csv", "no merged map of ours"),
    ],
)
def test_maps_that_cannot_be_merged_are_refused(
    home: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    a: str,
    b: str,
    out: str,
    said: str,
) -> None:
    (tmp_path / "mine.csv").write_text("line,rho,alpha\n")
    assert main(["merge", str(home / a), str(home / b), "--out", str(tmp_path / out)]) == 1
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "m.csv").exists()


def test_a_merged_map_is_not_merged_with_its_parent_again(home: Path, tmp_path: Path) -> None:
    merge_maps(home / "monday", home / "friday", tmp_path / "floor.csv")
    with pytest.raises(BadConfig, match="twice"):
        merge_maps(home / "monday", tmp_path / "floor.npz")


def test_a_map_without_covariances_cannot_be_merged(home: Path, tmp_path: Path) -> None:
    plan = tmp_path / "plan.csv"
    plan.write_text("line,rho,alpha\n0,1.0,0.0\n1,1.0,1.57\n")
    with pytest.raises(BadConfig, match="cov_rr"):
        merge_maps(home / "monday", plan)


def lattice(path: Path, shift: float) -> Path:
    """Writes a map of a floor of 0.6 m tiles."""
    rho = 0.2 + 0.6 * np.arange(4) + shift
    rows = ["line,rho,alpha,cov_rr,cov_ra,cov_aa,s_min,s_max"]
    for k, (r, alpha) in enumerate([(r, a) for a in (0.0, np.pi / 2) for r in rho.tolist()]):
        reach = (shift, 2.3 + shift) if alpha == 0.0 else (-2.3 - shift, -shift)
        rows.append(f"{k},{r!r},{alpha!r},1e-6,0.0,1e-6,{reach[0]!r},{reach[1]!r}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_a_periodic_floor_is_merged_only_where_the_user_says_so(tmp_path: Path) -> None:
    a, b = lattice(tmp_path / "a.csv", 0.0), lattice(tmp_path / "b.csv", 0.1)
    with pytest.raises(BadConfig, match=r"repeat every 0\.600 m along 0° and 0\.600 m along 90°"):
        merge_maps(a, b)
    [pair] = compare_maps([a, b], tmp_path / "out")
    assert pair.choice is not None
    assert pair.choice.in_question == len(pair.alternatives) > 1
    found = json.loads((tmp_path / "out" / "comparison.json").read_text())["pairs"][0]["ambiguity"]
    assert len(found["equal"]) == len(pair.alternatives)
    page = (tmp_path / "out" / "report.html").read_text()
    listed = page.split("Alignments that fit equally well</h3>")[1].split("</section>")[0]
    assert listed.count("<tr>") == 1 + len(pair.alternatives)
    same = merge_maps(a, b, near=(-0.1, -0.1, 0.0))
    assert len(same.merged.map) == 8
    beside = merge_maps(a, b, near=(0.5, -0.1, 0.0))
    assert len(beside.merged.map) == 9


# ---- the page in docs -------------------------------------------------------------------------


def test_what_the_documentation_tells_to_run_runs(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(home.parent)
    page = Path(__file__).parents[2] / "docs" / "compare.md"
    found = re.findall(r"^```(\w+)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S)
    lines = [line for kind, text in found if kind == "sh" for line in text.splitlines()]
    assert len(lines) >= 7
    for line in lines:
        words = shlex.split(line, comments=True)
        assert main(words[1:]) == 0, line
    assert (home / "localised" / "report.html").is_file()
    for text in (text for kind, text in found if kind == "python"):
        exec(compile(text, "snippet", "exec"), {})


# ---- what the issue asks for ------------------------------------------------------------------


@pytest.fixture(scope="module")
def benchmark_module() -> ModuleType:
    path = Path(__file__).parents[2] / "benchmarks" / "map_comparison.py"
    spec = importlib.util.spec_from_file_location("map_comparison", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_a_turned_map_without_a_third_of_its_lines_is_found_and_merged(
    benchmark_module: ModuleType,
) -> None:
    for seed in range(2):
        outcome = benchmark_module.judge(seed)
        assert outcome.found
        assert outcome.matched[1] == 0
        assert outcome.ratio < 0.85
        assert outcome.test.probability > 0.001
        first, merged_first, second, merged_second = outcome.errors
        assert merged_first < 1.2 * first
        assert merged_second < 1.2 * second


def test_the_captured_floors_fit_up_to_their_period(shared_data: Path, tmp_path: Path) -> None:
    plans = [shared_data / "logs" / name / "map.csv" for name in ("square", "free")]
    copies = []
    for name, plan in zip(("a.csv", "b.csv"), plans, strict=True):
        copies.append(tmp_path / name)
        copies[-1].write_bytes(plan.read_bytes())
    [pair] = compare_maps(copies)
    assert pair.ambiguity is not None
    assert not pair.ambiguity.unique
    np.testing.assert_allclose(np.hypot(*pair.ambiguity.periods.T), 0.6, atol=0.005)
    assert pair.test is not None
    assert np.abs(pair.test.offset).max() < 0.005
