"""The gain that `graphslam study --what-if` predicts beside the gain that simulation shows.

    python benchmarks/what_if.py [--runs N]

Each prediction is made once, from the log of seed 0, as a user would make it from theirs. The
change is then simulated: the smoother's RMS errors over all seeds, before and after. Beside it
stands the gain of the bound in the changed world, at the true path and lines of a few seeds: what
the simulated gain comes to where there are very many seeds and the smoother is efficient. Matches
are the true ones.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from compare.bound import bound_at_truth, bound_of
from compare.metrics import trajectory
from compare.montecarlo import Value, run_seeded
from compare.truth import truth_of
from compare.what_if import WhatIf, what_if
from frontend.config import NoiseConfig
from frontend.extract import extract
from frontend.simulate import NoiseLevel, Scenario, load_scenario, noisier, simulate_log
from frontend.simulate.floor import LineGrid
from graphslam.config import EkfConfig, MatchingConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.smoother import smooth

EKF = EkfConfig(matching=MatchingConfig(method="known"))
SMOOTHER = SmootherConfig(engine="chain")
NOISE = NoiseConfig()
FIGURES = {"path": "rmse_m", "last pose": "final_error_m"}
BOUND = {"path": "path_m", "last pose": "final_m"}
BOUND_SEEDS = range(10)


def main() -> None:
    """Prints a table of predicted and simulated gains."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200, help="seeds before and after each change")
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    given = parser.parse_args()
    print("| floor | change | quantity | predicted gain | of the true bound | simulated |")
    print("|---|---|---|---:|---:|---:|")
    for floor, changes in CASES.items():
        scenario = load_scenario(floor)
        predicted = predict(scenario)
        before = simulated(scenario, given.runs, given.jobs)
        bound = bounds(scenario)
        for number, change in changes.items():
            after = simulated(change(scenario), given.runs, given.jobs)
            changed = bounds(change(scenario))
            for quantity in FIGURES:
                entry = predicted.predictions[number]
                told = predicted.gain(entry, quantity)
                ratio, scatter = compared(before[quantity], after[quantity])
                true = 1.0 - changed[quantity] / bound[quantity]
                print(
                    f"| `{floor}` | {entry.change} | {quantity} | {told:.3f} |"
                    f" {true:.3f} ({told / true - 1.0:+.0%}) |"
                    f" {1.0 - ratio:.3f} ± {scatter:.3f} ({told / (1.0 - ratio) - 1.0:+.0%}) |",
                    flush=True,
                )


def predict(scenario: Scenario) -> WhatIf:
    """Returns what the log of seed 0 promises of each change."""
    log = simulate_log(scenario, 0)
    measurements = extract(log)
    estimate = smooth(measurements, run_ekf(measurements, EKF), SMOOTHER)
    return what_if(log, measurements, estimate, NOISE, SMOOTHER.engine)


def simulated(scenario: Scenario, runs: int, jobs: int) -> dict[str, np.ndarray]:
    """Returns the smoother's errors (n,) under all seeds, by quantity; NaN where a run failed."""
    done = run_seeded(partial(_errors, scenario), runs, None, jobs=jobs)
    return {q: np.array([float(run.values.get(q, math.nan)) for run in done]) for q in FIGURES}


def _errors(scenario: Scenario, seed: int) -> dict[str, Value]:
    log = simulate_log(scenario, seed)
    measurements = extract(log)
    path = trajectory(
        smooth(measurements, run_ekf(measurements, EKF), SMOOTHER), truth_of(log, measurements)
    )
    assert path is not None, "a simulated path is known"
    return {quantity: getattr(path, figure) for quantity, figure in FIGURES.items()}


def bounds(scenario: Scenario) -> dict[str, float]:
    """Returns the bound, RMS over `BOUND_SEEDS`, by quantity, m."""
    found = []
    for seed in BOUND_SEEDS:
        log = simulate_log(scenario, seed)
        measurements = extract(log)
        truth = truth_of(log, measurements)
        at_truth = bound_at_truth(measurements, truth, SMOOTHER.engine)
        assert at_truth is not None, "a simulated world is known"
        found.append(bound_of(at_truth, measurements, "truth", truth))
    return {
        q: float(np.sqrt(np.mean([getattr(b, f) ** 2 for b in found]))) for q, f in BOUND.items()
    }


def compared(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Returns the ratio of RMS errors and its standard error, runs of one seed taken as a pair."""
    known = np.isfinite(before) & np.isfinite(after)
    a, b = before[known] ** 2, after[known] ** 2
    ratio = math.sqrt(b.mean() / a.mean())
    relative = b / b.mean() - a / a.mean()
    return ratio, 0.5 * ratio * float(relative.std(ddof=1)) / math.sqrt(len(a))


def crossed(scenario: Scenario) -> Scenario:
    """Returns `one-direction` with lines across it, every metre."""
    grid = LineGrid(alpha_deg=90.0, first=-9.63, spacings=(1.0,) * 20)
    return replace(scenario, grids=(*scenario.grids, grid))


def twice_the_frames(scenario: Scenario) -> Scenario:
    """Returns a scenario whose robot looks twice as often."""
    encoder = replace(scenario.encoder, rate=2.0 * scenario.encoder.rate)
    if scenario.camera is None:
        assert scenario.sightings.rate is not None
        faster = replace(scenario.sightings, rate=2.0 * scenario.sightings.rate)
        return replace(scenario, sightings=faster, encoder=encoder)
    camera = replace(scenario.camera, rate=2.0 * scenario.camera.rate)
    return replace(scenario, camera=camera, encoder=encoder)


def sharper(scenario: Scenario) -> Scenario:
    """Returns a scenario with half the noise of the sightings."""
    return noisier(scenario, NoiseLevel(1.0, 0.5))


def better_wheels(scenario: Scenario) -> Scenario:
    """Returns a scenario with half the noise of the wheels."""
    return noisier(scenario, NoiseLevel(0.5, 1.0))


Change = Callable[[Scenario], Scenario]
CASES: dict[str, dict[int, Change]] = {
    "one-direction": {0: crossed},
    "grid": {1: twice_the_frames, 2: sharper, 3: better_wheels},
}
"""Floor, number of the prediction in `compare.what_if`, and the change that it speaks of."""


if __name__ == "__main__":
    main()
