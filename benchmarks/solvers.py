"""The chain solver against Ceres, g2o and GTSAM: same problems, start, Jacobians and final cost.

Run with ``python benchmarks/solvers.py [--poses 2000 10000 ...] [--lines 20 200 2000]
[--rounds 3] [--cpu]``. Prints tables with growth exponents, and writes them with the machine's name
to docs/performance.md, a plot beside it. Solvers take turns on each problem; every figure is the
median over the rounds. Ceres comes from Debian's libceres-dev; g2o, which Debian 12 does not have,
is found through ``G2O_ROOT``.
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from solver_runs import Solver, build_natives, our_solvers, run, write_problem

DOCS = Path(__file__).resolve().parents[1] / "docs"
POSES = (2_000, 10_000, 50_000, 200_000)
LINES = (20, 200, 2_000)
OURS = "chain"


@dataclass(frozen=True, slots=True)
class Figures:
    """Medians over the rounds of one solver on one problem.

    Attributes:
        seconds: set-up and solve.
        per_iteration: of the solve alone, s.
        iterations: linear systems solved.
        memory: growth of the process while it solves, MB.
        cost: final cost.
    """

    seconds: float
    per_iteration: float
    iterations: int
    memory: float
    cost: float


Results = dict[tuple[int, int, str], Figures]


def measure(
    poses: Sequence[int], lines: Sequence[int], rounds: int, cpu: bool, solvers: Sequence[Solver]
) -> Results:
    """Returns the figures of all solvers on all problems."""
    results: Results = {}
    for nodes in poses:
        for count in lines:
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                write_problem(nodes, count, folder)
                ran = [solver for solver in solvers if nodes <= solver.up_to]
                runs: dict[str, list[dict[str, float]]] = {solver.name: [] for solver in ran}
                for _ in range(rounds):
                    for solver in ran:
                        runs[solver.name].append(run(solver, folder))
            for solver_name, reports in runs.items():
                results[nodes, count, solver_name] = _medians(reports, cpu)
            print(_row(results, nodes, count, [solver.name for solver in solvers]), flush=True)
    return results


def _medians(reports: list[dict[str, float]], cpu: bool) -> Figures:
    wall = [report["setup_s"] + report["solve_s"] for report in reports]
    seconds = [report["cpu_s"] for report in reports] if cpu else wall
    share = [report["solve_s"] / total for report, total in zip(reports, wall, strict=True)]
    iterations = int(reports[0]["iterations"])
    solve = [part * total for part, total in zip(share, seconds, strict=True)]
    return Figures(
        median(seconds),
        median(solve) / iterations,
        iterations,
        median(report["memory_mb"] for report in reports),
        reports[0]["cost"],
    )


def _row(results: Results, nodes: int, lines: int, names: Sequence[str]) -> str:
    cells = [f"{nodes:,}", f"{lines:,}"]
    for name in names:
        figures = results.get((nodes, lines, name))
        if figures is None:
            cells += ["–", "–", "–"]
            continue
        cells += [
            f"{figures.seconds:.3f}",
            f"{1e3 * figures.per_iteration:.1f} × {figures.iterations}",
            f"{figures.memory:.0f}",
        ]
    others = [
        results[nodes, lines, name]
        for name in names
        if name in ("Ceres", "g2o") and (nodes, lines, name) in results
    ]
    ours = results[nodes, lines, OURS]
    if others:
        cells.append(f"{min(other.seconds for other in others) / ours.seconds:.1f}")
    worst = max((abs(other.cost / ours.cost - 1.0) for other in others), default=0.0)
    return "| " + " | ".join([*cells, f"{worst:.0e}"]) + " |"


def table(results: Results, names: Sequence[str]) -> str:
    """Returns the figures as a Markdown table."""
    heads = ["poses", "lines"]
    for name in names:
        heads += [f"{name}, s", "ms × iterations", "MB"]
    if any(name in ("Ceres", "g2o") for name in names):
        heads.append("times faster")
    heads.append("cost differs by")
    problems = sorted({(nodes, lines) for nodes, lines, _ in results})
    rows = [_row(results, nodes, lines, names) for nodes, lines in problems]
    return "\n".join(["| " + " | ".join(heads) + " |", "|" + "---:|" * len(heads), *rows])


def exponents(results: Results, names: Sequence[str]) -> str:
    """Returns how the time grows with the number of poses, for each solver and number of lines."""
    rows = []
    for name in names:
        for count in sorted({lines for _, lines, _ in results}):
            sizes = sorted(n for n, lines, s in results if lines == count and s == name)
            sizes = [n for n in sizes if n >= 10_000] if len(sizes) > 3 else sizes
            if len(sizes) < 2:
                continue
            seconds = [results[n, count, name].seconds for n in sizes]
            slope = np.polyfit(np.log(sizes), np.log(seconds), 1)[0]
            rows.append(f"| {name} | {count:,} | {sizes[0]:,} to {sizes[-1]:,} | {slope:.2f} |")
    heads = "| solver | lines | poses | exponent |\n|---|---:|---|---:|"
    return "\n".join([heads, *rows])


def plot(results: Results, names: Sequence[str], path: Path) -> None:
    """Writes total time against the number of poses, one panel for each number of lines."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "graphslam"
    import matplotlib.pyplot as plt

    counts = sorted({lines for _, lines, _ in results})
    figure, axes = plt.subplots(
        1, len(counts), figsize=(3.6 * len(counts), 3.4), sharey=True, squeeze=False
    )
    for axis, count in zip(axes[0], counts, strict=True):
        for name in names:
            sizes = sorted(n for n, lines, s in results if lines == count and s == name)
            axis.loglog(sizes, [results[n, count, name].seconds for n in sizes], "o-", label=name)
        axis.set_title(f"{count:,} lines", fontsize=10)
        axis.set_xlabel("poses")
        axis.grid(True, which="major", alpha=0.3)
    axes[0][0].set_ylabel("set-up and solve, s")
    axes[0][-1].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})


