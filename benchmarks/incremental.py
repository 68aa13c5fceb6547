"""What an update of iSAM2 costs with this project's Python line factors, beside native factors.

Run with ``python benchmarks/incremental.py [LENGTH ...] [--seeds 3]``. Two iSAM2 take turns, node
by node, on graphs of one shape: ours with lines by custom factors, the other with points by GTSAM's
own `BearingRangeFactor2D` and `BetweenFactorPose2`. The same nodes see the same landmarks, start
and noise are alike, elimination is by QR in both. Figures are of the last fifth of the nodes of all
seeds, of the update alone (a pose asked for included, the factors made before it), in processor
time: medians; the median of the ratio node by node; and the ratio of all updates together. How many
variables are eliminated again differs from node to node, and says how alike the work was.
"""

from __future__ import annotations

import argparse
import time

import gtsam
import numpy as np
from rooms import ODOMETRY_SIGMA, START_SIGMA, rooms_problem

from graphslam.geometry import compose
from graphslam.models.line import LINE
from graphslam.smoother.factors import (
    landmark_key,
    odometry_factor,
    pose_key,
    sighting_factor,
    start_factor,
)
from graphslam.smoother.problem import Problem
from graphslam.smoother.updates import Step, Whole

LINES = 200
RELINEARISE = 0.01
RANGE_SIGMA, BEARING_SIGMA = 0.005, 0.009


class Lines:
    """The problem's own factors."""

    kinds: tuple[str, ...] = ("line",)

    def __init__(self, problem: Problem) -> None:
        self.problem, self.updates = problem, Whole(RELINEARISE, self.kinds)
        self.started: set[int] = set()

    def step(self, node: int) -> Step:
        """Returns what a node adds."""
        problem, step = self.problem, Step(node)
        measurements, table = problem.measurements, problem.measurements.sightings["line"]
        if node == 0:
            pose = measurements.start_pose
            step.graph.push_back(start_factor(pose, measurements.start_cov))
        else:
            increment = measurements.odometry.increment[node - 1]
            pose = compose(self.now(node - 1), increment)
            cov = measurements.odometry.cov[node - 1]
            step.graph.push_back(odometry_factor(node - 1, increment, cov))
        step.add_pose(pose)
        for row in (2 * node, 2 * node + 1):
            landmark, z, cov = int(problem.match[row]), table.z[row], table.cov[row]
            if landmark not in self.started:
                self.started.add(landmark)
                first = LINE.initialise(pose, z, cov)
                assert first is not None
                step.add_landmark(landmark, first[0])
            step.graph.push_back(sighting_factor(LINE, z, cov, node, landmark))
        return step

    def now(self, node: int) -> np.ndarray:
        """Returns a pose as it is known, (3,)."""
        found = self.updates.solver.calculateEstimatePose2(pose_key(node))
        return np.array([found.x(), found.y(), found.theta()])


class Points(Lines):
    """A graph of the same shape: each line is replaced by a point that lies before its viewers."""

    kinds = ("bearing",)

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        rng = np.random.default_rng(3)
        table = problem.measurements.sightings["line"]
        self.truth = truth = problem.pose
        count = len(problem.kinds)
        total, seen = np.zeros((count, 2)), np.zeros(count)
        np.add.at(total, problem.match, truth[table.node, :2])
        np.add.at(seen, problem.match, 1.0)
        points = total / seen[:, None] + rng.uniform(-1.5, 1.5, (count, 2))
        away = points[problem.match] - truth[table.node, :2]
        angle = np.arctan2(away[:, 1], away[:, 0]) - truth[table.node, 2]
        self.bearing = angle + BEARING_SIGMA * rng.standard_normal(len(angle))
        self.range = np.hypot(*away.T) + RANGE_SIGMA * rng.standard_normal(len(angle))
        sigmas = np.array([BEARING_SIGMA, RANGE_SIGMA])
        self.noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        self.odometry_noise = gtsam.noiseModel.Diagonal.Sigmas(ODOMETRY_SIGMA)
        between = [
            gtsam.Pose2(*a).between(gtsam.Pose2(*b))
            for a, b in zip(truth[:-1].tolist(), truth[1:].tolist(), strict=True)
        ]
        moved = np.array([[p.x(), p.y(), p.theta()] for p in between])
        self.increment = moved + rng.standard_normal(moved.shape) * ODOMETRY_SIGMA

    def step(self, node: int) -> Step:
        step = Step(node)
        if node == 0:
            pose = self.truth[0]
            start = gtsam.noiseModel.Isotropic.Sigma(3, START_SIGMA)
            step.graph.push_back(gtsam.PriorFactorPose2(pose_key(0), gtsam.Pose2(*pose), start))
        else:
            increment = self.increment[node - 1]
            pose = compose(self.now(node - 1), increment)
            step.graph.push_back(
                gtsam.BetweenFactorPose2(
                    pose_key(node - 1), pose_key(node), gtsam.Pose2(*increment), self.odometry_noise
                )
            )
        step.add_pose(pose)
        for row in (2 * node, 2 * node + 1):
            landmark, angle = int(self.problem.match[row]), float(self.bearing[row])
            if landmark not in self.started:
                self.started.add(landmark)
                heading = pose[2] + angle
                way = self.range[row] * np.array([np.cos(heading), np.sin(heading)])
                step.add_landmark(landmark, pose[:2] + way)
            step.graph.push_back(
                gtsam.BearingRangeFactor2D(
                    pose_key(node),
                    landmark_key(landmark),
                    gtsam.Rot2(angle),
                    float(self.range[row]),
                    self.noise,
                )
            )
        return step


