"""GTSAM's own Levenberg-Marquardt beside this project's engines, on graphs that it can afford.

Run with ``python benchmarks/gtsam_small.py [--poses 250 500 1000] [--rounds 3]``. Four ways
take turns: the chain engine; the GTSAM engine (custom factors, steps driven from Python); GTSAM's
own optimiser on those very factors; and GTSAM's own optimiser on a graph of the same shape whose
lines are points, by its native factors. Processor time, medians, set-up included. The first three
reach the same cost, which is checked; the fourth is another problem.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from statistics import median

import gtsam
import numpy as np
from incremental import LINES, Points
from rooms import rooms_problem

from graphslam.config import SmootherConfig
from graphslam.smoother import engine_gtsam
from graphslam.smoother.chain import minimise
from graphslam.smoother.graph import graph_of
from graphslam.smoother.problem import Problem

CONFIG = SmootherConfig()
SAME = 1e-9


class Still(Points):
    """The points' graph as a whole, started where the lines' is, nothing estimated on the way."""

    def now(self, node: int) -> np.ndarray:
        return np.asarray(self.problem.pose[node])


def points_graph(problem: Problem) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Returns a graph of native factors of the same shape, and its start."""
    side = Still(problem)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for node in range(len(problem.pose)):
        step = side.step(node)
        graph.push_back(step.graph)
        values.insert(step.values)
    return graph, values


def gtsams_own(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> tuple[float, int]:
    """Returns cost and iterations of GTSAM's Levenberg-Marquardt, by QR, to our tolerance."""
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType("MULTIFRONTAL_QR")
    parameters.setRelativeErrorTol(1e-9)
    parameters.setAbsoluteErrorTol(0.0)
    solver = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
    solver.optimize()
    return float(solver.error()), int(solver.iterations())


def ours(engine: Callable[..., object], problem: Problem) -> tuple[float, int]:
    """Returns cost and iterations of one of this project's engines."""
    found = engine(problem, CONFIG)
    return found.cost, found.iterations  # type: ignore[attr-defined]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, nargs="+", default=[250, 500, 1000])
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    heads = ("chain", "GTSAM engine", "GTSAM's LM, same factors", "GTSAM's LM, native points")
    print("| poses | " + " | ".join(f"{head}, s | iterations" for head in heads) + " |")
    print("|---:|" + "---:|" * 8)
    ours(minimise, rooms_problem(100, 20))  # compile before timing
    for nodes in options.poses:
        problem = rooms_problem(nodes, LINES)
        ways = (
            lambda p: ours(minimise, p),
            lambda p: ours(engine_gtsam.minimise, p),
            lambda p: gtsams_own(*graph_of(p)[:2]),
            lambda p: gtsams_own(*points_graph(p)),
        )
        spent, found = [[] for _ in ways], [(0.0, 0)] * len(ways)
        for _ in range(options.rounds):
            for k, way in enumerate(ways):
                began = time.process_time()
                found[k] = way(problem)
                spent[k].append(time.process_time() - began)
        for cost, _ in found[1:3]:
            assert abs(cost / found[0][0] - 1.0) < SAME, (cost, found[0][0])
        cells = [f"{median(s):.3f} | {f[1]}" for s, f in zip(spent, found, strict=True)]
        print(f"| {nodes:,} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
