"""The overhead camera: fused against camera alone and odometry alone, and the paper's Table II.

    python benchmarks/overhead.py              # 20 seeds at 1, 2 and 5 mm, without images
    python benchmarks/overhead.py --images     # the same seeds through rendered images, at 2 mm
    python benchmarks/overhead.py --trouble    # atali-trouble through images: is a wrong pose used?
    python benchmarks/overhead.py --table      # Table II as printed, and its structure from a run

The world is the scenario `atali`, cut to its first 60 s: 1.60 x 2 m, one image in ten lost. Camera
alone is judged where it sees the tags, the others at the same nodes.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from compare.montecarlo import Value, run_seeded
from compare.printed.paper import printed_paper
from frontend.config import ExtractConfig, NoiseConfig
from frontend.extract import extract
from frontend.log import Log, open_log
from frontend.pose_fixes import KIND
from frontend.simulate import Scenario, load_scenario, simulate, simulate_log
from frontend.tag_config import TagConfig
from graphslam import dead_reckoning, run_ekf, smooth
from graphslam.estimate import Estimate
from graphslam.fixes import follow_fixes
from graphslam.geometry import Array, interpolate_poses, wrap
from graphslam.measurements import Measurements

LASTS_S = 60.0
NOISE_M = (0.001, 0.002, 0.005)
METHODS = ("odometry", "camera", "ekf", "smoother")
TABLE_AT_S = (2.0, 12.0, 22.0, 32.0)
PAPER = ExtractConfig(tags=TagConfig(sigma_law="paper"), noise=NoiseConfig(process_mps=2.0))
"""Atali's Q and R."""


