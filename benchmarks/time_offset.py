"""How well the clock of the camera is found: errors and their stated sigmas over simulated logs.

python benchmarks/time_offset.py --seeds 4
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from compare.time_offset import estimate_time_offset
from frontend.log import with_camera_offset
from frontend.simulate import load_scenario, simulate_log

SCENARIOS = ("sample", "grid", "corridor", "periodic")
PUT_IN_S = (0.0, 0.08, -0.05)


def main() -> None:
    """Prints a row for each drive, and for each scenario the errors over their sigmas."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    given = parser.parse_args()
    print("scenario   seed   error (ms) with 0, 80, -50 ms put in   sigma (ms)")
    ratios = []
    for scenario in given.scenarios:
        for seed in range(given.seeds):
            log = simulate_log(load_scenario(scenario), seed)
            errors, sigma = [], 0.0
            for put_in in PUT_IN_S:
                found = estimate_time_offset(
                    replace(with_camera_offset(log, -put_in), offset_s=0.0)
                )
                errors.append(1e3 * (found.offset_s - put_in))
                sigma = 1e3 * found.sigma_s
            told = "  ".join(f"{error:+6.2f}" for error in errors)
            print(f"{scenario:9}  {seed:4}   {told}                 {sigma:5.2f}", flush=True)
            ratios.append(errors[0] / sigma)
    print(
        f"mean squared error over variance: {np.mean(np.square(ratios)):.2f} ({len(ratios)} drives)"
    )


if __name__ == "__main__":
    main()
