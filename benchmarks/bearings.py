"""Driving among cones: triangulation, filter and smoother, cones known and unknown, 20 seeds.

python benchmarks/bearings.py [--runs 20]
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import replace

import numpy as np

from compare import compare
from frontend.extract import extract
from frontend.simulate import load_scenario, simulate_log
from graphslam.baseline import dead_reckoning
from graphslam.ekf import run_ekf
from graphslam.memoryless import triangulate
from graphslam.smoother import smooth

SCENARIOS = {"three-cones": 2, "cones-outdoors": 2}
"""Scenario and how often its path is driven."""


def main() -> None:
    """Prints one table for each scenario."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    runs = parser.parse_args().runs
    for name, laps in SCENARIOS.items():
        found: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
        once: dict[tuple[str, str], list[bool]] = defaultdict(list)
        for seed in range(runs):
            log = simulate_log(replace(load_scenario(name), repeat=laps), seed)
            known = extract(log)
            for cones, measurements in (
                ("known", known),
                ("unknown", replace(known, known=None)),
            ):
                filtered = run_ekf(measurements)
                estimates = [dead_reckoning(measurements), filtered, smooth(measurements, filtered)]
                if cones == "known":
                    estimates.insert(1, triangulate(measurements))
                comparison = compare(log, measurements, estimates)
                for entry in comparison.methods:
                    path = entry.trajectory
                    assert path is not None
                    key = (cones, entry.method)
                    found[key].append([1e3 * path.rmse_m, path.heading_rmse_deg, entry.pose_nees])
                    points = entry.points
                    if points is not None:
                        wrong = points.missed + points.duplicates + points.spurious
                        once[key].append(wrong == 0)
        print(f"{name}, {laps} laps, {runs} seeds; means over the seeds")
        print("| cones | method | path RMSE (mm) | heading RMSE (deg) | NEES | every cone once |")
        print("|---|---|---|---|---|---|")
        for (cones, method), rows in found.items():
            path, heading, nees = np.mean(rows, axis=0)
            each = once.get((cones, method))
            text = f"{sum(each)} of {len(each)}" if each else ""
            print(f"| {cones} | {method} | {path:.2f} | {heading:.3f} | {nees:.2f} | {text} |")
        print()


if __name__ == "__main__":
    main()
