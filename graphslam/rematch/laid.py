"""How probable the places of lines are: floors and walls have few directions and spacings."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from graphslam.geometry import Array, points_on_line, wrap
from graphslam.measurements import IntArray
from graphslam.models.line import LINE
from graphslam.rematch.fitted import Fitted

TURNED = np.radians([0.1, 0.3, 1.0, 3.0])
"""Standard deviations of lines that are laid in one direction, rad: any of these may be true."""
SPACED_M = np.array([0.001, 0.003, 0.01, 0.03])
"""Standard deviations of lines that are laid at one spacing, m: any of these may be true."""
ANYWHERE = np.array([0.1, 0.3, 1.0])
"""Parts of the lines that may lie anywhere: any of these may be true."""
PARALLEL = np.radians(5.0)
"""Lines that differ by less lie beside each other, rad."""
LEAST_M = 0.05
"""Lines that are nearer to each other lie on each other, which is no way of laying them, m."""
MOST_OTHERS = 200
"""Others with which each is compared, at most."""


def laid_odds(fitted: Fitted) -> float:
    """Returns the logarithm of how much more probable the lines' places are than any others.

    Each line is compared with all others. A part of the lines may lie anywhere; the rest lies in
    the direction of another line, and as far from the next one as some other line does from its
    next. How large that part is and how exactly lines are laid nobody knows: the odds are the mean
    over some values. So a line more that is parallel to many, one spacing on, is hardly a
    coincidence and costs little; one that lies askew costs what anything does.
    """
    lines = fitted.of_kind(LINE.kind)
    return _turned_alike(fitted, lines) + _spaced_alike(fitted, lines)


def _turned_alike(fitted: Fitted, lines: IntArray) -> float:
    """Returns the logarithm of the odds of the lines' directions against any directions."""
    if len(lines) < 2:
        return 0.0
    free, other = lines[~fitted.problem.fixed[lines]], _some(lines)
    alpha, dim = fitted.problem.params[:, 1], LINE.dim_landmark
    one, two = np.repeat(free, len(other)), np.tile(other, len(free))
    both = fitted.landmark_cov(one, two, dim)[:, 1, 1].reshape(len(free), len(other))
    own = fitted.landmark_cov(free, free, dim)[:, None, 1, 1]
    others = fitted.landmark_cov(other, other, dim)[None, :, 1, 1]
    turn = 0.5 * wrap(2.0 * (alpha[free][:, None] - alpha[other][None, :]))
    itself = free[:, None] == other[None, :]
    return _odds(turn, own + others - 2.0 * both, itself, TURNED, math.pi)


def _spaced_alike(fitted: Fitted, lines: IntArray) -> float:
    """Returns the logarithm of the odds of the lines' spacings against any spacings."""
    pairs = np.concatenate([np.zeros((0, 2), np.int64), *_beside(fitted, lines)])
    if len(pairs) < 2:
        return 0.0
    step, variance = _steps(fitted, pairs)
    free = np.flatnonzero(~fitted.problem.fixed[pairs].all(axis=1))
    other = _some(np.arange(len(pairs)))
    step = np.where(step < LEAST_M, np.nan, step)
    apart = np.nan_to_num(step[free][:, None] - step[other][None, :], nan=np.inf)
    both = variance[free][:, None] + variance[other][None, :]
    itself = free[:, None] == other[None, :]
    return _odds(apart, both, itself, math.sqrt(2.0) * SPACED_M, 1.0)


def _beside(fitted: Fitted, lines: IntArray) -> Iterator[IntArray]:
    """Yields pairs (p, 2) of lines next to each other, for each direction of lines."""
    alpha, left = fitted.problem.params[:, 1], lines
    middle = _middle(fitted)
    while len(left):
        turn = 0.5 * wrap(2.0 * (alpha[left] - alpha[left[0]]))
        group, left = left[np.abs(turn) < PARALLEL], left[np.abs(turn) >= PARALLEL]
        normal = np.array([math.cos(alpha[group[0]]), math.sin(alpha[group[0]])])
        order = group[np.argsort(middle[group] @ normal, kind="stable")]
        yield np.column_stack([order[:-1], order[1:]])


def _middle(fitted: Fitted) -> Array:
    """Returns the points (M, 2) in the middle of what was seen of lines, m, floor frame."""
    params = fitted.problem.params[:, : LINE.dim_landmark]
    along = np.nan_to_num(fitted.extent.mean(axis=1))
    return np.asarray(points_on_line(params[:, None, :], along[:, None])[:, 0])


def _steps(fitted: Fitted, pairs: IntArray) -> tuple[Array, Array]:
    """Returns how far the lines of pairs (p, 2) are apart (p,), m, halfway between them.

    With their variances (p,), m².
    """
    dim = LINE.dim_landmark
    at = _middle(fitted)[pairs].mean(axis=1)
    rho, J = [], []
    first = fitted.problem.params[pairs[:, 0], 1]
    for line in pairs.T:
        alpha = fitted.problem.params[line, 1]
        sign = np.sign(np.cos(alpha - first))
        normal = np.column_stack([np.cos(alpha), np.sin(alpha)])
        lever = at[:, 0] * np.sin(alpha) - at[:, 1] * np.cos(alpha)
        rho.append(sign * (fitted.problem.params[line, 0] - np.sum(at * normal, axis=1)))
        J.append(np.column_stack([sign, sign * lever]))
    one, two = pairs.T
    variance = np.einsum("ki,kij,kj->k", J[0], fitted.landmark_cov(one, one, dim), J[0])
    variance += np.einsum("ki,kij,kj->k", J[1], fitted.landmark_cov(two, two, dim), J[1])
    variance -= 2.0 * np.einsum("ki,kij,kj->k", J[0], fitted.landmark_cov(one, two, dim), J[1])
    return np.abs(rho[1] - rho[0]), variance


def _some(of: IntArray) -> IntArray:
    """Returns all, or as many as are worth comparing with, evenly taken."""
    return of[np.unique(np.linspace(0, len(of) - 1, MOST_OTHERS).round().astype(np.int64))]


def _odds(
    off: Array, variance: Array, itself: NDArray[np.bool_], scales: Array, anywhere: float
) -> float:
    """Returns the logarithm of the mean odds of being like others against being anywhere.

    Args:
        off: (n, m) differences.
        variance: (n, m) of them, as far as they are not known.
        itself: (n, m) where nothing is compared with itself.
        scales: (s,) standard deviations of what is alike; each may be true.
        anywhere: inverse of the density of what may be anywhere.
    """
    found = []
    others = np.maximum((~itself).sum(axis=1), 1)
    for scale in scales:
        total = np.maximum(variance, 0.0) + scale**2
        near = np.exp(-0.5 * off**2 / total) / np.sqrt(2.0 * math.pi * total)
        ratio = anywhere * np.where(itself, 0.0, near).sum(axis=1) / others
        found += [float(np.log(part + (1.0 - part) * ratio).sum()) for part in ANYWHERE]
    return float(np.logaddexp.reduce(found) - math.log(len(found)))
