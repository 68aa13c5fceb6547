"""Smoothing as the robot drives: one update of GTSAM's iSAM2 for each node.

`run_isam2` keeps every pose and tells each one as it was known at its time; `run_fixed_lag` keeps
those of the last seconds and tells each one as it was known when it left them. Landmarks stay.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from graphslam.config import IncrementalConfig
from graphslam.ending import end
from graphslam.estimate import Estimate, Told
from graphslam.geometry import Array, compose, rotate_covariance, wrap
from graphslam.landmarks import padded
from graphslam.late import TOO_LATE, Arrivals
from graphslam.measurements import Measurements, Sightings
from graphslam.models import MODELS
from graphslam.models.base import Delayed
from graphslam.smoother.engine_gtsam import last_and_map_covariance
from graphslam.smoother.factors import (
    fixed_sighting_factor,
    landmark_key,
    odometry_factor,
    pose_key,
    sighting_factor,
    start_factor,
)
from graphslam.smoother.fit import sighting_fit
from graphslam.smoother.optimise import translated_errors
from graphslam.smoother.problem import Problem, state_problem
from graphslam.smoother.updates import Step, Updates, Whole, Window

LEFT = "sighting whose pose left the window before its landmark could start"
UNSTARTED = "sighting of a landmark that never started"


def run_isam2(
    measurements: Measurements,
    initial: Estimate,
    config: IncrementalConfig | None = None,
    told: Told | None = None,
) -> Estimate:
    """Returns each pose as it was known at its time, with the whole past linearised anew.

    It is the smoother's causal counterpart: what smoothing says, at each time, of the pose then.

    Args:
        measurements: the same as the filter's.
        initial: the filter's estimate, for its matches; nothing else of it is used.
        config: when to linearise anew.
        told: called after each node.

    Raises:
        BadMeasurements: ``initial`` does not belong to these measurements.
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    config = config or IncrementalConfig()
    problem = state_problem(measurements, initial.match, initial)
    return _Run(problem, Whole(config.relinearise, _moving(problem))).run(told)


