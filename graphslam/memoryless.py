"""The method `triangulation`: at each node the pose from that node's bearings alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from math import perm, prod

import numpy as np

from graphslam.association import gate_for, same_label
from graphslam.config import EkfConfig
from graphslam.errors import BadMeasurements, UnderConstrained
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose, wrap
from graphslam.landmarks import finish_map
from graphslam.measurements import IntArray, LandmarkMap, Measurements, Sightings
from graphslam.models.bearing import BEARING
from graphslam.models.odometry import transition
from graphslam.triangulation import Fix, fix

NOT_DETERMINED = "node whose pose its bearings do not determine: odometry goes on from the last"
AMBIGUOUS = "node whose bearings fit several poses: odometry goes on from the last"
NO_FIT = "node whose bearings fit no pose: odometry goes on from the last"

MOST_NAMINGS = 720
"""Ways of naming one node's sightings that are tried; with more the node counts as ambiguous."""
SAME_ANSWER = 9.0
"""Squared Mahalanobis distance up to which two ways of naming give one pose."""


def triangulate(measurements: Measurements, config: EkfConfig | None = None) -> Estimate:
    """Returns the path whose pose is, at every node, what that node's bearings say.

    Nothing is carried from node to node, unless the bearings of a node do not determine its pose
    (fewer than three, robot on the circle through the points, names unclear): then odometry goes on
    from the node before, with its covariance, and the node is counted. Before the first node that
    is determined the pose is the start's.

    Who is who is decided by labels; where these repeat, or are absent, by which way of naming gives
    a pose, and of several, which one lies between the points. With matching "known" the log says.

    Args:
        measurements: nodes, odometry, bearings, and known points.
        config: matching, as of the filter: its gate decides whether four and more bearings agree.

    Raises:
        BadMeasurements: there are no bearings, or no known points.

    Source: Kato, for three cones with names by colour.
    """
    config = config or EkfConfig()
    known, table = measurements.known, measurements.sightings.get(BEARING.kind)
    if known is None or not len(known.of_kind(BEARING.kind)[0]) or table is None:
        raise BadMeasurements(
            "triangulation needs bearings and known points (bearings.csv and landmarks.csv); add "
            "them, or leave the method out"
        )
    nodes, starts = len(measurements.t), table.starts(len(measurements.t))
    first = next(f for f, t in measurements.tables() if t is table)
    match = np.full(measurements.sighting_count, -1)
    pose, cov = np.empty((nodes, 3)), np.empty((nodes, 3, 3))
    last, spread = measurements.start_pose, measurements.start_cov
    counts: Counter[str] = Counter()
    for node in range(nodes):
        if node:
            last, spread = onward(measurements, node - 1, last, spread)
        rows = np.arange(*starts[node : node + 2])
        try:
            found, named = fix_by_names(table, rows, known, config)
            last, spread = found.pose, found.cov
            match[first + rows] = named
        except UnderConstrained as reason:
            text = str(reason)
            counts[text if text in (AMBIGUOUS, NO_FIT) else NOT_DETERMINED] += 1
        pose[node], cov[node] = last, 0.5 * (spread + spread.T)
    size = int(known.offsets()[-1])
    joint = np.zeros((size, size))
    joint[:3, :3] = cov[-1]
    landmarks, joint = finish_map(measurements, pose, known.kind, known.params, match, joint)
    return Estimate(
        method="triangulation",
        causal=True,
        t=measurements.t,
        pose=pose,
        cov_floor=cov,
        map=landmarks,
        cov_joint=joint,
        match=match,
        used=match >= 0,
        nis=np.full(len(match), np.nan),
        weight=np.ones(len(match)),
        counts=counts,
    )


def fix_by_names(
    table: Sightings, rows: IntArray, known: LandmarkMap, config: EkfConfig
) -> tuple[Fix, IntArray]:
    """Returns the pose from one node's bearings, and the known landmark (k,) of each.

    Args:
        table: bearings.
        rows: (k,) those of the node.
        known: landmarks; those that are points count.
        config: matching.

    Raises:
        UnderConstrained: the pose is not determined, or names are not clear.
    """
    landmarks, points = known.of_kind(BEARING.kind)
    bearing, variance = table.z[rows, 0], table.cov[rows, 0, 0]
    if config.matching.method == "known":
        possible = table.truth[rows, None] == known.id[landmarks]
    else:
        possible = same_label(table.label[rows], known.label[landmarks])
    low, high = points.min(axis=0), points.max(axis=0)
    found: list[tuple[Fix, IntArray]] = []
    refused: UnderConstrained = UnderConstrained(NO_FIT)
    for which in _namings(possible):
        try:
            answer = fix(points[which], bearing, variance)
        except UnderConstrained as reason:
            refused = reason
            continue
        freedom = len(rows) - 3
        if freedom and 2.0 * answer.cost > gate_for(config.matching.gate, freedom):
            continue
        found.append((answer, landmarks[which]))
    if len(found) > 1:
        inside = [np.all((low <= f.pose[:2]) & (f.pose[:2] <= high)) for f, _ in found]
        found = [entry for entry, within in zip(found, inside, strict=True) if within] or found
    if not found:
        raise refused
    best = min(found, key=lambda entry: entry[0].cost)
    if any(_apart(best[0], other) for other, _ in found):
        raise UnderConstrained(AMBIGUOUS)
    return best


def _namings(possible: Array) -> Iterator[IntArray]:
    """Yields the ways to give each sighting a landmark of its own, of those ``possible`` (k, M).

    Raises:
        UnderConstrained: there are too many, or a sighting has none.
    """
    options = [tuple(np.flatnonzero(row).tolist()) for row in possible]
    if not options or not all(options):
        raise UnderConstrained(NO_FIT)
    if prod(perm(len(same), count) for same, count in Counter(options).items()) > MOST_NAMINGS:
        raise UnderConstrained(AMBIGUOUS)
    yield from (np.array(chosen) for chosen in _chosen(options, ()))


def _chosen(options: list[tuple[int, ...]], taken: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Yields every way to go on from what is taken, no landmark twice."""
    if len(taken) == len(options):
        yield taken
        return
    for landmark in options[len(taken)]:
        if landmark not in taken:
            yield from _chosen(options, (*taken, landmark))


def _apart(a: Fix, b: Fix) -> bool:
    off = a.pose - b.pose
    off[2] = wrap(off[2])
    return bool(off @ np.linalg.solve(a.cov + b.cov, off) > SAME_ANSWER)


def onward(measurements: Measurements, node: int, pose: Array, cov: Array) -> tuple[Array, Array]:
    """Returns pose and covariance one increment on."""
    odometry = measurements.odometry
    there = compose(pose, odometry.increment[node])
    F, Q, _ = transition(pose, there, odometry.increment[node], odometry.cov[node])
    return there, F @ cov @ F.T + Q
