"""Logs for batches, one of them corrupt, and batches that are killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from compare.batch_job import JOURNAL
from tests.compare.tiny_log import write_tiny_log

FINAL = ("batch.csv", "summary.csv", "batch.json", "batch.html")
QUICK = ("odometry", "ekf")

SHOWING_PROGRESS = """
import sys
from compare.batch import batch
from compare.config import RunConfig
show = lambda stage, done, of: print(done, of, flush=True)
logs, out, dask, *methods = sys.argv[1:]
batch([logs], out, RunConfig(methods=tuple(methods)), jobs=1, dask=dask or None, reports=False,
      progress=show)
"""


def write_logs(folder: Path, count: int) -> Path:
    """Writes logs named log-0, log-1, ... of different seeds; returns their folder."""
    for seed in range(count):
        write_tiny_log(folder / f"log-{seed}", seed=seed, nodes=50, name="tiny")
    return folder


def corrupt(log: Path) -> Path:
    """Breaks a table of a log: half a row and no more; returns the log."""
    table = log / "sightings.csv"
    table.write_text(table.read_text()[:1000])
    return log


def final_files(out: Path) -> dict[str, bytes]:
    return {name: (out / name).read_bytes() for name in FINAL}


def results(out: Path) -> dict[str, dict[str, bytes]]:
    """Returns the bytes of every result folder, timings aside, by its name."""
    folders = [path.parent for path in sorted(out.glob("*/run.json"))]
    return {
        folder.name: {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file() and path.name != "timings.json"
        }
        for folder in folders
    }


def computed(out: Path) -> list[str]:
    """Returns the results that were computed, one entry each time, whoever did it."""
    lines = (out / JOURNAL).read_text().splitlines()
    return [json.loads(line)["result"] for line in lines]


def killed_batch(
    logs: Path, out: Path, ends: int, later_s: float, whole_group: bool, dask: str = ""
) -> None:
    """Starts a batch and kills it so much later than so many of its jobs ended.

    Args:
        logs: folder of logs.
        out: folder of the batch.
        ends: jobs to wait for.
        later_s: how much later, s.
        whole_group: whether its workers are killed with it, as by the end of the machine; else
            they go on for a while, as after the end of a terminal.
        dask: address of a cluster; none: worker processes of this machine.
    """
    program = [sys.executable, "-c", SHOWING_PROGRESS, str(logs), str(out), dask, *QUICK]
    with subprocess.Popen(
        program, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        for _ in range(1 + ends):
            process.stdout.readline()
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=later_s)
        assert process.poll() is None, "over before it was killed"
        if whole_group:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
