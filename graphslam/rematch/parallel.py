"""How probable the directions of lines are: floors and walls have few."""

from __future__ import annotations

import numpy as np

from graphslam.geometry import Array, wrap
from graphslam.models.line import LINE
from graphslam.smoother.problem import Problem

SPREAD = np.radians(1.5)
"""Standard deviation of lines that are laid in one direction, rad."""
ANYWHERE = 0.2
"""Part of the lines that may lie in any direction."""


def parallel_odds(problem: Problem) -> float:
    """Returns the logarithm of how much more probable the lines' directions are than any others.

    Each line is compared with all others: with ``ANYWHERE`` it may lie in any direction, else in
    one of theirs, within `SPREAD`. A line more that is parallel to many is less of a coincidence
    than one that lies askew, and costs less.
    """
    line = np.array([kind == LINE.kind for kind in problem.kinds], bool)
    alpha = problem.params[line & ~problem.fixed, 1]
    others = problem.params[line, 1]
    if len(others) < 2:
        return 0.0
    turn = 0.5 * wrap(2.0 * (alpha[:, None] - others[None, :]))
    near = _kernel(turn)
    itself = np.flatnonzero(line & ~problem.fixed)[:, None] == np.flatnonzero(line)[None, :]
    density = np.where(itself, 0.0, near).sum(axis=1) / (len(others) - 1)
    return float(np.log(ANYWHERE + (1.0 - ANYWHERE) * np.pi * density).sum())


def _kernel(turn: Array) -> Array:
    """Returns the density, 1/rad, of directions at ``turn`` from one of a line."""
    scale = np.sqrt(2.0 * np.pi) * SPREAD
    return np.asarray(np.exp(-0.5 * (turn / SPREAD) ** 2) / scale)
