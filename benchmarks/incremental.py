"""What an update of iSAM2 costs with this project's Python line factors, beside native factors.

Run with ``python benchmarks/incremental.py [LENGTH ...]``. Two iSAM2 take turns, node by node, on
graphs of one shape: ours with lines by custom factors, the other with points by GTSAM's own
`BearingRangeFactor2D` and `BetweenFactorPose2`. The same nodes see the same landmarks, start and
noise are alike, elimination is by QR in both. Figures are medians over the last tenth of the nodes,
of the update alone (a pose asked for included, the factors made before it), in processor time.
"""

from __future__ import annotations

import sys
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

LENGTHS = (1_000, 5_000, 20_000)
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


def measure(nodes: int) -> tuple[float, float, float, float]:
    """Returns the medians over the last tenth: ms of ours, of native, their ratio, ms to build."""
    problem = rooms_problem(nodes, LINES)
    sides = (Lines(problem), Points(problem))
    times, build = np.empty((nodes, 2)), np.empty(nodes)
    for node in range(nodes):
        for k in (node % 2, 1 - node % 2):
            begin = time.process_time()
            step = sides[k].step(node)
            ready = time.process_time()
            sides[k].updates.take(step)
            sides[k].now(node)
            times[node, k] = time.process_time() - ready
            if k == 0:
                build[node] = ready - begin
    ours, native = times[-nodes // 10 :].T
    told = (np.median(ours), np.median(native), np.median(ours / native), np.median(build))
    return 1e3 * told[0], 1e3 * told[1], float(told[2]), 1e3 * told[3]


def main() -> None:
    lengths = [int(word) for word in sys.argv[1:]] or LENGTHS
    print("| poses | custom lines, ms | native points, ms | ratio | making the factors, ms |")
    print("|---:|---:|---:|---:|---:|")
    for nodes in lengths:
        ours, native, ratio, build = measure(nodes)
        print(f"| {nodes:,} | {ours:.2f} | {native:.2f} | {ratio:.2f} | {build:.2f} |", flush=True)


if __name__ == "__main__":
    main()
