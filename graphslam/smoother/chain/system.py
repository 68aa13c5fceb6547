"""A problem's linear system: factorised as often as wanted, its structure found once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graphslam.errors import UnderConstrained
from graphslam.geometry import Array
from graphslam.measurements import IntArray
from graphslam.smoother.chain.chunks import POSE, Chunks, Linear, cut, diagonal
from graphslam.smoother.chain.fronts import factorise, solve, solve_chain
from graphslam.smoother.chain.linearise import carried_variables, carry, linearise, squares
from graphslam.smoother.chain.residuals import FIRST_POSE, Residuals, collect
from graphslam.smoother.chain.symbolic import Symbolic, analyse
from graphslam.smoother.problem import NOT_DETERMINED, Problem

CHUNK = 24
"""Poses from separator to separator."""


@dataclass(frozen=True, slots=True)
class System:
    """The linear system of a problem: its structure, and storage for one factorisation.

    Variable 0 is the first pose's change (see `linearise`), then come the separators along the
    chain, then the landmarks that are free.

    Attributes:
        residuals: of the problem.
        chunks: of the chain.
        symbolic: the tree of fronts.
        separators: how many.
        scalars: length of a solution.
        dims: (M,) parameters of each landmark.
        var_of: (M,) variable of each landmark, -1 where it is fixed.
        scalar_of: (M, l) place of each landmark's parameters in a solution; -1 where there is none.
        linear: the rows at the point last linearised at.
        panel: the factor of separators and landmarks.
        chain: (N, 15) the factor of the poses between.
    """

    residuals: Residuals
    chunks: Chunks
    symbolic: Symbolic
    separators: int
    scalars: int
    dims: IntArray
    var_of: IntArray
    scalar_of: IntArray
    linear: Linear
    panel: Array
    chain: Array


def build(problem: Problem) -> System:
    """Returns the system of a problem, its structure analysed, nothing linearised yet."""
    nodes = len(problem.pose)
    length = min(CHUNK, max(nodes - 1, 1))
    separators = -(-(nodes - 1) // length)
    own, free = np.array(problem.dims(), np.int64), np.flatnonzero(~problem.fixed)
    dims = np.concatenate([np.full(1 + separators, POSE), own[free]])
    var_of = np.full(len(own), -1)
    var_of[free] = 1 + separators + np.arange(len(free))
    residuals = collect(problem, var_of)
    tied = bool(np.any(residuals.row_var == FIRST_POSE))
    chunks = cut(residuals.row_start, residuals.row_var, dims, length, FIRST_POSE if tied else -1)
    middle = (chunks.bound[:-1] + chunks.bound[1:]) // 2
    place = problem.pose[middle, :2]
    symbolic = analyse(chunks.member_start, chunks.member, dims, place)
    axis = np.arange(problem.params.shape[1])
    there = (axis < own[:, None]) & (var_of >= 0)[:, None]
    return System(
        residuals=residuals,
        chunks=chunks,
        symbolic=symbolic,
        separators=separators,
        scalars=int(dims.sum()),
        dims=own,
        var_of=var_of,
        scalar_of=np.where(there, symbolic.var_at[var_of][:, None] + axis, -1),
        linear=Linear(
            np.empty((len(residuals.row_var), 1 + POSE + residuals.columns)),
            np.empty((nodes - 1, POSE, 1 + 2 * POSE)),
        ),
        panel=np.empty(symbolic.panel_start[-1]),
        chain=np.empty((nodes, 15)),
    )


def relinearise(system: System, pose: Array, params: Array) -> tuple[Array, float]:
    """Linearises at a path and a map; returns the start's rows (see `linearise`) and the cost."""
    return linearise(system.residuals, pose, params, system.linear)


def factor(system: System, prior: Array, damping: float) -> float:
    """Factorises the system; returns the sum of squared rows at its minimum.

    Raises:
        UnderConstrained: the system is singular, with the variable that shows it.
    """
    chunks, symbolic, linear = system.chunks, system.symbolic, system.linear
    alone = np.empty(system.scalars)
    diagonal(chunks, system.residuals.row_var, symbolic.var_at, linear, prior, alone)
    bad, least = factorise(
        symbolic, chunks, linear, prior, alone, damping, system.panel, system.chain
    )
    if bad >= 0:
        raise UnderConstrained(NOT_DETERMINED + _describe(system, int(bad)))
    return float(least)


def _describe(system: System, scalar: int) -> str:
    problem, at = system.residuals.problem, system.symbolic.var_at
    variable = int(np.searchsorted(at, scalar, side="right")) - 1
    if variable <= system.separators:
        node = int(system.chunks.bound[variable])
        name = ("x", "y", "theta")[scalar - int(at[variable])]
        return f"nothing fixes {name} of node {node}, t = {problem.measurements.t[node]:g} s"
    landmark = int(np.flatnonzero(system.var_of == variable)[0])
    seen = int(np.count_nonzero((problem.match == landmark) & (problem.weight > 0)))
    return (
        f"nothing fixes landmark {landmark} ({problem.kinds[landmark]}, {seen} sightings that "
        "count); leave its matches out"
    )


def solution(system: System, pose: Array) -> tuple[Array, Array, float]:
    """Returns the linear system's minimum: steps of all poses (N, 3) and landmarks (M, l).

    Also returns the squared length of the step in the system's own unknowns, which is what damping
    holds small.
    """
    x, step = np.empty(system.scalars), np.empty((len(pose), POSE))
    solve(system.symbolic, system.panel, x)
    at = system.symbolic.var_at
    solve_chain(system.chunks, system.linear, system.chain, x, at, step)
    length = float(squares(x) + squares(step.ravel()) - squares(step[system.chunks.bound].ravel()))
    first = x[:POSE]
    carry(pose, first, step)
    change = np.where(system.scalar_of >= 0, x[system.scalar_of], 0.0)
    if len(change):
        change += carried_landmarks(system, pose) @ first
    return step, change, length


def carried_landmarks(system: System, pose: Array) -> Array:
    """Returns how landmarks move (M, l, 3) as the first pose's change carries the floor along.

    Zero for fixed ones; the system is factorised.
    """
    residuals = system.residuals
    A, b = carried_variables(
        system.linear.rows,
        residuals.row_start,
        residuals.row_var,
        pose,
        len(system.symbolic.var_at),
    )
    out = np.zeros((*system.scalar_of.shape, POSE))
    for dim in np.unique(system.dims):
        chosen = np.flatnonzero((system.dims == dim) & (system.var_of >= 0))
        v = system.var_of[chosen]
        out[chosen, :dim] = np.linalg.solve(A[v, :dim, :dim], b[v, :dim])
    return out
