"""A batch: which logs, what is computed and what kept, its tables, and what failures cost."""

from __future__ import annotations

import csv
import html
import json
import math
import os
import shutil
import statistics
import sys
import threading
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from compare import batch_workers
from compare.batch import _watched, batch, duration
from compare.batch_inputs import find_logs
from compare.batch_job import Done, Job, do, reason_of
from compare.batch_lock import alone_at
from compare.batch_table import Failure, Row, duels, read_result, summarise
from compare.batch_workers import DIED, in_processes, on_cluster
from compare.cli import main
from compare.config import RunConfig
from frontend.write_bag import write_bag
from graphslam.errors import BadConfig, GraphSlamError
from tests.compare.batch_logs import QUICK, computed, corrupt, final_files, write_logs
from tests.compare.tiny_log import write_tiny_log
from tests.frontend.recordings import short_log, write_folder, write_robot_file


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three logs and a corrupt one."""
    folder = write_logs(tmp_path_factory.mktemp("logs"), 4)
    corrupt(folder / "log-3")
    return folder


def command(logs: Path, out: Path, *more: str) -> list[str]:
    quick = ["--jobs", "2", "--no-reports", "--methods", *QUICK]
    return ["batch", str(logs), "--out", str(out), *quick, *more]


@pytest.fixture(scope="module")
def done(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("batch") / "out"
    assert main(command(logs, out)) == 3
    return out


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def job(log: Path, folder: Path, **changes: Any) -> Job:
    """One job whose journal is beside its result."""
    plain = Job(0, log, folder, RunConfig(methods=("ekf",)), False, (), folder.parent / "journal")
    return replace(plain, **changes)


# ---- which logs --------------------------------------------------------------------------------


def test_folders_patterns_and_lists_name_logs_once_and_in_order(tmp_path: Path) -> None:
    write_logs(tmp_path / "a", 2)
    other = shutil.copytree(tmp_path / "a" / "log-1", tmp_path / "b" / "log-1")
    (tmp_path / "b" / "notes.md").write_text("not a log")
    (tmp_path / "list.txt").write_text("# mine\n\nb/log-1\na/log-?\n")
    one, two = tmp_path / "a" / "log-0", tmp_path / "a" / "log-1"
    assert [log.path for log in find_logs([one])] == [one]
    assert [log.path for log in find_logs([tmp_path / "a"])] == [one, two]
    assert [log.path for log in find_logs([tmp_path / "?" / "log-1"])] == [two, other]
    listed = find_logs([tmp_path / "list.txt", one, tmp_path / "a"])
    assert [(log.name, log.path) for log in listed] == [
        ("log-1", other),
        ("log-0", one),
        ("log-1-2", two),
    ]


def test_loose_bags_in_a_folder_are_a_log_each_and_a_bag_with_its_metadata_is_one(
    tmp_path: Path,
) -> None:
    for name in ("loose/two.mcap", "loose/one.bag", "whole/a_0.mcap", "whole/a_1.mcap"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "whole" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    loose = [tmp_path / "loose" / name for name in ("one.bag", "two.mcap")]
    assert [log.path for log in find_logs([tmp_path / "loose"])] == loose
    assert [log.path for log in find_logs([tmp_path / "whole"])] == [tmp_path / "whole"]
    assert [log.name for log in find_logs([tmp_path])] == ["loose", "whole"]


def test_what_is_no_log_is_kept_for_its_error_to_be_told(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    given = [tmp_path / "empty", tmp_path / "gone"]
    assert [log.path for log in find_logs(given)] == given


def test_pattern_or_list_without_a_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "list.txt").write_text("# nothing yet\n")
    with pytest.raises(BadConfig, match="no file or folder fits"):
        find_logs([tmp_path / "*.bag"])
    with pytest.raises(BadConfig, match="no log is given"):
        find_logs([tmp_path / "list.txt"])
    with pytest.raises(BadConfig, match="does not exist"):
        find_logs([tmp_path / "other.txt"])


# ---- tables ------------------------------------------------------------------------------------


def test_table_holds_what_each_result_says_and_the_summary_of_it(done: Path) -> None:
    rows = rows_of(done / "batch.csv")
    assert [(row["log"], row["method"]) for row in rows] == [
        (f"log-{i}", method) for i in range(3) for method in QUICK
    ]
    for row in rows:
        metrics = json.loads((done / row["log"] / "metrics.json").read_text())
        method = metrics["methods"][row["method"]]
        assert float(row["aligned_rmse_m"]) == method["trajectory"]["aligned_rmse_m"]
        assert float(row["pose_nees"]) == method["pose_nees"]
        assert float(row["landmarks"]) == method["landmarks"]
        if row["method"] == "ekf":
            assert float(row["map_nees"]) == method["map_nees"]
            assert float(row["right_share"]) == method["matching"]["right_share"]
        else:
            assert row["map_rmse_m"] == row["map_nees"] == row["right_share"] == ""
    errors = [float(row["rmse_m"]) for row in rows if row["method"] == "ekf"]
    summary = {(row["method"], row["figure"]): row for row in rows_of(done / "summary.csv")}
    entry = summary["ekf", "rmse_m"]
    assert float(entry["median"]) == statistics.median(errors)
    assert float(entry["mean"]) == pytest.approx(statistics.mean(errors))
    assert float(entry["worst"]) == max(errors)
    assert entry["logs"] == "3"
    assert summary["odometry", "map_rmse_m"]["logs"] == "0"
    content = json.loads((done / "batch.json").read_text())
    assert [row["log"] for row in content["results"]] == [row["log"] for row in rows]
    assert content["results"][0]["map_rmse_m"] is None


def test_failure_is_told_with_its_reason_and_costs_nothing_else(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["batch", str(tmp_path / "gone"), *command(logs, out)[1:]]) == 3
    captured = capsys.readouterr()
    failures = json.loads((out / "batch.json").read_text())["failures"]
    assert [failure["log"] for failure in failures] == ["gone", "log-3"]
    assert "does not exist" in failures[0]["reason"]
    assert "sightings.csv:" in failures[1]["reason"]
    for failure in failures:
        assert f"graphslam: error: {failure['log']}: {failure['reason']}\n" in captured.err
    assert "3 computed, 0 already there, 2 failed" in captured.out
    assert captured.out.endswith(f"{out / 'batch.html'}\n")


def test_nothing_but_failures_is_exit_code_1_with_empty_tables(tmp_path: Path) -> None:
    assert main(command(tmp_path / "gone", tmp_path / "out")) == 1
    assert rows_of(tmp_path / "out" / "batch.csv") == []
    assert "No log gave a result" in (tmp_path / "out" / "batch.html").read_text()


def test_method_that_failed_is_a_failure_and_the_others_of_its_log_are_not(
    done: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(done / "log-0", tmp_path / "log-0")
    info = json.loads((folder / "run.json").read_text())
    assert info["failed"] == {}
    (folder / "run.json").write_text(json.dumps(info | {"failed": {"smoother": "too little"}}))
    rows, failures = read_result(folder, 0, "log-0")
    assert [row.method for row in rows] == list(QUICK)
    assert failures == [Failure(0, "log-0", "smoother", "too little")]


@pytest.mark.parametrize("content", ["", "{}", "[]", '{"methods": {"ekf": 3}}'])
def test_damaged_result_is_named_with_the_cure(done: Path, tmp_path: Path, content: str) -> None:
    folder = shutil.copytree(done / "log-0", tmp_path / "log-0")
    (folder / "metrics.json").write_text(content)
    with pytest.raises(GraphSlamError, match=r"metrics.json: is damaged .*; remove the folder"):
        read_result(folder, 0, "log-0")


def test_methods_are_held_against_each_other_log_by_log() -> None:
    def row(log: str, method: str, error: float) -> Row:
        known = summarise([], 1, ("ekf",))
        values = {entry.summary.figure.name: math.nan for entry in known}
        return Row(0, log, method, values | {"aligned_rmse_m": error})

    errors = {"a": (4.0, 1.0), "b": (4.0, 2.0), "c": (4.0, 8.0), "d": (4.0, 4.0), "e": (4.0, 3.0)}
    rows = [row(log, "ekf", pair[0]) for log, pair in errors.items()]
    rows += [row(log, "smoother", pair[1]) for log, pair in errors.items()]
    rows += [row("f", "ekf", 1.0), row("g", "ekf", math.nan), row("g", "smoother", 1.0)]
    (duel,) = duels(rows, 1, ("ekf", "smoother"))
    assert (duel.logs, duel.second_better) == (4, 3)  # d is equal, f and g have one only
    assert duel.median_ratio == pytest.approx(0.625)
    assert duel.p == pytest.approx(2 * (1 + 4) / 2**4)


# ---- what is kept ------------------------------------------------------------------------------


def test_second_run_computes_nothing_and_changes_no_byte(
    logs: Path, done: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, computed_before = final_files(done), computed(done)
    assert main(command(logs, done)) == 3
    assert final_files(done) == before
    assert computed(done) == computed_before
    assert "0 computed, 3 already there, 1 failed" in capsys.readouterr().out


def test_result_is_kept_only_for_the_same_input_configuration_and_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, folder = write_tiny_log(tmp_path / "log", nodes=30), tmp_path / "out" / "log"
    plain = job(log, folder)
    assert [do(plain).state for _ in range(2)] == ["computed", "kept"]
    other = replace(plain.config, ekf=replace(plain.config.ekf, lost_after=4))
    assert do(replace(plain, config=other)).state == "computed"
    assert do(plain).state == "computed"
    threads = replace(plain.config, extract=replace(plain.config.extract, workers=3))
    assert do(replace(plain, config=threads)).state == "kept"
    with (log / "groundtruth.tum").open("a") as stream:
        stream.write("# looked at again\n")
    assert do(plain).state == "computed"
    (folder / "metrics.json").unlink()
    assert [do(plain).state for _ in range(2)] == ["computed", "kept"]
    monkeypatch.setattr("compare.fingerprint.versions", lambda: {"floorline-slam": "0.0.0"})
    assert do(plain).state == "computed"


def test_known_map_counts_by_its_content(tmp_path: Path) -> None:
    log, folder = write_tiny_log(tmp_path / "log", nodes=30), tmp_path / "out" / "log"
    known = tmp_path / "map.csv"
    lines = (log / "map.csv").read_text()
    known.write_text(lines)
    on_map = job(log, folder, config=RunConfig(methods=("ekf",), known_map=str(known)))
    assert [do(on_map).state for _ in range(2)] == ["computed", "kept"]
    known.write_text("\n".join(lines.splitlines()[:-1]) + "\n")
    assert do(on_map).state == "computed"


def test_folder_that_is_not_ours_fails_its_log_and_is_left_alone(tmp_path: Path) -> None:
    log, folder = write_tiny_log(tmp_path / "log", nodes=30), tmp_path / "out" / "log"
    folder.mkdir(parents=True)
    (folder / "mine.txt").write_text("keep")
    end = do(job(log, folder))
    assert end.state == "failed"
    assert "was not written by this program" in end.reason
    assert [path.name for path in folder.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize("name", ["batch.csv", "batch.json", "batch.html"])
def test_foreign_table_is_not_replaced(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(BadConfig, match=f"{name}: was not written by this program"):
        batch([tmp_path], tmp_path)
    assert (tmp_path / name).read_text() == "mine"


def test_report_is_made_later_where_it_is_wanted_and_missing(tmp_path: Path) -> None:
    log, out = write_tiny_log(tmp_path / "log one", nodes=30), tmp_path / "out"
    config = RunConfig(methods=("ekf",))
    without = batch([log], out, config, jobs=2, reports=False)
    assert "report.html" not in (out / "batch.html").read_text()
    assert without.computed == 1
    reported = batch([log], out, config, jobs=2)
    assert reported.computed == 1
    assert (out / "log one" / "report.html").is_file()
    assert 'href="log%20one/report.html"' in (out / "batch.html").read_text()


# ---- sweeps ------------------------------------------------------------------------------------


def test_sweep_gives_one_table_over_its_values_and_extracts_once(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(command(logs / "log-0", out, "--sweep", "ekf.gate=1,14", "--jobs", "1")) == 0
    rows = rows_of(out / "batch.csv")
    assert [(row["ekf.matching.gate"], row["method"]) for row in rows] == [
        (gate, method) for gate in ("1", "14") for method in QUICK
    ]
    used = [int(float(row["sightings_used"])) for row in rows if row["method"] == "ekf"]
    assert used[0] < used[1]
    folders = [out / f"ekf.matching.gate={gate}" / "log-0" for gate in ("1", "14")]
    timings = [json.loads((folder / "timings.json").read_text()) for folder in folders]
    assert ["extract" in stages for stages in timings] == [True, False]
    first, second = ((folder / "measurements.npz").read_bytes() for folder in folders)
    assert first == second
    summary = rows_of(out / "summary.csv")
    assert {row["ekf.matching.gate"] for row in summary} == {"1", "14"}
    assert "gate 14" in capsys.readouterr().out


def test_measurements_of_other_settings_are_not_taken_over(tmp_path: Path) -> None:
    log, first, second = write_tiny_log(tmp_path / "log"), tmp_path / "a", tmp_path / "b"
    every = replace(RunConfig().extract, every=2)
    assert do(job(log, first)).state == "computed"
    thinned = RunConfig(methods=("ekf",), extract=every)
    assert do(job(log, second, config=thinned, siblings=(first,))).state == "computed"
    nodes = [json.loads((f / "run.json").read_text())["nodes"] for f in (first, second)]
    assert nodes == [60, 30]


# ---- the page ----------------------------------------------------------------------------------


class Page(HTMLParser):
    """Collects what a page refers to, and checks that its tags close in order."""

    VOID = ("meta", "br", "link", "img", "input")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.refers: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.refers += [v or "" for k, v in attrs if k in ("href", "src", "xlink:href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_page_is_whole_offline_and_tells_figures_and_failures(done: Path) -> None:
    text = (done / "batch.html").read_text()
    page = Page(text)
    assert all(target.startswith("#") for target in page.refers)
    for told in ("median", "mean", "worst", "sightings.csv:", "3 of 4", "path RMSE, aligned (mm)"):
        assert told in text
    assert text.count("<svg") == 1


def test_notebook_shows_figures_failures_and_spread(logs: Path, done: Path) -> None:
    result = batch([logs], done, RunConfig(methods=QUICK), reports=False, jobs=1)
    assert result.computed == 0
    shown = result._repr_html_()
    assert Page(shown)
    assert "<td>path RMSE, aligned (mm)</td>" in shown
    assert shown.count("<svg") == 1
    assert all(html.escape(failure.reason) in shown for failure in result.failures)


def test_logs_without_truth_are_summed_up_by_what_methods_claim(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = write_tiny_log(tmp_path / "log", nodes=30, truth=False), tmp_path / "out"
    assert main(command(log, out)) == 0
    text = (out / "batch.html").read_text()
    assert "path σ (mm)" in text
    assert "path sigma, claimed (mm)" in text
    assert "Nothing to decide by" in text
    assert "path sigma" in " ".join(capsys.readouterr().out.split())


# ---- workers -----------------------------------------------------------------------------------


class Deadly:
    """Ends the process that unpickles it."""

    def __reduce__(self) -> tuple[Any, tuple[int]]:
        return os._exit, (3,)


def test_log_that_kills_its_worker_fails_alone(tmp_path: Path) -> None:
    log = write_tiny_log(tmp_path / "log", nodes=30)
    deadly = job(log, tmp_path / "a" / "log", config=Deadly())
    ends = list(in_processes([deadly, job(log, tmp_path / "b" / "log", number=1)], 1))
    assert ends == [Done(0, "failed", DIED), Done(1, "computed")]


def test_who_would_write_the_same_result_waits(tmp_path: Path) -> None:
    entered = threading.Event()

    def second() -> None:
        with alone_at(tmp_path / "log"):
            entered.set()

    waiting = threading.Thread(target=second)
    with alone_at(tmp_path / "log"), alone_at(tmp_path / "other"):
        waiting.start()
        assert not entered.wait(0.1)
    assert entered.wait(20.0)
    waiting.join()
    assert list(tmp_path.iterdir()) == []


def test_dask_that_is_missing_or_silent_is_told_with_the_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = [job(tmp_path / "log", tmp_path / "out")]
    with monkeypatch.context() as hidden:
        hidden.setitem(sys.modules, "distributed", None)
        with pytest.raises(BadConfig, match=r"pip install 'floorline-slam\[cluster\]'"):
            list(on_cluster(work, "tcp://127.0.0.1:9"))
    pytest.importorskip("distributed", reason="Dask is not installed")
    monkeypatch.setattr(batch_workers, "CONNECT_S", 0.2)
    with pytest.raises(BadConfig, match=r"--dask tcp://127.0.0.1:9: no scheduler answers"):
        list(on_cluster(work, "tcp://127.0.0.1:9"))


def test_negative_jobs_and_no_log_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["batch", "log", "--out", "x", "--jobs", "-1"]) == 1
    assert "jobs = -1: must be 0 (all cores) or a positive number" in capsys.readouterr().err
    assert main(["batch", "--out", "x"]) == 2


def test_errors_that_are_ours_say_so() -> None:
    assert reason_of(BadConfig("a\n b")) == "a b"
    assert reason_of(PermissionError(13, "Permission denied", "f.csv")) == (
        "f.csv: Permission denied"
    )
    assert "ZeroDivisionError: by nothing; this is a defect" in reason_of(
        ZeroDivisionError("by nothing")
    )


# ---- progress ----------------------------------------------------------------------------------


def test_progress_tells_failures_and_the_time_left_by_what_was_computed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = iter([100.0, 110.0, 130.0])  # begin, after the second end, after the third
    monkeypatch.setattr("compare.batch.time.monotonic", lambda: next(now))
    ends = [Done(0, "kept"), Done(1, "computed"), Done(2, "failed", "x"), Done(3, "computed")]
    told: list[tuple[str, int, int]] = []
    assert list(_watched(iter(ends), 4, lambda *state: told.append(state))) == ends
    assert told == [
        ("batch", 0, 4),
        ("batch", 1, 4),
        ("batch, about 20 s left", 2, 4),
        ("batch, 1 failed, about 30 s left", 3, 4),
        ("batch, 1 failed", 4, 4),
    ]


@pytest.mark.parametrize(
    ("seconds", "text"), [(3.2, "3 s"), (89.0, "89 s"), (150.0, "2 min"), (7200.0, "2.0 h")]
)
def test_duration_is_told_as_coarsely_as_a_guess_deserves(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_a_robot_file_goes_with_the_bags_among_log_folders(tmp_path: Path) -> None:
    recorded = short_log(2.0)
    write_bag(recorded, tmp_path / "logs" / "drive.mcap", "mcap")
    write_folder(recorded, tmp_path / "logs" / "folder")
    robot = write_robot_file(recorded, tmp_path / "robot.toml")
    out = tmp_path / "out"
    quick = ["--jobs", "1", "--no-reports", "--methods", "ekf", "--robot", str(robot)]
    assert main(["batch", str(tmp_path / "logs"), "--out", str(out), *quick]) == 0
    assert len(rows_of(out / "batch.csv")) == 2
    together = [str(tmp_path / "logs" / name) for name in ("drive.mcap", "folder")]
    both = ["--out", str(tmp_path / "run"), "--methods", "ekf", "--robot", str(robot)]
    assert main(["run", *together, *both]) == 0
    assert main(["run", together[1], *both]) == 1  # nothing there that the file goes with
