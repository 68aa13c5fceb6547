"""Both Santana papers again: many runs without images, one of each experiment through images."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from compare.fingerprint import fingerprints, holds_result
from compare.folders import whole_file, writing
from compare.montecarlo import Progress, SeededRun, run_seeded
from compare.papers_experiments import (
    EXACT,
    EXPERIMENTS,
    VARIANTS,
    Experiment,
    judge_seed,
    methods_under,
)
from compare.papers_flaws import Flaws, known_map
from compare.papers_images import drive_of, film
from compare.record import Record
from compare.results import write_json
from compare.run import run_opened
from graphslam.errors import BadConfig
from graphslam.geometry import Array

if TYPE_CHECKING:
    from compare.errata import ErrataStudy

PAPERS_FORMAT = "graphslam-papers/1"
SEED_OF_IMAGES = 0
"""Seed of the runs through images."""


def runs_under(variant: str, runs: int) -> int:
    """Returns how many runs a variant gets where the exact one gets ``runs``: half as many."""
    return runs if variant == EXACT else max(1, runs // 2)


@dataclass(frozen=True, slots=True)
class MonteCarlo:
    """One experiment under many seeds, without images.

    Attributes:
        experiment: which.
        variant: what was wrong, a key of `papers_experiments.VARIANTS`.
        runs: every run, by number.
    """

    experiment: Experiment
    variant: str
    runs: tuple[SeededRun, ...]

    @property
    def methods(self) -> tuple[str, ...]:
        """What was compared."""
        return methods_under(self.experiment, self.variant)

    def values(self, name: str) -> Array:
        """Returns a figure of all runs that define it."""
        found = np.array([float(run.values.get(name, np.nan)) for run in self.runs])
        return found[np.isfinite(found)]

    def median(self, name: str) -> float:
        """Returns the median of a figure; NaN where no run defines it."""
        values = self.values(name)
        return float(np.median(values)) if len(values) else float("nan")


@dataclass(frozen=True, slots=True)
class Papers:
    """What reproducing the papers came to.

    Attributes:
        folder: where it is written.
        runs: seeds of each experiment without images.
        studies: every experiment and variant.
        filmed: the run through images of each experiment, by its key.
        errata: what the misprints cost; None where it was not asked for.
        seconds: mean wall time of a frame, by experiment and stage.
    """

    folder: Path
    runs: int
    studies: tuple[MonteCarlo, ...]
    filmed: Mapping[str, Record]
    errata: ErrataStudy | None
    seconds: Mapping[str, Mapping[str, float]]

    def study(self, key: str, variant: str = EXACT) -> MonteCarlo:
        """Returns one study; KeyError where it was not made."""
        for study in self.studies:
            if (study.experiment.key, study.variant) == (key, variant):
                return study
        raise KeyError(f"{key}, {variant}")

    def variant(self, key: str, variant: str = EXACT) -> MonteCarlo:
        """Returns one study by those seeds only that every variant has."""
        study = self.study(key, variant)
        fewest = min(runs_under(name, self.runs) for name in VARIANTS)
        return replace(study, runs=study.runs[:fewest])

    @property
    def failed(self) -> tuple[SeededRun, ...]:
        """The runs that failed, of all studies."""
        return tuple(run for study in self.studies for run in study.runs if run.error)


def reproduce_papers(
    out: Path | str,
    runs: int = 20,
    *,
    errata: bool = False,
    jobs: int = 0,
    progress: Progress | None = None,
) -> Papers:
    """Reproduces the experiments of SantanaLoc and SantanaSLAM and writes one report.

    What an earlier call left in the folder is used again, finished or killed.

    Args:
        out: folder to write, or to go on in.
        runs: how many runs without images of each experiment; run N has the seed N.
        errata: whether to run what the papers' misprints cost, too.
        jobs: worker processes; 0: as many as the machine has cores. Changes no result.
        progress: told about each part.

    Raises:
        BadConfig: the folder holds something else.
        OSError: the folder cannot be written.
    """
    from compare.report_papers import metrics_of, write_papers_report

    out = Path(out)
    _check(out)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        about = {"format": PAPERS_FORMAT, "version": version("floorline-slam"), "runs": runs}
        with whole_file(out / "papers.json") as path:
            write_json(path, about | {"seed_of_images": SEED_OF_IMAGES})
        seconds = _read_json(out / "timings.json")
        filmed = {}
        for experiment in EXPERIMENTS:
            record, spent = _filmed(experiment, out / experiment.key, jobs, progress)
            filmed[experiment.key] = record
            seconds[experiment.key] = seconds.get(experiment.key, {}) | spent
            with whole_file(out / "timings.json") as path:
                write_json(path, seconds)
        studies = tuple(
            _study(experiment, variant, runs_under(variant, runs), out / "runs", jobs, progress)
            for experiment in EXPERIMENTS
            for variant in (VARIANTS if experiment.known else (EXACT,))
        )
        costs = _errata(runs, out / "errata", jobs, progress) if errata else None
        papers = Papers(out, runs, studies, filmed, costs, seconds)
        with whole_file(out / "metrics.json") as path:
            write_json(path, metrics_of(papers))
        write_papers_report(papers)
    return papers


def _check(out: Path) -> None:
    """Raises BadConfig where the folder holds something that this command did not write."""
    if out.exists() and not out.is_dir():
        raise BadConfig(f"{out}: this is a file; give another --out")
    ours = _read_json(out / "papers.json").get("format") == PAPERS_FORMAT
    if out.is_dir() and any(out.iterdir()) and not ours:
        raise BadConfig(
            f"{out}: holds something that this command did not write; give another --out"
        )


def _read_json(path: Path) -> dict[str, Any]:
    """Returns a JSON object; empty where there is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _study(
    experiment: Experiment,
    variant: str,
    runs: int,
    out: Path,
    jobs: int,
    progress: Progress | None,
) -> MonteCarlo:
    about = {
        "version": version("floorline-slam"),
        "scenario": asdict(experiment.simulated()),
        "config": asdict(experiment.config()),
        "methods": methods_under(experiment, variant),
        "flaws": asdict(VARIANTS[variant]),
    }
    done = run_seeded(
        partial(judge_seed, experiment, variant),
        runs,
        out / f"{experiment.key}, {variant}",
        jobs=jobs,
        fingerprint=hashlib.sha256(json.dumps(about).encode()).hexdigest(),
        progress=_named(progress, f"{experiment.title}, {variant}"),
    )
    return MonteCarlo(experiment, variant, done)


