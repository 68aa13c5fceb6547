"""Which filters are honest, how near each method comes to the bound, and whether the bound holds.

    python benchmarks/consistency.py              # four levels of noise, 50 seeds each
    python benchmarks/consistency.py --bound 500  # the smoother's errors against the bound

The world is the scenario `narrow-grid`: twelve lines, 28 m a lap, wheel noise by the law "paper" at
k = 0.02, 0.05, 0.10 and 0.15 for each step of 2 rad, sightings of 0.01 to 0.04 m and 0.5 to 2
degrees. Matches are the true ones: what is judged is the estimator. Increments carry the
covariance that their noise was drawn from. Taken from the wheels as they were read, as a run must,
the law "paper" makes it smaller where the noise was, by chance, negative; `--as-read` shows what
that costs.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from functools import partial

from compare.config import RunConfig
from compare.montecarlo import Value, run_seeded
from compare.study import Study, judge, summed_up
from compare.study_answers import answers, efficiencies, honesties
from frontend.extract import extract
from frontend.log import Log
from frontend.simulate import NoiseLevel, Scenario, load_scenario, noisier, simulate_log
from graphslam.config import EkfConfig, MatchingConfig, SmootherConfig
from graphslam.measurements import Measurements
from graphslam.models.wheels import increments_from_wheels

LEVELS = tuple(map(NoiseLevel.parse, ("1", "2.5:2", "5:3", "7.5:4")))
METHODS = ("ekf", "ekf-fej", "ekf-robot", "smoother")
FIRST_OF_BOUND = 1000
"""The bound is checked on seeds of its own, from this one on."""


def main() -> None:
    """Runs what the command line asks for, and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=50, help="seeds at each level of noise")
    parser.add_argument("--bound", type=int, default=0, help="check the bound on so many seeds")
    parser.add_argument("--as-read", action="store_true", help="covariances from wheels as read")
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    given = parser.parse_args()
    if given.bound:
        methods, levels, runs, first = ("smoother",), LEVELS[:2], given.bound, FIRST_OF_BOUND
    else:
        methods, levels, runs, first = METHODS, LEVELS, given.runs, 0
    config = RunConfig(
        methods=methods,  # type: ignore[arg-type]
        ekf=EkfConfig(matching=MatchingConfig(method="known")),
        smoother=SmootherConfig(engine="chain"),
    )
    scenario = load_scenario("narrow-grid")
    job = partial(judge_run, scenario, levels, config, first, not given.as_read)
    done = run_seeded(job, runs * len(levels), None, jobs=given.jobs)
    for run in done:
        if run.error:
            print(f"run {run.run} failed: {run.error}")
    report(summed_up(scenario.name, methods, levels, done))


def judge_run(
    scenario: Scenario,
    levels: tuple[NoiseLevel, ...],
    config: RunConfig,
    first: int,
    exact: bool,
    run: int,
) -> dict[str, Value]:
    """Returns the figures of all methods for one seed at one level."""
    seed, level = divmod(run, len(levels))
    noisy = noisier(scenario, levels[level])
    log = simulate_log(noisy, first + seed)
    measurements = extract(log)
    if exact:
        measurements = as_drawn(noisy, log, measurements, first + seed)
    return judge(log, measurements, config)


def as_drawn(scenario: Scenario, log: Log, measurements: Measurements, seed: int) -> Measurements:
    """Returns measurements whose increments carry the covariance that their noise was drawn from.

    It is that of the true rotations: those of the same drive without wheel noise.
    """
    quiet = replace(scenario, robot=replace(scenario.robot, noise_left=0.0, noise_right=0.0))
    wheels = simulate_log(quiet, seed).wheels
    assert wheels is not None
    _, cov = increments_from_wheels(wheels.t, wheels.angle, measurements.t, scenario.robot)
    return replace(measurements, odometry=replace(measurements.odometry, cov=cov))


def report(result: Study) -> None:
    """Prints honesty and efficiency as tables of Markdown, and what follows."""
    print("| noise | method | pose NEES | map NEES, start's frame | map NEES, up to a motion |"
          " NIS | overconfident |")  # fmt: skip
    print("|---|---|---|---|---|---|---|")
    for h in honesties(result):
        said = "" if h.overconfidence is None else str(h.overconfidence).partition(" by ")[2]
        nis = math.nan if h.innovations is None else h.innovations.total
        print(f"| {h.noise} | {h.method} | {h.pose:.2f} | {h.map_start:.2f} | {h.map:.2f} |"
              f" {nis:.2f} | {said} |")  # fmt: skip
    print("\n| noise | method | quantity | RMS error | bound | error / bound |")
    print("|---|---|---|---|---|---|")
    for e in efficiencies(result):
        scale, unit = (1e3, "mm") if e.unit == "m" else (1.0, "°")
        if math.isfinite(e.ratio):
            print(
                f"| {e.noise} | {e.method} | {e.quantity} | {scale * e.error:.3g} {unit} |"
                f" {scale * e.bound:.3g} {unit} | {e.ratio:.3f} ± {e.scatter:.3f} |"
            )
    print()
    print("\n".join(answers(result)))


if __name__ == "__main__":
    main()
