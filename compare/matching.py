"""Which map line is which true line, and how many sightings were taken for the right one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from compare.align import line_differences, rigid_from_lines
from compare.arrays import freeze_arrays
from compare.truth import BoolArray, Truth
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Measurements
from graphslam.models import MODELS
from graphslam.models.line import LINE

MATCH_M = 0.1
"""By geometry a map line is a true line's within this offset at the middle of its stretch, m."""
MATCH_DEG = 5.0
"""By geometry a map line is a true line's within this angle, degrees."""
MAX_ROUNDS = 10
"""Matching and aligning alternate at most this often."""
OPEN, NOTHING = -2, -1
FORBIDDEN = 1e6


@dataclass(frozen=True, slots=True)
class MatchingTable:
    """How many sightings were taken for which true landmark, as in SantanaSLAM Table 2.

    A landmark of the map stands for the true one that most of its sightings are of. Sightings
    whose true landmark is not known are counted apart. The paper has the first three columns.

    Attributes:
        kind: (n,) kind of each true landmark.
        true_id: (n,) its identity.
        identifications: (n,) used sightings of known truth that were taken for it.
        correct: (n,) of those, how many are of it.
        unknown: (n,) used sightings of unknown truth that were taken for it.
        missed: (n,) sightings of it that were taken for nothing.
        needless: (n,) landmarks of the map that stand for it, beyond the first.
        unknown_total: used sightings of unknown truth, whatever they were taken for.
        needless_total: landmarks of the map beyond one for each true one; where the log itself
            names the sightings' landmarks, also those that stand for none.
    """

    kind: tuple[str, ...]
    true_id: IntArray
    identifications: IntArray
    correct: IntArray
    unknown: IntArray
    missed: IntArray
    needless: IntArray
    unknown_total: int
    needless_total: int

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def incorrect(self) -> IntArray:
        """(n,) sightings that were taken for the landmark and are of another."""
        return self.identifications - self.correct

    @property
    def hit_rate(self) -> Array:
        """(n,) share of `correct` among `identifications`; NaN where there are none."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.correct / self.identifications)

    @property
    def right_share(self) -> float:
        """Share of right matches among all sightings of known truth; NaN where there are none."""
        total = int(self.identifications.sum())
        return int(self.correct.sum()) / total if total else float("nan")


def matching_table(
    estimate: Estimate, measurements: Measurements, truth: Truth
) -> MatchingTable | None:
    """Returns the table, or None where no used sighting has a known true landmark.

    Source: SantanaSLAM Table 2.
    """
    rows: list[tuple[str, int, list[int]]] = []
    unknown_total = no_landmark = 0
    for first, table in measurements.tables():
        here = slice(first, first + len(table))
        used = estimate.used[here] & (estimate.match[here] >= 0)
        if not MODELS[table.kind].dim_landmark:
            continue
        row, true = estimate.match[here], truth.landmark[here]
        stands_for = _majority(row[used], true[used])
        unknown_total += int(np.sum(true[used] < 0))
        no_landmark += len(np.unique(row[used][stands_for == NOTHING]))
        for name in np.unique(true[true >= 0]):
            taken = true[used][stands_for == name]
            known, right = int(np.sum(taken >= 0)), int(np.sum(taken == name))
            missed = int(np.sum(true[~used] == name))
            lines = len(np.unique(row[used][stands_for == name]))
            counts = [known, right, len(taken) - known, missed, max(0, lines - 1)]
            rows.append((table.kind, int(name), counts))
    counts = np.array([entry[2] for entry in rows], np.int64).reshape(-1, 5).T
    if not counts[0].sum():
        return None
    kinds, names = tuple(entry[0] for entry in rows), np.array([entry[1] for entry in rows])
    needless = int(counts[4].sum()) + (no_landmark if truth.labelled else 0)
    return MatchingTable(kinds, names, *counts, unknown_total, needless)


def _majority(row: IntArray, true: IntArray) -> IntArray:
    """Returns for each sighting the true landmark that most of its map row's sightings are of."""
    out = np.full(len(row), NOTHING)
    for landmark in np.unique(row):
        names, counts = np.unique(true[(row == landmark) & (true >= 0)], return_counts=True)
        if len(names):
            out[row == landmark] = names[counts.argmax()]
    return out


