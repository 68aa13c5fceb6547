"""Errors of a map of lines: how many true lines it has, and how far off they lie."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from compare.align import line_differences, unobserved_direction
from compare.arrays import freeze_arrays
from compare.matching import NOTHING, match_lines, vote
from compare.metrics import map_nees, rms
from compare.truth import BoolArray, Truth
from graphslam.estimate import Estimate
from graphslam.geometry import (
    Array,
    line_to_floor,
    line_to_robot,
    nearest_twin,
    offset_error,
    position_along,
    wrap,
)
from graphslam.landmarks import known_count
from graphslam.measurements import IntArray, Measurements
from graphslam.models.line import LINE


@dataclass(frozen=True, slots=True)
class MapLines:
    """One row for each line of an estimated map; truth's frame, after the map's own alignment.

    Attributes:
        row: (M,) row in the estimate's map.
        status: (M,) "matched", "duplicate", "unseen" or "spurious".
        true_id: (M,) identity of the true line; -1 for spurious lines.
        line: (M, 2) the estimate (rho, alpha), by the name that is nearer to the true line's.
        true_line: (M, 2) the true line, canonical; NaN for spurious lines.
        offset: (M,) estimate minus truth across the line at the middle of the seen stretch, m.
        d_line: (M, 2) estimate minus truth of rho (at the origin, m) and alpha (rad).
        sigma_offset: (M,) the estimate's own standard deviation of `offset`, m.
        sigma_alpha: (M,) the same of alpha, rad.
        sightings: (M,) how many sightings support the line.
    """

    row: IntArray
    status: tuple[str, ...]
    true_id: IntArray
    line: Array
    true_line: Array
    offset: Array
    d_line: Array
    sigma_offset: Array
    sigma_alpha: Array
    sightings: IntArray

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True, slots=True)
class MapMetrics:
    """Errors of a map of lines. Every map line is matched, a duplicate, unseen or spurious.

    Attributes:
        true_lines_seen: true lines that were to be seen; None where nothing tells.
        matched: of those, how many the map has.
        missed: of those, how many it has not; None where nothing tells which were to be seen.
        spurious: map lines that are no true line.
        duplicates: further map lines of a true line that is matched already.
        unseen: map lines of true lines that were not to be seen.
        rho_rmse_m: RMS offset of matched lines at the middle of the seen stretch, after the map's
            own rigid motion, m; NaN where that motion fits so few lines exactly.
        rho_origin_rmse_m: RMS difference in rho itself, after that motion, m (SantanaSLAM's).
        alpha_rmse_deg: RMS difference in angle after that motion, degrees.
        unaligned_rho_rmse_m: as `rho_rmse_m` with the true path moved to begin at the start pose.
        unaligned_alpha_rmse_deg: as `alpha_rmse_deg`, moved likewise.
        nees: joint NEES per degree of freedom, up to a rigid motion; see `metrics.map_nees`.
        nees_freedom: its degrees of freedom.
        start_nees: the same, two degrees of freedom a line, with the frame of the start as the
            frame: where the robot takes its map to lie counts, too. NaN where the start is not
            known exactly.
        missed_id: identities of the missed lines.
        truth_T_estimate: (3,) the map's own rigid motion, m and rad.
        lines: the table behind these figures.
    """

    true_lines_seen: int | None
    matched: int
    missed: int | None
    spurious: int
    duplicates: int
    unseen: int
    rho_rmse_m: float
    rho_origin_rmse_m: float
    alpha_rmse_deg: float
    unaligned_rho_rmse_m: float
    unaligned_alpha_rmse_deg: float
    nees: float
    nees_freedom: int
    start_nees: float
    missed_id: tuple[int, ...]
    truth_T_estimate: Array
    lines: MapLines

    def __post_init__(self) -> None:
        freeze_arrays(self)


def map_metrics(
    estimate: Estimate,
    measurements: Measurements,
    truth: Truth,
    path_motion: Array,
    start_known: bool = False,
) -> MapMetrics | None:
    """Returns the map's errors, or None where either map has no lines.

    Known landmarks were given, not estimated, and are not judged.

    Args:
        estimate: the map, and which sighting is matched with which line.
        measurements: the sightings.
        truth: true lines and the true line of each sighting.
        path_motion: (3,) ``truth_T_estimate`` of the aligned path: where the search begins, and
            the answer along directions that the lines do not fix.
        start_known: whether the start is known exactly, and the true path begins there.
    """
    rows, _ = estimate.map.of_kind(LINE.kind)
    rows = rows[rows >= known_count(measurements)]
    lines = estimate.map.params[rows, : LINE.dim_landmark]
    if len(rows) == 0 or len(truth.lines) == 0:
        return None
    middle = seen_middles(estimate, measurements, rows)
    voted, votes = vote(estimate, truth, rows)
    target, first, motion = match_lines(
        lines, middle, estimate.map.extent[rows], truth, voted, votes, path_motion
    )
    seen = np.ones(len(truth.lines), bool) if truth.seen is None else truth.seen
    status = _status(target, first, seen)
    matched = status == "matched"
    table = _table(estimate, rows, middle, truth, target, motion, status)
    e, _ = line_differences(
        truth.truth_T_start, lines[matched], middle[matched], truth.lines[target[matched]]
    )
    pairs = rows[matched], truth.lines[target[matched]]
    nees, freedom = _nees(estimate, *pairs, motion)
    start_nees, _ = _nees(estimate, *pairs, truth.truth_T_start, frame_known=True)
    found = np.isin(np.arange(len(seen)), target[matched])
    true = truth.lines[target[matched]]
    shifts = 1 if len(true) and unobserved_direction(true) is not None else 2
    # so many lines the map's own motion always fits exactly: nothing is left to judge
    judged_offset = np.full(len(true), len(true) > shifts)
    judged_angle = np.full(len(true), len(true) > 1)
    return MapMetrics(
        true_lines_seen=None if truth.seen is None else int(seen.sum()),
        matched=int(matched.sum()),
        missed=None if truth.seen is None else int(np.sum(seen & ~found)),
        spurious=int(np.sum(status == "spurious")),
        duplicates=int(np.sum(status == "duplicate")),
        unseen=int(np.sum(status == "unseen")),
        rho_rmse_m=rms(table.offset[matched][judged_offset]),
        rho_origin_rmse_m=rms(table.d_line[matched, 0][judged_offset]),
        alpha_rmse_deg=math.degrees(rms(table.d_line[matched, 1][judged_angle])),
        unaligned_rho_rmse_m=rms(e[:, 0]),
        unaligned_alpha_rmse_deg=math.degrees(rms(e[:, 1])),
        nees=nees,
        nees_freedom=freedom,
        start_nees=start_nees if start_known else float("nan"),
        missed_id=() if truth.seen is None else tuple(truth.line_id[seen & ~found].tolist()),
        truth_T_estimate=motion,
        lines=table,
    )


def seen_middles(estimate: Estimate, measurements: Measurements, rows: IntArray) -> Array:
    """Returns (m,) the position along map lines at which they were seen, m.

    The middle of the seen stretch; where that is unknown, the foot of the mean position of the
    robot at the line's sightings.
    """
    middle = estimate.map.extent[rows].mean(axis=1)
    node = np.concatenate(
        [np.zeros(0, np.int64), *(table.node for _, table in measurements.tables())]
    )
    for i in np.flatnonzero(np.isnan(middle)):
        stood = estimate.pose[node[estimate.match == rows[i]], :2]
        where = (stood if len(stood) else estimate.pose[:, :2]).mean(axis=0)
        middle[i] = position_along(estimate.map.params[rows[i]], where)
    return np.asarray(middle)


def line_sigmas(estimate: Estimate, rows: IntArray, middle: Array) -> tuple[Array, Array]:
    """Returns standard deviations (m,) of lines' offsets at ``middle`` (m) and angles (rad)."""
    cov = np.array([estimate.landmark_cov(int(row)) for row in rows]).reshape(-1, 2, 2)
    J = offset_error(np.eye(2), middle[:, None])
    variance = np.einsum("mi,mij,mj->m", J, cov, J)
    return np.sqrt(variance), np.sqrt(cov[:, 1, 1])


def common_direction(estimate: Estimate) -> tuple[float, float]:
    """Returns the mean normal of a map's lines and its standard deviation, floor frame, degrees.

    Lines count by their sightings; the normal lies from 0 to 180. It makes sense where all lines
    run one way: then the position along them is not observed, and this is how surely that way is
    known in the floor frame. NaN without lines.
    """
    rows, lines = estimate.map.of_kind(LINE.kind)
    weight = estimate.map.sightings[rows].astype(float)
    if not weight.sum():
        return math.nan, math.nan
    weight /= weight.sum()
    normal = 0.5 * np.angle(weight @ np.exp(2j * lines[:, 1]))
    place = estimate.map.offsets()[rows] + LINE.dim_landmark - 1
    variance = weight @ estimate.cov_joint[np.ix_(place, place)] @ weight
    return float(np.degrees(normal) % 180.0), math.degrees(math.sqrt(variance))


def _status(target: IntArray, first: BoolArray, seen: BoolArray) -> np.ndarray:
    of_seen = np.append(seen, False)[target]
    kinds = ["spurious", "unseen", "matched"]
    return np.select([target == NOTHING, ~of_seen, first], kinds, "duplicate")


def _table(
    estimate: Estimate,
    rows: IntArray,
    middle: Array,
    truth: Truth,
    target: IntArray,
    motion: Array,
    status: np.ndarray,
) -> MapLines:
    params = estimate.map.params[rows, : LINE.dim_landmark]
    true = np.vstack([truth.lines, [np.nan, np.nan]])[target]
    moved = line_to_floor(params, motion)
    known = target >= 0
    offset, d_line = np.full(len(rows), np.nan), np.full((len(rows), 2), np.nan)
    e, _ = line_differences(motion, params[known], middle[known], true[known])
    moved[known] = nearest_twin(moved[known], true[known])
    offset[known] = e[:, 0]
    d_line[known] = moved[known] - true[known]
    d_line[known, 1] = wrap(d_line[known, 1])
    sigma_offset, sigma_alpha = line_sigmas(estimate, rows, middle)
    ids = np.append(truth.line_id, -1)[target]
    sightings = estimate.map.sightings[rows]
    return MapLines(
        rows, tuple(status.tolist()), ids, moved, true, offset, d_line, sigma_offset, sigma_alpha,
        sightings,
    )  # fmt: skip


def _nees(
    estimate: Estimate,
    rows: IntArray,
    true_lines: Array,
    motion: Array,
    frame_known: bool = False,
) -> tuple[float, int]:
    """Returns `map_nees` of matched lines, the true ones moved into the estimate's frame."""
    lines = estimate.map.params[rows][:, : LINE.dim_landmark]
    true = nearest_twin(line_to_robot(true_lines, motion), lines)
    difference = lines - true
    difference[:, 1] = wrap(difference[:, 1])
    place = (estimate.map.offsets()[rows][:, None] + np.arange(LINE.dim_landmark)).ravel()
    cov = estimate.cov_joint[np.ix_(place, place)]
    return map_nees(difference, true, cov, frame_known)