def machine() -> str:
    """Returns the machine's name for the page."""
    cpu = platform.machine()
    for line in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith("model name"):
            cpu = line.split(":", 1)[1].strip()
            break
    return f"{cpu}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"


PAGE = """# Performance of the chain solver

Written by `python benchmarks/solvers.py` ({rounds} rounds, medians, solvers taking turns) on
{machine}.
Times are {clock}, of one thread, set-up and solve together; compiling and loading are left out for
all. Memory is what the process grew by while solving. Machines differ, and this
one was shared: compare rows and columns of one run with each other.

The problem: a robot wanders through rooms with four floor lines each, two sightings a pose, rooms
entered again and again; matches are known; the start is 5 cm, 0.6° off. All solvers
minimise the same residuals with the same analytic Jacobians from the same start. Ceres runs
Gauss-Newton steps (trust region wide open) through SuiteSparse's normal Cholesky, g2o Gauss-Newton
through CHOLMOD with block ordering; GTSAM is this project's reference engine by custom factors.
*Times faster* compares the chain solver with the better of Ceres and g2o.

{table}

![Total time against the number of poses](performance.svg)

GTSAM's own Levenberg-Marquardt, on the same custom factors and on native ones, is in
[benchmarks](../benchmarks/README.md), and so is iSAM2.

Growth with the number of poses, as the exponent of a power law:

{exponents}
{missing}"""


def main() -> None:
    """Measures, prints, and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, nargs="+", default=POSES)
    parser.add_argument("--lines", type=int, nargs="+", default=LINES)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--cpu", action="store_true", help="processor time, for busy machines")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder of performance.md and .svg")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        natives, missing = build_natives(Path(name))
        for message in missing:
            print(message)
        solvers = [*our_solvers(), *natives]
        results = measure(options.poses, options.lines, options.rounds, options.cpu, solvers)
    names = [solver.name for solver in solvers]
    page = PAGE.format(
        rounds=options.rounds,
        machine=machine(),
        clock="processor time" if options.cpu else "wall-clock time",
        table=table(results, names),
        exponents=exponents(results, names),
        missing="".join(f"\n{message}\n" for message in missing),
    )
    print(page)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "performance.md").write_text(page, encoding="utf-8")
    plot(results, names, options.out / "performance.svg")


if __name__ == "__main__":
    main()
