"""What each way of matching makes of the cases in `matching_cases`, and how long it takes.

Run with ``python benchmarks/matching.py [CASE ...] [--seeds N] [--jobs N] [--logs DIR]``; prints a
table for each case with one row for each method. Without cases all are run; those on recordings
need ``--logs``, the folder with the log folders.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from matching_cases import (
    Case,
    clean,
    fine_grid,
    random_views,
    recorded,
    wheel_slip,
    wrong_matches,
)
from matching_loop import closings, loop
from matching_methods import METHODS
from smoother_scaling import corridor, grid_laps

from compare import compare
from compare.montecarlo import SeededRun, run_seeded
from frontend.config import DetectorConfig
from frontend.lines import detect_lines
from frontend.log import open_log
from frontend.simulate import load_scenario, simulate
from frontend.simulate.scenario import Motion
from graphslam.estimate import Estimate

CASES: Mapping[str, Callable[[int], Case]] = {
    "clean": clean,
    "wrong-matches": wrong_matches,
    "fine-grid": fine_grid,
    "wheel-slip": wheel_slip,
    "random-views": random_views,
    "loop": loop,
}
SEEDS = {
    "clean": 20,
    "wrong-matches": 50,
    "fine-grid": 50,
    "wheel-slip": 50,
    "random-views": 20,
    "loop": 50,
}
RECORDED = {
    "full rate": {},
    "half rate": {"every": 2},
    "quarter rate": {"every": 4},
    "odometry noise stated x3": {"odometry": 3.0},
    "odometry noise drawn x3": {"odometry": 3.0, "seed": 0},
    "quarter rate, drawn x3": {"every": 4, "odometry": 3.0, "seed": 0},
}
LENGTHS = (500, 1_000, 2_000, 4_000)
TIMED_WAYS = {
    "laps over a grid": grid_laps,
    "a corridor with a new line every half metre": corridor,
}
ROUNDS = 3
TIMED = (
    "filter, known",
    "filter, nearest",
    "filter, gated",
    "filter, jcbb",
    "smoother",
    "smoother, rematch",
)


COLUMNS = (
    ("rmse_m", "path mm", 1e3, np.median),
    ("rmse_m", "mean", 1e3, np.mean),
    ("map_m", "map mm", 1e3, np.median),
    ("wrong", "wrong %", 1e2, np.mean),
    ("missed_sightings", "missed", 1.0, np.mean),
    ("needless", "needless", 1.0, np.mean),
    ("duplicated", "runs with duplicates %", 1e2, np.mean),
    ("missed_lines", "lines missed", 1.0, np.mean),
    ("per_line", "map lines a true line", 1.0, np.mean),
    ("lost", "times lost", 1.0, np.mean),
    ("joined", "lines joined over 150 m", 1.0, np.mean),
    ("misjoined", "wrongly", 1.0, np.mean),
)
"""Name of the figure, heading, factor, and how runs are summed up."""


def judge(case: Case, estimate: Estimate) -> dict[str, float]:
    """Returns the figures of one run of one method."""
    metrics = compare(case.log, case.measurements, [replace(estimate, method="it")])["it"]
    path, found, table = metrics.trajectory, metrics.map, metrics.matching
    assert path is not None
    assert found is not None
    assert table is not None
    right, wrong = int(table.correct.sum()), int(table.incorrect.sum())
    on_lines = len(found.lines.row) - found.spurious
    lost = [n for reason, n in estimate.counts.items() if reason.startswith("lost")]
    joined, misjoined = closings(case, estimate)
    return {
        "rmse_m": path.rmse_m,
        "joined": float(joined),
        "misjoined": float(misjoined),
        "aligned_m": path.aligned_rmse_m,
        "map_m": found.rho_rmse_m,
        "wrong": wrong / (right + wrong),
        "missed_sightings": float(table.missed.sum()),
        "needless": float(table.needless_total),
        "duplicated": float(found.duplicates > 0),
        "missed_lines": float(found.missed or 0),
        "spurious": float(found.spurious),
        "matched": float(found.matched),
        "duplicates": float(found.duplicates),
        "per_line": on_lines / max(1, found.matched + found.unseen),
        "lost": float(sum(lost)),
    }


def run_case(name: str, methods: Sequence[str], seed: int) -> dict[str, float]:
    """Returns the figures of all methods for one seed of a case, named ``method.figure``."""
    case = CASES[name](seed)
    figures = {method: judge(case, METHODS[method](case)) for method in methods}
    return {f"{m}.{key}": value for m, own in figures.items() for key, value in own.items()}


def print_case(name: str, methods: Sequence[str], runs: Sequence[SeededRun]) -> None:
    """Prints the table of a case."""
    for run in runs:
        if run.error:
            print(f"{name}, seed {run.run}: {run.error}")
    runs = [run for run in runs if not run.error]
    print(f"\n### {name}, {len(runs)} seeds\n")
    print("| method | " + " | ".join(heading for _, heading, _, _ in COLUMNS) + " |")
    print("|---" * (len(COLUMNS) + 1) + "|")
    for method in methods:
        cells = []
        for figure, _, scale, summed in COLUMNS:
            values = np.array([float(run.values[f"{method}.{figure}"]) for run in runs])
            cells.append(f"{scale * summed(values):.3g}")
        print(f"| {method} | " + " | ".join(cells) + " |")


def print_recorded(logs: Path, methods: Sequence[str]) -> None:
    """Prints what methods make of recordings, thinned or with worse odometry."""
    print("\n### recordings: lines matched of those seen, twice, spurious; path, aligned, mm\n")
    print("| log | " + " | ".join(methods) + " |")
    print("|---" * (len(methods) + 1) + "|")
    for folder in sorted(path.parent for path in logs.glob("*/log.toml")):
        for what, options in RECORDED.items():
            case, cells = recorded(folder, **options), []
            for method in methods:
                own = judge(case, METHODS[method](case))
                seen = own["matched"] + own["missed_lines"]
                cells.append(
                    f"{own['matched']:.0f} of {seen:.0f}, {own['duplicates']:.0f}, "
                    f"{own['spurious']:.0f}; {1e3 * own['aligned_m']:.1f}"
                )
            print(f"| {folder.name}, {what} | " + " | ".join(cells) + " |")


def print_times() -> None:
    """Prints how the time of filter, smoother and matching grows with the length of a log.

    Processor time, least of several rounds; two sightings a node. What a filter takes beyond
    "filter, known" is its matching, what "smoother, rematch" takes beyond "smoother" its second
    thoughts.
    """
    for title, measured in TIMED_WAYS.items():
        print(f"\n### time, {title}, µs a node\n")
        print("| nodes | " + " | ".join(TIMED) + " |")
        print("|---" * (len(TIMED) + 1) + "|")
        best = {(n, m): np.inf for n in LENGTHS for m in TIMED}
        cases = {n: Case(None, measured(n)) for n in LENGTHS}
        for _ in range(ROUNDS):
            for (nodes, method), least in best.items():
                begin = time.process_time()
                METHODS[method](cases[nodes])
                best[nodes, method] = min(least, time.process_time() - begin)
        for nodes in LENGTHS:
            cells = [f"{1e6 * best[nodes, method] / nodes:.0f}" for method in TIMED]
            print(f"| {nodes:,} | " + " | ".join(cells) + " |")
        exponents = [
            np.polyfit(np.log(LENGTHS), np.log([best[n, m] for n in LENGTHS]), 1)[0] for m in TIMED
        ]
        print("| growth exponent | " + " | ".join(f"{e:.2f}" for e in exponents) + " |")
    print(f"\nThe line detector: {1e6 * detector_time():.0f} µs a frame of 320x240.")


def detector_time() -> float:
    """Returns the detector's processor time for one rendered frame, s, at its defaults."""
    scenario = replace(load_scenario("grid"), repeat=1, path=(Motion(forward=2.0),))
    with tempfile.TemporaryDirectory() as folder:
        log = open_log(simulate(scenario, Path(folder) / "log"))
        assert log.images is not None
        files = [log.folder / name for name in log.images.file]
        frames = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files]
    camera = next(iter(log.cameras.values()))
    least = np.inf
    for _ in range(ROUNDS):
        begin = time.process_time()
        for frame in frames:
            detect_lines(frame, camera, DetectorConfig())
        least = min(least, time.process_time() - begin)
    return float(least / len(frames))


def main() -> None:
    """Prints the tables that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", help=f"of {', '.join(CASES)}, recorded, time")
    parser.add_argument("--methods", nargs="+", default=list(METHODS))
    parser.add_argument("--seeds", type=int, help="runs of each case; by default 20 or 50")
    parser.add_argument("--jobs", type=int, default=1, help="worker processes")
    parser.add_argument("--logs", type=Path, help="folder of recordings")
    options = parser.parse_args()
    for name in options.cases or [*CASES, "recorded", "time"]:
        if name == "time":
            print_times()
        elif name == "recorded":
            if options.logs is not None:
                print_recorded(options.logs, options.methods)
        else:
            job = partial(run_case, name, tuple(options.methods))
            runs = run_seeded(job, options.seeds or SEEDS[name], None, jobs=options.jobs)
            print_case(name, options.methods, runs)


if __name__ == "__main__":
    main()
