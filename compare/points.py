"""Errors of a map's points: cones, lamps, whatever stands at a place and is no line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compare.align import rigid_from_points
from compare.arrays import freeze_arrays
from compare.metrics import mean_nees, rms
from compare.truth import SEEN_FRAMES, Truth
from graphslam.estimate import Estimate
from graphslam.geometry import Array, rotation, transform_points
from graphslam.landmarks import known_count
from graphslam.measurements import IntArray, LandmarkMap, Measurements
from graphslam.models.line import LINE

MATCH_M = 0.5
"""A point none of whose sightings has a known truth is a true point's within this distance, m."""
OWN_MOTION = 3
"""Matched points from which on the map's own rigid motion leaves something to judge."""
MATCHED, DUPLICATE, SPURIOUS = "matched", "duplicate", "spurious"


@dataclass(frozen=True, slots=True)
class MapPoints:
    """One row for each point of an estimated map; truth's frame, as the start puts it.

    Attributes:
        row: (M,) row in the estimate's map.
        kind: (M,) kind of each.
        status: (M,) "matched", "duplicate" or "spurious".
        true_id: (M,) identity of the true point; -1 for spurious ones.
        place: (M, 2) the estimate, m.
        error: (M, 2) estimate minus truth, m; NaN for spurious ones.
        cov: (M, 2, 2) the estimate's own covariance, m², truth's frame.
        sightings: (M,) how many sightings support it.
    """

    row: IntArray
    kind: tuple[str, ...]
    status: tuple[str, ...]
    true_id: IntArray
    place: Array
    error: Array
    cov: Array
    sightings: IntArray

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True, slots=True)
class PointMetrics:
    """Errors of a map's points, known ones left out.

    Attributes:
        true_points_seen: true points of which there are at least `SEEN_FRAMES` sightings.
        matched: true points that the map has.
        missed: true points seen that it has not.
        spurious: points of the map that are no true one.
        duplicates: further points of a true one that is matched already.
        rmse_m: RMS distance of matched points after the best rigid motion of their own, m; NaN for
            fewer than `OWN_MOTION`.
        unaligned_rmse_m: RMS distance with the true path moved to begin at the start pose, m.
        nees: mean of e' C^-1 e / 2 of matched points, one by one, in the start's frame; NaN where
            the start is not known exactly.
        missed_id: identities of the missed points.
        points: the table behind these figures.
    """

    true_points_seen: int
    matched: int
    missed: int
    spurious: int
    duplicates: int
    rmse_m: float
    unaligned_rmse_m: float
    nees: float
    missed_id: tuple[int, ...]
    points: MapPoints


def point_rows(landmarks: LandmarkMap) -> IntArray:
    """Returns the rows (m,) of the landmarks that are points: x and y are their first numbers."""
    return np.flatnonzero([kind != LINE.kind for kind in landmarks.kind])


def point_metrics(
    estimate: Estimate, measurements: Measurements, truth: Truth, start_known: bool
) -> PointMetrics | None:
    """Returns the errors of the points, or None where either map has none to judge.

    A point of the map stands for the true one that most of its sightings are of; where none of them
    has a known truth, for the nearest within `MATCH_M`. Of several, that with the most sightings.

    Args:
        estimate: the map, and which sighting is matched with which point.
        measurements: the sightings.
        truth: true points, and the true one of each sighting.
        start_known: whether the start is known exactly, and the true path begins there.
    """
    rows = point_rows(estimate.map)
    rows = rows[rows >= known_count(measurements)]
    if not len(rows) or not len(truth.point_id):
        return None
    place = transform_points(truth.truth_T_start, estimate.map.params[rows, :2])
    target = _targets(estimate, truth, rows, place)
    status = np.full(len(rows), SPURIOUS, dtype=object)
    taken: set[int] = set()
    for i in np.argsort(-estimate.map.sightings[rows], kind="stable").tolist():
        if target[i] >= 0:
            status[i] = DUPLICATE if target[i] in taken else MATCHED
            taken.add(int(target[i]))
    true = np.vstack([truth.points, [np.nan, np.nan]])[target]
    cov = _covariances(estimate, rows, float(truth.truth_T_start[2]))
    table = MapPoints(
        rows,
        tuple(estimate.map.kind[row] for row in rows.tolist()),
        tuple(status.tolist()),
        np.append(truth.point_id, -1)[target],
        place,
        place - true,
        cov,
        estimate.map.sightings[rows],
    )
    good = status == MATCHED
    seen = _seen(measurements, truth)
    missed = np.setdiff1d(np.flatnonzero(seen), target[good])
    own = np.full((0, 2), np.nan)
    if good.sum() >= OWN_MOTION:
        motion = rigid_from_points(place[good], true[good])
        own = transform_points(motion, place[good]) - true[good]
    return PointMetrics(
        true_points_seen=int(seen.sum()),
        matched=int(good.sum()),
        missed=len(missed),
        spurious=int(np.sum(status == SPURIOUS)),
        duplicates=int(np.sum(status == DUPLICATE)),
        rmse_m=rms(np.hypot(own[:, 0], own[:, 1])),
        unaligned_rmse_m=rms(np.hypot(*table.error[good].T)),
        nees=mean_nees(table.error[good], cov[good]) if start_known else float("nan"),
        missed_id=tuple(truth.point_id[missed].tolist()),
        points=table,
    )


def _targets(estimate: Estimate, truth: Truth, rows: IntArray, place: Array) -> IntArray:
    """Returns the row (m,) of each point's true one, -1 for none."""
    target = np.full(len(rows), -1)
    kinds = np.array(truth.point_kind, dtype=object)
    for i, row in enumerate(rows.tolist()):
        same = np.flatnonzero(kinds == estimate.map.kind[row])
        voted = truth.landmark[(estimate.match == row) & estimate.used]
        voted = voted[voted >= 0]
        if len(voted):
            names, votes = np.unique(voted, return_counts=True)
            found = same[truth.point_id[same] == names[votes.argmax()]]
            target[i] = found[0] if len(found) else -1
        elif len(same):
            gap = np.hypot(*(truth.points[same] - place[i]).T)
            target[i] = same[gap.argmin()] if gap.min() <= MATCH_M else -1
    return target


def _covariances(estimate: Estimate, rows: IntArray, turn: float) -> Array:
    """Returns the covariances (m, 2, 2) of points' places in a frame turned by ``turn``, m²."""
    R = rotation(turn)
    cov = [estimate.landmark_cov(row)[:2, :2] for row in rows.tolist()]
    return np.asarray(R @ np.array(cov).reshape(-1, 2, 2) @ R.T)


def _seen(measurements: Measurements, truth: Truth) -> Array:
    """Returns which true points (P,) have at least `SEEN_FRAMES` sightings of theirs."""
    seen = np.zeros(len(truth.point_id), bool)
    for first, table in measurements.tables():
        of = truth.landmark[first : first + len(table)]
        for i, (kind, name) in enumerate(zip(truth.point_kind, truth.point_id, strict=True)):
            seen[i] |= kind == table.kind and int(np.sum(of == name)) >= SEEN_FRAMES
    return seen
