"""The experiments of the Santana papers, and what one run of each comes to."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from compare.comparison import Comparison, compare
from compare.config import RunConfig
from compare.methods import run_methods
from compare.montecarlo import Value
from compare.papers_flaws import Flaws, passes, simulate_flawed
from compare.printed import PrintedPaper, printed_paper
from compare.study import FIGURES
from frontend.config import DetectorConfig, ExtractConfig
from frontend.extract import extract
from frontend.simulate import Scenario, load_scenario, simulate_log
from graphslam.config import SmootherConfig
from graphslam.measurements import Measurements
from graphslam.models.line import LINE

LOCALISING = ("odometry", "geometric", "ekf", "smoother", "particle")
"""Methods on a known map: SantanaLoc's three, and two more."""
MAPPING = ("odometry", "ekf", "smoother")
"""Methods without: SantanaSLAM's, and two more."""
EXACT = "exact"
VARIANTS = {
    EXACT: Flaws(),
    "camera": Flaws(calibration_m=0.015),
    "map": Flaws(map_rho_m=0.01, map_alpha_deg=0.5),
    "noise held": Flaws(held=1.0),
    "noise held, threefold": Flaws(held=3.0),
}
"""What is wrong in the runs of SantanaLoc, by name. 1.5 cm is its mean reprojection error; it says
nothing of the map's, so 1 cm and half a degree are ours."""
MOST_LINES = 3
"""Lines in one frame that are counted one by one; more are counted with these."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """One experiment of a paper.

    Attributes:
        key: name of its folder.
        title: a few words.
        paper: key of the paper.
        prefix: what its printed values begin with.
        scenario: name of the scenario that simulates it.
        known: whether the robot has a map.
        binarise: edge pixels of the paper's detector.
        methods: what is compared.
    """

    key: str
    title: str
    paper: str
    prefix: str
    scenario: str
    known: bool
    binarise: str
    methods: tuple[str, ...]

    @property
    def printed(self) -> PrintedPaper:
        """What the paper prints."""
        return printed_paper(self.paper)

    def simulated(self) -> Scenario:
        """Returns the scenario."""
        return load_scenario(self.scenario)

    def detector(self) -> DetectorConfig:
        """Returns the paper's detector and its noise law, whatever our defaults are."""
        loc = printed_paper("SantanaLoc")
        return DetectorConfig(
            method="hough",
            sigma_law="paper",
            binarise="global" if self.binarise == "global" else "canny",
            sigma_rho_a_m=loc.value("noise_a"),
            sigma_rho_b_m=loc.value("noise_b"),
            sigma_rho_c_m=loc.value("noise_c"),
            sigma_alpha_deg=0.5,
        )

    def config(self) -> RunConfig:
        """Returns what a run of it computes."""
        return RunConfig(
            methods=self.methods,  # type: ignore[arg-type]
            extract=ExtractConfig(detector=self.detector()),
            smoother=SmootherConfig(engine="chain"),
        )


LOC_1 = Experiment(
    "experiment-1",
    "SantanaLoc, experiment 1",
    "SantanaLoc",
    "experiment_1_",
    "santana-loc-1",
    True,
    "canny",
    LOCALISING,
)
LOC_2 = replace(
    LOC_1,
    key="experiment-2",
    title="SantanaLoc, experiment 2",
    prefix="experiment_2_",
    scenario="santana-loc-2",
)
SLAM = Experiment(
    "slam", "SantanaSLAM", "SantanaSLAM", "", "santana-slam", False, "global", MAPPING
)
EXPERIMENTS = (LOC_1, LOC_2, SLAM)


def methods_under(experiment: Experiment, variant: str) -> tuple[str, ...]:
    """Returns the methods that are run under a variant: the paper's own but under the exact one."""
    if variant == EXACT:
        return experiment.methods
    return tuple(name for name in experiment.methods if name not in ("smoother", "particle"))


def judge_seed(experiment: Experiment, variant: str, seed: int) -> dict[str, Value]:
    """Returns what one run without images comes to.

    Figures of `compare.study.FIGURES` are named ``method.figure``; `seen_figures` are named alone.
    """
    scenario = experiment.simulated()
    if experiment.known:
        log, measurements = simulate_flawed(scenario, VARIANTS[variant], seed)
    else:
        log = simulate_log(scenario, seed)
        measurements = extract(log)
    config = replace(experiment.config(), methods=methods_under(experiment, variant))
    estimates, failed = run_methods(measurements, config, lambda name, call: call())
    for error in failed.values():
        raise error
    assert log.truth is not None, "simulated"
    frames = math.floor(log.truth.t[-1] * scenario.rate + 1e-6) + 1
    comparison = compare(log, measurements, list(estimates.values()))
    return {**seen_figures(measurements, frames), **method_figures(comparison)}


def method_figures(comparison: Comparison) -> dict[str, Value]:
    """Returns the figures of every method, named ``method.figure``; NaN where not defined."""
    values: dict[str, Value] = {}
    for metrics in comparison.methods:
        name = metrics.method
        for figure in FIGURES:
            value = figure.of(metrics)
            values[f"{name}.{figure.name}"] = math.nan if value is None else value
        table = metrics.matching
        right = 0 if table is None else int(table.correct.sum())
        wrong = 0 if table is None else int(table.incorrect.sum())
        values |= shares(name, right, wrong, metrics.sightings)
        origin = math.nan if metrics.map is None else metrics.map.rho_origin_rmse_m
        values[f"{name}.rho_origin_rmse_m"] = origin
    return values


def shares(method: str, right: int, wrong: int, sightings: int) -> dict[str, Value]:
    """Returns the shares of sightings that a method took for their own line, and for another."""
    return {
        f"{method}.matched_share": right / max(1, sightings),
        f"{method}.wrong_share": wrong / max(1, sightings),
    }


def seen_figures(measurements: Measurements, frames: int) -> dict[str, Value]:
    """Returns how often how many lines were seen, whatever a method makes of them.

    ``images``; ``seen_share`` of all frames, ``one_share``, ``two_share`` and ``three_share`` (or
    more) likewise, ``one_of_seen`` and ``two_of_seen`` of those with lines; ``views_per_line`` over
    the run, ``views_per_pass`` each time that a line is driven over.
    """
    lines = measurements.sightings[LINE.kind]
    counts = np.bincount(np.unique(lines.node, return_counts=True)[1], minlength=MOST_LINES + 1)
    true = lines.truth >= 0
    which, t = lines.truth[true], measurements.t[lines.node[true]]
    seen = max(1, int(counts[1:].sum()))
    passed = len(np.unique(passes(t, which)))
    return {
        "images": frames,
        "seen_share": float(counts[1:].sum()) / frames,
        "one_share": float(counts[1]) / frames,
        "two_share": float(counts[2]) / frames,
        "three_share": float(counts[MOST_LINES:].sum()) / frames,
        "one_of_seen": float(counts[1]) / seen,
        "two_of_seen": float(counts[2]) / seen,
        "views_per_line": len(which) / max(1, len(np.unique(which))),
        "views_per_pass": len(which) / max(1, passed),
    }
