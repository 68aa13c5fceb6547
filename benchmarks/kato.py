"""Kato's tables I to IV again: four points, four headings, ten shots each, in rendered images.

The noise of the pixels is the one number that is fitted: it gives the paper's spread at point A.
All else follows: the images, the cones found in them, the pose from each shot. Beside it stands
what the bound foretells from the spread of the directions.

    python benchmarks/kato.py [--shots 10]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from frontend.cones import detect_bearings
from frontend.omni_config import OmniConfig
from frontend.simulate import load_scenario
from frontend.simulate.cones import cone_landmarks, omni_camera
from frontend.simulate.mirror import render_around
from graphslam.config import EkfConfig
from graphslam.geometry import Array, wrap
from graphslam.measurements import Sightings
from graphslam.memoryless import fix_by_names
from graphslam.models.bearing import BEARING
from graphslam.triangulation import pose_covariance

POINTS = {"A": (0.50, 0.35), "B": (0.50, 0.05), "C": (0.05, 0.35), "D": (0.95, 0.65)}
HEADINGS = (0.0, 30.0, 60.0, 90.0)
PAPER = {
    "A": [
        (0.490, 0.350, 0.11, 3.15e-4, 2.54e-4, 4.69e-3),
        (0.497, 0.336, 30.25, 1.51e-4, 1.31e-4, 1.55e-2),
        (0.502, 0.346, 59.81, 9.04e-5, 9.31e-5, 6.49e-3),
        (0.502, 0.342, 89.78, 1.38e-4, 6.70e-5, 4.64e-3),
    ],
    "B": [
        (0.483, 0.052, -1.01, 5.21e-4, 1.71e-4, 2.48e-2),
        (0.492, 0.045, 29.59, 3.61e-4, 1.65e-4, 1.59e-2),
        (0.494, 0.044, 59.52, 8.20e-3, 4.92e-5, 1.70e-2),
        (0.503, 0.053, 90.83, 7.64e-4, 3.62e-4, 2.75e-2),
    ],
    "C": [
        (0.049, 0.357, 0.15, 9.77e-4, 1.99e-3, 8.47e-2),
        (0.053, 0.352, 30.33, 8.45e-5, 1.65e-4, 1.00e-2),
        (0.054, 0.338, 59.30, 1.07e-4, 2.92e-4, 1.14e-2),
        (0.058, 0.342, 89.73, 6.96e-5, 2.18e-4, 4.47e-3),
    ],
    "D": [
        (0.914, 0.687, 2.48, 4.41e-3, 4.88e-3, 3.11e-1),
        (0.945, 0.651, 30.12, 2.29e-3, 3.07e-3, 1.79e-1),
        (0.964, 0.612, 59.46, 1.79e-3, 2.78e-3, 1.58e-1),
        (0.993, 0.573, 86.61, 1.46e-3, 2.70e-3, 1.47e-1),
    ],
}
"""Averages of x, y (m) and heading (degrees), and their standard deviations, by point and heading:
tables I to IV."""
NOISES = (1.0, 2.0, 4.0, 8.0, 12.0)
"""Pixel noises tried at A, grey levels."""


@dataclass(frozen=True)
class Shots:
    """One cell of the tables: poses (n, 3) found, and directions (n, 3) by cone, rad."""

    pose: Array
    bearing: Array


def shoot(point: tuple[float, float], heading_deg: float, noise: float, shots: int) -> Shots:
    """Returns what ten shots from one place give."""
    scenario = load_scenario("three-cones")
    assert scenario.omni is not None
    spec = replace(scenario.omni, noise=noise)
    camera, known = omni_camera(spec, scenario.cones), cone_landmarks(scenario.cones)
    pose = np.array([*point, np.radians(heading_deg)])
    seed = [round(1e3 * v) for v in (*point, heading_deg, noise)]
    rng = np.random.default_rng(seed)
    poses, bearings = [], []
    for _ in range(shots):
        image = render_around(spec, scenario.cones, pose, scenario.surface.grey, rng)
        found = detect_bearings(image, camera, OmniConfig())
        n = len(found)
        none = np.full(n, -1)
        table = Sightings(
            "bearing", np.zeros(n, int), found.z, found.cov, np.full((n, 2), np.nan), np.zeros(n),
            found.area, none, none, found.label,
        )  # fmt: skip
        answer, named = fix_by_names(table, np.arange(n), known, EkfConfig())
        poses.append(answer.pose)
        bearings.append(found.z[np.argsort(named), 0])
    return Shots(np.array(poses), np.array(bearings))


def spread(shots: Shots) -> Array:
    """Returns standard deviations (3,) of x, y (m) and heading (degrees)."""
    off = wrap(shots.pose - shots.pose[0])
    return off.std(axis=0, ddof=1) * [1.0, 1.0, 180.0 / np.pi]


def matched_noise(shots: int) -> float:
    """Returns the pixel noise that gives the paper's spread of the position at A, grey levels."""
    target = np.sqrt(np.mean([row[3] ** 2 + row[4] ** 2 for row in PAPER["A"]]))
    reached = []
    for noise in NOISES:
        each = [spread(shoot(POINTS["A"], heading, noise, shots)) for heading in HEADINGS]
        reached.append(np.sqrt(np.mean([s[0] ** 2 + s[1] ** 2 for s in each])))
    print("position spread at A by pixel noise:", end=" ")
    print(", ".join(f"{n:g}: {1e3 * s:.3f} mm" for n, s in zip(NOISES, reached, strict=True)))
    return float(np.interp(target, np.maximum.accumulate(reached), NOISES))


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shots", type=int, default=10)
    shots = parser.parse_args().shots
    noise = matched_noise(shots)
    print(f"pixel noise that gives the paper's spread at A: {noise:.1f} grey levels\n")
    cones = cone_landmarks(load_scenario("three-cones").cones).params
    cells = {
        (name, heading): shoot(place, heading, noise, shots)
        for name, place in POINTS.items()
        for heading in HEADINGS
    }
    for number, heading in enumerate(HEADINGS):
        print(f"Table {'I' * (number + 1) if number < 3 else 'IV'}, heading {heading:g} degrees")
        print("| | x (m) | y (m) | heading (deg) | std x (mm) | std y (mm) | std heading (deg) |")
        print("|---|---|---|---|---|---|---|")
        for name in POINTS:
            cell, paper = cells[name, heading], PAPER[name][number]
            mean = cell.pose[0] + wrap(cell.pose - cell.pose[0]).mean(axis=0)
            ours = (mean[0], mean[1], np.degrees(mean[2]), *spread(cell))
            texts = [f"{paper[k]:.3f}, {ours[k]:.3f}" for k in (0, 1)]
            texts += [f"{paper[2]:.2f}, {ours[2]:.2f}"]
            texts += [f"{1e3 * paper[k]:.3f}, {1e3 * ours[k]:.3f}" for k in (3, 4)]
            texts += [f"{paper[5]:.4f}, {ours[5]:.4f}"]
            print(f"| {name} | {' | '.join(texts)} |")
        print()
    print("RMS over the headings: spread measured, and foretold by the bound (mm, mm, deg)")
    own_a = np.sqrt(np.mean([np.var(cells["A", h].bearing, axis=0, ddof=1) for h in HEADINGS]))
    rms = {}
    print(
        "| | paper | ours | bound, sigma of A | ours over it | bound, own sigmas | ours over it |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, place in POINTS.items():
        measured = np.sqrt(np.mean([spread(cells[name, h]) ** 2 for h in HEADINGS], axis=0))
        paper = np.sqrt(np.mean(np.square(PAPER[name])[:, 3:], axis=0))
        own = np.mean([np.var(cells[name, h].bearing, axis=0, ddof=1) for h in HEADINGS], axis=0)
        unit = np.array([1e3, 1e3, 180.0 / np.pi])
        bound = [
            np.sqrt(np.diag(pose_covariance(np.array([*place, 0.0]), cones, variance))) * unit
            for variance in (np.full(3, own_a**2), own)
        ]
        ours = measured * [1e3, 1e3, 1.0]
        rms[name] = (paper * [1e3, 1e3, 1.0], ours, *bound)
        ratios = [ours / b for b in bound]
        columns = (rms[name][0], ours, bound[0], ratios[0], bound[1], ratios[1])
        print(f"| {name} | {' | '.join(', '.join(f'{v:.3g}' for v in c) for c in columns)} |")
    for k, label in enumerate(("paper", "ours", "bound, sigma of A", "bound, own sigmas")):
        ratio = rms["D"][k] / rms["A"][k]
        print(f"D over A, {label}: x {ratio[0]:.1f}, y {ratio[1]:.1f}, heading {ratio[2]:.1f}")
    e = [
        BEARING.residual(np.array([*POINTS[n], np.radians(h)]), cones, c.bearing.mean(0)[:, None])[
            0
        ]
        for (n, h), c in cells.items()
    ]
    bias = np.degrees(np.sqrt(np.mean(np.square(e))))
    print(f"bias of the directions, RMS over all places and headings: {bias:.3f} deg")


if __name__ == "__main__":
    main()
