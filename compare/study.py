"""A Monte Carlo study: one scenario simulated under many seeds, every method judged on each."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from compare.comparison import MethodMetrics, compare
from compare.config import RunConfig
from compare.folders import whole_file
from compare.methods import run_methods
from compare.montecarlo import Progress, SeededRun, Value, run_seeded
from compare.results import write_csv, write_json
from frontend.extract import extract
from frontend.simulate import Scenario, simulate_log

STUDY_FORMAT = "graphslam-study/1"


@dataclass(frozen=True, slots=True)
class Figure:
    """One number about a method in a run.

    Attributes:
        name: column of runs.csv.
        label: what tables for people call it.
        unit: its unit in such tables.
        scale: factor from the column to that unit.
        of: takes the method's metrics; returns the number, NaN or None where it is not defined.
        worst: which of many is the worst.
    """

    name: str
    label: str
    unit: str
    scale: float
    of: Callable[[MethodMetrics], float | None]
    worst: Callable[[Sequence[float]], float] = max


FIGURES = (
    Figure("rmse_m", "path RMSE", "mm", 1e3, lambda m: m.trajectory and m.trajectory.rmse_m),
    Figure(
        "aligned_rmse_m",
        "path RMSE, aligned",
        "mm",
        1e3,
        lambda m: m.trajectory and m.trajectory.aligned_rmse_m,
    ),
    Figure(
        "final_error_m",
        "final error",
        "mm",
        1e3,
        lambda m: m.trajectory and m.trajectory.final_error_m,
    ),
    Figure(
        "aligned_final_error_m",
        "final error, aligned",
        "mm",
        1e3,
        lambda m: m.trajectory and m.trajectory.aligned_final_error_m,
    ),
    Figure(
        "heading_rmse_deg",
        "heading RMSE",
        "°",
        1.0,
        lambda m: m.trajectory and m.trajectory.heading_rmse_deg,
    ),
    Figure("map_rmse_m", "map RMSE", "mm", 1e3, lambda m: m.map and m.map.rho_rmse_m),
    Figure("alpha_rmse_deg", "map angle RMSE", "°", 1.0, lambda m: m.map and m.map.alpha_rmse_deg),
    Figure("matched", "lines matched", "", 1.0, lambda m: m.map and m.map.matched, min),
    Figure("missed", "lines missed", "", 1.0, lambda m: m.map and m.map.missed),
    Figure("spurious", "lines spurious", "", 1.0, lambda m: m.map and m.map.spurious),
    Figure("duplicates", "lines twice", "", 1.0, lambda m: m.map and m.map.duplicates),
    Figure("pose_nees", "pose NEES", "", 1.0, lambda m: m.pose_nees),
    Figure("map_nees", "map NEES", "", 1.0, lambda m: m.map and m.map.nees),
    Figure(
        "right_share",
        "right matches",
        "%",
        1e2,
        lambda m: m.matching and m.matching.right_share,
        min,
    ),
    Figure("nis", "NIS per dimension", "", 1.0, lambda m: m.nis_per_dof),
)


@dataclass(frozen=True, slots=True)
class Summary:
    """One figure of one method over all runs that define it.

    Attributes:
        method: name of the method.
        figure: which figure.
        runs: runs in which it is defined.
        median: over them; NaN where there are none, as the two below.
        mean: over them.
        worst: over them.
    """

    method: str
    figure: Figure
    runs: int
    median: float
    mean: float
    worst: float


@dataclass(frozen=True, slots=True)
class Study:
    """What a study came to.

    Attributes:
        scenario: name of the scenario.
        methods: the methods compared.
        runs: every run, by number.
        summary: one entry a method and figure.
    """

    scenario: str
    methods: tuple[str, ...]
    runs: tuple[SeededRun, ...]
    summary: tuple[Summary, ...]

    @property
    def failed(self) -> tuple[SeededRun, ...]:
        """The runs that failed."""
        return tuple(run for run in self.runs if run.error)


def study(
    scenario: Scenario,
    runs: int,
    out: Path | None,
    config: RunConfig | None = None,
    *,
    jobs: int = 0,
    progress: Progress | None = None,
) -> Study:
    """Simulates measurements under the seeds 0 to ``runs - 1``, estimates, and judges.

    Args:
        scenario: what to simulate, without images.
        runs: how many.
        out: folder to write, or to go on in: study.json, runs.jsonl, runs.csv and summary.csv;
            equal input gives equal bytes. None writes nothing.
        config: what to compute; None for the defaults. The detector has nothing to detect.
        jobs: worker processes; 0: as many as the machine has cores. Changes no result.
        progress: told about each run.

    Raises:
        BadConfig: ``out`` holds something else, or another study.
        OSError: the folder cannot be written.
    """
    config = config or RunConfig()
    about = _about(scenario, config)
    fingerprint = hashlib.sha256(json.dumps(about).encode()).hexdigest()
    job = partial(judge_seed, scenario, config)
    done = run_seeded(job, runs, out, jobs=jobs, fingerprint=fingerprint, progress=progress)
    result = Study(scenario.name, config.methods, done, _summary(done, config.methods))
    if out is not None:
        with whole_file(out / "study.json") as path:
            write_json(path, about | {"runs": runs})
        with whole_file(out / "runs.csv") as path:
            write_csv(path, _runs_columns(result))
        with whole_file(out / "summary.csv") as path:
            write_csv(path, _summary_columns(result))
    return result


def judge_seed(scenario: Scenario, config: RunConfig, seed: int) -> dict[str, Value]:
    """Returns the figures of all methods for one seed, named ``method.figure``."""
    log = simulate_log(scenario, seed)
    measurements = extract(log, config.extract)
    estimates, failed = run_methods(measurements, config, lambda name, call: call())
    for error in failed.values():
        raise error
    comparison = compare(log, measurements, list(estimates.values()))
    values: dict[str, Value] = {}
    for metrics in comparison.methods:
        for figure in FIGURES:
            value = figure.of(metrics)
            values[f"{metrics.method}.{figure.name}"] = math.nan if value is None else value
    return values


def _about(scenario: Scenario, config: RunConfig) -> dict[str, Any]:
    config = replace(config, extract=replace(config.extract, workers=0))  # changes no result
    return {
        "format": STUDY_FORMAT,
        "version": version("floorline-slam"),
        "scenario": asdict(scenario),
        "config": asdict(config),
    }


def _summary(runs: Sequence[SeededRun], methods: Sequence[str]) -> tuple[Summary, ...]:
    table = []
    for method in methods:
        for figure in FIGURES:
            found = [run.values.get(f"{method}.{figure.name}", math.nan) for run in runs]
            known = [float(value) for value in found if not math.isnan(float(value))]
            numbers = (math.nan,) * 3
            if known:
                numbers = (float(np.median(known)), float(np.mean(known)), figure.worst(known))
            table.append(Summary(method, figure, len(known), *numbers))
    return tuple(table)


def _runs_columns(result: Study) -> dict[str, list[Any]]:
    """Returns the columns of runs.csv: one row for each run that did not fail and each method."""
    rows = [(run, method) for run in result.runs if not run.error for method in result.methods]
    columns: dict[str, list[Any]] = {
        "run": [run.run for run, _ in rows],
        "method": [method for _, method in rows],
    }
    for figure in FIGURES:
        columns[figure.name] = [run.values[f"{method}.{figure.name}"] for run, method in rows]
    return columns


def _summary_columns(result: Study) -> dict[str, list[Any]]:
    return {
        "method": [entry.method for entry in result.summary],
        "figure": [entry.figure.name for entry in result.summary],
        "runs": [entry.runs for entry in result.summary],
        "median": [entry.median for entry in result.summary],
        "mean": [entry.mean for entry in result.summary],
        "worst": [entry.worst for entry in result.summary],
    }
