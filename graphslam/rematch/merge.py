"""Landmarks that are one: found by a chi-square test on their difference, and joined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from graphslam.association import gate_for, labels_agree, mahalanobis
from graphslam.config import RematchConfig
from graphslam.geometry import Array
from graphslam.measurements import IntArray
from graphslam.models import MODELS, Model
from graphslam.rematch.candidates import CHUNK, near_each_other
from graphslam.rematch.crowd import by_chance, density_of, most_surprise
from graphslam.rematch.fitted import Fitted, sightings_of, stretch_on
from graphslam.rematch.reach import gap_price

TOGETHER = 0.1
"""Landmarks that share the nodes of more than this part of the fewer sightings are two."""
TWO = 2.0
"""Gates that the difference of two landmarks may fill while they still are one: two lines so near
to each other are rare, and of all ways to part the sightings of one the worst is looked at."""
CROWDED = 0.1
"""Landmarks within the gate by chance beyond which nearness is no reason to merge."""
CLEARLY = 9.0
"""How much smaller than the next the squared distance of a pair must be, where the next landmark is
not itself one with the partner."""


@dataclass(frozen=True, slots=True)
class Alike:
    """Pairs of landmarks of one kind that are not certainly two.

    Attributes:
        a: (p,) one landmark, the smaller number.
        b: (p,) the other.
        distance: (p,) squared Mahalanobis distance between them, with the price of a gap.
        most: (p,) beyond which chance explains better that they lie so near to each other.
    """

    a: IntArray
    b: IntArray
    distance: Array
    most: Array


def merges(fitted: Fitted, config: RematchConfig) -> IntArray:
    """Returns pairs (P, 2) of landmarks that are one, each landmark in at most one pair.

    A pair is taken where both are each other's nearest and no third landmark, one that is not the
    partner's twin, is nearly as near: parallel lines at one spacing wait for more evidence.
    """
    found = [np.zeros((0, 2), np.int64)]
    for kind in sorted(set(fitted.problem.kinds)):
        landmarks = fitted.of_kind(kind)
        if len(landmarks) > 1:
            found.append(_mutual(alike(fitted, kind, landmarks, config), kind, config))
    return np.concatenate(found)


def alike(fitted: Fitted, kind: str, landmarks: IntArray, config: RematchConfig) -> Alike:
    """Returns the pairs of landmarks of one kind whose difference is within the wide gate.

    Each difference is taken in the frame of the place where the first was seen, which keeps lever
    arms short, and in that of the second; the smaller counts. Pairs that are certainly two, because
    one node saw both, both are known or their labels differ, are none.
    """
    problem = fitted.problem
    a, b, distance, most = _differences(fitted, kind, landmarks, config)
    low, high = np.minimum(a, b), np.maximum(a, b)
    pairs, place = np.unique(np.column_stack([low, high]), axis=0, return_inverse=True)
    nearest, least = np.full((2, len(pairs)), np.inf)
    np.minimum.at(nearest, place.ravel(), distance)
    np.minimum.at(least, place.ravel(), most)
    a, b = pairs.T
    possible = ~(problem.fixed[a] & problem.fixed[b]) & ~_seen_together(fitted, a, b)
    possible &= labels_agree(fitted.label[a], fitted.label[b])
    a, b, nearest, least = a[possible], b[possible], nearest[possible], least[possible]
    by = sightings_of(problem.match, len(problem.kinds))
    close = np.flatnonzero(nearest <= config.gate_new)
    gap = np.array([_gap(fitted, int(a[p]), int(b[p]), by[b[p]]) for p in close])
    nearest[close] += gap_price(gap, config)
    return Alike(a, b, nearest, least)


def _differences(
    fitted: Fitted, kind: str, landmarks: IntArray, config: RematchConfig
) -> tuple[IntArray, IntArray, Array, Array]:
    """Returns ordered pairs, distances from the first's place, and what chance would make of them.

    Only pairs within the wide gate; the bounds of `candidates` spare the correlations of all else.
    """
    model, problem, dim = MODELS[kind], fitted.problem, MODELS[kind].dim_landmark
    params, places = problem.params[:, :dim], _places(fitted)
    gate = gate_for(config.gate_new, model.dim_landmark)
    own = fitted.landmark_cov(landmarks, landmarks, dim)
    count, density = len(landmarks), density_of(problem, model)
    found = []
    for begin in range(0, count, max(1, CHUNK // count)):
        first = np.arange(begin, min(begin + max(1, CHUNK // count), count))
        i, j = np.repeat(first, count), np.tile(np.arange(count), len(first))
        i, j = i[i != j], j[i != j]
        e, J_a, J_b = _difference(model, places, params, landmarks[i], landmarks[j])
        near = np.flatnonzero(near_each_other((i, j), (e, J_a, J_b), own, gate))
        i, j, e, J_a, J_b = i[near], j[near], e[near], J_a[near], J_b[near]
        a, b = landmarks[i], landmarks[j]
        S = _sandwich(J_a, own[i], J_a) + _sandwich(J_b, own[j], J_b)
        cross = _sandwich(J_a, fitted.landmark_cov(a, b, dim), J_b)
        S -= cross + np.swapaxes(cross, -1, -2)
        scale = np.trace(S, axis1=-2, axis2=-1)[:, None, None]
        S = S + 1e-12 * scale * np.eye(S.shape[-1])
        distance = mahalanobis(e, S)
        kept = (distance <= gate) & (by_chance(density, S, config) <= CROWDED)
        found.append((a[kept], b[kept], distance[kept], most_surprise(S)[kept]))
    a, b, distance, most = (np.concatenate(column) for column in zip(*found, strict=True))
    return a, b, distance, most


def _difference(
    model: Model, places: Array, params: Array, a: IntArray, b: IntArray
) -> tuple[Array, Array, Array]:
    """Returns how landmarks a and b (k,) differ as seen from a's places, and the Jacobians."""
    pose = places[a]
    z, _, J_b = model.residual(pose, params[b], np.zeros((len(b), model.dim_z)))
    e, _, J_a = model.residual(pose, params[a], z)
    return e, J_a, J_b


