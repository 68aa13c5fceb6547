"""A run as the bound sees it: where the robot drove, what it saw from where, how surely."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from compare.bound import true_matches
from compare.truth import Truth
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.field_of_view import FieldOfView
from graphslam.geometry import (
    Array,
    between,
    compose,
    interpolate_poses,
    inverse,
    line_to_robot,
    transform_points,
)
from graphslam.information import position_information
from graphslam.landmarks import used_sightings
from graphslam.measurements import IntArray, LandmarkMap, Measurements, Odometry, Sightings
from graphslam.models import MODELS
from graphslam.models.line import LINE

PARALLEL_DEG = 20.0
"""Lines within this angle of the direction that is fixed best count as parallel."""
USUAL_SPACING_M = 1.0
"""Distance between added lines where the log has no two parallel ones to take it from, m."""
BLOCK = 500
"""Nodes whose views of added lines are looked at at a time."""


@dataclass(frozen=True, slots=True)
class Situation:
    """Measurements with the path, the map and the matches at which they are linearised.

    Attributes:
        measurements: covariances count, values do not.
        pose: (N, 3) floor frame.
        landmarks: floor frame.
        match: (K,) row in ``landmarks`` of each sighting, -1 where it is left out.
        at: whether path and map are the truth or an estimate.
    """

    measurements: Measurements
    pose: Array
    landmarks: LandmarkMap
    match: IntArray
    at: Literal["truth", "estimate"]


def situation_of(measurements: Measurements, truth: Truth, estimate: Estimate) -> Situation:
    """Returns the true situation where the log tells it, else the estimated one."""
    pose, covered = truth.at(measurements.t)
    matches, names = true_matches(measurements, truth)
    kinds = {k for k in measurements.sightings if MODELS[k].dim_landmark}
    if not covered.all() or kinds - {LINE.kind} or not (matches >= 0).any():
        return Situation(measurements, estimate.pose, estimate.map, estimate.match, "estimate")
    pose = compose(inverse(truth.truth_T_start), pose)
    if measurements.known is not None:
        return Situation(measurements, pose, measurements.known, matches, "truth")
    rows = np.array([int(np.flatnonzero(truth.line_id == name)[0]) for name in names])
    lines = line_to_robot(truth.lines[rows], truth.truth_T_start)
    seen = np.bincount(matches[matches >= 0], minlength=len(names))
    extent = np.full((len(names), 2), np.nan)
    landmarks = LandmarkMap(names, (LINE.kind,) * len(names), lines, extent, seen)
    return Situation(measurements, pose, landmarks, matches, "truth")


# ---- changes ------------------------------------------------------------------------------------


def with_sharper_sightings(now: Situation, factor: float) -> Situation:
    """Returns the situation with all sightings' standard deviations times ``factor``."""
    tables = {
        kind: replace(table, cov=factor**2 * table.cov)
        for kind, table in now.measurements.sightings.items()
    }
    return replace(now, measurements=replace(now.measurements, sightings=tables))


def with_better_wheels(now: Situation, factor: float) -> Situation:
    """Returns the situation with the increments' standard deviations times ``factor``."""
    odometry = now.measurements.odometry
    better = replace(odometry, cov=factor**2 * odometry.cov)
    return replace(now, measurements=replace(now.measurements, odometry=better))


def node_times_twice(t: Array) -> Array:
    """Returns (N-1,) a time after each node but the last: half a usual interval later.

    Between nodes that follow each other sooner it is the middle.
    """
    gap = np.diff(t)
    return t[:-1] + 0.5 * np.minimum(gap, float(np.median(gap)))


def with_twice_the_frames(now: Situation, odometry: Odometry) -> Situation:
    """Returns the situation with a further node after each, that sees what the node before it saw.

    Args:
        now: with N nodes, at least two.
        odometry: between the 2 N - 1 nodes, at the times of both and `node_times_twice`.
    """
    old = now.measurements
    nodes, added = len(old.t), node_times_twice(old.t)
    t, pose = np.empty(2 * nodes - 1), np.empty((2 * nodes - 1, 3))
    t[::2], t[1::2] = old.t, added
    pose[::2], pose[1::2] = now.pose, interpolate_poses(added, old.t, now.pose)
    tables, match = {}, []
    for first, table in old.tables():
        both, source = _seen_twice(now, table, first, pose)
        tables[table.kind] = both
        match.append(now.match[first + source])
    increment = between(pose[:-1], pose[1:])
    made = replace(
        old, t=t, odometry=Odometry(increment, odometry.cov), sightings=tables, rejected={}
    )
    joined = np.concatenate(match) if match else np.zeros(0, np.int64)
    return replace(now, measurements=made, pose=pose, match=joined)


def _seen_twice(
    now: Situation, table: Sightings, first: int, pose: Array
) -> tuple[Sightings, IntArray]:
    """Returns a table with each sighting at its node and the next, and the rows they come from."""
    rows = np.arange(len(table))
    again = rows[2 * table.node + 1 < len(pose)]
    source = np.concatenate([rows, again])
    node = np.concatenate([2 * table.node, 2 * table.node[again] + 1])
    order = np.argsort(node, kind="stable")
    source, node = source[order], node[order]
    made = replace(table.select(source), node=node)
    model, match = MODELS[table.kind], now.match[first + source]
    params = np.zeros((len(node), 0))
    if model.dim_landmark:
        params = now.landmarks.params[match, : model.dim_landmark]  # of -1, anything will do
    e, _, _ = model.residual(pose[node], params, made.z)
    return replace(made, z=made.z + e), source