def _filmed(
    experiment: Experiment, folder: Path, jobs: int, progress: Progress | None
) -> tuple[Record, dict[str, float]]:
    """Returns the run through images, and the time of its frames, s, empty where it is reused."""
    scenario, detector, config = experiment.simulated(), experiment.detector(), experiment.config()
    log = drive_of(scenario, detector, SEED_OF_IMAGES)
    if holds_result(folder, fingerprints(log, config)):
        return Record.load(folder), {}
    seen = film(scenario, detector, SEED_OF_IMAGES, jobs=jobs, progress=progress)
    measurements = seen.measurements
    if experiment.known:
        exact = known_map(seen.log, Flaws(), np.random.default_rng(SEED_OF_IMAGES))
        measurements = replace(measurements, known=exact)
    run_opened(seen.log, folder, config, progress, measurements=measurements)
    record = Record.load(folder)
    frames = len(measurements.t)
    methods = {name: record.timings[name] / frames for name in record.estimates}
    return record, seen.seconds | methods


def _errata(runs: int, out: Path, jobs: int, progress: Progress | None) -> ErrataStudy:
    from compare.errata import study_errata

    return study_errata(runs, out, jobs=jobs, progress=_named(progress, "errata"))


def _named(progress: Progress | None, name: str) -> Progress | None:
    if progress is None:
        return None
    return lambda stage, done, total: progress(f"{name}: {stage}", done, total)