def run_fixed_lag(
    measurements: Measurements,
    initial: Estimate,
    config: IncrementalConfig | None = None,
    told: Told | None = None,
) -> Estimate:
    """Returns each pose as it was known ``config.lag_s`` later, or at the end of the log.

    A pose that leaves the window is marginalised, linearised where it then is.

    Args:
        measurements: the same as the filter's.
        initial: the filter's estimate, for its matches; nothing else of it is used.
        config: how long a pose stays, and when to linearise anew.
        told: called after each node.

    Raises:
        BadMeasurements: ``initial`` does not belong to these measurements.
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    config = config or IncrementalConfig()
    problem = state_problem(measurements, initial.match, initial)
    window = Window(measurements.t, config.lag_s, config.relinearise, _moving(problem))
    return _Run(problem, window).run(told)


def _moving(problem: Problem) -> set[str]:
    """Returns the kinds of the landmarks that are variables."""
    return {kind for kind, fixed in zip(problem.kinds, problem.fixed, strict=True) if not fixed}


class _Run:
    """One run over all nodes.

    Attributes:
        problem: measurements, matches and kinds of landmarks. Of its poses none is used, of its
            landmarks only the fixed ones.
        updates: GTSAM's side.
        pose: (N, 3) poses as they are told, floor frame.
        cov: (N, 3, 3) their covariances, floor frame.
        match: (K,) landmark of each sighting, -1 for those that were left out.
        started: (M,) landmarks that are known, or variables by now.
        waiting: rows of the sightings that wait for a landmark to start.
        counts: sightings left out, by reason.
    """

    def __init__(self, problem: Problem, updates: Updates) -> None:
        nodes = len(problem.pose)
        self.problem, self.updates = problem, updates
        self.pose, self.cov = np.empty((nodes, 3)), np.empty((nodes, 3, 3))
        self.match, self.started = problem.match.copy(), np.array(problem.fixed)
        self.waiting: dict[int, list[int]] = {}
        self.counts: Counter[str] = Counter()

    def run(self, told: Told | None) -> Estimate:
        """Returns what all nodes gave."""
        nodes = len(self.problem.pose)
        arrivals = Arrivals(self.problem.measurements, np.inf)
        news = [(first, table, arrivals.news(table)) for first, table in arrivals.tables]
        with translated_errors():
            for node in range(nodes):
                step = Step(node)
                pose = self._move(step)
                for first, table, known in news:
                    for row in known[node].tolist():
                        self._see(step, pose, table, row, first)
                self.updates.take(step)
                for done in self.updates.told(node, last=node == nodes - 1):
                    self._keep(done)
                if told is not None:
                    told(node)
            return self._finish()

    def _move(self, step: Step) -> Array:
        """Adds the pose of a node, tied to the start or to the pose before; returns its guess."""
        measurements, node = self.problem.measurements, step.node
        if node == 0:
            pose = measurements.start_pose
            step.graph.push_back(start_factor(pose, measurements.start_cov))
        else:
            increment = measurements.odometry.increment[node - 1]
            cov = measurements.odometry.cov[node - 1]
            pose = compose(self._now(node - 1), increment)
            step.graph.push_back(odometry_factor(node - 1, increment, cov))
        step.add_pose(pose)
        return np.asarray(pose)

    def _see(self, step: Step, here: Array, table: Sightings, row: int, first: int) -> None:
        """Adds one sighting, where it was made, and its landmark where that can start now."""
        problem, model, landmark = self.problem, MODELS[table.kind], int(self.match[first + row])
        z, cov, node = table.z[row], table.cov[row], int(table.node[row])
        if node != step.node and not self.updates.holds(node):
            self.counts[TOO_LATE] += 1
            self.match[first + row] = -1
        elif not model.dim_landmark:
            step.graph.push_back(sighting_factor(model, z, cov, node))
        elif landmark >= 0 and problem.fixed[landmark]:
            params = problem.params[landmark, : model.dim_landmark]
            step.graph.push_back(fixed_sighting_factor(model, z, cov, node, params))
        elif landmark >= 0 and self.started[landmark]:
            step.graph.push_back(sighting_factor(model, z, cov, node, landmark))
        elif landmark >= 0:
            rows = [*self._still_waiting(landmark, table, first), row]
            started = self._start(step.node, here, table, rows)
            if started is None:
                self.waiting[landmark] = rows
                return
            self.started[landmark] = True
            step.add_landmark(landmark, started)
            for one in rows:
                at = int(table.node[one])
                factor = sighting_factor(model, table.z[one], table.cov[one], at, landmark)
                step.graph.push_back(factor)

    def _still_waiting(self, landmark: int, table: Sightings, first: int) -> list[int]:
        """Returns the waiting sightings of a landmark whose poses are variables still."""
        rows = self.waiting.pop(landmark, [])
        kept = [row for row in rows if self.updates.holds(int(table.node[row]))]
        for row in set(rows) - set(kept):
            self.match[first + row] = -1
            self.counts[LEFT] += 1
        return kept

    def _start(self, node: int, pose: Array, table: Sightings, rows: list[int]) -> Array | None:
        """Returns a landmark from the last of some sightings, else from all; None if not yet."""
        model, z, cov = MODELS[table.kind], table.z[rows], table.cov[rows]
        seen_from = [pose if n == node else self._now(n) for n in table.node[rows].tolist()]
        alone = model.initialise(seen_from[-1], z[-1], cov[-1])
        if alone is not None:
            return alone[0]
        if not isinstance(model, Delayed):
            return None
        return model.initialise_from(np.array(seen_from), None, z, cov)

    def _now(self, node: int) -> Array:
        """Returns the pose (3,) of a node as it is known now, floor frame."""
        found = self.updates.solver.calculateEstimatePose2(pose_key(node))
        return np.array([found.x(), found.y(), found.theta()])

    def _keep(self, node: int) -> None:
        """Keeps the pose of a node and its covariance as they are known now."""
        self.pose[node] = pose = self._now(node)
        cov = self.updates.solver.marginalCovariance(pose_key(node))
        cov = rotate_covariance(cov, pose[2])
        self.cov[node] = 0.5 * (cov + cov.T)

    def _finish(self) -> Estimate:
        """Returns the estimate; landmarks get their one name only here."""
        problem, measurements = self._found(), self.problem.measurements
        free = np.flatnonzero(self.started & ~self.problem.fixed).tolist()
        joint = last_and_map_covariance(
            problem, self.updates.linear(), free, len(self.pose) - 1, self.pose[-1, 2]
        )
        nis, _ = sighting_fit(measurements, problem.pose, problem.params, problem.match)
        used = np.isfinite(nis)
        ending = end(
            measurements,
            self.pose,
            self.cov,
            problem.kinds,
            problem.params,
            problem.match,
            used,
            joint,
        )
        return Estimate(
            method=self.updates.method,
            causal=self.updates.causal,
            t=measurements.t,
            pose=np.column_stack([self.pose[:, :2], wrap(self.pose[:, 2])]),
            cov_floor=self.cov,
            map=ending.map,
            cov_joint=ending.cov_joint,
            match=problem.match,
            used=used,
            nis=nis,
            weight=problem.weight,
            unobserved=ending.unobserved,
            counts=dict(self.counts),
        )

    def _found(self) -> Problem:
        """Returns the problem at its end: path and landmarks that started, and their sightings."""
        problem, solver, dims = self.problem, self.updates.solver, self.problem.dims()
        kept = np.flatnonzero(self.started).tolist()
        row_of = np.append(np.full(len(problem.kinds), -1), -1)
        row_of[kept] = np.arange(len(kept))
        params = [
            problem.params[m, : dims[m]]
            if problem.fixed[m]
            else solver.calculateEstimateVector(landmark_key(m))
            for m in kept
        ]
        unstarted = int(np.sum((self.match >= 0) & (row_of[self.match] < 0)))
        if unstarted:
            self.counts[UNSTARTED] = unstarted
        return replace(
            problem,
            match=row_of[self.match],
            kinds=tuple(problem.kinds[m] for m in kept),
            fixed=problem.fixed[kept],
            params=padded(params),
            pose=self.updates.path(self.pose),
        )
