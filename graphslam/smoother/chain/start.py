"""A start for problems whose own is too far off: stretch by stretch along the chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graphslam.baseline import integrate
from graphslam.config import SmootherConfig
from graphslam.errors import UnderConstrained
from graphslam.geometry import Array, rotate_covariance
from graphslam.measurements import IntArray, Measurements, Odometry
from graphslam.models import MODELS
from graphslam.smoother.chain.engine import minimise
from graphslam.smoother.problem import Problem

BoolArray = NDArray[np.bool_]

STRETCH = 20
"""Increments that are trusted in a row before sightings correct them."""


def started_along(
    problem: Problem, config: SmootherConfig | None = None, stretch: int = STRETCH
) -> Problem:
    """Returns the problem with a start that needs no more than odometry, and no luck.

    From the start on, a short stretch at a time is laid out by odometry and minimised against the
    landmarks placed so far, which stay; those seen for the first time are placed with it. Within a
    stretch odometry cannot go far wrong, so that headings never leave the right branch.

    Args:
        problem: its poses are not used, its landmarks only where no sighting alone can start them.
        config: of each stretch's minimisation.
        stretch: nodes in each.

    Raises:
        UnderConstrained: a stretch does not determine its poses.
    """
    config = config or SmootherConfig()
    nodes = len(problem.pose)
    pose, params = np.array(problem.pose), np.array(problem.params)
    pose[0] = problem.measurements.start_pose
    placed = problem.fixed.copy()
    for first in range(0, max(nodes - 1, 1), stretch):
        last = min(first + stretch, nodes - 1)
        part, landmarks = _part(problem, first, last, pose, params, placed)
        try:
            found = minimise(part, config)
        except UnderConstrained:  # a landmark that one stretch does not fix waits for the next
            part, landmarks = _without_new(part, landmarks)
            found = minimise(part, config)
        pose[first : last + 1] = found.pose
        params[landmarks, : found.params.shape[1]] = found.params
        placed[landmarks] = True
    return replace(problem, pose=pose, params=params)


def _part(
    problem: Problem, first: int, last: int, pose: Array, params: Array, placed: BoolArray
) -> tuple[Problem, IntArray]:
    """Returns the problem of the nodes ``first`` to ``last``, and which landmarks it has."""
    measurements, tables = problem.measurements, {}
    index = []
    for begin, table in measurements.tables():
        low, high = np.searchsorted(table.node, [first, last + 1])
        chosen = table.select(np.arange(low, high))
        tables[table.kind] = replace(chosen, node=chosen.node - first)
        index.append(begin + np.arange(low, high))
    rows = np.concatenate(index) if index else np.zeros(0, np.int64)
    increments = slice(first, last)
    odometry = measurements.odometry
    cut = Measurements(
        measurements.t[first : last + 1],
        pose[first],
        _start_cov(problem, first, float(pose[first, 2])),
        Odometry(odometry.increment[increments], odometry.cov[increments]),
        tables,
    )
    laid = integrate(pose[first], odometry.increment[increments])
    landmarks = np.unique(problem.match[rows][problem.match[rows] >= 0])
    match = np.where(problem.match[rows] >= 0, np.searchsorted(landmarks, problem.match[rows]), -1)
    own = params[landmarks]
    _place(cut, match, laid, own, placed[landmarks])
    kinds = tuple(problem.kinds[m] for m in landmarks)
    weights = problem.weight[rows], problem.odometry_weight[increments]
    return Problem(cut, match, kinds, placed[landmarks], laid, own, *weights), landmarks


def _start_cov(problem: Problem, first: int, theta: float) -> Array:
    if first == 0:
        return np.asarray(problem.measurements.start_cov)
    return rotate_covariance(problem.measurements.odometry.cov[first - 1], theta)


def _place(
    cut: Measurements, match: IntArray, pose: Array, params: Array, placed: BoolArray
) -> None:
    """Fills the parameters of landmarks not yet placed from their first sighting, where it can."""
    done = placed.copy()
    for begin, table in cut.tables():
        model = MODELS[table.kind]
        for row, m in enumerate(match[begin : begin + len(table)].tolist()):
            if m >= 0 and not done[m]:
                started = model.initialise(pose[table.node[row]], table.z[row], table.cov[row])
                if started is not None:
                    params[m, : model.dim_landmark] = started[0]
                done[m] = True


def _without_new(part: Problem, landmarks: IntArray) -> tuple[Problem, IntArray]:
    """Returns the part with the sightings of landmarks not placed left out."""
    keep = np.flatnonzero(part.fixed)
    number = np.full(len(landmarks) + 1, -1)
    number[keep] = np.arange(len(keep))
    kinds = tuple(part.kinds[m] for m in keep)
    return (
        replace(
            part,
            match=number[part.match],
            kinds=kinds,
            fixed=part.fixed[keep],
            params=part.params[keep],
        ),
        landmarks[keep],
    )