def vote(estimate: Estimate, truth: Truth, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Returns the true line (m,) that most sightings of each map line are of, and the votes (m,).

    The sightings say what a line is without regard to where the estimate puts it. Geometry does
    worse where it matters: under drift the nearest line of a tiled floor is the wrong one, and its
    error is then at most half a tile however lost the estimate is. So the vote decides where it
    has more than half, and geometry only where there is none. Where the log labels its sightings,
    'no true line' is a candidate too; where labels are derived from the true path, a sighting
    without one merely has no vote.

    Returns:
        Rows of ``truth.lines``, `NOTHING` where most sightings are of no true line, `OPEN` where
        the vote does not decide; and how many sightings voted for it.
    """
    count, none = len(truth.lines), len(truth.lines)
    used = np.flatnonzero((estimate.match >= 0) & estimate.used)
    place = np.full(len(estimate.map), -1)
    place[rows] = np.arange(len(rows))
    used = used[place[estimate.match[used]] >= 0]
    row_of = {int(name): row for row, name in enumerate(truth.line_id)}
    said = np.array([row_of.get(int(i), none) for i in truth.landmark[used]], np.int64)
    ballots = np.zeros((len(rows), count + 1), np.int64)
    np.add.at(ballots, (place[estimate.match[used]], said), 1)
    if not truth.labelled:
        ballots[:, none] = 0
    winner, votes = ballots.argmax(axis=1), ballots.max(axis=1)
    decided = 2 * votes > ballots.sum(axis=1)
    return np.where(decided, np.where(winner == none, NOTHING, winner), OPEN), votes


def match_lines(
    lines: Array,
    middle: Array,
    stretch: Array,
    truth: Truth,
    voted: IntArray,
    votes: IntArray,
    initial: Array,
) -> tuple[IntArray, BoolArray, Array]:
    """Returns the true line of each map line, which is its first, and the map's rigid motion.

    Args:
        lines: (m, 2) map lines.
        middle: (m,) middle of the stretch seen of each, m.
        stretch: (m, 2) that stretch, m; NaN where unknown.
        truth: the true lines.
        voted: (m,) as by `vote`; `OPEN` ones are matched by geometry (`near_lines`).
        votes: (m,) how many sightings are behind ``voted``: the line with most is the first.
        initial: (3,) motion to begin with.

    Returns:
        (m,) rows of ``truth.lines``, or `NOTHING`; (m,) whether the map line is the one that
        counts for its true line, others being duplicates; (3,) ``truth_T_estimate`` fitted to
        those of true lines that were to be seen.
    """
    by_votes = np.lexsort((np.arange(len(voted)), -votes))
    _, best = np.unique(voted[by_votes], return_index=True)
    first_voted = np.isin(np.arange(len(voted)), by_votes[best]) & (voted >= 0)
    target, first = voted, first_voted
    for _ in range(MAX_ROUNDS):
        fits = np.flatnonzero(first)
        if truth.seen is not None:
            fits = fits[truth.seen[target[fits]]]
        motion = rigid_from_lines(lines[fits], middle[fits], truth.lines[target[fits]], initial)
        resolved = voted.copy(), first_voted.copy()
        rest = np.flatnonzero(voted == OPEN)
        near = near_lines(
            motion, lines[rest], middle[rest], stretch[rest], truth.lines, truth.extent
        )
        free = ~np.isin(np.arange(len(truth.lines)), voted)
        resolved[0][rest], resolved[1][rest] = assign(near, free)
        if np.array_equal(resolved, (target, first)):
            break
        target, first = resolved
    return target, first, motion


def near_lines(
    motion: Array,
    lines: Array,
    middle: Array,
    stretch: Array,
    true_lines: Array,
    true_stretch: Array,
) -> Array:
    """Returns (m, L) how far map lines lie from true lines, in thresholds; infinite where not near.

    Near is within `MATCH_M` at the middle of the seen stretch and `MATCH_DEG`, stretches that are
    known meeting within `MATCH_M`. Arguments are as in `match_lines`.
    """
    e, _ = line_differences(motion, lines[:, None], middle[:, None], true_lines)
    scaled = np.abs(e) / (MATCH_M, math.radians(MATCH_DEG))
    near = np.all(scaled <= 1.0, axis=-1)
    for row, true_line in enumerate(true_lines):
        there = np.broadcast_to(true_line, lines.shape)
        at = np.broadcast_to(motion, (len(lines), 3))
        laid = LINE.extent_on_landmark(at, there, lines, stretch)
        low, high = true_stretch[row] + (-MATCH_M, MATCH_M)
        near[:, row] &= ~((laid[:, 1] < low) | (laid[:, 0] > high))
    return np.where(near, np.hypot(scaled[..., 0], scaled[..., 1]), np.inf)


def assign(distance: Array, free: BoolArray) -> tuple[IntArray, BoolArray]:
    """Returns a one-to-one assignment of rows to free columns, as many as possible, then nearest.

    Args:
        distance: (m, L), infinite where a pair is impossible.
        free: (L,) columns that may be assigned.

    Returns:
        (m,) the column of each row: its own, or for a row that got none the nearest possible one,
        or `NOTHING`; (m,) whether the column is its own.
    """
    cost = np.where(np.isfinite(distance) & free, distance, FORBIDDEN)
    rows, columns = scipy.optimize.linear_sum_assignment(cost)
    granted = cost[rows, columns] < FORBIDDEN
    own = np.zeros(len(distance), bool)
    own[rows[granted]] = True
    target = np.where(np.isfinite(distance).any(axis=1), distance.argmin(axis=1), NOTHING)
    target[rows[granted]] = columns[granted]
    return target, own
