"""How long saving and loading measurements of many nodes takes.

Run with ``python benchmarks/load_time.py [--poses 200000] [--rounds 5]``: two sightings a pose,
wall clock and processor time, medians.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from statistics import median

from rooms import rooms_problem

from graphslam.measurements import Measurements


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, nargs="+", default=[200_000])
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    print("| poses | file, MB | save, s | load, s | load, processor s |")
    print("|---:|---:|---:|---:|---:|")
    for nodes in options.poses:
        measurements = rooms_problem(nodes, 200).measurements
        saves, loads, cpu = [], [], []
        with tempfile.TemporaryDirectory() as name:
            path = Path(name) / "measurements.npz"
            for _ in range(options.rounds):
                began = time.perf_counter()
                measurements.save(path)
                saved, used = time.perf_counter(), time.process_time()
                loaded = Measurements.load(path)
                loads.append(time.perf_counter() - saved)
                cpu.append(time.process_time() - used)
                saves.append(saved - began)
                assert len(loaded.t) == nodes
            size = path.stat().st_size / 1e6
        print(
            f"| {nodes:,} | {size:.0f} | {median(saves):.2f} | {median(loads):.2f} | "
            f"{median(cpu):.2f} |"
        )


if __name__ == "__main__":
    main()