def _sandwich(A: Array, P: Array, B: Array) -> Array:
    return np.asarray(A @ P @ np.swapaxes(B, -1, -2))


def _places(fitted: Fitted) -> Array:
    """Returns poses (M, 3) in the middle of the nodes that saw each landmark, heading 0."""
    match, count = fitted.problem.match, len(fitted.problem.kinds)
    used = match >= 0
    sightings = np.maximum(np.bincount(match[used], minlength=count), 1)
    at = fitted.problem.pose[fitted.node[used]]
    x, y = (np.bincount(match[used], at[:, k], count) / sightings for k in range(2))
    return np.column_stack([x, y, np.zeros(count)])


def _seen_together(fitted: Fitted, a: IntArray, b: IntArray) -> NDArray[np.bool_]:
    """Returns (p,) whether landmarks have been seen by the same nodes too often to be one."""
    match, size = fitted.problem.match, (len(fitted.problem.kinds), len(fitted.problem.pose))
    used = match >= 0
    ones = np.ones(int(used.sum()))
    saw = scipy.sparse.csr_array((ones, (match[used], fitted.node[used])), size)
    saw.data[:] = 1.0  # however often a node saw it
    both, each = saw[a].multiply(saw[b]).sum(axis=1), saw.sum(axis=1)
    return np.asarray(both > TOGETHER * np.minimum(each[a], each[b]))


def _gap(fitted: Fitted, a: int, b: int, sightings: IntArray) -> float:
    """Returns the gap, m, between the stretches of two landmarks, both laid along the first.

    ``sightings`` are the second's.
    """
    if not len(sightings):
        return 0.0
    other, own = stretch_on(fitted.problem, sightings, a), fitted.extent[a]
    gap = max(own[0], other[0]) - min(own[1], other[1])
    return float(gap) if gap > 0.0 else 0.0


def _mutual(found: Alike, kind: str, config: RematchConfig) -> IntArray:
    """Returns landmarks (P, 2) that are each other's nearest, within their gates."""
    dim = MODELS[kind].dim_landmark
    gate = np.minimum(gate_for(TWO * config.gate, dim), found.most)
    near: dict[int, dict[int, float]] = {}
    for a, b, distance in zip(
        found.a.tolist(), found.b.tolist(), found.distance.tolist(), strict=True
    ):
        near.setdefault(a, {})[b] = distance
        near.setdefault(b, {})[a] = distance
    nearest = {a: min(own, key=lambda b: (own[b], b)) for a, own in near.items()}
    pairs, taken = [], set()
    for p in np.lexsort((found.a, found.distance)).tolist():
        a, b = int(found.a[p]), int(found.b[p])
        if found.distance[p] > gate[p] or a in taken or b in taken:
            continue
        if (
            nearest[a] == b
            and nearest[b] == a
            and _clear(near, a, b, gate_for(config.gate_new, dim))
        ):
            pairs.append((a, b))
            taken |= {a, b}
    return np.array(pairs, np.int64).reshape(-1, 2)


def _clear(near: dict[int, dict[int, float]], a: int, b: int, gate_new: float) -> bool:
    """Returns whether no third landmark competes for either of a pair."""
    most = near[a][b] + CLEARLY
    for one, partner in ((a, b), (b, a)):
        for rival, distance in near[one].items():
            apart = near[partner].get(rival, np.inf)
            if rival != partner and distance < most and apart > gate_new:
                return False
    return True