def main() -> None:
    """Runs what the command line asks for, and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=20, help="seeds")
    parser.add_argument("--images", action="store_true", help="through rendered images")
    parser.add_argument("--trouble", action="store_true", help="atali-trouble through images")
    parser.add_argument("--table", action="store_true", help="Table II")
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    given = parser.parse_args()
    if given.table:
        print_table()
    elif given.trouble:
        print_trouble(given.runs, given.jobs)
    else:
        for noise in NOISE_M[1:2] if given.images else NOISE_M:
            job = partial(judged, noise, given.images)
            print_level(
                noise, [r.values for r in run_seeded(job, given.runs, None, jobs=given.jobs)]
            )


def scenario_with(noise: float) -> Scenario:
    """Returns the work space with tags that err by ``noise``, m."""
    scenario = load_scenario("atali")
    assert scenario.overhead is not None
    return replace(scenario, overhead=replace(scenario.overhead, tag_noise=noise))


def judged(noise: float, images: bool, seed: int) -> Mapping[str, Value]:
    """Returns errors and NEES of every method on one run."""
    scenario = scenario_with(noise)
    config = ExtractConfig(to_s=LASTS_S, tags=TagConfig(sigma_m=noise))
    if images:
        with tempfile.TemporaryDirectory() as folder:
            log = open_log(simulate(scenario, Path(folder) / "log", seed))
            measurements = extract(log, replace(config, workers=1))
    else:
        log = simulate_log(scenario, seed)
        measurements = extract(log, config)
    return figures(log, measurements)


def estimates(measurements: Measurements) -> dict[str, Estimate]:
    """Returns what each method makes of measurements."""
    ekf = run_ekf(measurements)
    made = dead_reckoning(measurements), follow_fixes(measurements), ekf, smooth(measurements, ekf)
    return dict(zip(METHODS, made, strict=True))


def figures(log: Log, measurements: Measurements) -> dict[str, Value]:
    """Returns RMSE of position (mm) and heading (degrees), and NEES per dimension, by method."""
    seen = np.unique(measurements.sightings[KIND].node)
    rate = scenario_with(0.0).overhead.rate  # type: ignore[union-attr]
    out: dict[str, Value] = {"lost": 1.0 - len(seen) / (LASTS_S * rate + 1.0)}
    for name, estimate in estimates(measurements).items():
        off = error(log, estimate)
        nodes = slice(1, None)  # the start is known
        chi = np.einsum(
            "ki,ki->k", off, np.linalg.solve(estimate.cov_floor, off[..., None])[..., 0]
        )
        out[f"{name} mm"] = 1e3 * float(np.sqrt(np.mean(np.sum(off[seen, :2] ** 2, axis=1))))
        out[f"{name} deg"] = float(np.degrees(np.sqrt(np.mean(off[seen, 2] ** 2))))
        out[f"{name} all mm"] = 1e3 * float(np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))))
        out[f"{name} nees"] = float(np.mean(chi[nodes]) / 3.0)
    return out


def error(log: Log, estimate: Estimate) -> Array:
    """Returns a path minus the true one (N, 3), m and rad."""
    assert log.truth is not None
    off = estimate.pose - interpolate_poses(estimate.t, log.truth.t, log.truth.pose)
    off[:, 2] = wrap(off[:, 2])
    return off


def print_level(noise: float, runs: list[Mapping[str, Value]]) -> None:
    """Prints medians over the seeds, how often each method beats camera and odometry, and NEES."""
    lost = np.mean([float(run["lost"]) for run in runs])
    print(f"\ntags err by {1e3 * noise:g} mm, {len(runs)} seeds, {100 * lost:.0f} % of images lost")
    print(
        f"{'':10}{'RMSE mm':>9}{'worst':>8}{'heading °':>11}{'NEES/3':>8}{'spread':>15}"
        f"{'beats both':>12}"
    )
    for name in METHODS:
        mm, deg, nees = (
            np.array([float(run[f"{name} {what}"]) for run in runs])
            for what in ("mm", "deg", "nees")
        )
        better = sum(
            all(
                run[f"{name} {w}"] < run[f"{other} {w}"]
                for other in METHODS[:2]
                for w in ("mm", "deg")
            )
            for run in runs
        )
        spread = f"{nees.min():.2f} to {nees.max():.2f}"
        won = f"{better} of {len(runs)}" if name not in METHODS[:2] else ""
        print(
            f"{name:10}{np.median(mm):9.2f}{mm.max():8.2f}{np.median(deg):11.3f}"
            f"{nees.mean():8.2f}{spread:>15}{won:>12}"
        )


def trouble(seed: int) -> Mapping[str, Value]:
    """Returns what is used of a run in which everything goes wrong, and how wrong it is."""
    with tempfile.TemporaryDirectory() as folder:
        log = open_log(simulate(load_scenario("atali-trouble"), Path(folder) / "log", seed))
        measurements = extract(log, ExtractConfig(workers=1))
    fixes = measurements.sightings[KIND]
    assert log.truth is not None
    t = measurements.t[fixes.node]
    off = fixes.z - interpolate_poses(t, log.truth.t, log.truth.pose)
    off[:, 2] = wrap(off[:, 2])
    sigma = np.sqrt(np.diagonal(fixes.cov, axis1=1, axis2=2))
    return {
        "used": len(fixes),
        "wrong": int(np.any(np.abs(off) > 6.0 * sigma, axis=1).sum()),
        "after": int(np.sum(t >= 150.0)),
        "told": sum(measurements.rejected.values()),
        "images": len(log.images_of("overhead")),
    }


def print_trouble(runs: int, jobs: int) -> None:
    """Prints how many poses were used, and how many of them were wrong."""
    seeded = run_seeded(trouble, runs, None, jobs=jobs)
    for run in seeded:
        if run.error:
            print(f"run {run.run} failed: {run.error}")
    done = [run.values for run in seeded if not run.error]
    total = {key: sum(int(run[key]) for run in done) for key in done[0]}
    print(
        f"{len(done)} seeds, {total['images']} images: {total['used']} poses used, "
        f"{total['wrong']} of them wrong (beyond 6 sigma), {total['after']} with exchanged tags; "
        f"{total['told']} images or objects told as left out"
    )


def print_table() -> None:
    """Prints Table II, what its angle is, and the same columns of a run of ours."""
    printed = printed_paper("Atali").tables["positions"]
    print("Table II as printed, and atan2(y, x) of its positions")
    for row in printed.rows:
        cells = "".join(f"{cell:9.4f}" for cell in row)
        print(f"{cells}   atan2(y, x): imaging {np.arctan2(row[1], row[0]):.4f}")
    log = simulate_log(scenario_with(0.005), 0)
    for title, config in (("ours, noise as it is", ExtractConfig()), ("ours, his Q and R", PAPER)):
        measurements = extract(log, replace(config, to_s=LASTS_S))
        made = estimates(measurements)
        print(f"\n{title}: imaging, odometry, EKF, truth, each x (m), y (m), heading (rad)")
        assert log.truth is not None
        for t in TABLE_AT_S:
            node = int(np.argmin(np.abs(measurements.t - t)))
            true = interpolate_poses(measurements.t[node : node + 1], log.truth.t, log.truth.pose)[
                0
            ]
            poses = [made[name].pose[node] for name in ("camera", "odometry", "ekf")]
            print("".join(f"{cell:9.4f}" for cell in np.concatenate([*poses, true])))


if __name__ == "__main__":
    main()
