"""How much faster a batch of 20 logs is with two jobs than with one.

Run with ``python benchmarks/batch_scaling.py [LOGS [ROUNDS]]``; prints the wall time of each, and
their ratio: 0.5 would be perfect on two idle cores. Start of the processes, imports, the table and
the page are in it. Both take turns over several rounds, because shared machines are noisy; the
processor time says what ran: where the wall time for two jobs is much above half of it, the cores
were not free.
"""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from frontend.simulate import load_scenario, simulate

LOGS, ROUNDS = 20, 3


def measure(logs: Path, out: Path, jobs: int) -> tuple[float, float]:
    """Returns wall and processor time, s, of one batch, and removes what it wrote."""
    program = "from compare.cli import main; raise SystemExit(main())"
    arguments = ["batch", str(logs), "--out", str(out), "--jobs", str(jobs)]
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", program, *arguments], stdout=subprocess.DEVNULL, check=True
    )
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    shutil.rmtree(out)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, used


def main(count: int, rounds: int) -> None:
    """Prints the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenario = load_scenario("grid")
        for seed in range(count):
            simulate(scenario, folder / "logs" / f"grid-{seed:03d}", seed, images=False)
        simulate(scenario, folder / "warm" / "grid", 0, images=False)
        measure(folder / "warm", folder / "out", 1)  # compile before timing
        print(f"{count} logs      one job: wall, cpu (s)    two jobs: wall, cpu (s)    wall ratio")
        ratios = []
        for turn in range(rounds):
            one = measure(folder / "logs", folder / "out", 1)
            two = measure(folder / "logs", folder / "out", 2)
            ratios.append(two[0] / one[0])
            print(
                f"round {turn + 1} {one[0]:16.1f} {one[1]:8.1f} {two[0]:18.1f} {two[1]:8.1f} "
                f"{ratios[-1]:13.2f}",
                flush=True,
            )
        print(f"best ratio {min(ratios):.2f}, median {sorted(ratios)[len(ratios) // 2]:.2f}")


if __name__ == "__main__":
    given = [int(text) for text in sys.argv[1:]]
    main(*(given + [LOGS, ROUNDS][len(given) :]))
