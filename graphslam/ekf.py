"""EKF-SLAM: the pose and a growing map of landmarks, updated node by node (SantanaSLAM)."""

from __future__ import annotations

from collections import Counter

import numpy as np

from graphslam.association import DROPPED, NEW, mahalanobis
from graphslam.config import EkfConfig
from graphslam.ekf_matching import Matcher
from graphslam.ekf_result import History, result
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate, Told
from graphslam.geometry import Array, compose
from graphslam.kalman import JointState
from graphslam.landmarks import padded
from graphslam.late import Arrivals, Past
from graphslam.measurements import IntArray, Measurements, Sightings
from graphslam.models import MODELS, Model
from graphslam.models.odometry import transition
from graphslam.roster import FIXED
from graphslam.waiting import Waiting

UNCONFIRMED = "sighting of a landmark that was seen too few times to count"
REMOVED = "sighting of a landmark that was removed: no longer seen where it should be"


def run_ekf(
    measurements: Measurements,
    config: EkfConfig | None = None,
    linearise_at: Estimate | None = None,
    told: Told | None = None,
) -> Estimate:
    """Returns the path as each pose was known at its time, and the map at the end.

    Args:
        measurements: nodes, odometry, sightings. Where it has known landmarks this is localisation
            (SantanaLoc): they stay where they are, and none is added unless the configuration says
            so.
        config: matching, which landmarks count, and what to do when lost.
        linearise_at: where given, every model is linearised at this path and map, and its matches
            are used: the filter is then exactly linear and agrees with a smoother linearised at
            the same point.
        told: called after each node.

    Raises:
        BadMeasurements: ``linearise_at`` does not belong to these measurements.
    """
    return Filter(measurements, config or EkfConfig(), linearise_at).run(told)


def innovation_log_likelihood(measurements: Measurements, at: Estimate) -> float:
    """Returns the log-likelihood of all innovations under the noise that the measurements state.

    The filter is linearised at ``at`` and takes its matches, so that measurements which differ in
    their covariances only can be compared. The sightings that start landmarks do not count: a
    landmark has no prior.

    Args:
        measurements: nodes, odometry, sightings, with the covariances to be judged.
        at: path, map and matches; an estimate from the same nodes and sightings.

    Raises:
        BadMeasurements: ``at`` does not belong to these measurements.
    """
    run = Filter(measurements, EkfConfig(), at)
    run.filter()
    return run.state.log_likelihood