def with_crossing_lines(now: Situation) -> tuple[Situation, float, float]:
    """Returns the situation with lines across the direction that is fixed best.

    They lie as far apart as the present ones, are as long as the floor, and are seen wherever they
    cross the view that the log's own sightings fill, as surely as the present ones.

    Returns:
        The situation, the direction of the new lines' normals (degrees, floor frame, from 0 to
        180), and their distance from each other, m.

    Raises:
        BadConfig: the log's sightings do not tell what is in view.
    """
    table = now.measurements.sightings.get(LINE.kind)
    view = FieldOfView()
    if table is not None:
        view.see(LINE.ends(table.z, table.extent))
    if table is None or not view.learned:
        raise BadConfig("the sightings' stretches are too few to tell what is in view")
    information = position_information(now.measurements, now.pose, now.landmarks, now.match)
    strong, weak = np.linalg.eigh(information)[1].T[::-1]
    spacing = _spacing(now.landmarks, strong)
    along = now.pose[:, :2] @ weak
    rho = np.arange(along.min() - spacing, along.max() + 1.5 * spacing, spacing) + 0.37 * spacing
    lines = np.column_stack([rho, np.full(len(rho), math.atan2(weak[1], weak[0]))])
    node, line = _views_of(view, lines, now.pose)
    cov = np.diag(np.median(np.diagonal(table.cov, axis1=1, axis2=2), axis=0))
    added = _added(table, now, node, line_to_robot(lines[line], now.pose[node]), cov)
    landmarks, match = _joined(now, table, added, lines, line)
    order = np.argsort(np.concatenate([table.node, node]), kind="stable")
    tables = {**now.measurements.sightings, LINE.kind: _stacked(table, added, order)}
    made = replace(now.measurements, sightings=tables)
    first = {t.kind: f for f, t in now.measurements.tables()}[LINE.kind]
    whole = [now.match[:first], match[order], now.match[first + len(table) :]]
    degrees = math.degrees(lines[0, 1]) % 180.0
    changed = replace(now, measurements=made, landmarks=landmarks, match=np.concatenate(whole))
    return changed, degrees, spacing


def _spacing(landmarks: LandmarkMap, normal: Array) -> float:
    """Returns the median distance between lines across ``normal`` (2,), m."""
    _, lines = landmarks.of_kind(LINE.kind)
    cosine = np.cos(lines[:, 1]) * normal[0] + np.sin(lines[:, 1]) * normal[1]
    parallel = np.abs(cosine) > math.cos(math.radians(PARALLEL_DEG))
    gaps = np.diff(np.sort(lines[parallel, 0] * np.sign(cosine[parallel])))
    gaps = gaps[gaps > 0.05]
    return float(np.median(gaps)) if len(gaps) else USUAL_SPACING_M


def _views_of(view: FieldOfView, lines: Array, pose: Array) -> tuple[IntArray, IntArray]:
    """Returns node and line (k,) of all pairs in which a node has an endless line in view."""
    far = 10.0 + float(np.abs(pose[:, :2]).max()) + float(np.abs(lines[:, 0]).max())
    ends = LINE.ends(lines, np.tile([-far, far], (len(lines), 1)))
    found = []
    for first in range(0, len(pose), BLOCK):
        part = inverse(pose[first : first + BLOCK])
        seen = transform_points(part[:, None, None], ends).reshape(-1, 2, 2)
        node, line = np.nonzero(view.shows(seen).reshape(len(part), len(lines)))
        found.append((first + node, line))
    node, line = map(np.concatenate, zip(*found, strict=True))
    return node, line


def _added(table: Sightings, now: Situation, node: IntArray, z: Array, cov: Array) -> Sightings:
    count, t = len(node), now.measurements.t[node]
    nothing = np.full(count, np.nan)
    return Sightings(
        kind=table.kind,
        node=node,
        z=z,
        cov=np.broadcast_to(cov, (count, *cov.shape)),
        extent=np.full((count, 2), np.nan),
        t_received=t,
        quality=nothing,
        source=np.full(count, -1),
        truth=np.full(count, -1),
    )


def _joined(
    now: Situation, table: Sightings, added: Sightings, lines: Array, line: IntArray
) -> tuple[LandmarkMap, IntArray]:
    """Returns the map with the added lines that are seen, and the matches of both tables."""
    seen, number = np.unique(line, return_inverse=True)
    old, count = now.landmarks, len(seen)
    params = np.full((count, old.params.shape[1]), np.nan)
    params[:, : LINE.dim_landmark] = lines[seen]
    first = {t.kind: f for f, t in now.measurements.tables()}[LINE.kind]
    landmarks = LandmarkMap(
        np.concatenate([old.id, 1 + old.id.max(initial=-1) + np.arange(count)]),
        (*old.kind, *(LINE.kind,) * count),
        np.vstack([old.params, params]),
        np.vstack([old.extent, np.full((count, 2), np.nan)]),
        np.concatenate([old.sightings, np.bincount(number, minlength=count)]),
    )
    match = np.concatenate([now.match[first : first + len(table)], len(old) + number])
    return landmarks, match


def _stacked(table: Sightings, added: Sightings, order: IntArray) -> Sightings:
    names = ("node", "z", "cov", "extent", "t_received", "quality", "source", "truth")
    return Sightings(
        table.kind,
        **{n: np.concatenate([getattr(table, n), getattr(added, n)])[order] for n in names},
    )


def sightings_used(now: Situation) -> int:
    """Returns how many sightings count."""
    each = used_sightings(now.measurements, now.match, now.landmarks.params)
    return sum(len(used.rows) for used in each)
