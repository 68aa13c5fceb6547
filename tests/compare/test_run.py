"""The folder of a run: its files, their bytes, and how it comes to its place."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from compare import run as run_module
from compare.cli import main
from compare.config import RunConfig
from compare.report_tables import number
from compare.run import RunResult, extract_log, run_log
from compare.run_many import run_logs
from frontend.extract import extract
from frontend.log import open_log
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.measurements import Measurements
from tests.compare.tiny_log import write_tiny_log

METHOD_FILES = {"trajectory.tum", "trajectory.csv", "map.csv", "matches.csv", "estimate.npz"}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_log(tmp_path_factory.mktemp("logs") / "tiny")


@pytest.fixture(scope="module")
def result(log: Path, tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    return run_log(log, tmp_path_factory.mktemp("results") / "tiny")


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def files_of(folder: Path) -> dict[str, bytes]:
    paths = sorted(p for p in folder.rglob("*") if p.is_file())
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in paths}


def without_timings(files: dict[str, bytes]) -> dict[str, bytes]:
    """Drops timings.json and the report's one marked block, which must be there once."""
    files = dict(files)
    del files["timings.json"]
    block = re.compile(rb"<!-- timings -->.*?<!-- /timings -->", re.DOTALL)
    files["report.html"], count = block.subn(b"", files["report.html"])
    assert count == 1
    return files


def test_a_run_writes_every_file_of_the_design(result: RunResult) -> None:
    names = set(files_of(result.folder))
    expected = {"run.json", "measurements.npz", "sightings.csv", "metrics.json", "timings.json"}
    expected |= {"report.html", "truth.npz", "plots/floor-plan.svg", "plots/errors.svg"}
    expected |= {f"{m}/{f}" for m in ("odometry", "ekf", "smoother") for f in METHOD_FILES}
    assert expected <= names
    assert {n for n in names - expected if not n.startswith("plots/")} == set()


def test_two_processes_write_the_same_bytes_but_for_timings(
    result: RunResult, log: Path, tmp_path: Path
) -> None:
    moved = shutil.copytree(log, tmp_path / "elsewhere" / "tiny")
    out = tmp_path / "other place" / "second"
    program = "import sys; from compare.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", program, "run", str(moved), "--out", str(out)]
    environment = os.environ | {"PYTHONHASHSEED": "7"}
    subprocess.run(command, env=environment, capture_output=True, timeout=300, check=True)
    assert without_timings(files_of(out)) == without_timings(files_of(result.folder))


def test_no_file_says_where_log_or_result_lie(result: RunResult, log: Path) -> None:
    for name, content in files_of(result.folder).items():
        for place in (log.parent, result.folder.parent):
            assert str(place).encode() not in content, name


def test_run_json_says_what_was_computed_from_what(result: RunResult) -> None:
    info = json.loads((result.folder / "run.json").read_text())
    assert info["log"] == {"name": "tiny", "digest": result.log.digest, "start_given": True}
    assert info["methods"] == ["odometry", "ekf", "smoother"]
    assert info["config"]["ekf"]["matching"]["gate"] == RunConfig().ekf.matching.gate
    assert info["nodes"] == 60
    assert info["sightings"] == {"line": result.measurements.sighting_count}
    assert set(info["versions"]) >= {"floorline-slam", "numpy", "gtsam", "python"}
    assert "seed" in info


def test_saved_measurements_and_estimates_are_those_returned(result: RunResult) -> None:
    loaded = Measurements.load(result.folder / "measurements.npz")
    assert np.array_equal(loaded.odometry.increment, result.measurements.odometry.increment)
    for name, estimate in result.estimates.items():
        saved = Estimate.load(result.folder / name / "estimate.npz")
        assert np.array_equal(saved.pose, estimate.pose)
        assert np.array_equal(saved.cov_joint, estimate.cov_joint)


