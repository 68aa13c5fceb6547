"""How the filter tells landmarks: which are candidates, which fit, which should be there."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from graphslam.arrays import AnyArray
from graphslam.association import (
    DROPPED,
    NEW,
    Compatibility,
    assign,
    by_identity,
    compatibility,
    jcbb,
    leftover,
    same_label,
    stretch_gap,
)
from graphslam.config import EkfConfig
from graphslam.estimate import Estimate
from graphslam.field_of_view import FieldOfView
from graphslam.geometry import Array, inverse, transform_points
from graphslam.kalman import JointState
from graphslam.measurements import IntArray, Measurements, Sightings
from graphslam.models import MODELS, Model
from graphslam.models.base import Stretched
from graphslam.roster import FIXED, Roster

BESIDE_M, BESIDE_DEG = 0.3, 20.0
"""A new line so near to one that should be seen, and is not, is that one displaced."""
MOST_DOUBLINGS = 10
"""The noise of a lost robot's odometry is doubled at most this often."""
LOST = "lost: most sightings rejected for several nodes"


class Matcher:
    """The half of the filter that decides which landmark a sighting is of."""

    measurements: Measurements
    config: EkfConfig
    at: Estimate | None
    state: JointState
    known: Array
    match: IntArray
    counts: Counter[str]

    def __init__(self, confirm_after: int) -> None:
        self.roster = Roster(self.measurements.known, confirm_after)
        self.views: dict[str, FieldOfView] = {}
        self.tally = np.zeros(2, np.int64)  # sightings of this node that were matched, and dropped
        self.rejected_in_a_row = 0
        self.last_Q = np.zeros((3, 3))

    @property
    def recognises(self) -> bool:
        """Whether the filter tells landmarks by itself: nobody gives it the matches."""
        return self.at is None and self.config.matching.method != "known"

    def remove(self, row: int) -> None:
        """Takes a landmark out of the state, and rejects its sightings."""
        raise NotImplementedError

    # ---- which landmark --------------------------------------------------------------------

    def candidates(self, node: int, kind: str) -> IntArray:
        """Returns the landmarks, tentative ones too, that a sighting at a node may be of."""
        return self.roster.present(kind)

    def find(
        self, node: int, model: Model, table: Sightings, rows: IntArray, first: int
    ) -> IntArray:
        """Returns the landmark (k,) of each sighting, `NEW` or `DROPPED`."""
        if self.at is not None:
            given = self.at.match[first + rows]
            ours = {int(g): row for row, g in enumerate(self.roster.given) if g >= 0}
            return np.array([ours.get(int(g), NEW) if g >= 0 else DROPPED for g in given])
        landmarks = self.candidates(node, table.kind)
        if self.config.matching.method == "known":
            found = by_identity(table.truth[rows], self.roster.identity[landmarks])
        elif len(landmarks):
            fit = self.fit(model, table, rows, landmarks)
            taken = self.roster.last[landmarks] == node
            if self.config.matching.method == "jcbb":
                found = self.find_jointly(model, table, rows, landmarks, fit, taken)
            else:
                found = assign(fit, taken)
        else:
            return np.full(len(rows), NEW)
        matched = found >= 0
        found[matched] = landmarks[found[matched]]
        return found

    def fit(
        self, model: Model, table: Sightings, rows: IntArray, landmarks: IntArray
    ) -> Compatibility:
        """Returns how well sightings (k,) fit landmarks (M,), stretches seen included."""
        e, S = self.innovations(model, table, rows, landmarks)
        fit = compatibility(e, S, model.angular, self.config.matching)
        fit = fit.among(same_label(table.label[rows], self.roster.label[landmarks]))
        near, which = np.nonzero(fit.new <= 1.0)
        if not len(near):
            return fit
        gap = np.zeros(fit.new.shape)
        gap[near, which] = stretch_gap(
            model,
            np.broadcast_to(self.state.mean[:3], (len(near), 3)),
            self.look_up(model, landmarks)[1][which],
            self.roster.extent[landmarks[which]],
            table.z[rows[near]],
            table.extent[rows[near]],
        )
        beyond = gap / self.config.matching.gap_m
        return Compatibility(fit.match + beyond, fit.new + beyond)

    def find_jointly(
        self,
        model: Model,
        table: Sightings,
        rows: IntArray,
        landmarks: IntArray,
        fit: Compatibility,
        taken: AnyArray,
    ) -> IntArray:
        """Returns the place in ``landmarks`` of each sighting's by joint compatibility."""
        found = leftover(fit)
        near, which = np.nonzero((fit.match <= 1.0) & ~taken)
        if len(near):
            columns, params, free = self.look_up(model, landmarks[which])
            e, J_p, J_l = self.residual(model, self.state.mean[:3], params, table.z[rows[near]])
            J_l *= free
            cov = table.cov[rows[near]]
            S = self.state.joint_innovation_covariance(J_p, J_l, columns, cov)
            chosen = jcbb(near, which, e, S, self.config.matching.gate)
            found[near[chosen]] = which[chosen]
        return found

    def residual(
        self, model: Model, pose: Array, params: Array, z: Array
    ) -> tuple[Array, Array, Array]:
        """Returns residuals of sightings with their Jacobians; see `Model.residual`."""
        return model.residual(pose, params, z)

    def innovations(
        self, model: Model, table: Sightings, rows: IntArray, landmarks: IntArray
    ) -> tuple[Array, Array]:
        """Returns residuals (k, M, d) and their covariances (k, M, d, d) for all pairs."""
        columns, params, free = self.look_up(model, landmarks)
        e, J_p, J_l = self.residual(model, self.state.mean[:3], params, table.z[rows, None])
        J_l *= free
        return e, self.state.innovation_covariance(J_p, J_l, columns, table.cov[rows])

    def look_up(self, model: Model, landmarks: IntArray) -> tuple[IntArray, Array, Array]:
        """Returns landmarks' places (M, l) in the state, their parameters (M, l) and who is free.

        A known landmark has no place in the state: it is given the first one, and its Jacobians
        are to be multiplied by its zero in ``free`` (M, 1, 1).
        """
        if not model.dim_landmark:
            none = np.zeros((len(landmarks), 0))
            return none.astype(np.int64), none, np.ones((len(landmarks), 1, 1))
        offsets = self.roster.offset[landmarks]
        free = offsets != FIXED
        columns = np.where(free, offsets, 0)[:, None] + np.arange(model.dim_landmark)
        params = self.state.mean[columns]
        if not free.all():  # the known ones' table may be narrower than this kind
            params[~free] = self.known[landmarks[~free], : model.dim_landmark]
        return columns, params, free[:, None, None].astype(np.float64)

    # ---- what should be there --------------------------------------------------------------

    def note_seen(
        self, node: int, model: Model, table: Sightings, rows: IntArray, landmarks: IntArray
    ) -> None:
        """Notes which stretches of landmarks the sightings saw, and what the view is."""
        params = self.look_up(model, landmarks)[1]
        pose = np.broadcast_to(self.state.mean[:3], (len(rows), 3))
        z, extent = table.z[rows], table.extent[rows]
        stretch = model.extent_on_landmark(pose, params, z, extent)
        self.roster.saw(landmarks, node, stretch)
        if self.recognises and isinstance(model, Stretched):
            self.views.setdefault(table.kind, FieldOfView()).see(model.ends(z, extent))

    def expected(self, node: int, model: Model) -> IntArray:
        """Returns the landmarks of a kind that a node should see, by where the pose is now."""
        view = self.views.get(model.kind)
        if view is None or not isinstance(model, Stretched):
            return np.zeros(0, np.int64)
        landmarks = self.candidates(node, model.kind)
        ends = model.ends(self.look_up(model, landmarks)[1], self.roster.extent[landmarks])
        shown = view.shows(transform_points(inverse(self.state.mean[:3]), ends))
        return np.asarray(landmarks[shown])

    def should_start(self, node: int, model: Model, table: Sightings, row: int) -> bool:
        """Returns whether a sighting of no landmark may start one.

        It may not while the filter is lost; nor where landmarks should be seen and none is; nor
        beside one that should be seen and is not: that is a displaced robot, not a new landmark.
        """
        if self.is_lost:
            self.counts["sighting of no landmark while lost"] += 1
            return False
        rows = self.expected(node, model)
        rows = rows[self.roster.confirmed[rows]]
        missing = rows[self.roster.last[rows] != node]
        if not len(missing):
            return True
        displaced = len(missing) == len(rows)
        if not displaced:
            params = self.look_up(model, missing)[1]
            e = self.residual(model, self.state.mean[:3], params, table.z[row])[0]
            limits = np.where(model.angular, math.radians(BESIDE_DEG), BESIDE_M)
            displaced = bool(np.any(np.all(np.abs(e) < limits, axis=1)))
        self.counts["sighting instead of a landmark that should be seen"] += displaced
        return not displaced

    @property
    def is_lost(self) -> bool:
        """Whether the filter has said 'lost' and not found itself yet."""
        patience = self.config.lost_after if self.recognises else 0
        return bool(patience) and self.rejected_in_a_row >= patience

    def after_node(self, node: int) -> None:
        """Judges a node as a whole: is the filter lost, and which landmarks are not there?"""
        matched, dropped = self.tally.tolist()
        self.tally[:] = 0
        if not self.recognises:
            return
        if dropped > matched:
            self.rejected_in_a_row += 1
        elif matched:
            self.rejected_in_a_row = 0
        if self.is_lost:
            self.widen()
        elif matched:
            self.miss_landmarks(node)

    def widen(self) -> None:
        """Takes the odometry for worse than stated, twice as bad with every node."""
        beyond = self.rejected_in_a_row - self.config.lost_after
        self.counts[LOST] += beyond == 0
        factor = 4.0 ** min(beyond + 1, MOST_DOUBLINGS)
        self.state.add_pose_noise(self.config.lost_after * factor * self.last_Q)

    def miss_landmarks(self, node: int) -> None:
        """Notes which landmarks were not seen that should be, and removes those missed too often.

        Nodes that saw no landmark that counts say nothing: there the pose may be wrong.
        """
        roster = self.roster
        for kind in self.views:
            self.roster.expect(self.expected(node, MODELS[kind]), node)
        for row in roster.doubtful().tolist():
            self.remove(row)
