"""Whether a batch that is killed at random instants comes to the same bytes, doing nothing twice.

Run with ``python benchmarks/batch_restart.py [--logs N] [--kills N] [--jobs N] [--dask]``:
simulates logs of the scenario `grid` without images, corrupts one, runs them once in peace, and
once killed by SIGKILL at random instants, by turns with and without its workers. With ``--dask``
the killed one is the client of a cluster of two workers that goes on without it. Ends with an
error where a byte differs, a result is lost, or one was computed twice.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np

from compare.batch_job import JOURNAL
from frontend.simulate import load_scenario, simulate

FINAL = ("batch.csv", "summary.csv", "batch.json", "batch.html")
CORRUPT = 17
SEED = 20


def main() -> None:
    """Prints what each run of the batch did."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=50)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--dask", action="store_true")
    given = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        logs = write_logs(folder / "logs", given.logs)
        more = ["--jobs", str(given.jobs)]
        began = time.perf_counter()
        run(logs, folder / "calm", more)
        whole = time.perf_counter() - began
        print(f"in peace: {whole:.0f} s, {account(folder / 'calm')}", flush=True)
        if given.dask:
            more = ["--dask", stack.enter_context(cluster()).scheduler_address]
        rng = np.random.default_rng(SEED)
        for kill in range(given.kills):
            killed(logs, folder / "killed", more, rng.uniform(0.05, 0.25) * whole, kill % 2 == 0)
            print(f"kill {kill + 1}: {account(folder / 'killed')}", flush=True)
        run(logs, folder / "killed", more)
        print(f"to the end: {account(folder / 'killed')}")
        check(folder / "calm", folder / "killed", given.logs)


def write_logs(folder: Path, count: int) -> Path:
    """Simulates the logs and spoils one; returns their folder."""
    scenario = load_scenario("grid")
    for seed in range(count):
        simulate(scenario, folder / f"grid-{seed:03d}", seed, images=False)
    wheels = folder / f"grid-{CORRUPT % count:03d}" / "wheels.csv"
    wheels.write_text(wheels.read_text()[:5000])
    return folder


def cluster() -> object:
    """Returns a Dask cluster of two worker processes."""
    from distributed import LocalCluster

    return LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)


def start(logs: Path, out: Path, more: list[str]) -> subprocess.Popen[bytes]:
    """Starts the command in a process group of its own."""
    program = [sys.executable, "-c", "from compare.cli import main; raise SystemExit(main())"]
    arguments = ["batch", str(logs), "--out", str(out), "--no-reports", *more]
    return subprocess.Popen(
        program + arguments,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def run(logs: Path, out: Path, more: list[str]) -> None:
    """Runs the batch to its end, which is exit code 3 for the corrupt log."""
    with start(logs, out, more) as process:
        if process.wait() != 3:
            sys.exit(f"exit code {process.returncode}, not 3")


def killed(logs: Path, out: Path, more: list[str], after_s: float, whole_group: bool) -> None:
    """Runs the batch and kills it after a time, with its workers or without."""
    with start(logs, out, more) as process:
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=after_s)
            print("(over before it was killed)", flush=True)
            return
        if whole_group:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()


def computed(out: Path) -> list[str]:
    """Returns the results that were computed, one entry each time."""
    path = out / JOURNAL
    lines = path.read_text().splitlines() if path.exists() else []
    return [json.loads(line)["result"] for line in lines]


def account(out: Path) -> str:
    """Returns how many results there are, and how many computations were noted."""
    results = len(list(out.glob("*/run.json")))
    done = computed(out)
    return f"{results} results; computed so far {len(done)}, of them twice {twice(done)}"


def twice(done: list[str]) -> int:
    """Returns how many computations were of what was computed already."""
    return len(done) - len(set(done))


def content(out: Path) -> dict[str, bytes]:
    """Returns the bytes of all tables and results, without times."""
    paths = [out / name for name in FINAL]
    paths += [p for p in sorted(out.glob("*/**/*")) if p.is_file() and p.name != "timings.json"]
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in paths}


def check(calm: Path, killed: Path, logs: int) -> None:
    """Exits with an error unless both came to the same bytes, without loss or repetition."""
    first, second = content(calm), content(killed)
    different = sorted({*first, *second} - {k for k in first if first[k] == second.get(k)})
    results = len(list(killed.glob("*/run.json")))
    print(f"{len(first)} files compared, different: {len(different)} {different[:3]}")
    print(f"results {results} of {logs - 1}, computed twice: {twice(computed(killed))}")
    if different or results != logs - 1 or twice(computed(killed)):
        sys.exit(1)


if __name__ == "__main__":
    main()