def measure(nodes: int, seeds: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns, of the last fifth of the nodes of all seeds, what each took and each did.

    These are seconds (k, 2) of ours and native, variables eliminated again (k, 2), and seconds (k,)
    to make our factors.
    """
    first = nodes - nodes // 5
    times, work, build = (np.zeros((seeds, nodes, 2)) for _ in range(3))
    for seed in range(seeds):
        problem = rooms_problem(nodes, LINES, seed=1 + seed)
        sides = (Lines(problem), Points(problem))
        for node in range(nodes):
            for k in (node % 2, 1 - node % 2):
                begin = time.process_time()
                step = sides[k].step(node)
                ready = time.process_time()
                result = sides[k].updates.solver.update(step.graph, step.values)
                sides[k].now(node)
                times[seed, node, k] = time.process_time() - ready
                build[seed, node, k] = ready - begin
                work[seed, node, k] = result.getVariablesReeliminated()
    last = np.s_[:, first:]
    return times[last].reshape(-1, 2), work[last].reshape(-1, 2), build[last][..., 0].ravel()


def microseconds(nodes: int = 2_000, rounds: int = 30) -> tuple[float, float, float]:
    """Returns what linearising one factor takes, us: a line's, an odometry's and a native one's."""
    problem = rooms_problem(nodes, LINES)
    measurements, table = problem.measurements, problem.measurements.sightings["line"]
    odometry = measurements.odometry
    native = gtsam.noiseModel.Diagonal.Sigmas(np.array([BEARING_SIGMA, RANGE_SIGMA]))
    values = gtsam.Values()
    for node, (x, y, theta) in enumerate(problem.pose.tolist()):
        values.insert(pose_key(node), gtsam.Pose2(x, y, theta))
    for landmark, params in enumerate(problem.params):
        values.insert(landmark_key(landmark), params)
    graphs = [gtsam.NonlinearFactorGraph() for _ in range(3)]
    for row, (node, landmark) in enumerate(zip(table.node, problem.match, strict=True)):
        graphs[0].push_back(sighting_factor(LINE, table.z[row], table.cov[row], node, landmark))
        keys = (pose_key(node), landmark_key(landmark))
        graphs[2].push_back(gtsam.BearingRangeFactor2D(*keys, gtsam.Rot2(0.1), 1.0, native))
    for node, increment in enumerate(odometry.increment):
        graphs[1].push_back(odometry_factor(node, increment, odometry.cov[node]))
    spent = np.empty((rounds, 3))
    for k in range(rounds):
        for n, graph in enumerate(graphs):
            begin = time.process_time()
            graph.linearize(values)
            spent[k, n] = (time.process_time() - begin) / graph.size()
    line, odometer, point = 1e6 * np.median(spent, axis=0)
    return float(line), float(odometer), float(point)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("lengths", type=int, nargs="*", default=[1_000, 5_000, 20_000])
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    line, odometer, point = microseconds()
    print(f"Linearising a factor, us: {line:.1f} line, {odometer:.1f} odometry, {point:.1f} native")
    print(
        "| poses | custom lines, ms | native points, ms | ratio, median | ratio of all together |"
    )
    print("|---:|---:|---:|---:|---:|", flush=True)
    for nodes in options.lengths:
        times, work, build = measure(nodes, options.seeds)
        ours, native = 1e3 * np.median(times, axis=0)
        each, total = np.median(times[:, 0] / times[:, 1]), times[:, 0].sum() / times[:, 1].sum()
        print(f"| {nodes:,} | {ours:.2f} | {native:.2f} | {each:.2f} | {total:.2f} |", flush=True)
        again = " and ".join(f"{count:.1f}" for count in work.mean(axis=0))
        print(f"  eliminated again {again}; factors made in {1e3 * np.median(build):.2f} ms")


if __name__ == "__main__":
    main()
