"""Seeded runs: parallel, resumable after any kill, and the same bytes whatever happened."""

from __future__ import annotations

import ctypes
import json
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compare.montecarlo import FILE, SeededRun, run_seeded
from graphslam.errors import BadConfig, GraphSlamError


def normal(run: int) -> dict[str, float | int | str]:
    """A job whose values depend on the seed alone."""
    draws = np.random.default_rng(run).standard_normal(3)
    return {"mean": float(draws.mean()), "count": 3, "name": f"run {run}", "none": math.nan}


def moody(run: int) -> dict[str, float | int | str]:
    """A job that fails in some runs, by our own errors and by others."""
    if run == 1:
        raise BadConfig("this run's floor is bare")
    if run == 3:
        raise ZeroDivisionError("by nothing")
    return {"value": run}


def same(a: tuple[SeededRun, ...], b: tuple[SeededRun, ...]) -> bool:
    return repr(a) == repr(b)  # NaN equals NaN


def keep_lines(path: Path, keep: Callable[[list[bytes]], list[bytes]]) -> None:
    path.write_bytes(b"".join(keep(path.read_bytes().splitlines(keepends=True))))


def test_results_come_by_run_number_and_seed_alone_decides_them() -> None:
    seen: list[tuple[str, int, int]] = []
    found = run_seeded(normal, 7, None, jobs=2, progress=lambda *state: seen.append(state))
    assert [result.run for result in found] == list(range(7))
    assert all(result.values["mean"] == normal(result.run)["mean"] for result in found)
    assert math.isnan(found[0].values["none"])
    assert seen == [("runs", done, 7) for done in range(8)]
    assert same(found, run_seeded(normal, 7, None, jobs=1))


def test_failure_is_the_result_of_its_run_and_stops_no_other(tmp_path: Path) -> None:
    found = run_seeded(moody, 5, tmp_path / "out", jobs=2)
    assert [result.error for result in found] == [
        "",
        "this run's floor is bare",
        "",
        "ZeroDivisionError: by nothing",
        "",
    ]
    assert [result.values.get("value") for result in found] == [0, None, 2, None, 4]
    assert same(found, run_seeded(moody, 5, tmp_path / "out", jobs=2))


@pytest.mark.parametrize(
    "damage",
    [
        lambda lines: lines[:1],
        lambda lines: lines[:4],
        lambda lines: [*lines[:4], lines[4][:-9]],
        lambda lines: [*lines[:4], lines[4][:20] + b"\n"],
        lambda lines: [lines[0], *lines[:4:-1]],
        lambda lines: [*lines[:3], *lines[2:]],
    ],
    ids=["nothing done", "cut", "half a line", "broken line", "other order", "twice"],
)
def test_resumed_file_is_byte_for_byte_the_uninterrupted_one(
    tmp_path: Path, damage: Callable[[list[bytes]], list[bytes]]
) -> None:
    whole = run_seeded(normal, 8, tmp_path / "whole", jobs=2, fingerprint="a")
    found = run_seeded(normal, 8, tmp_path / "cut", jobs=2, fingerprint="a")
    file = tmp_path / "cut" / FILE
    keep_lines(file, damage)
    found = run_seeded(normal, 8, tmp_path / "cut", jobs=2, fingerprint="a")
    assert same(found, whole)
    assert file.read_bytes() == (tmp_path / "whole" / FILE).read_bytes()
    assert sorted(path.name for path in (tmp_path / "cut").iterdir()) == [FILE]


def test_finished_runs_are_not_done_again(tmp_path: Path) -> None:
    run_seeded(normal, 3, tmp_path, jobs=2)
    again = run_seeded(moody, 5, tmp_path, jobs=2)  # only runs 3 and 4 are left for this job
    assert [result.values.get("count") for result in again] == [3, 3, 3, None, None]
    assert again[4].values == {"value": 4}
    fewer = run_seeded(moody, 2, tmp_path, jobs=2)
    assert [result.run for result in fewer] == [0, 1]
    assert len((tmp_path / FILE).read_text().splitlines()) == 6


def test_results_of_another_fingerprint_are_not_taken_over(tmp_path: Path) -> None:
    run_seeded(normal, 2, tmp_path, jobs=2, fingerprint="a")
    before = (tmp_path / FILE).read_bytes()
    with pytest.raises(BadConfig, match="another scenario, configuration or version; give another"):
        run_seeded(normal, 2, tmp_path, jobs=2, fingerprint="b")
    assert (tmp_path / FILE).read_bytes() == before


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("notes.txt", "mine", f"holds no {FILE} of ours"),
        (FILE, "", "was not written by this program"),
        (FILE, '{"a": 1}\n', "was not written by this program"),
        (FILE, "[" * 100_000 + "\n", "was not written by this program"),
    ],
)
def test_foreign_folder_is_refused_and_left_alone(
    tmp_path: Path, name: str, content: str, message: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(BadConfig, match=message):
        run_seeded(normal, 2, tmp_path, jobs=2)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == content


def test_file_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(BadConfig, match="is not a folder"):
        run_seeded(normal, 2, tmp_path / "out", jobs=2)


def test_damaged_line_in_the_middle_is_named(tmp_path: Path) -> None:
    run_seeded(normal, 3, tmp_path, jobs=2)
    keep_lines(tmp_path / FILE, lambda lines: [*lines[:2], b"{}\n", *lines[3:]])
    with pytest.raises(BadConfig, match=rf"{FILE}:3: is damaged; remove the line"):
        run_seeded(normal, 3, tmp_path, jobs=2)


@pytest.mark.parametrize(("runs", "jobs"), [(0, 1), (3, -1)])
def test_numbers_out_of_range_are_refused(runs: int, jobs: int) -> None:
    with pytest.raises(BadConfig, match=f"runs = {runs}, jobs = {jobs}"):
        run_seeded(normal, runs, None, jobs=jobs)


def test_interruption_keeps_what_was_finished(tmp_path: Path) -> None:
    def stop(stage: str, done: int, of: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_seeded(normal, 6, tmp_path, jobs=2, progress=stop)
    lines = (tmp_path / FILE).read_text().splitlines()
    assert len(lines) == 3
    assert all("values" in json.loads(line) for line in lines[1:])


def die(run: int) -> dict[str, float | int | str]:
    os._exit(3)


def test_death_of_a_worker_says_what_to_do() -> None:
    with pytest.raises(GraphSlamError, match="the same command again goes on"):
        run_seeded(die, 2, None, jobs=2)


def blas_threads(run: int) -> dict[str, Any]:
    """A job that asks the loaded OpenBLAS libraries how many threads they use."""
    np.ones((300, 300)) @ np.ones((300, 300))
    maps = Path("/proc/self/maps").read_text().splitlines()
    counts = {}
    for library in sorted({line.split()[-1] for line in maps if "openblas" in line}):
        handle = ctypes.CDLL(library)
        for name in ("scipy_openblas_get_num_threads64_", "scipy_openblas_get_num_threads"):
            if hasattr(handle, name):
                counts[Path(library).name] = int(getattr(handle, name)())
    return counts


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("jobs", [1, 2])
def test_each_worker_has_one_blas_thread(jobs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        monkeypatch.setenv(name, "2")
    found = run_seeded(blas_threads, 4, None, jobs=jobs)
    counts = [count for result in found for count in result.values.values()]
    if not counts:
        pytest.skip("NumPy here is not built on OpenBLAS")
    assert set(counts) == {1}
