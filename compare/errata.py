"""What each misprint of the Santana papers costs: seeded runs with it, and the same without."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np

from compare.errata_world import draw_run, errata_scenario
from compare.metrics import mean_nees, rms
from compare.montecarlo import Progress, SeededRun, Value, run_seeded
from graphslam.config import EkfConfig, MatchingConfig
from graphslam.errors import UnderConstrained
from graphslam.estimate import Estimate
from graphslam.geometry import Array, wrap
from graphslam.measurements import Measurements
from graphslam.printed import ERRATA, Erratum, run_printed

AS_IN_THE_PAPERS = EkfConfig(
    matching=MatchingConfig(method="nearest"), confirm_after=1, lost_after=0
)
"""The papers' matching with the twins put right; a landmark counts from its first sighting."""
SENSELESS = 1e5
"""Figures beyond this are told as such."""
LARGEST = 1e6
"""Errors beyond this are not told apart, m: a filter that doubles its pose leaves all numbers."""
RIGHT = {"SantanaLoc": "localisation", "SantanaSLAM": "slam"}
"""Which of the two right filters an erratum is compared with, by paper."""


@dataclass(frozen=True, slots=True)
class Cost:
    """A filter over many seeds; NaN where no run of it came to an end.

    Attributes:
        runs: runs that came to an end.
        rmse_m: median of the root mean square position errors, m.
        pose_nees: median of the pose NEES per degree of freedom; 1 is honest.
        duplicates: mean number of landmarks more than there are true lines among them.
    """

    runs: int
    rmse_m: float
    pose_nees: float
    duplicates: float


@dataclass(frozen=True, slots=True)
class ErratumCost:
    """One erratum, as printed against right, over the same seeds.

    Attributes:
        erratum: which.
        right: the filter without it, localising or mapping as its paper does.
        printed: the filter with it.
    """

    erratum: Erratum
    right: Cost
    printed: Cost

    @property
    def path_factor(self) -> float:
        """How many times the right filter's path error the printed one's is."""
        return self.printed.rmse_m / self.right.rmse_m


@dataclass(frozen=True, slots=True)
class ErrataStudy:
    """What all errata cost that a filter feels.

    Attributes:
        runs: seeds.
        costs: one entry an erratum, in the order of the papers.
    """

    runs: int
    costs: tuple[ErratumCost, ...]

    def __getitem__(self, name: str) -> ErratumCost:
        """Returns the entry of an erratum; KeyError where it was not run."""
        for cost in self.costs:
            if cost.erratum.name == name:
                return cost
        raise KeyError(name)

    headings = (
        "erratum",
        "equation",
        "path RMSE, right (mm)",
        "printed (mm)",
        "times",
        "pose NEES, right",
        "printed",
        "lines twice, right",
        "printed",
        "broke down",
    )

    def rows(self) -> list[tuple[str, ...]]:
        """Returns the study as text, one row an erratum, by `headings`."""
        return [
            (
                cost.erratum.name,
                f"{cost.erratum.paper} {cost.erratum.where}",
                _text(1e3 * cost.right.rmse_m),
                _text(1e3 * cost.printed.rmse_m),
                _text(cost.path_factor),
                _text(cost.right.pose_nees),
                _text(cost.printed.pose_nees),
                _twice(cost, cost.right),
                _twice(cost, cost.printed),
                f"{self.runs - cost.printed.runs} of {self.runs}",
            )
            for cost in self.costs
        ]


