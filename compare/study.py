"""A Monte Carlo study: one scenario simulated under many seeds, every method judged on each."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from compare.comparison import Comparison, compare
from compare.config import RunConfig
from compare.consistency import SHARES, sampled
from compare.folders import whole_file
from compare.methods import run_methods
from compare.montecarlo import Progress, SeededRun, Value, run_seeded
from compare.results import write_csv, write_json
from compare.study_figures import BOUNDS, FIGURES, STUDY_FIGURES, Figure
from compare.verdict import first_of_all
from frontend.extract import extract
from frontend.simulate import NoiseLevel, Scenario, noisier, simulate_log
from frontend.strict import from_dict
from graphslam.errors import BadConfig

if TYPE_CHECKING:
    from frontend.log import Log
    from graphslam.measurements import Measurements

__all__ = ["FIGURES", "Figure", "Study", "Summary", "judge_seed", "read_study", "study"]

STUDY_FORMAT = "graphslam-study/2"
POINTS = SHARES
"""Distances along the way at which errors are held against covariances."""
CURVES = ("x", "y", "heading", "pose")


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
        noise: level of noise.
    """

    method: str
    figure: Figure
    runs: int
    median: float
    mean: float
    worst: float
    noise: str = "1"


@dataclass(frozen=True, slots=True)
class Study:
    """What a study came to.

    Attributes:
        scenario: name of the scenario.
        methods: the methods compared.
        noise: the levels of noise.
        runs: every run, by number; of L levels run number r is seed r // L at level r % L.
        summary: one entry a level, method and figure.
    """

    scenario: str
    methods: tuple[str, ...]
    noise: tuple[NoiseLevel, ...]
    runs: tuple[SeededRun, ...]
    summary: tuple[Summary, ...]

    @property
    def failed(self) -> tuple[SeededRun, ...]:
        """The runs that failed."""
        return tuple(run for run in self.runs if run.error)

    def name(self, run: SeededRun) -> str:
        """Returns what a run is called: its seed, and its level of noise if there are several."""
        seed, level = divmod(run.run, len(self.noise))
        at = f" at noise {self.noise[level]}" if len(self.noise) > 1 else ""
        return f"run {seed}{at}"

    def at(self, level: NoiseLevel) -> list[Mapping[str, Value]]:
        """Returns the values of all runs at a level that did not fail."""
        place, levels = self.noise.index(level), len(self.noise)
        return [run.values for run in self.runs if run.run % levels == place and not run.error]

    def column(self, level: NoiseLevel, name: str) -> np.ndarray:
        """Returns one value (n,) of all runs at a level, NaN where it is not defined."""
        return np.array([float(values.get(name, math.nan)) for values in self.at(level)])


def study(
    scenario: Scenario,
    runs: int,
    out: Path | None,
    config: RunConfig | None = None,
    *,
    noise: Sequence[NoiseLevel] = (),
    jobs: int = 0,
    progress: Progress | None = None,
) -> Study:
    """Simulates measurements under the seeds 0 to ``runs - 1``, estimates, and judges.

    Args:
        scenario: what to simulate, without images.
        runs: how many at each level of noise.
        out: folder to write, or to go on in: study.json, runs.jsonl and the tables made from it;
            equal input gives equal bytes. None writes nothing.
        config: what to compute; None for the defaults. The detector has nothing to detect.
        noise: levels of noise; the scenario's own where empty.
        jobs: worker processes; 0: as many as the machine has cores. Changes no result.
        progress: told about each run.

    Raises:
        BadConfig: ``out`` holds something else, or another study.
        OSError: the folder cannot be written.
    """
    config, levels = config or RunConfig(), tuple(dict.fromkeys(noise)) or (NoiseLevel(),)
    about = _about(scenario, config, levels)
    fingerprint = hashlib.sha256(json.dumps(about).encode()).hexdigest()
    job = partial(_judge_run, tuple(noisier(scenario, level) for level in levels), config)
    total = runs * len(levels)
    done = run_seeded(job, total, out, jobs=jobs, fingerprint=fingerprint, progress=progress)
    result = summed_up(scenario.name, config.methods, levels, done)
    if out is not None:
        with whole_file(out / "study.json") as path:
            write_json(path, about | {"runs": runs})
        with whole_file(out / "runs.csv") as path:
            write_csv(path, _runs_columns(result))
        with whole_file(out / "summary.csv") as path:
            write_csv(path, _summary_columns(result))
        from compare.study_report import write_study

        write_study(result, out)
    return result


def summed_up(
    scenario: str,
    methods: tuple[str, ...],
    levels: tuple[NoiseLevel, ...],
    runs: tuple[SeededRun, ...],
) -> Study:
    """Returns a study of runs that are done, in the order that `Study` says."""
    result = Study(scenario, methods, levels, runs, ())
    return replace(result, summary=_summary(result))


