"""Landmarks that are one: found by a chi-square test on their difference, and joined."""

from __future__ import annotations

import numpy as np

from graphslam.association import gate_for, mahalanobis, same_label
from graphslam.config import RematchConfig
from graphslam.geometry import Array
from graphslam.measurements import IntArray
from graphslam.models import MODELS
from graphslam.rematch.crowd import by_chance, most_surprise
from graphslam.rematch.fitted import Fitted, stretch_on
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


def merges(fitted: Fitted, config: RematchConfig) -> IntArray:
    """Returns pairs (P, 2) of landmarks that are one, each landmark in at most one pair.

    A pair is taken where both are each other's nearest and no third landmark, one that is not the
    partner's twin, is nearly as near: parallel lines at one spacing wait for more evidence.
    """
    found = [np.zeros((0, 2), np.int64)]
    for kind in sorted(set(fitted.problem.kinds)):
        landmarks = fitted.of_kind(kind)
        if len(landmarks) > 1:
            distance, most = difference(fitted, kind, landmarks, config)
            gate = np.minimum(gate_for(TWO * config.gate, MODELS[kind].dim_landmark), most)
            gate_new = gate_for(config.gate_new, MODELS[kind].dim_landmark)
            found.append(landmarks[_mutual(distance, gate, gate_new)])
    return np.concatenate(found)


def difference(
    fitted: Fitted, kind: str, landmarks: IntArray, config: RematchConfig
) -> tuple[Array, Array]:
    """Returns squared Mahalanobis distances (m, m) between landmarks of one kind, and their bounds.

    Beyond the bounds (m, m) chance explains better that two landmarks lie so near to each other.

    Each is taken in the frame of the place where the first was seen, which keeps lever arms short.
    Pairs that are certainly two, because one node saw both, both are known or their labels differ,
    are infinitely far.
    """
    model, problem = MODELS[kind], fitted.problem
    dim, count = model.dim_landmark, len(landmarks)
    params = problem.params[landmarks, :dim]
    places = _places(fitted, landmarks)
    distance, most = np.full((2, count, count), np.inf)
    everyone = np.arange(count)
    for a in range(count):
        b = everyone[everyone != a]
        pose = np.broadcast_to(places[a], (len(b), 3))
        z, _, J_b = model.residual(pose, params[b], np.zeros((len(b), model.dim_z)))
        e, _, J_a = model.residual(pose, np.broadcast_to(params[a], (len(b), dim)), z)
        own = np.full(len(b), landmarks[a])
        S = _sandwich(J_a, fitted.landmark_cov(own, own, dim), J_a)
        S += _sandwich(J_b, fitted.landmark_cov(landmarks[b], landmarks[b], dim), J_b)
        cross = _sandwich(J_a, fitted.landmark_cov(own, landmarks[b], dim), J_b)
        S -= cross + np.swapaxes(cross, -1, -2)
        scale = np.trace(S, axis1=-2, axis2=-1)[:, None, None]
        S = S + 1e-12 * scale * np.eye(S.shape[-1])
        distance[a, b], most[a, b] = mahalanobis(e, S), most_surprise(S)
        distance[a, b[by_chance(problem, model, S, config) > CROWDED]] = np.inf
    distance[_seen_together(fitted, landmarks)] = np.inf
    label = fitted.label[landmarks]
    distance[~same_label(label, label)] = np.inf
    fixed = problem.fixed[landmarks]
    distance[fixed[:, None] & fixed[None, :]] = np.inf
    distance = np.asarray(np.minimum(distance, distance.T))
    for a, b in np.argwhere(np.triu(distance <= config.gate_new)):
        price = gap_price(np.array(_gap(fitted, int(landmarks[a]), int(landmarks[b]))), config)
        distance[a, b] = distance[b, a] = distance[a, b] + float(price)
    return distance, np.minimum(most, most.T)


def _sandwich(A: Array, P: Array, B: Array) -> Array:
    return np.asarray(A @ P @ np.swapaxes(B, -1, -2))


def _places(fitted: Fitted, landmarks: IntArray) -> Array:
    """Returns poses (m, 3) in the middle of the nodes that saw each landmark, heading 0."""
    problem = fitted.problem
    places = np.zeros((len(landmarks), 3))
    for row, landmark in enumerate(landmarks):
        nodes = fitted.node[problem.match == landmark]
        if len(nodes):
            places[row, :2] = problem.pose[nodes, :2].mean(axis=0)
    return places


def _seen_together(fitted: Fitted, landmarks: IntArray) -> Array:
    """Returns (m, m) whether two landmarks have been seen by the same nodes too often to be one."""
    match = fitted.problem.match
    saw = np.zeros((len(fitted.problem.pose), len(landmarks)), np.float32)
    for column, landmark in enumerate(landmarks):
        saw[fitted.node[match == landmark], column] = 1.0
    both, each = saw.T @ saw, saw.sum(axis=0)
    return np.asarray(both > TOGETHER * np.minimum(each[:, None], each[None, :]))


def _gap(fitted: Fitted, a: int, b: int) -> float:
    """Returns the gap, m, between the stretches of two landmarks, both laid along the first."""
    problem = fitted.problem
    sightings = np.flatnonzero(problem.match == b)
    if not len(sightings):
        return 0.0
    other, own = stretch_on(problem, sightings, a), fitted.extent[a]
    gap = max(own[0], other[0]) - min(own[1], other[1])
    return float(gap) if gap > 0.0 else 0.0


def _mutual(distance: Array, gate: Array, gate_new: float) -> IntArray:
    """Returns rows (P, 2) of the table that are each other's nearest, within their gates (m, m)."""
    pairs, taken = [], set()
    best = distance.min(axis=1)
    for a in np.argsort(best, kind="stable").tolist():
        b = int(np.argmin(distance[a]))
        if best[a] > gate[a, b] or a in taken or b in taken:
            continue
        if int(np.argmin(distance[b])) == a and _clear(distance, a, b, gate_new):
            pairs.append((a, b))
            taken |= {a, b}
    return np.array(pairs, np.int64).reshape(-1, 2)


def _clear(distance: Array, a: int, b: int, gate_new: float) -> bool:
    """Returns whether no third landmark competes for either of a pair."""
    for one, partner in ((a, b), (b, a)):
        rivals = distance[one] < distance[a, b] + CLEARLY
        rivals[[one, partner]] = False
        if np.any(distance[partner][rivals] > gate_new):
            return False
    return True
