"""Two maps of one floor from two simulated runs: found, judged rightly, and merged for the better.

Run with ``python benchmarks/map_comparison.py [SEEDS]``, by default 50. Each seed draws a floor of
straight lines in random places and directions and two runs on it with their own noise. The second
starts elsewhere, turned by 130 degrees, and never sees a third of the lines. Both are estimated by
the smoother, each in the frame of its own start, of which nothing is told to the alignment.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from compare.metrics import rms
from frontend.extract import extract
from frontend.simulate import Scenario, simulate_log
from frontend.simulate.floor import FloorLine
from frontend.simulate.scenario import Motion, Start
from frontend.simulate.sensors import SightingSpec
from graphslam.ekf import run_ekf
from graphslam.estimate import Estimate
from graphslam.geometry import (
    Array,
    between,
    interpolate_poses,
    points_on_line,
    position_along,
    wrap,
)
from graphslam.line_maps.alignment import align_matches, find_alignments
from graphslam.line_maps.ambiguity import ambiguity
from graphslam.line_maps.chi2 import MapTest, same_map
from graphslam.line_maps.line_map import LineMap
from graphslam.line_maps.merge import merge_line_maps
from graphslam.measurements import IntArray, Measurements
from graphslam.models.wheels import DifferentialDrive
from graphslam.smoother import smooth

SEEDS = 50
LINES, SIZE = 15, 6.0
"""Lines on a floor, and the side of the square they lie in, m."""
APART = 0.35
"""Lines within 20 degrees of each other lie further apart than this, m."""
STARTS = (np.array([1.0, 1.0, 0.0]), np.array([4.6, 4.2, math.radians(130.0)]))
PATHS = (
    (Motion(forward=4.0), Motion(turn_deg=90.0)) * 8,
    (Motion(arc_deg=360.0, radius=1.6),) * 3,
)
FOUND_M, FOUND_DEG = 0.1, 2.0
"""An alignment is the right one within this distance and turn of the true motion."""


@dataclass(frozen=True, slots=True)
class Run:
    """One simulated run.

    Attributes:
        map: its lines, in the frame of its own first node.
        true: for each the row of the true line that it is.
        start: (3,) true pose at the first node, floor frame.
    """

    map: LineMap
    true: IntArray
    start: Array


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one seed.

    Attributes:
        found: whether the alignment is the right one.
        seconds: what finding it took.
        ratio: score of the next best alignment over that of the best.
        matched: lines matched, and how many of them wrongly.
        test: the two maps' differences.
        motion_nees: error of the motion, normalised, per degree of freedom.
        errors: RMS offset of the two maps and of the merged one, m, each after its own motion: of
            the first and the merged over the first's lines, of the second and the merged over the
            second's.
        nees: NEES of both maps and of the merged, per degree of freedom, up to a rigid motion.
    """

    found: bool
    seconds: float
    ratio: float
    matched: tuple[int, int]
    test: MapTest
    motion_nees: float
    errors: tuple[float, float, float, float]
    nees: tuple[float, float, float]


def random_floor(rng: np.random.Generator) -> tuple[FloorLine, ...]:
    """Returns lines of 2.5 to 5 m in random places and directions, none beside another."""
    lines: list[FloorLine] = []
    while len(lines) < LINES:
        alpha, length = rng.uniform(-math.pi, math.pi), rng.uniform(2.5, 5.0)
        middle = rng.uniform(0.1 * SIZE, 0.9 * SIZE, 2)
        rho = float(middle @ [math.cos(alpha), math.sin(alpha)])
        s = float(position_along(np.array([rho, alpha]), middle))
        stretch = (s - 0.5 * length, s + 0.5 * length)
        new = FloorLine(rho, math.degrees(alpha), stretch)
        if all(_apart(new, other) for other in lines):
            lines.append(new)
    return tuple(lines)


def _apart(a: FloorLine, b: FloorLine) -> bool:
    turn = math.radians(a.alpha_deg - b.alpha_deg)
    if abs(math.sin(turn)) > math.sin(math.radians(20.0)):
        return True
    line = np.array([a.rho, math.radians(a.alpha_deg)])
    ends = points_on_line(np.array([b.rho, math.radians(b.alpha_deg)]), np.array(b.stretch))
    offset = ends @ [math.cos(line[1]), math.sin(line[1])] - line[0]
    return bool(np.abs(offset).min() > APART and offset[0] * offset[1] > 0)


def floor_lines(lines: tuple[FloorLine, ...]) -> tuple[Array, Array]:
    """Returns (rho, alpha) of lines and their stretches."""
    values = np.array([(line.rho, math.radians(line.alpha_deg)) for line in lines])
    return values, np.array([line.stretch for line in lines])


def drive(lines: tuple[FloorLine, ...], which: int, seed: int, unseen: IntArray) -> Run:
    """Returns a run and its map; lines ``unseen`` are never seen."""
    x, y, heading = STARTS[which]
    scenario = Scenario(
        format="graphslam-scenario/1",
        name="floor",
        robot=DifferentialDrive(0.05, 0.05, 0.3),
        path=PATHS[which],
        start=Start(x, y, math.degrees(heading), known=False),
        lines=lines,
        sightings=SightingSpec(0.004, 0.4, reach=1.2, rate=3.0),
    )
    log = simulate_log(scenario, seed)
    measurements = without(extract(log), unseen)
    estimate = smooth(measurements, run_ekf(measurements))
    assert log.truth is not None
    start = interpolate_poses(measurements.t[:1], log.truth.t, log.truth.pose)[0]
    return Run(LineMap.of_estimate(estimate), true_rows(estimate, measurements), start)


