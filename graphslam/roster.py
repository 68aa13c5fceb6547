"""The landmarks of one run of the filter: where each stands in the state, and what it is worth.

A landmark is *tentative* until enough nodes have seen it, then *confirmed*; known ones are
confirmed from the start. One that is removed keeps its row here, so that rows name landmarks for
the whole run; so does one that is left behind, with what was known of it then.
"""

from __future__ import annotations

import math

import numpy as np

from graphslam.geometry import Array
from graphslam.kalman import JointState
from graphslam.measurements import IntArray, LandmarkMap
from graphslam.models import MODELS

FIXED, GONE, LEFT = -1, -2, -3
MOST_TENTATIVE = 50
"""Tentative landmarks that are kept at a time; the one unseen for longest goes first."""
UNLIKELY_TENTATIVE, UNLIKELY = math.log(1e-2), math.log(1e-6)
"""Log-probability of being missed so often by chance, below which a landmark is taken for gone."""
SURE = 0.97
"""Largest probability of being detected that is believed."""


class Roster:
    """Rows of landmarks, in order of appearance, known ones first.

    Attributes:
        kinds: name of each landmark's model.
        offset: (M,) place in the state; `FIXED` for known ones, `GONE` for removed ones, `LEFT` for
            those left behind.
        identity: (M,) true identity that each was started with, for judging only.
        label: (M,) what sensors tell it apart by; -1 for none.
        given: (M,) with a given linearisation: row of each in the given map; else -1.
        seen: (M,) nodes that saw it.
        last: (M,) the last of them; -1 before.
        hits: (M,) nodes that should have seen it, and did.
        misses: (M,) nodes that should have seen it, and did not.
        missed: (M,) the same since the last that did.
        extent: (M, 2) stretch seen or known, m; NaN where unknown.
        confirmed: (M,) whether it counts.
        left: by row, parameters (l,) and covariance (l, l) of what was left behind, as known then.
    """

    def __init__(self, known: LandmarkMap | None, confirm_after: int) -> None:
        self.confirm_after = confirm_after
        self.kinds: list[str] = [] if known is None else list(known.kind)
        count = len(self.kinds)
        self.known = count
        self.offset = np.full(count, FIXED)
        self.identity = np.zeros(0, np.int64) if known is None else np.array(known.id)
        self.label = np.zeros(0, np.int64) if known is None else np.array(known.label)
        self.given = np.arange(count)
        self.seen, self.last = np.zeros(count, np.int64), np.full(count, -1)
        self.hits, self.misses = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self.missed = np.zeros(count, np.int64)
        self.extent = np.zeros((0, 2)) if known is None else np.array(known.extent)
        self.confirmed = np.ones(count, bool)
        self.left: dict[int, tuple[Array, Array]] = {}
        self._present: dict[str, IntArray] = {}
        self._free: IntArray | None = None

    def __len__(self) -> int:
        return len(self.kinds)

    def present(self, kind: str) -> IntArray:
        """Returns the rows of all landmarks of a kind that are neither removed nor left behind."""
        if kind not in self._present:
            there = np.flatnonzero(self.offset >= FIXED)
            self._present[kind] = there[[self.kinds[row] == kind for row in there.tolist()]]
        return self._present[kind]

    def free(self) -> IntArray:
        """Returns the rows of the landmarks that are in the state, in its order."""
        if self._free is None:
            self._free = np.flatnonzero(self.offset >= 0)
        return self._free

    def add(self, kind: str, offset: int, identity: int, given: int = -1, label: int = -1) -> int:
        """Adds a landmark that stands at ``offset`` in the state; returns its row."""
        self.kinds.append(kind)
        self.offset = np.append(self.offset, offset)
        self.identity = np.append(self.identity, identity)
        self.given = np.append(self.given, given)
        self.label = np.append(self.label, label)
        for name, value in (("seen", 0), ("last", -1), ("hits", 0), ("misses", 0), ("missed", 0)):
            setattr(self, name, np.append(getattr(self, name), value))
        self.extent = np.vstack([self.extent, [np.nan, np.nan]])
        self.confirmed = np.append(self.confirmed, self.confirm_after == 1)
        self._present.pop(kind, None)
        self._free = None
        return len(self.kinds) - 1

    def saw(self, rows: IntArray, node: int, stretch: Array) -> None:
        """Notes that a node saw landmarks (k,), and which stretches (k, 2) of them, m."""
        fresh = rows[self.last[rows] != node]
        self.seen[fresh] += 1
        self.last[rows] = node
        self.missed[rows] = 0
        self.extent[rows, 0] = np.fmin(self.extent[rows, 0], stretch[:, 0])
        self.extent[rows, 1] = np.fmax(self.extent[rows, 1], stretch[:, 1])
        self.confirmed[rows] |= self.seen[rows] >= self.confirm_after

    def expect(self, rows: IntArray, node: int) -> None:
        """Notes that a node should have seen landmarks (k,), and whether it did."""
        there = self.last[rows] == node
        self.hits[rows[there]] += 1
        self.misses[rows[~there]] += 1
        self.missed[rows[~there]] += 1

    def detection(self) -> float:
        """Returns the probability, learned so far, that a landmark in view is seen."""
        rows = np.flatnonzero(self.confirmed)
        hits, misses = 9 + int(self.hits[rows].sum()), 1 + int(self.misses[rows].sum())
        return min(SURE, hits / (hits + misses))

    def doubtful(self) -> IntArray:
        """Returns the rows of landmarks that have been missed too often, or are one too many.

        A confirmed one also has to be missed more often than seen, all in all.
        """
        free = self.free()
        chance = self.missed[free] * math.log1p(-self.detection())
        sure = self.confirmed[free]
        gone = np.where(
            sure,
            (chance < UNLIKELY) & (self.misses[free] > self.seen[free]),
            chance < UNLIKELY_TENTATIVE,
        )
        tentative = free[~sure & ~gone]
        spare = max(0, len(tentative) - MOST_TENTATIVE)
        oldest = tentative[np.argsort(self.last[tentative], kind="stable")[:spare]]
        return np.sort(np.concatenate([free[gone], oldest]))

    def tentative(self) -> IntArray:
        """Returns the rows of tentative landmarks."""
        free = self.free()
        return free[~self.confirmed[free]]

    def leave(self, row: int, state: JointState) -> None:
        """Takes a landmark out of the state and keeps what is known of it; its row stays, `LEFT`.

        Nothing else in the state changes, as if the landmark were never seen again.
        """
        own = slice(int(self.offset[row]), int(self.offset[row]) + self._length(row))
        self.left[row] = state.mean[own].copy(), state.P[own, own].copy()
        self.remove(row, state)
        self.offset[row] = LEFT

    def remove(self, row: int, state: JointState) -> None:
        """Takes a landmark out of the state; its row stays, `GONE`."""
        kind, at = self.kinds[row], int(self.offset[row])
        length = self._length(row)
        state.remove(at, length)
        self.offset[row] = GONE
        self.close_gap(at, length)
        self._present.pop(kind, None)
        self._free = None

    def close_gap(self, at: int, length: int) -> None:
        """Moves up the places behind ``length`` entries that were taken out of the state."""
        self.offset[self.offset > at] -= length

    def _length(self, row: int) -> int:
        return MODELS[self.kinds[row]].dim_landmark
