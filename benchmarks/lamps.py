"""Bellini's corridor: late lamps, the covariance along the way, and lamps that are mapped.

python benchmarks/lamps.py [--seeds 20] [--plot FILE.svg]

Scenario four-lamps: 300 frames, half of them without a lamp, known 0.1 s late. Where seeds count,
lamps are drawn as sightings; the covariance along the way is that of rendered images.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from frontend.config import ExtractConfig
from frontend.extract import extract
from frontend.lamp_config import LampConfig
from frontend.log import Log, open_log
from frontend.simulate import Scenario, load_scenario, simulate, simulate_log
from graphslam import run_ekf, smooth
from graphslam.estimate import Estimate
from graphslam.geometry import Array, interpolate_poses, wrap
from graphslam.late import run_naive
from graphslam.measurements import Measurements
from graphslam.models.lamp import LAMP

SPEEDS = (0.5, 0.75, 1.0)
"""m/s."""


def in_order(measurements: Measurements) -> Measurements:
    """Returns the same measurements, each known at its own time."""
    tables = {
        kind: replace(table, t_received=measurements.t[table.node])
        for kind, table in measurements.sightings.items()
    }
    return replace(measurements, sightings=tables)


def at_speed(scenario: Scenario, speed: float) -> Scenario:
    """Returns the scenario driven faster, turns too."""
    return replace(scenario, speed=speed, turn_rate_deg=90.0 * speed)


def difference(late: Measurements) -> float:
    """Returns how far the last pose and its covariance are from those of an in-order run."""
    a, b = run_ekf(late), run_ekf(in_order(late))
    gap = a.pose[-1] - b.pose[-1]
    gap[2] = wrap(gap[2])
    return float(max(np.abs(gap).max(), np.abs(a.cov_floor[-1] - b.cov_floor[-1]).max()))


def path_rmse(log: Log, estimate: Estimate) -> float:
    """Returns the root mean square position error of the poses as they were known, m."""
    e = _true_poses(log, estimate.t) - estimate.pose
    return float(np.sqrt(np.mean(np.sum(e[:, :2] ** 2, axis=1))))


def _true_poses(log: Log, t: Array) -> Array:
    assert log.truth is not None
    return interpolate_poses(t, log.truth.t, log.truth.pose)


@dataclass(frozen=True)
class Mapped:
    """A map of lamps held against the truth.

    Attributes:
        once: whether every lit lamp is there once, and nothing else.
        map_nees: per dimension, of all lamps jointly, floor frame.
        pose_nees: per dimension, mean over the nodes but the first.
        rmse_m: of the lamps' places.
    """

    once: bool
    map_nees: float
    pose_nees: float
    rmse_m: float


def judge(log: Log, scenario: Scenario, estimate: Estimate) -> Mapped:
    """Returns how good a map of unknown lamps is."""
    assert scenario.ceiling is not None
    lamps, lit = scenario.ceiling.places(), scenario.ceiling.lit()
    found = estimate.map.params[:, :3]
    away = np.hypot(*(found[:, None, :2] - lamps[lit][:, :2]).transpose(2, 0, 1))
    row = away.argmin(axis=1)
    e, _, _ = LAMP.residual(np.zeros(3), lamps[lit][row], found)
    joint = e.ravel() @ np.linalg.solve(estimate.cov_joint[3:, 3:], e.ravel())
    d = estimate.pose - _true_poses(log, estimate.t)
    d[:, 2] = wrap(d[:, 2])
    nees = np.einsum("ki,kij,kj->k", d[1:], np.linalg.inv(estimate.cov_floor[1:]), d[1:])
    once = sorted(row.tolist()) == list(range(len(lit)))
    return Mapped(
        once, joint / e.size, float(nees.mean()) / 3.0, float(np.sqrt(np.mean(e[:, :2] ** 2) * 2))
    )


def maps(seeds: int) -> Iterator[tuple[str, Mapped]]:
    """Yields method and map of unknown lamps, seed after seed."""
    scenario = load_scenario("four-lamps")
    for seed in range(seeds):
        log = simulate_log(scenario, seed)
        measurements = extract(log, ExtractConfig(landmarks="mapped"))
        filtered = run_ekf(measurements)
        yield "ekf", judge(log, scenario, filtered)
        yield "smoother", judge(log, scenario, smooth(measurements, filtered))


@dataclass(frozen=True)
class Covariance:
    """The norm of the pose's covariance along the way.

    Attributes:
        t: (N,) times, s.
        norm: (N,) Frobenius norm of the covariance as it was known then; m, rad.
        lit: (N,) whether a sighting of a lamp had arrived since the node before.
    """

    t: Array
    norm: Array
    lit: Array

    def falls(self) -> list[float]:
        """Returns of each stretch with lamps the norm at its end over that just before it."""
        begins = np.flatnonzero(self.lit[1:] & ~self.lit[:-1]) + 1
        ends = np.flatnonzero(self.lit & ~np.append(self.lit[1:], False))
        last = [int(ends[ends >= begin][0]) for begin in begins]
        return [float(self.norm[b] / self.norm[a - 1]) for a, b in zip(begins, last, strict=True)]

    def largest_fall_in_the_dark(self) -> float:
        """Returns by how much the norm fell at most from a node to a dark one; 0 for never."""
        change = np.diff(self.norm)[~self.lit[1:]]
        return max(0.0, -float(change.min()))


def covariance_along(log: Log) -> Covariance:
    """Returns the filter's covariance along the way."""
    assert log.looking_at("ceiling")
    settings = ExtractConfig(lamps=LampConfig(size_m=(0.6, 0.25)))
    measurements = extract(log, settings)
    estimate = run_ekf(measurements)
    arrived = np.searchsorted(measurements.t, measurements.sightings["lamp"].t_received, "left")
    lit = np.isin(np.arange(len(measurements.t)), arrived)
    norm = np.linalg.norm(estimate.cov_floor, axis=(1, 2))
    return Covariance(measurements.t, norm, lit)


