"""Landmarks joined to close a loop, pair by pair as far as the sightings bear it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from graphslam.config import SmootherConfig
from graphslam.geometry import Array
from graphslam.measurements import IntArray
from graphslam.rematch.fitted import UNMATCHED, nodes_of, renumbered
from graphslam.rematch.found import start_landmarks
from graphslam.smoother.fit import sighting_fit
from graphslam.smoother.problem import Minimum, Problem
from graphslam.smoother.robust import minimise_robustly

Minimise = Callable[[Problem, SmootherConfig], Minimum]
Pair = tuple[int, int]

TOGETHER = 0.1
"""Landmarks that share the nodes of more than this part of the fewer sightings are two."""
FEWEST = 3
"""Groups of landmarks that must become one each for a loop to close."""
ACROSS = 0.8
"""Groups, counted by how they fix it, that must fix the direction that is fixed worse."""
TRIES = 5


@dataclass(frozen=True, slots=True)
class Joined:
    """A loop closed.

    Attributes:
        problem: the matches with landmarks joined.
        minimum: theirs.
        landmarks: how many landmarks there are fewer.
    """

    problem: Problem
    minimum: Minimum
    landmarks: int


def seen_together(problem: Problem) -> NDArray[np.bool_]:
    """Returns (M, M) whether two landmarks have been seen by the same nodes too often to be one."""
    used, count = problem.match >= 0, len(problem.kinds)
    place = (nodes_of(problem)[used], problem.match[used])
    saw = scipy.sparse.csr_matrix((np.ones(used.sum()), place), (len(problem.pose), count))
    saw.data[:] = 1.0
    both = (saw.T @ saw).toarray()
    each = np.diag(both)
    share = both / np.maximum(np.minimum(each[:, None], each[None, :]), 1.0)
    np.fill_diagonal(share, 0.0)
    return np.asarray(share > TOGETHER)


def join(
    problem: Problem,
    votes: Counter[Pair],
    start: Array | None,
    config: SmootherConfig,
    minimise: Minimise,
) -> Joined | str:
    """Returns the minimum after joining landmarks, or why a loop cannot be closed.

    Pairs whose sightings do not bear to be of one line are left out, the worst first, and the rest
    is minimised again from where it began.

    Args:
        problem: matches at their minimum.
        votes: pairs of landmarks that may be one, and how often they were found to be.
        start: (N, 3) path to start from where it is torn; then what contradicts is switched off by
            the robust kernel. None: the minimum is near, all sightings count.
        config: of the minimisation, and the gate that says what a sighting may cost.
        minimise: minimises.
    """
    apart = seen_together(problem)
    before = _price(problem, problem.pose, problem.params, problem.match, config)
    pairs = [pair for pair, _ in sorted(votes.items(), key=lambda kv: (-kv[1], kv[0]))]
    bad: set[Pair] = set()
    for _ in range(TRIES):
        used = [pair for pair in pairs if pair not in bad]
        groups = _groups(used, apart)
        if len(groups) < FEWEST:
            return "too few walls agree"
        if _across(problem, groups) < ACROSS:
            return "the walls that agree have one direction"
        tried = renumbered(problem, _named(problem, groups))
        minimum, match = _minimum(tried, start, config, minimise)
        after = _price(tried, minimum.pose, minimum.params, match, config)
        worst = _too_dear(problem, groups, after - before, config)
        if not worst:
            if start is not None:
                tried = replace(tried, pose=minimum.pose, params=minimum.params)
                tried, minimum = _without(tried, match, config, minimise)
            return Joined(tried, minimum, len(problem.kinds) - len(tried.kinds))
        dropped = {m for group in worst[: max(1, len(worst) // 2)] for m in group}
        bad |= {pair for pair in used if pair[0] in dropped}
    return "walls that seem to agree contradict each other"


def _minimum(
    tried: Problem, start: Array | None, config: SmootherConfig, minimise: Minimise
) -> tuple[Minimum, IntArray]:
    """Returns a minimum, and the matches that it left on."""
    if start is None:
        return minimise(tried, config), tried.match
    kernel = replace(config, robust="gnc", robust_odometry=False)
    weighed, minimum = minimise_robustly(replace(tried, pose=start), kernel, minimise)
    return minimum, np.where(weighed.weight > 0.5, tried.match, UNMATCHED)


def _without(
    tried: Problem, match: IntArray, config: SmootherConfig, minimise: Minimise
) -> tuple[Problem, Minimum]:
    """Returns a torn problem with what contradicted it matched anew, and its minimum.

    Where a path was torn, one landmark holds the sightings of several walls: those switched off are
    no outliers, but start landmarks of their own.
    """
    off = np.flatnonzero((tried.match >= 0) & (match < 0))
    begun = start_landmarks(replace(tried, match=match), off, config.rematching)
    kernel = replace(config, robust="gnc", robust_odometry=False)
    weighed, minimum = minimise_robustly(begun, kernel, minimise)
    match = np.where(weighed.weight > 0.5, begun.match, UNMATCHED)
    left = renumbered(replace(begun, pose=minimum.pose, params=minimum.params), match)
    return left, minimise(left, config)


def _price(
    problem: Problem, pose: Array, params: Array, match: IntArray, config: SmootherConfig
) -> Array:
    """Returns what each sighting (K,) costs: half its squared residual, or half the gate if out."""
    nis, _ = sighting_fit(problem.measurements, pose, params, match)
    return 0.5 * np.where(np.isfinite(nis), nis, config.rematching.gate)


def _too_dear(
    problem: Problem, groups: list[list[int]], more: Array, config: SmootherConfig
) -> list[list[int]]:
    """Returns the groups whose sightings cost more by being of one line than that is worth.

    Each landmark saved is worth most of a gate; besides, what a wall is off a straight line, seen
    from here and from there, adds a part of one standard deviation to each of its sightings.
    """
    dear = []
    for group in groups:
        own = np.isin(problem.match, group)
        limit = 0.7 * config.rematching.gate * (len(group) - 1) + 0.35 * own.sum()
        share = float(more[own].sum()) / limit
        if share > 1.0:
            dear.append((share, group))
    return [group for _, group in sorted(dear, key=lambda entry: (-entry[0], entry[1]))]


def _groups(pairs: list[Pair], apart: NDArray[np.bool_]) -> list[list[int]]:
    """Returns groups of landmarks that pairs make one; none holds two that were seen together."""
    home: dict[int, list[int]] = {}
    for a, b in pairs:
        one, other = home.get(a, [a]), home.get(b, [b])
        if one == other or apart[np.ix_(one, other)].any():
            continue
        both = sorted(one + other)
        for m in both:
            home[m] = both
    return [group for m, group in sorted(home.items()) if group[0] == m]


def _named(problem: Problem, groups: list[list[int]]) -> IntArray:
    name = np.arange(len(problem.kinds))
    for group in groups:
        name[group] = group[0]
    return np.where(problem.match >= 0, name[problem.match], UNMATCHED)


def _across(problem: Problem, groups: list[list[int]]) -> float:
    """Returns how many groups, by the square of the sine, fix the direction that is fixed worse."""
    alpha = problem.params[[group[0] for group in groups], 1]
    normal = np.column_stack([np.cos(alpha), np.sin(alpha)])
    return float(np.linalg.eigvalsh(normal.T @ normal)[0])