def study_errata(
    runs: int,
    out: Path | None = None,
    *,
    names: Sequence[str] = (),
    config: EkfConfig = AS_IN_THE_PAPERS,
    jobs: int = 0,
    progress: Progress | None = None,
) -> ErrataStudy:
    """Returns what each misprint costs over the seeds 0 to ``runs - 1``.

    Every erratum is switched on alone: those of SantanaLoc in localisation on the known map, those
    of SantanaSLAM in mapping, on the floor and drive of `errata_scenario`.

    Args:
        runs: how many.
        out: folder to keep finished runs in, and to go on in; None keeps nothing.
        names: errata to run; none means all that have a switch.
        config: of all filters.
        jobs: worker processes; 0: as many as the machine has cores. Changes no result.
        progress: told about each run.

    Raises:
        BadConfig: a number is out of range, or ``out`` holds something else.
        KeyError: a name is no erratum.
    """
    chosen = [ERRATA[name] for name in names] or [e for e in ERRATA.values() if e.switchable]
    job = partial(_judge_seed, tuple(e.name for e in chosen), config)
    about = {
        "version": version("floorline-slam"),
        "scenario": asdict(errata_scenario()),
        "errata": [e.name for e in chosen],
        "config": asdict(config),
    }
    fingerprint = hashlib.sha256(json.dumps(about).encode()).hexdigest()
    done = run_seeded(job, runs, out, jobs=jobs, fingerprint=fingerprint, progress=progress)
    costs = [ErratumCost(e, _cost(done, RIGHT[e.paper]), _cost(done, e.name)) for e in chosen]
    return ErrataStudy(runs, tuple(costs))


def _judge_seed(names: tuple[str, ...], config: EkfConfig, seed: int) -> dict[str, Value]:
    """Returns the figures of both right filters and of all printed ones, ``name.figure``."""
    scenario = errata_scenario()
    values: dict[str, Value] = {}
    for paper, right in RIGHT.items():
        measurements, truth = draw_run(scenario, seed, known=paper == "SantanaLoc")
        for name in [right, *(n for n in names if ERRATA[n].paper == paper)]:
            printed = () if name == right else (name,)
            try:
                estimate = run_printed(measurements, printed, config, scenario.robot)
            except UnderConstrained:
                continue
            figures = _judge(estimate, measurements, truth)
            values |= {f"{name}.{figure}": value for figure, value in figures.items()}
    return values


def _judge(estimate: Estimate, measurements: Measurements, truth: Array) -> dict[str, float]:
    error = np.clip(estimate.pose - truth, -LARGEST, LARGEST)
    error[:, 2] = wrap(error[:, 2])
    identity = np.concatenate([table.truth for _, table in measurements.tables()])
    lines = [_majority(identity[estimate.match == row]) for row in range(len(estimate.map))]
    return {
        "rmse_m": rms(np.hypot(*error[:, :2].T)),
        "pose_nees": mean_nees(error[1:], estimate.cov_floor[1:]),
        "duplicates": float(len(lines) - len(set(lines))),
    }


def _majority(identity: Array) -> int:
    """Returns what most sightings of a landmark are of; a known landmark may have none: -1."""
    names, counts = np.unique(identity, return_counts=True)
    return int(names[np.argmax(counts)]) if len(names) else -1


def _cost(done: Sequence[SeededRun], name: str) -> Cost:
    ended = [run.values for run in done if f"{name}.rmse_m" in run.values]
    if not ended:
        return Cost(0, math.nan, math.nan, math.nan)
    return Cost(
        len(ended),
        float(np.median(_column(ended, f"{name}.rmse_m"))),
        float(np.median(_column(ended, f"{name}.pose_nees"))),
        float(np.mean(_column(ended, f"{name}.duplicates"))),
    )


def _column(ended: Sequence[Mapping[str, Value]], name: str) -> list[float]:
    return [float(values[name]) for values in ended]


def _twice(cost: ErratumCost, of: Cost) -> str:
    return _text(of.duplicates) if cost.erratum.paper == "SantanaSLAM" else "–"


def _text(value: float) -> str:
    """Returns a figure with two significant digits; a dash where there is none."""
    if math.isnan(value):
        return "–"
    if value > SENSELESS:
        return f"> {SENSELESS:,.0f}"
    return f"{value:,.0f}" if abs(value) >= 10 else f"{value:.2g}"
