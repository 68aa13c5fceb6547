"""The line back-end on the Intel Research Lab log, scored by the published relations.

    python benchmarks/intel.py FOLDER [--seeds 10]

FOLDER holds intel.clf (2,726 scans, CARMEN) and relations.csv (rows and relative poses, derived
from those of Kuemmerle et al. 2009, On measuring the accuracy of SLAM algorithms). An error is that
of the motion between two rows, the pose interpolated linearly between whole rows. With --seeds the
odometry gets noise of 2 cm and 1 degree a row first. The walls that the map holds to be one across
loops are judged by the same relations (`closures.py`).
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from closures import judge

from frontend.extract import extract
from frontend.log import open_log
from graphslam.baseline import dead_reckoning
from graphslam.config import EkfConfig, LongConfig, SmootherConfig
from graphslam.geometry import Array, between, interpolate_poses, wrap
from graphslam.long import close_all_loops, run_window
from graphslam.measurements import Measurements

NOISE = np.array([0.02, 0.02, np.radians(1.0)])
GOOD_M = 0.06
PUBLISHED = (
    ("scan matching, published", "0.220 ± 0.296"),
    ("Rao-Blackwellised particle filter, published", "0.070 ± 0.083"),
    ("graph mapping, published", "0.031 ± 0.026"),
)


def errors(pose: Array, relations: Array) -> tuple[Array, Array]:
    """Returns errors of translation (m) and rotation (degrees) of every relation (K,).

    Args:
        pose: (N, 3) estimate, one a row of the log.
        relations: (K, 6) row, row, dx, dy, dtheta, exact.
    """
    row = np.arange(len(pose), dtype=float)
    first, second = (interpolate_poses(relations[:, k], row, pose) for k in (0, 1))
    e = between(relations[:, 2:5], between(first, second))
    return np.hypot(e[:, 0], e[:, 1]), np.degrees(np.abs(wrap(e[:, 2])))


def row(name: str, pose: Array, relations: Array, seconds: float) -> str:
    """Returns a line of the table."""
    cells = [f"{name:34s}"]
    shift, turn = errors(pose, relations)
    for rows in (relations[:, 5] == 1, np.ones(len(relations), bool)):
        cells.append(f"{shift[rows].mean():6.3f} ± {shift[rows].std():6.3f}")
        cells.append(f"{turn[rows].mean():6.2f} ± {turn[rows].std():6.2f}")
    return " | ".join([*cells, f"{seconds:6.1f}"])


def noisy(measurements: Measurements, seed: int) -> Measurements:
    """Returns measurements with noise added to the odometry of every row."""
    odometry = measurements.odometry
    noise = np.random.default_rng(seed).standard_normal(odometry.increment.shape) * NOISE
    return replace(measurements, odometry=replace(odometry, increment=odometry.increment + noise))


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=0)
    options = parser.parse_args()
    relations = np.loadtxt(options.folder / "relations.csv", delimiter=",", skiprows=1)

    def timed(work):
        began = time.process_time()
        done = work()
        return done, time.process_time() - began

    measurements, seconds = timed(lambda: extract(open_log(options.folder / "intel.clf")))
    warm = replace(measurements)  # compiled before anything is timed
    if not options.seeds:
        close_all_loops(warm, run_window(warm, EkfConfig()), SmootherConfig())
        _, seconds = timed(lambda: extract(open_log(options.folder / "intel.clf")))
        print(f"read and searched for walls: {seconds:.1f} s of CPU")
        print(f"{'':34s} | exact: m | degrees | all: m | degrees | CPU, s")
        print(row("odometry", dead_reckoning(measurements).pose, relations, 0.0))
        window, first = timed(lambda: run_window(measurements, EkfConfig()))
        print(row("filter over a window", window.pose, relations, seconds + first))
        open_, second = timed(
            lambda: close_all_loops(measurements, window, SmootherConfig(), LongConfig(close=False))
        )
        print(row("batch, loops not closed", open_.pose, relations, seconds + first + second))
        whole, second = timed(lambda: close_all_loops(measurements, window, SmootherConfig()))
        print(row("whole chain", whole.pose, relations, seconds + first + second))
        for name, published in PUBLISHED:
            print(f"{name}: {published} m")
        print(f"NIS per dimension: {np.nanmean(whole.nis) / 2:.2f}; {dict(whole.counts)}")
        print(judge(measurements, whole, relations))
        for name, (value, sigma) in whole.quantities.items():
            print(f"{name}: {value:.4f} ± {sigma:.4f}")
        return
    good = wrong = 0
    for seed in range(options.seeds):
        given = noisy(measurements, seed)
        window, first = timed(lambda g=given: run_window(g, EkfConfig()))
        whole, second = timed(lambda w=window, g=given: close_all_loops(g, w, SmootherConfig()))
        closures = judge(given, whole, relations)
        print(row(f"seed {seed}", whole.pose, relations, first + second), flush=True)
        print(f"    {closures}; {dict(whole.counts)}", flush=True)
        good += errors(whole.pose, relations)[0].mean() < GOOD_M
        wrong += closures.wrong > 0
    print(f"{good} of {options.seeds} seeds end below {GOOD_M} m over all rows")
    print(f"{wrong} of {options.seeds} seeds keep a relation that rests on wrong walls")


if __name__ == "__main__":
    main()
