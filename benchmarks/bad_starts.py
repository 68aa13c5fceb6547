"""How often smoothing finds the optimum from dead reckoning alone, over seeds and noise.

Run with ``python benchmarks/bad_starts.py [--seeds 100] [--poses 1000]``. A robot drives over a
grid of lines, each of its matches known; the heading of its odometry walks at random. The path
starts as odometry has it, lines where that path first saw them. The optimum is the one reached from
the truth.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from graphslam.config import SmootherConfig
from graphslam.smoother.batch import HOPELESS, misfit
from graphslam.smoother.chain import minimise, started_along
from graphslam.smoother.problem import Problem
from tests.graphslam.test_chain import from_odometry

RATES = (0.03, 0.06, 0.1, 0.2)
"""Random walk of the heading, rad for each square root of a metre."""
SAME = 1e-6
"""Relative difference of cost up to which a minimum is the optimum."""


def smoothed(problem: Problem, config: SmootherConfig) -> tuple[float, int, bool, float, bool]:
    """Returns cost, iterations, convergence, misfit of the plain start, whether another was tried.

    The rule is that of `graphslam.smoother.batch`.
    """
    plain = minimise(problem, config)
    off = misfit(problem, plain)
    if off <= HOPELESS:
        return plain.cost, plain.iterations, plain.converged, off, False
    along = minimise(started_along(problem, config), config)
    best = along if along.cost < plain.cost else plain
    return best.cost, plain.iterations + along.iterations, best.converged, off, True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--rates", type=float, nargs="+", default=RATES)
    options = parser.parse_args()
    config = SmootherConfig()
    print(
        f"{options.poses:,} poses, {options.seeds} seeds\n\n"
        "| heading, rad/√m | optimum, plain start | with the start along the chain | tried | "
        "iterations, median and most | not converged | misfit of those that missed, least | "
        "of those that reached, most |"
    )
    print("|---:|---:|---:|---:|---:|---:|---:|---:|")
    for rate in options.rates:
        rows = []
        for seed in range(options.seeds):
            problem, cost = from_odometry(seed, rate, options.poses)
            plain = minimise(problem, config)
            best, iterations, converged, off, tried = smoothed(problem, config)
            reached = plain.cost <= cost * (1.0 + SAME)
            rows.append((reached, best <= cost * (1.0 + SAME), tried, iterations, converged, off))
        reached, mended, tried, iterations, converged, off = (
            np.array(x) for x in zip(*rows, strict=True)
        )
        missed = f"{off[~reached].min():.2f}" if not reached.all() else "–"
        held = f"{off[reached].max():.2f}" if reached.any() else "–"
        print(
            f"| {rate:g} | {reached.sum()} | {mended.sum()} | {tried.sum()} | "
            f"{np.median(iterations):.0f}, {iterations.max()} | {np.sum(~converged)} | "
            f"{missed} | {held} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
