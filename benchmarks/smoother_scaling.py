"""How the time of filter and smoother grows with the length of a log.

Run with ``python benchmarks/smoother_scaling.py [LENGTH ...]``; prints a table with the time per
pose and the growth exponent fitted over the lengths, which is 1 for linear growth. Lengths take
turns over several rounds and each keeps its fastest, because shared machines are noisy.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from graphslam.baseline import integrate
from graphslam.config import EkfConfig, MatchingConfig
from graphslam.ekf import run_ekf
from graphslam.estimate import Estimate
from graphslam.geometry import line_to_robot
from graphslam.measurements import Measurements, Odometry, Sightings
from graphslam.smoother import smooth

LENGTHS = (2_000, 4_000, 8_000, 16_000, 32_000)
ROUNDS = 3
ODOMETRY_SIGMA = np.array([0.002, 0.002, 0.003])
SIGHTING_SIGMA = np.array([0.005, 0.009])
SPACING = 0.97
KNOWN = EkfConfig(MatchingConfig(method="known"))  # no matching: hundreds of laps, one problem


def grid_laps(nodes: int) -> Measurements:
    """Returns laps over a grid of 14 lines, with two sightings at every node."""
    rng = np.random.default_rng(1)
    lap = ([[0.1, 0.0, 0.0]] * 40 + [[0.03, 0.0, np.pi / 20]] * 10) * 4
    increments = np.resize(np.array(lap), (nodes - 1, 3))
    truth = integrate(np.array([0.6, 0.5, 0.0]), increments)
    offsets = SPACING * np.arange(-1, 6)
    lines = np.array([[rho, alpha] for alpha in (0.0, np.pi / 2) for rho in offsets])
    node, z, identity = [], [], []
    for i, pose in enumerate(truth):
        seen = line_to_robot(lines, pose)
        for line in np.argsort(np.abs(seen[:, 0]))[:2]:
            node.append(i)
            z.append(seen[line] + rng.standard_normal(2) * SIGHTING_SIGMA)
            identity.append(line)
    measured = increments + rng.standard_normal((nodes - 1, 3)) * ODOMETRY_SIGMA
    return _measurements(measured, np.array([0.6, 0.5, 0.0]), node, z, identity, None)


def corridor(nodes: int) -> Measurements:
    """Returns a straight way with a new line across it every half metre, none seen for long.

    So the map grows with the way. Lines are a metre long, turned by up to 23°, and in view up to a
    metre ahead.
    """
    rng = np.random.default_rng(1)
    lines = nodes // 5
    alpha = rng.uniform(-0.4, 0.4, lines)
    x = 0.4 + 0.5 * np.arange(lines)
    increments = np.tile([0.1, 0.0, 0.0], (nodes - 1, 1))
    truth = integrate(np.zeros(3), increments)
    node, z, identity = [], [], []
    for i, pose in enumerate(truth):
        for line in np.flatnonzero((x > pose[0]) & (x < pose[0] + 1.0)).tolist():
            floor = np.array([x[line] * np.cos(alpha[line]), alpha[line]])
            node.append(i)
            z.append(line_to_robot(floor, pose) + rng.standard_normal(2) * SIGHTING_SIGMA)
            identity.append(line)
    measured = increments + rng.standard_normal((nodes - 1, 3)) * ODOMETRY_SIGMA
    return _measurements(measured, np.zeros(3), node, z, identity, (-0.5, 0.5))


def _measurements(
    increment: np.ndarray,
    start: np.ndarray,
    node: list[int],
    z: list[np.ndarray],
    identity: list[int],
    extent: tuple[float, float] | None,
) -> Measurements:
    """Returns nodes a tenth of a second apart with one table of line sightings."""
    count, nodes = len(node), len(increment) + 1
    table = Sightings(
        "line",
        np.array(node),
        np.array(z),
        np.tile(np.diag(SIGHTING_SIGMA**2), (count, 1, 1)),
        np.tile(extent or (np.nan, np.nan), (count, 1)),
        0.1 * np.array(node),
        np.ones(count),
        np.array(node),
        np.array(identity),
    )
    odometry = Odometry(increment, np.tile(np.diag(ODOMETRY_SIGMA**2), (nodes - 1, 1, 1)))
    return Measurements(0.1 * np.arange(nodes), start, 1e-12 * np.eye(3), odometry, {"line": table})


def timed(work: Callable[[], Estimate]) -> tuple[float, Estimate]:
    """Returns the wall-clock seconds of one call, and its result."""
    begin = time.perf_counter()
    result = work()
    return time.perf_counter() - begin, result


def main(lengths: tuple[int, ...]) -> None:
    """Prints the table."""
    logs = {nodes: grid_laps(nodes) for nodes in lengths}
    smooth(grid_laps(100), run_ekf(grid_laps(100), KNOWN))  # compile and import before timing
    best = {nodes: [np.inf, np.inf] for nodes in lengths}
    notes = {}
    for _ in range(ROUNDS):
        for nodes, log in logs.items():
            seconds, filtered = timed(lambda log=log: run_ekf(log, KNOWN))
            best[nodes][0] = min(best[nodes][0], seconds)
            seconds, smoothed = timed(lambda log=log, at=filtered: smooth(log, at))
            best[nodes][1] = min(best[nodes][1], seconds)
            notes[nodes] = (log.sighting_count, smoothed.iterations, len(smoothed.map))
    print("  poses  sightings  lines  iterations   ekf s  us/pose   smooth s  us/pose")
    for nodes in lengths:
        sightings, iterations, lines = notes[nodes]
        ekf, batch = best[nodes]
        print(
            f"{nodes:7d}  {sightings:9d}  {lines:5d}  {iterations:10d}  {ekf:6.2f}  "
            f"{1e6 * ekf / nodes:7.0f}  {batch:9.2f}  {1e6 * batch / nodes:7.0f}"
        )
    if len(lengths) > 1:
        for column, name in enumerate(("ekf", "smoother")):
            seconds = [best[nodes][column] for nodes in lengths]
            exponent = np.polyfit(np.log(lengths), np.log(seconds), 1)[0]
            print(f"growth exponent of {name}: {exponent:.2f}")


if __name__ == "__main__":
    main(tuple(int(n) for n in sys.argv[1:]) or LENGTHS)
