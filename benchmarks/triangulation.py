"""Triangulation on real bearings: nine positions, 200 shots each, four beacons.

Closed form from three beacons, least squares from all four, and both after a correction of the
directions (offset, and waves around the robot) fitted on some positions and tested on the others.

    python benchmarks/triangulation.py FOLDER    # the data set of TriangulationToolbox
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from frontend.calibrate_bearings import KnownDirections, fit_correction
from graphslam.errors import UnderConstrained
from graphslam.geometry import Array, wrap
from graphslam.models.bearing import BEARING
from graphslam.triangulation import fix, three_beacons

HEADING = np.pi / 2
SIGMA = np.radians(1.0)


def read(folder: Path) -> tuple[Array, dict[tuple[float, float], Array]]:
    """Returns the beacons (4, 2), m, and by true position the directions (200, 4), rad."""
    beacons = np.loadtxt(folder / "landmark.csv", delimiter=",")
    shots = {}
    for path in sorted(folder.glob("(X*.csv")):
        x, y = map(float, re.findall(r"[XY]([\d.]+?)(?=[,)])", path.name))
        shots[x, y] = np.radians(np.loadtxt(path, delimiter=","))
    return beacons, shots


def directions(
    place: tuple[float, float], shots: Array, beacons: Array, group: int
) -> KnownDirections:
    """Returns the directions of one position with the true ones."""
    pose = np.array([*place, HEADING])
    true = BEARING.residual(pose, beacons, np.zeros((len(beacons), 1)))[0][:, 0]
    count = shots.size
    return KnownDirections(
        wrap(shots).ravel(),
        wrap(np.tile(true, len(shots))),
        np.full(count, SIGMA),
        np.full((count, 2), np.nan),
        np.full(count, group),
    )


def closed(shots: Array, beacons: Array) -> Array:
    """Returns the poses from the first three beacons."""
    return poses(lambda z: three_beacons(beacons[:3], z[:3]), shots)


def least(shots: Array, beacons: Array) -> Array:
    """Returns the poses from all beacons."""
    variance = np.full(len(beacons), SIGMA**2)
    return poses(lambda z: fix(beacons, z, variance).pose, shots)


def poses(solve: Callable[[Array], Array], shots: Array) -> Array:
    """Returns the poses (n, 3) that are determined."""
    found = []
    for z in shots:
        try:
            found.append(solve(z))
        except UnderConstrained:
            continue
    return np.array(found).reshape(-1, 3)


def figures(found: dict[tuple[float, float], Array], total: int) -> list[float]:
    """Returns mean and largest error of the averages, spread, of positions (mm); the same of the
    heading (deg); and how many shots are not determined."""
    off = {place: pose - [*place, HEADING] for place, pose in found.items()}
    mean = np.concatenate([np.hypot(*o[:, :2].T) for o in off.values()])
    bias = [np.hypot(*o[:, :2].mean(axis=0)) for o in off.values()]
    spread = np.sqrt(np.mean([o[:, :2].var(axis=0).sum() for o in off.values()]))
    turn = np.concatenate([np.degrees(np.abs(wrap(o[:, 2]))) for o in off.values()])
    count = sum(map(len, found.values()))
    return [1e3 * mean.mean(), 1e3 * max(bias), 1e3 * spread, turn.mean(), total - count]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    beacons, shots = read(parser.parse_args().folder)
    places = list(shots)
    known = {p: directions(p, shots[p], beacons, k) for k, p in enumerate(places)}
    total = sum(map(len, shots.values()))
    raw = np.concatenate([np.degrees(wrap(k.true - k.measured)) for k in known.values()])
    print(f"{len(places)} positions, {total} shots")
    print(f"direction error: mean {raw.mean():.2f}, std {raw.std():.2f} deg")
    headings = (
        "mean error (mm)",
        "worst bias (mm)",
        "spread (mm)",
        "heading (deg)",
        "undetermined",
    )
    print(f"| directions | method | {' | '.join(headings)} |")
    print("|---|---|---|---|---|---|---|")
    fits: dict[str, int | None] = {
        "as measured": None,
        "offset": 0,
        "offset and 1 wave": 1,
        "offset and 2 waves": 2,
    }
    for name, harmonics in fits.items():
        corrected = dict(shots)
        for k, place in enumerate(places if harmonics is not None else []):
            held = [p for i, p in enumerate(places) if i % 3 == k % 3]
            parts = [known[p] for p in places if p not in held]
            rest = KnownDirections(
                *(np.concatenate([getattr(p, n) for p in parts]) for n in parts[0].__slots__)
            )
            corrected[place] = fit_correction(rest, harmonics)[0].of(wrap(shots[place]))
        for label, method in (
            ("three beacons, closed form", closed),
            ("four, least squares", least),
        ):
            row = figures({p: method(z, beacons) for p, z in corrected.items()}, total)
            texts = [f"{row[0]:.0f}", f"{row[1]:.0f}", f"{row[2]:.1f}", f"{row[3]:.2f}"]
            print(f"| {name} | {label} | {' | '.join(texts)} | {row[4]} |")
    print("A correction is fitted on six positions and tested on the other three, in three rounds.")


if __name__ == "__main__":
    main()