def test_trajectory_csv_holds_poses_and_covariances_exactly(result: RunResult) -> None:
    estimate = result.estimates["smoother"]
    rows = rows_of(result.folder / "smoother" / "trajectory.csv")
    assert ",".join(rows[0]) == "t,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt"
    table = np.array([[float(v) for v in row.values()] for row in rows])
    upper = estimate.cov_floor[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    assert np.array_equal(table, np.column_stack([estimate.t, estimate.pose, upper]))


def test_trajectory_tum_holds_the_same_poses_as_quaternions(result: RunResult) -> None:
    estimate = result.estimates["ekf"]
    table = np.loadtxt(result.folder / "ekf" / "trajectory.tum")
    assert np.array_equal(table[:, :3], np.column_stack([estimate.t, estimate.pose[:, :2]]))
    assert np.array_equal(table[:, 3:6], np.zeros((60, 3)))
    heading = 2.0 * np.arctan2(table[:, 6], table[:, 7])
    assert np.allclose(np.exp(1j * heading), np.exp(1j * estimate.pose[:, 2]), atol=1e-12)


def test_matches_csv_names_landmarks_by_their_number_in_map_csv(result: RunResult) -> None:
    estimate, table = result.estimates["ekf"], result.measurements.sightings["line"]
    rows = rows_of(result.folder / "ekf" / "matches.csv")
    assert ",".join(rows[0]) == "t,node,kind,sighting,landmark,true_landmark,nis,weight"
    assert len(rows) == len(table)
    numbers = {row["line"] for row in rows_of(result.folder / "ekf" / "map.csv")}
    for i, row in enumerate(rows):
        assert (row["kind"], int(row["sighting"])) == ("line", i)
        assert int(row["node"]) == table.node[i]
        assert float(row["t"]) == result.measurements.t[table.node[i]]
        assert int(row["true_landmark"]) == table.truth[i]
        matched = estimate.match[i]
        assert int(row["landmark"]) == (estimate.map.id[matched] if matched >= 0 else -1)
        assert row["landmark"] in numbers or row["landmark"] == "-1"
        assert (row["nis"] == "") == bool(np.isnan(estimate.nis[i]))


def test_map_csv_is_canonical_and_serves_as_the_map_of_a_log(
    result: RunResult, log: Path, tmp_path: Path
) -> None:
    path = result.folder / "smoother" / "map.csv"
    header = "line,rho,alpha,cov_rr,cov_ra,cov_aa,s_min,s_max,sightings"
    assert ",".join(rows_of(path)[0]) == header
    other = shutil.copytree(log, tmp_path / "log")
    (other / "sightings.csv").unlink()
    shutil.copy(path, other / "map.csv")
    lines = open_log(other).map
    estimated = result.estimates["smoother"].map
    assert lines is not None
    assert np.array_equal(lines.params, estimated.params)
    assert np.array_equal(lines.extent, estimated.extent)
    assert (lines.params[:, 0] >= 0).all()


def test_sightings_csv_gives_the_same_measurements_when_put_into_the_log(
    result: RunResult, log: Path, tmp_path: Path
) -> None:
    other = shutil.copytree(log, tmp_path / "log")
    shutil.copy(result.folder / "sightings.csv", other / "sightings.csv")
    before, after = (
        result.measurements.sightings["line"],
        extract(open_log(other)).sightings["line"],
    )
    for name in ("node", "z", "cov", "extent", "t_received", "truth"):
        assert np.array_equal(getattr(before, name), getattr(after, name)), name


def test_a_method_that_another_starts_from_gets_no_folder_unasked(
    log: Path, result: RunResult, tmp_path: Path
) -> None:
    alone = run_log(log, tmp_path / "out", RunConfig(methods=("smoother",)))
    assert list(alone.estimates) == ["smoother"]
    assert not (tmp_path / "out" / "ekf").exists()
    assert np.array_equal(alone.estimates["smoother"].pose, result.estimates["smoother"].pose)


def test_extract_writes_measurements_as_run_does_and_nothing_more(
    result: RunResult, log: Path, tmp_path: Path
) -> None:
    extract_log(log, tmp_path / "out")
    files = files_of(tmp_path / "out")
    assert set(files) == {"run.json", "measurements.npz", "sightings.csv"}
    for name in ("measurements.npz", "sightings.csv"):
        assert files[name] == (result.folder / name).read_bytes()


def test_a_folder_that_is_not_of_a_run_is_refused_and_left_alone(log: Path, tmp_path: Path) -> None:
    folder = tmp_path / "thesis"
    folder.mkdir()
    (folder / "chapter1.txt").write_text("mine")
    (folder / "run.json").write_text('{"format": "somebody else\'s"}')
    before = files_of(folder)
    with pytest.raises(BadConfig, match=r"thesis.*not replaced.*--out"):
        run_log(log, folder)
    assert files_of(folder) == before
    assert [p.name for p in tmp_path.iterdir()] == ["thesis"]


def test_a_run_replaces_an_earlier_one_and_leaves_nothing_else(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run_log(log, out)
    (out / "stale.txt").write_text("of the earlier run")
    run_log(log, out, RunConfig(methods=("odometry",)))
    assert not (out / "stale.txt").exists()
    assert not (out / "ekf").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_run_that_fails_while_writing_leaves_the_earlier_result(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    run_log(log, out, RunConfig(methods=("odometry",)))
    before = files_of(out)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "report.html")

    monkeypatch.setattr(run_module, "write_report", full)
    with pytest.raises(OSError, match="No space left"):
        run_log(log, out)
    assert files_of(out) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_several_logs_go_on_after_a_failure_and_get_an_index(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "all"
    quick = RunConfig(methods=("odometry",))
    outcomes = run_logs([log, tmp_path / "nowhere", log], out, quick)
    assert [o.result is not None for o in outcomes] == [True, False, True]
    assert sorted(p.name for p in out.iterdir()) == ["index.html", "tiny", "tiny-2"]
    index = (out / "index.html").read_text()
    assert 'href="tiny/report.html"' in index
    assert 'href="tiny-2/report.html"' in index
    assert "nowhere: does not exist" in index


def test_an_index_of_somebody_else_is_not_overwritten(log: Path, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("<html>my home page</html>")
    with pytest.raises(BadConfig, match=r"index\.html"):
        run_logs([log, log], tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["index.html"]


def test_without_gtsam_the_smoother_says_what_to_do_and_the_filter_runs(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [n for n in sys.modules if n.partition(".")[0] == "gtsam"]:
        monkeypatch.delitem(sys.modules, name)
    for name in [n for n in sys.modules if n.startswith("graphslam.smoother")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(BadConfig, match=r"GTSAM.*--methods odometry ekf"):
        run_log(log, tmp_path / "all")
    run_log(log, tmp_path / "two", RunConfig(methods=("odometry", "ekf")))
    assert [p.name for p in tmp_path.iterdir()] == ["two"]


def test_progress_names_the_log_and_ends_every_stage(log: Path, tmp_path: Path) -> None:
    seen: list[tuple[str, int, int]] = []
    run_log(log, tmp_path / "out", progress=lambda *step: seen.append(step))
    stages = list(dict.fromkeys(stage for stage, _, _ in seen))
    expected = ["extract", "odometry", "ekf", "smoother", "compare", "thumbnails", "write"]
    expected += ["report"]
    assert stages == [f"tiny: {name}" for name in expected]
    last = {stage: (done, total) for stage, done, total in seen}
    assert all(done == total for done, total in last.values())


def test_methods_that_go_from_node_to_node_tell_how_long_a_node_took(tmp_path: Path) -> None:
    log = write_tiny_log(tmp_path / "log", nodes=30)
    methods = ("odometry", "ekf", "isam2", "fixed-lag", "smoother")
    result = run_log(log, tmp_path / "out", RunConfig(methods=methods))
    assert tuple(result.estimates) == methods
    latency = json.loads((result.folder / "timings.json").read_text())["latency"]
    assert set(latency) == {"ekf", "isam2", "fixed-lag"}
    for figures in latency.values():
        assert 0 < figures["median_ms"] <= figures["p99_ms"] <= figures["worst_ms"]
    page = (result.folder / "report.html").read_text()
    block = page.split("<!-- timings -->")[1].split("<!-- /timings -->")[0]
    assert f"{latency['isam2']['median_ms']:.2f}" in block
    rows = [re.findall(r"<td>(.*?)</td>", row) for row in block.split("<tr>")]
    rows = [row for row in rows if len(row) == 8]
    told = [row[1] for row in rows]
    assert told == ["0", "0", "0", f"{RunConfig().incremental.lag_s:g}", "whole log"]
    judged = json.loads((result.folder / "metrics.json").read_text())["methods"]
    path = [judged[name]["trajectory"]["aligned_rmse_m"] for name in methods]
    assert [row[2] for row in rows] == [number(1e3 * error) for error in path]
    assert [row[4] == "–" for row in rows] == [True, False, False, False, True]


def test_check_holds_both_engines_against_each_other_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = write_tiny_log(tmp_path / "log", nodes=30), tmp_path / "out"
    assert main(["run", str(log), "--check", "--out", str(out)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "The engines gtsam and chain agree" in told
    info = json.loads((out / "run.json").read_text())
    assert info["engine"] == {"smoother": "gtsam"}
    assert info["check"] in told
    assert info["check"] in (out / "report.html").read_text()
