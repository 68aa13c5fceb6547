"""Single runs of the solvers that benchmarks/solvers.py compares, each in a process of its own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

NATIVE = Path(__file__).parent / "native"
TOLERANCE = 1e-10
"""Predicted relative decrease of the cost at which our engines stop, before the step."""
G2O_LIBRARIES = ("-lg2o_core", "-lg2o_stuff", "-lg2o_solver_cholmod", "-lcholmod")
NATIVE_TOLERANCE = 1e-9
"""Relative decrease in the last step at which Ceres and g2o stop: one more would find nothing."""


@dataclass(frozen=True, slots=True)
class Solver:
    """One column of the comparison.

    Attributes:
        name: in the table.
        command: without the problem's files.
        up_to: largest number of poses that it is run on.
    """

    name: str
    command: tuple[str, ...]
    up_to: int = 10**9


def build_natives(folder: Path) -> tuple[list[Solver], list[str]]:
    """Returns the native solvers that could be built, and a message for each that could not.

    g2o is looked for in ``$G2O_ROOT`` (an installation's prefix) and where the system keeps its
    libraries; Ceres in the latter.
    """
    found, missing = [], []
    root = os.environ.get("G2O_ROOT")
    prefix = [f"-I{root}/include", f"-L{root}/lib", f"-Wl,-rpath,{root}/lib"] if root else []
    libraries = {
        "Ceres": ("with_ceres", ["-lceres", "-lglog"], ["normal"]),
        "g2o": (
            "with_g2o",
            [*prefix, "-I/usr/include/suitesparse", *G2O_LIBRARIES],
            ["cholmod"],
        ),
    }
    if not shutil.which("g++"):
        return [], ["Ceres and g2o: skipped, no g++ here (Debian: apt install g++)"]
    for name, (program, flags, variants) in libraries.items():
        out = folder / program
        source = str(NATIVE / f"{program}.cpp")
        command = ["g++", "-O3", "-march=native", "-I/usr/include/eigen3", source, "-o", str(out)]
        done = subprocess.run([*command, *flags], capture_output=True, text=True, check=False)
        if done.returncode:
            first = next(line for line in done.stderr.splitlines() if "error" in line)
            missing.append(f"{name}: skipped, its program did not build: {first}")
            continue
        for variant in variants:
            found.append(Solver(name, (str(out), "FILE", variant, str(NATIVE_TOLERANCE))))
    return found, missing


def our_solvers() -> list[Solver]:
    """Returns the engines of this project; the reference by custom factors on small problems."""
    me = str(Path(__file__).resolve())
    return [
        Solver("chain", (sys.executable, me, "FOLDER", "chain")),
        Solver("GTSAM, custom factors", (sys.executable, me, "FOLDER", "gtsam"), up_to=2_000),
    ]


def run(solver: Solver, folder: Path) -> dict[str, float]:
    """Returns what one run of a solver on a written problem reports."""
    places = {"FILE": str(folder / "problem.bin"), "FOLDER": str(folder)}
    command = [places.get(part, part) for part in solver.command]
    env = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    if done.returncode:
        raise SystemExit(f"{solver.name} failed on {folder}: {done.stderr.strip()[-400:]}")
    return dict(json.loads(done.stdout.splitlines()[-1]))


def write_problem(nodes: int, lines: int, folder: Path) -> None:
    """Writes a problem twice: for the native programs, and for ours."""
    from rooms import rooms_problem

    from graphslam.smoother.chain.residuals import whiteners

    problem = rooms_problem(nodes, lines)
    measurements = problem.measurements
    table, odometry = measurements.sightings["line"], measurements.odometry
    measurements.save(folder / "measurements.npz")
    np.savez(folder / "start.npz", pose=problem.pose, params=problem.params, match=problem.match)
    with (folder / "problem.bin").open("wb") as stream:
        counts = (len(problem.pose), len(problem.params), len(table))
        np.array(counts, np.int64).tofile(stream)
        for array in (
            problem.pose,
            problem.params,
            measurements.start_pose,
            whiteners(measurements.start_cov[None], np.ones(1)),
            odometry.increment,
            whiteners(odometry.cov, problem.odometry_weight),
            table.node,
            problem.match,
            table.z,
            whiteners(table.cov, problem.weight),
        ):
            np.ascontiguousarray(array).tofile(stream)


def main(folder: Path, engine: str) -> None:
    """Solves the problem in a folder and prints what it took, as one line of JSON."""
    from importlib import import_module

    from rooms import rooms_problem

    from graphslam.config import SmootherConfig
    from graphslam.measurements import Measurements
    from graphslam.smoother.batch import ENGINES
    from graphslam.smoother.chain.system import build
    from graphslam.smoother.problem import Problem

    minimise = import_module(ENGINES[engine]).minimise
    config = SmootherConfig(tolerance=TOLERANCE)
    small = rooms_problem(100, 20)
    minimise(small, config)  # compile and import before timing
    measurements = Measurements.load(folder / "measurements.npz")
    arrays = np.load(folder / "start.npz")
    count = len(arrays["params"])
    problem = Problem(
        measurements,
        arrays["match"],
        ("line",) * count,
        np.zeros(count, bool),
        arrays["pose"],
        arrays["params"],
        np.ones(measurements.sighting_count),
        np.ones(len(arrays["pose"]) - 1),
    )
    base = _status("VmRSS")
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # forget the peak so far
    begin, used = time.perf_counter(), time.process_time()
    minimum = minimise(problem, config)
    seconds, cpu, memory = (
        time.perf_counter() - begin,
        time.process_time() - used,
        _status("VmHWM") - base,
    )
    if engine == "chain":
        begin = time.perf_counter()
        build(problem)
        setup = time.perf_counter() - begin
    else:
        setup = 0.0
    report = {
        "setup_s": setup,
        "solve_s": seconds - setup,
        "cpu_s": cpu,
        "iterations": minimum.iterations,
        "cost": minimum.cost,
        "memory_mb": memory,
    }
    print(json.dumps(report))


def _status(name: str) -> float:
    """Returns an entry of this process's status in megabytes."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1]) / 1024
    return float("nan")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