def without(measurements: Measurements, lines: IntArray) -> Measurements:
    """Returns measurements without the sightings of some true lines."""
    table = measurements.sightings["line"]
    return replace(measurements, sightings={"line": table.select(~np.isin(table.truth, lines))})


def true_rows(estimate: Estimate, measurements: Measurements) -> IntArray:
    """Returns the true line that most sightings of each map line are of."""
    truth = measurements.sightings["line"].truth
    rows = range(len(estimate.map))
    return np.array([np.bincount(truth[(estimate.match == row)]).argmax() for row in rows])


def judge(seed: int) -> Outcome:
    """Returns what comes of one seed."""
    rng = np.random.default_rng(seed)
    lines = random_floor(rng)
    unseen = rng.permutation(LINES)[: LINES // 3]
    a = drive(lines, 0, 2 * seed, np.zeros(0, np.int64))
    b = drive(lines, 1, 2 * seed + 1, unseen)
    begin = time.perf_counter()
    alignments = find_alignments(a.map, b.map)
    seconds = time.perf_counter() - begin
    best = alignments[0]
    error = best.motion - between(a.start, b.start)
    error[2] = wrap(error[2])
    sure = ambiguity(alignments, b.map)
    assert sure is not None
    wrong = a.true[best.matches[:, 0]] != b.true[best.matches[:, 1]]
    merged = merge_line_maps(a.map, b.map, best)
    whole = Run(
        merged.map,
        np.array(
            [
                a.true[i[0]] if i else b.true[j[0]]
                for i, j in zip(merged.rows_a, merged.rows_b, strict=True)
            ]
        ),
        a.start,
    )
    both = [against_truth(run, lines, run.true) for run in (a, b)]
    parts = [against_truth(whole, lines, run.true) for run in (a, b)]
    everything = against_truth(whole, lines, whole.true)
    return Outcome(
        found=math.hypot(*error[:2]) < FOUND_M and abs(error[2]) < math.radians(FOUND_DEG),
        seconds=seconds,
        ratio=sure.ratio,
        matched=(len(wrong), int(wrong.sum())),
        test=same_map(a.map, b.map, best),
        motion_nees=float(error @ np.linalg.solve(best.cov, error)) / 3.0,
        errors=tuple(rms(t.offset) for t in (both[0], parts[0], both[1], parts[1])),  # type: ignore[arg-type]
        nees=(both[0].per_freedom, both[1].per_freedom, everything.per_freedom),
    )


def against_truth(run: Run, lines: tuple[FloorLine, ...], wanted: IntArray) -> MapTest:
    """Returns a map's differences from the floor's own lines, of those among ``wanted``."""
    values, stretches = floor_lines(lines)
    truth = LineMap.exact(values, stretches)
    rows = np.array([row for row, true in enumerate(run.true) if true in wanted])
    _, first = np.unique(run.true[rows], return_index=True)
    matches = np.column_stack([run.true[rows[first]], rows[first]])
    return same_map(truth, run.map, align_matches(truth, run.map, matches, run.start))


def figures(outcomes: Sequence[Outcome]) -> dict[str, str]:
    """Returns the rows of the table; figures of maps are those of alignments that are right."""
    right = [o for o in outcomes if o.found]
    matched = np.sum([o.matched for o in right], axis=0)
    passed = np.mean([o.test.probability > 0.05 for o in right])
    per = sum(o.test.chi2 for o in right) / sum(o.test.freedom for o in right)
    offset = np.concatenate([o.test.offset for o in right])
    sigma = np.concatenate([o.test.sigma[:, 0] for o in right])
    error = 1e3 * np.array([o.errors for o in right])
    better = (error[:, 1] < error[:, 0]) & (error[:, 3] < error[:, 2])
    a, a_merged, b, b_merged = (rms(column) for column in error.T)
    seconds = np.array([o.seconds for o in outcomes])
    nees = np.mean([o.nees for o in right], axis=0)
    return {
        "right alignment found": f"{len(right)} of {len(outcomes)}",
        "time to find it, median and worst (s)": f"{np.median(seconds):.2f}, {seconds.max():.2f}",
        "score of the next best over the best's, worst": f"{max(o.ratio for o in outcomes):.2f}",
        "lines matched, and wrongly": f"{matched[0]}, {matched[1]}",
        "chi-square test at 95 % passed": f"{passed:.0%}",
        "chi-square per degree of freedom": f"{per:.3f}",
        "offset between the maps, RMS, and predicted (mm)": (
            f"{1e3 * rms(offset):.2f}, {1e3 * rms(sigma):.2f}"
        ),
        "NEES of the motion": f"{np.mean([o.motion_nees for o in right]):.2f}",
        "error of the first map, of the merged on its lines (mm)": f"{a:.2f}, {a_merged:.2f}",
        "error of the second map, of the merged on its lines (mm)": f"{b:.2f}, {b_merged:.2f}",
        "merged error below both parents'": f"{np.mean(better):.0%}",
        "NEES of first, second and merged map": " ".join(f"{v:.2f}" for v in nees),
    }


def main(seeds: int) -> None:
    """Prints the table."""
    print(f"{seeds} seeds, {LINES} lines, second map turned by 130° and without a third of them")
    for name, value in figures([judge(seed) for seed in range(seeds)]).items():
        print(f"{name:58} {value}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS)
