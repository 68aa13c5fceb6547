"""Compiled functions on disk, and several processes that want them at once."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import graphslam
from graphslam.compiled import one_at_a_time

CALL = """
import numpy as np
from graphslam.geometry import line_to_robot
print(line_to_robot(np.array([[1.0, 0.2]]), np.array([0.1, 0.2, 0.3])).sum())
"""


def start(folder: Path) -> subprocess.Popen:
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONSAFEPATH": "1"}
    environment.pop("NUMBA_CACHE_DIR", None)
    return subprocess.Popen(
        [sys.executable, "-c", CALL], env=environment, stdout=-1, stderr=-1, text=True
    )


def test_processes_that_compile_at_once_leave_nothing_broken(tmp_path: Path) -> None:
    """Without turns about four of five starts of a fresh copy ended in a crash, then all after."""
    copy = tmp_path / "graphslam"
    away = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(graphslam.__file__).parent, copy, ignore=away)
    together = [start(tmp_path) for _ in range(2)]
    said = [process.communicate(timeout=300)[0] for process in together]
    after = start(tmp_path)
    said.append(after.communicate(timeout=300)[0])
    assert [process.returncode for process in (*together, after)] == [0, 0, 0]
    assert len(set(said)) == 1


def test_where_no_lock_can_be_had_it_goes_on_without(monkeypatch, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setattr("graphslam.compiled.FOLDERS", (tmp_path / "file" / "below",))
    done = False
    with one_at_a_time():
        done = True
    assert done
