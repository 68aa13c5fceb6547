"""Accuracy against latency: what waiting for a pose buys, for each lag, beside filter and smoother.

Run with ``python benchmarks/lag.py [--scenarios grid corridor] [--seeds 10]``. Measurements are
simulated; matches are the filter's, the same for all. Errors are those of each pose as it was
told, at its time plus the lag, root mean square over all poses and seeds, not aligned.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from frontend.extract import extract
from frontend.simulate import load_scenario
from frontend.simulate.record import simulate_log
from graphslam.baseline import dead_reckoning
from graphslam.config import IncrementalConfig
from graphslam.ekf import run_ekf
from graphslam.estimate import Estimate
from graphslam.geometry import interpolate_poses, wrap
from graphslam.measurements import Measurements
from graphslam.smoother import run_fixed_lag, run_isam2, smooth

LAGS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
Run = Callable[[Measurements, Estimate, Callable[[int], None]], Estimate]


def runs() -> dict[tuple[str, str], Run]:
    """Returns what is compared, by method and how long after its time a pose is told."""
    found: dict[tuple[str, str], Run] = {
        ("odometry", "0"): lambda m, _, told: dead_reckoning(m),
        ("ekf", "0"): lambda m, _, told: run_ekf(m, told=told),
        ("isam2", "0"): lambda m, f, told: run_isam2(m, f, told=told),
    }
    for lag in LAGS:
        config = IncrementalConfig(lag_s=lag)
        found["fixed-lag", f"{lag:g}"] = lambda m, f, told, c=config: run_fixed_lag(m, f, c, told)
    found["smoother", "whole log"] = lambda m, f, told: smooth(m, f)
    return found


class Clock:
    """Notes the processor time at the start and after each node."""

    def __init__(self) -> None:
        self.stamps = [time.process_time()]

    def __call__(self, node: int) -> None:
        self.stamps.append(time.process_time())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenarios", nargs="+", default=["grid", "corridor"])
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    heads = ("scenario", "method", "told after, s", "path, mm", "heading, °", "a node, ms")
    print("| " + " | ".join((*heads, "slowest 1 %, ms")) + " |")
    print("|---|---|---:|---:|---:|---:|---:|")
    for name in options.scenarios:
        errors: dict[tuple[str, str], list[np.ndarray]] = {key: [] for key in runs()}
        spent: dict[tuple[str, str], list[np.ndarray]] = {key: [] for key in runs()}
        for seed in range(options.seeds):
            log = simulate_log(load_scenario(name), seed)
            measurements = extract(log)
            assert log.truth is not None
            truth = interpolate_poses(measurements.t, log.truth.t, log.truth.pose)
            filtered = run_ekf(measurements)
            for key, run in runs().items():
                clock = Clock()
                off = run(measurements, filtered, clock).pose - truth
                errors[key].append(np.column_stack([off[:, :2], wrap(off[:, 2])]))
                spent[key].append(np.diff(clock.stamps))
        for key in runs():
            off, ms = np.concatenate(errors[key]), 1e3 * np.concatenate(spent[key])
            place = 1e3 * np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1)))
            turn = np.degrees(np.sqrt(np.mean(off[:, 2] ** 2)))
            cost = f"{np.median(ms):.2f} | {np.quantile(ms, 0.99):.2f}" if len(ms) else "– | –"
            print(f"| {name} | {' | '.join(key)} | {place:.2f} | {turn:.3f} | {cost} |")


if __name__ == "__main__":
    main()