def read_study(path: Path) -> tuple[Scenario, RunConfig, tuple[NoiseLevel, ...], int]:
    """Returns scenario, settings, levels of noise and number of runs of a study.json.

    Raises:
        BadConfig: it is none, or another version wrote it.
    """
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
        if about["format"] != STUDY_FORMAT or about["version"] != version("floorline-slam"):
            raise BadConfig(f"{path}: another version wrote it; install {about['version']}")
        scenario = from_dict(Scenario, _without_none(about["scenario"]), str(path))
        config = from_dict(RunConfig, _without_none(about["config"]), str(path))
        return scenario, config, tuple(NoiseLevel(*e) for e in about["noise"]), int(about["runs"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise BadConfig(f"{path}: is no study.json of ours ({error!r})") from error


def judge_seed(scenario: Scenario, config: RunConfig, seed: int) -> dict[str, Value]:
    """Returns the figures of all methods for one seed, as `judge` names them."""
    log = simulate_log(scenario, seed)
    return judge(log, extract(log, config.extract), config)


def judge(log: Log, measurements: Measurements, config: RunConfig) -> dict[str, Value]:
    """Returns the figures of all methods for one run, named ``method.figure``.

    ``bound.path_m`` and the like are the fields of `compare.bound.Bound`, ``method.heading.07``
    the squared error over its variance at the seventh of `POINTS` distances, ``distance.07``.
    ``method.innovation.07`` is the NIS per degree of freedom of the way up to there from the one
    before, ``method.freedom.07`` how many degrees those are. ``neither_deg`` is the direction that
    needs lines across before any method is chosen, where the run's verdict names one.
    """
    estimates, failed = run_methods(measurements, config, lambda name, call: call())
    for error in failed.values():
        raise error
    comparison = compare(log, measurements, list(estimates.values()), config.smoother.engine)
    values: dict[str, Value] = {}
    for metrics in comparison.methods:
        for figure in STUDY_FIGURES:
            value = figure.of(metrics)
            values[f"{metrics.method}.{figure.name}"] = math.nan if value is None else value
    open_direction = first_of_all(comparison.methods)
    if open_direction is not None:
        values["neither_deg"] = open_direction.angle_deg
    return values | _bound_values(comparison) | _curve_values(comparison)


def _judge_run(scenarios: tuple[Scenario, ...], config: RunConfig, run: int) -> dict[str, Value]:
    seed, level = divmod(run, len(scenarios))
    return judge_seed(scenarios[level], config, seed)


def _bound_values(comparison: Comparison) -> dict[str, Value]:
    bound = comparison.bound
    if bound is None or bound.at != "truth":
        return {}
    return {f"bound.{field}": float(getattr(bound, field)) for _, _, field in BOUNDS}


def _curve_values(comparison: Comparison) -> dict[str, Value]:
    values: dict[str, Value] = {}
    for metrics in comparison.methods:
        if metrics.innovations is not None:
            found = metrics.innovations
            for k in range(POINTS):
                values[f"{metrics.method}.share.{k:02}"] = float(found.distance[k])
                values[f"{metrics.method}.innovation.{k:02}"] = float(found.nis[k])
                values[f"{metrics.method}.freedom.{k:02}"] = float(found.freedom[k])
        if metrics.consistency is None:
            continue
        curve = sampled(metrics.consistency, POINTS)
        for k in range(POINTS):
            values[f"distance.{k:02}"] = float(curve.distance[k])
            for column, state in enumerate(CURVES):
                values[f"{metrics.method}.{state}.{k:02}"] = float(curve.nees[k, column])
    return values


def _about(scenario: Scenario, config: RunConfig, levels: Sequence[NoiseLevel]) -> dict[str, Any]:
    config = replace(config, extract=replace(config.extract, workers=0))  # changes no result
    return {
        "format": STUDY_FORMAT,
        "version": version("floorline-slam"),
        "scenario": asdict(scenario),
        "config": asdict(config),
        "noise": [[level.wheels, level.sightings] for level in levels],
    }


def _without_none(data: Any) -> Any:
    """Returns parsed JSON without its nulls: what is absent has its default, as in TOML."""
    if isinstance(data, dict):
        return {key: _without_none(value) for key, value in data.items() if value is not None}
    return [_without_none(value) for value in data] if isinstance(data, list) else data


def _summary(result: Study) -> tuple[Summary, ...]:
    table = []
    for level in result.noise:
        for method in result.methods:
            for figure in STUDY_FIGURES:
                found = result.column(level, f"{method}.{figure.name}")
                known = [float(value) for value in found if not math.isnan(value)]
                numbers = (math.nan,) * 3
                if known:
                    numbers = (float(np.median(known)), float(np.mean(known)), figure.worst(known))
                table.append(Summary(method, figure, len(known), *numbers, str(level)))
    return tuple(table)


def _runs_columns(result: Study) -> dict[str, list[Any]]:
    """Returns the columns of runs.csv: one row for each run that did not fail and each method."""
    rows = [(run, method) for run in result.runs if not run.error for method in result.methods]
    levels = len(result.noise)
    columns: dict[str, list[Any]] = {
        "run": [run.run // levels for run, _ in rows],
        "noise": [str(result.noise[run.run % levels]) for run, _ in rows],
        "method": [method for _, method in rows],
    }
    for figure in STUDY_FIGURES:
        columns[figure.name] = [run.values[f"{method}.{figure.name}"] for run, method in rows]
    for _, _, field in BOUNDS:
        columns[f"bound_{field}"] = [run.values.get(f"bound.{field}", math.nan) for run, _ in rows]
    return columns


def _summary_columns(result: Study) -> dict[str, list[Any]]:
    return {
        "noise": [entry.noise for entry in result.summary],
        "method": [entry.method for entry in result.summary],
        "figure": [entry.figure.name for entry in result.summary],
        "runs": [entry.runs for entry in result.summary],
        "median": [entry.median for entry in result.summary],
        "mean": [entry.mean for entry in result.summary],
        "worst": [entry.worst for entry in result.summary],
    }