def draw(covariance: Covariance, path: Path) -> None:
    """Draws Bellini's Fig. 7."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    mpl.rcParams["svg.hashsalt"] = "graphslam"
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    ax = figure.subplots()
    ax.fill_between(
        covariance.t, 0, 1, where=covariance.lit, transform=ax.get_xaxis_transform(),
        color="#f2c14e", alpha=0.35, lw=0, step="mid", label="a lamp was seen",
    )  # fmt: skip
    ax.semilogy(covariance.t[1:], covariance.norm[1:], color="#0072b2", lw=1.2, label="norm")
    ax.set_xlabel("time (s)")
    ax.set_ylabel("norm of the pose's covariance (m, rad)")
    ax.legend(frameon=False, loc="upper left")
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    figure.savefig(path, metadata={"Date": None})


def delays(seeds: int) -> None:
    """Prints what delays cost, heeded and unheeded."""
    scenario = load_scenario("four-lamps")
    print("| speed, m/s | delayed against in order | causal path, mm | naive, mm | naive worse |")
    print("|---:|---:|---:|---:|---:|")
    for speed in SPEEDS:
        logs = [simulate_log(at_speed(scenario, speed), seed) for seed in range(seeds)]
        seen = [extract(log) for log in logs]
        gap = max(map(difference, seen))
        rmse = np.array(
            [
                [path_rmse(log, run(measurements)) for run in (run_ekf, run_naive)]
                for log, measurements in zip(logs, seen, strict=True)
            ]
        )
        heeded, naive = 1e3 * np.median(rmse, axis=0)
        worse = np.count_nonzero(rmse[:, 1] > rmse[:, 0])
        print(f"| {speed} | {gap:.1e} | {heeded:.1f} | {naive:.1f} | {worse} of {len(rmse)} |")


def unknown(seeds: int) -> None:
    """Prints how good maps of unknown lamps are."""
    found: dict[str, list[Mapped]] = {"ekf": [], "smoother": []}
    for method, one in maps(seeds):
        found[method].append(one)
    print("| unknown lamps | each once | map NEES | pose NEES | map, mm |")
    print("|---|---:|---:|---:|---:|")
    for method, rows in found.items():
        columns = np.array([[row.map_nees, row.pose_nees, 1e3 * row.rmse_m] for row in rows])
        of_map, of_poses, rmse = columns.mean(axis=0)
        once = sum(row.once for row in rows)
        print(f"| {method} | {once} of {len(rows)} | {of_map:.2f} | {of_poses:.2f} | {rmse:.0f} |")


def along(plot: Path | None) -> None:
    """Prints, and draws, the covariance along a rendered drive."""
    scenario = load_scenario("four-lamps")
    with tempfile.TemporaryDirectory() as folder:
        covariance = covariance_along(open_log(simulate(scenario, Path(folder) / "log", seed=1)))
    frames, dark = len(covariance.t), int(np.count_nonzero(~covariance.lit))
    falls = ", ".join(f"{100.0 * (1.0 - share):.0f} %" for share in covariance.falls())
    most = covariance.largest_fall_in_the_dark()
    print(f"{frames} frames, {dark} of them dark")
    print(f"the norm of the covariance falls at the lamps by {falls}")
    print(f"the largest fall in the dark: {most:.1e}")
    if plot is not None:
        draw(covariance, plot)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--plot", type=Path, help="picture of the covariance along the way, .svg")
    options = parser.parse_args()
    delays(options.seeds)
    print()
    unknown(options.seeds)
    print()
    along(options.plot)


if __name__ == "__main__":
    main()