class Filter(Matcher):
    """One run of the filter: the joint state, and what became of each sighting.

    Filters that differ in a model override `residual` or `motion`, those that linearise elsewhere
    `linearisation` and `measure_waiting`, those that match otherwise `find` or `candidates`.

    Attributes:
        name: of the method.
        measurements, config, at: what the run was given.
        state: mean and covariance of pose and landmarks.
        roster: the landmarks; rows of it name them below.
        match: (K,) landmark of each sighting, -1 where it has none.
        used: (K,) whether the sighting is used.
        nis: (K,) squared normalised innovation; NaN where not used or where it started a landmark.
        counts: what happened to sightings, by reason.
        innovation: (N, 2) joint squared normalised innovation of each node, and its freedom.
        history: the landmarks' variances, node by node.
        waiting: sightings that cannot start a landmark yet.
    """

    name = "ekf"

    def __init__(self, measurements: Measurements, config: EkfConfig, at: Estimate | None) -> None:
        if at is not None and (
            len(at.t) != len(measurements.t) or len(at.match) != measurements.sighting_count
        ):
            raise BadMeasurements("linearise_at is an estimate from other measurements")
        self.measurements, self.config, self.at = measurements, config, at
        self.state = JointState(measurements.start_pose, measurements.start_cov)
        super().__init__(config.confirm_after if self.recognises else 1)
        self.known = padded([]) if measurements.known is None else measurements.known.params
        count = measurements.sighting_count
        self.match = np.full(count, -1)
        self.used = np.zeros(count, bool)
        self.nis = np.full(count, np.nan)
        self.counts: Counter[str] = Counter()
        self.innovation = np.zeros((len(measurements.t), 2))
        self.history = History(len(measurements.t))
        self.waiting = Waiting(self)

    def run(self, told: Told | None = None) -> Estimate:
        """Returns what filtering all nodes gives; calls ``told`` after each."""
        return self.finish(*self.filter(told))

    def filter(self, told: Told | None = None) -> tuple[Array, Array]:
        """Returns the poses (N, 3) and covariances (N, 3, 3) as each was known at its time."""
        nodes = len(self.measurements.t)
        pose, cov = np.empty((nodes, 3)), np.empty((nodes, 3, 3))
        arrivals, past = Arrivals(self.measurements, self.config.late_s), Past(self)
        for now in range(nodes + arrivals.after_last):
            back = arrivals.back(now)
            if back < now:
                past.go_back(back)
            for node in range(back, min(now + 1, nodes)):
                if arrivals.awaits(node, now):
                    past.keep(node)
                self.take_node(node, arrivals, now)
            past.forget(arrivals, now)
            at = min(now, nodes - 1)
            pose[at], cov[at] = self.state.mean[:3], self.state.P[:3, :3]
            if told is not None and now < nodes:
                told(now)
        self.waiting.forget_all()
        for row in self.roster.tentative().tolist():
            self.remove(row)
        self.counts.update(arrivals.counts)
        return pose, cov

    def take_node(self, node: int, arrivals: Arrivals, now: int) -> None:
        """Comes to a node and takes those of its sightings that are known at node ``now``."""
        if node > 0:
            self.predict(node - 1)
        before = self.state.innovation.copy()
        for first, table in arrivals.tables:
            rows = arrivals.rows(table, node, now)
            if len(rows):
                self.take_sightings(node, table, rows, first)
        self.innovation[node] = self.state.innovation - before
        self.after_node(node)
        self.waiting.after_node(node)
        self.history.remember(self.roster, self.state, self.waiting.columns())

    # ---- prediction ------------------------------------------------------------------------

    def predict(self, i: int) -> None:
        """Moves the state from node i to i + 1. Source: SantanaSLAM eq. (2)."""
        odometry, state = self.measurements.odometry, self.state
        increment = odometry.increment[i]
        if self.at is None:
            here, there = state.mean[:3].copy(), compose(state.mean[:3], increment)
        else:
            here, there = self.at.pose[i], self.at.pose[i + 1]
        F, Q, offset = self.motion(here, there, increment, odometry.cov[i])
        state.move(there + F @ state.deviation(here) + offset, F, Q)
        self.last_Q = Q

    def motion(
        self, here: Array, there: Array, increment: Array, cov: Array
    ) -> tuple[Array, Array, Array]:
        """Returns the linear motion model F, Q and offset; see `transition`."""
        return transition(here, there, increment, cov)

    # ---- sightings -------------------------------------------------------------------------

    def take_sightings(self, node: int, table: Sightings, rows: IntArray, first: int) -> None:
        """Matches one node's sightings of one kind, updates, and starts new landmarks."""
        model = MODELS[table.kind]
        if not model.dim_landmark:
            self.update(node, model, table, rows, np.full(len(rows), -1), first)
            return
        found = self.find(node, model, table, rows, first)
        self.take(node, model, table, rows, found, first)
        left = found < 0
        if self.recognises and left.any() and not left.all():
            # the others have corrected the pose: what is left may be clearer now
            found[left] = self.find(node, model, table, rows[left], first)
            self.take(node, model, table, rows[left], found[left], first)
        known = self.config.matching.method == "known"
        reason = "sighting without a true landmark" if known else "sighting between the gates"
        self.counts[reason] += int(np.sum(found == DROPPED))
        matched = int(self.roster.confirmed[found[found >= 0]].sum())
        given = self.measurements.known
        if given is None or table.kind not in given.kind or self.config.extend_map:
            for i in np.flatnonzero(found == NEW):
                found[i] = self.take_new(node, model, table, int(rows[i]), first)
        else:
            self.counts["sighting of no known landmark"] += int(np.sum(found == NEW))
        self.tally += np.array([matched, np.sum(found == DROPPED)])

    def take(
        self, node: int, model: Model, table: Sightings, rows: IntArray, found: IntArray, first: int
    ) -> None:
        """Corrects the state by the matched ones among sightings of one node."""
        rows, found = rows[found >= 0], found[found >= 0]
        if len(rows):
            self.update(node, model, table, rows, found, first)
            self.note_seen(node, model, table, rows, found)

    def take_new(self, node: int, model: Model, table: Sightings, row: int, first: int) -> int:
        """Starts a landmark, unless one that this node has just started explains the sighting.

        Returns its row, `DROPPED` where the sighting contradicts the map, else `NEW`.
        """
        one = np.array([row])
        found = self.find(node, model, table, one, first)
        if found[0] != NEW:
            if self.recognises:
                self.counts["second sighting of a new landmark in one node"] += 1
                return NEW
            self.take(node, model, table, one, found, first)
            return int(found[0])
        if not self.should_start(node, model, table, row):
            return DROPPED
        started = self.start_landmark(node, model, table, row, first)
        if started is None:
            return NEW
        self.note_seen(node, model, table, one, np.array([started]))
        return started

    def linearisation(self, node: int, model: Model, landmarks: IntArray) -> tuple[Array, Array]:
        """Returns the pose (3,) and landmarks (k, l) at which to linearise."""
        if self.at is None:
            return self.state.mean[:3].copy(), self.look_up(model, landmarks)[1]
        if not model.dim_landmark:
            return self.at.pose[node], np.zeros((len(landmarks), 0))
        given = self.roster.given[landmarks]
        return self.at.pose[node], self.at.map.params[given, : model.dim_landmark]

    def update(
        self,
        node: int,
        model: Model,
        table: Sightings,
        rows: IntArray,
        landmarks: IntArray,
        first: int,
    ) -> None:
        """Updates the state with matched sightings of one node in one step."""
        if not len(rows):
            return
        columns, current, free = self.look_up(model, landmarks)
        pose, params = self.linearisation(node, model, landmarks)
        e, J_p, J_l = self.residual(model, pose, params, table.z[rows])
        J_l *= free
        innovation = -e - J_p @ self.state.deviation(pose)
        innovation -= (J_l @ (current - params)[..., None])[..., 0]
        own = self.state.correct(innovation, J_p, J_l, columns, table.cov[rows])
        self.note_used(first + rows, landmarks, mahalanobis(innovation, own))

    def note_used(self, sightings: IntArray, landmarks: IntArray, nis: Array) -> None:
        """Notes that sightings (k,), by number over all tables, have corrected the state."""
        self.match[sightings] = landmarks
        self.used[sightings] = True
        self.nis[sightings] = nis

    def start_landmark(
        self, node: int, model: Model, table: Sightings, row: int, first: int
    ) -> int | None:
        """Adds a landmark with its full covariance, cross terms included; None if not yet."""
        z, cov, given = table.z[row], table.cov[row], -1
        started = model.initialise(self.state.mean[:3], z, cov)
        if started is None:
            return self.waiting.take(node, model, table, row, first)
        landmark, J_pose, J_z = started
        if self.at is not None:
            given = int(self.at.match[first + row])
            landmark, J_pose, J_z = self.start_at(node, model, z, given)
        offset = self.state.add(landmark, J_pose, J_z @ cov @ J_z.T)
        return self.admit(table, row, first, offset, given)

    def measure_waiting(
        self, model: Model, nodes: IntArray, poses: Array, landmark: Array, z: Array, cov: Array
    ) -> tuple[Array, Array, Array] | None:
        """Returns residuals and Jacobians of waiting sightings at what they start; None: not yet.

        Args:
            model: of the sightings.
            nodes: (k,) where they were made.
            poses: (k, 3) the poses of these nodes as they are known now, floor frame.
            landmark: (l,) what the sightings start.
            z: (k, d) the sightings.
            cov: (k, d, d) their covariances.
        """
        return self.residual(model, poses, landmark, z)

    def admit(self, table: Sightings, row: int, first: int, offset: int, given: int = -1) -> int:
        """Enters a landmark that one sighting put at ``offset`` of the state; returns its row."""
        truth, label = int(table.truth[row]), int(table.label[row])
        added = self.roster.add(table.kind, offset, truth, given, label)
        self.match[first + row] = added
        self.used[first + row] = True
        return added

    def start_at(self, node: int, model: Model, z: Array, given: int) -> tuple[Array, Array, Array]:
        """Returns a new landmark by solving the residual linearised at the given point."""
        assert self.at is not None
        pose, params = self.at.pose[node], self.at.map.params[given, : model.dim_landmark]
        e, J_p, J_l = model.residual(pose, params, z)
        inverse = np.asarray(np.linalg.inv(J_l), dtype=np.float64)
        J_pose = -inverse @ J_p
        return (
            params - inverse @ e + J_pose @ self.state.deviation(pose),
            J_pose,
            inverse,
        )

    def remove(self, row: int) -> None:
        """Takes a landmark out of the state; its sightings are rejected in the end."""
        reason = REMOVED if self.roster.confirmed[row] else UNCONFIRMED
        self.counts[reason] += int(np.count_nonzero(self.match == row))
        assert self.roster.offset[row] != FIXED, "known landmarks stay"
        at = int(self.roster.offset[row])
        self.roster.remove(row, self.state)
        self.waiting.close_gap(at, MODELS[self.roster.kinds[row]].dim_landmark)

    def finish(self, pose: Array, cov: Array) -> Estimate:
        """Returns the state as an estimate; landmarks get their one name only here."""
        return result(self, pose, cov)
