"""EKF-SLAM: the pose and a growing map of landmarks, updated node by node (SantanaSLAM)."""

from __future__ import annotations

from collections import Counter

import numpy as np

from graphslam.association import DROPPED, NEW, mahalanobis, match
from graphslam.baseline import propagate
from graphslam.config import EkfConfig
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose
from graphslam.information import position_information, unobserved_directions
from graphslam.kalman import JointState
from graphslam.landmarks import finish_map, padded
from graphslam.measurements import IntArray, LandmarkMap, Measurements, Sightings
from graphslam.models import MODELS, Model
from graphslam.models.odometry import transition

LOST_INFLATION = 2.0
"""Factor on the pose's standard deviations when the filter says that it is lost."""
FIXED = -1
LARGEST_HISTORY = 4_000_000
"""Most entries of the landmarks' variances over time that are kept: 32 MB."""


def run_ekf(
    measurements: Measurements,
    config: EkfConfig | None = None,
    linearise_at: Estimate | None = None,
) -> Estimate:
    """Returns the path as each pose was known at its time, and the map at the end.

    Args:
        measurements: nodes, odometry, sightings. Where it has known landmarks this is localisation
            (SantanaLoc): they stay where they are, and none is added unless the configuration says
            so.
        config: matching and what to do when lost.
        linearise_at: where given, every model is linearised at this path and map, and its matches
            are used: the filter is then exactly linear and agrees with a smoother linearised at
            the same point.

    Raises:
        BadMeasurements: ``linearise_at`` does not belong to these measurements.
    """
    return Filter(measurements, config or EkfConfig(), linearise_at).run()


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


class Filter:
    """One run of the filter: the joint state, and what became of each sighting.

    Filters that differ in a model override `residual` or `motion`, those that linearise elsewhere
    `linearisation`, those that match otherwise `find`.
    """

    def __init__(self, measurements: Measurements, config: EkfConfig, at: Estimate | None) -> None:
        if at is not None and (
            len(at.t) != len(measurements.t) or len(at.match) != measurements.sighting_count
        ):
            raise BadMeasurements("linearise_at is an estimate from other measurements")
        self.measurements, self.config, self.at = measurements, config, at
        self.state = JointState(measurements.start_pose, measurements.start_cov)
        self.kinds: list[str] = []
        self.offsets: list[int] = []  # of each landmark in the state; `FIXED` for known ones
        self.identity: list[int] = []
        self.row_in_given: list[int] = []  # with ``at``: which of its landmarks each of ours is
        self.known = padded([])
        if measurements.known is not None:
            self.take_known(measurements.known)
        count = measurements.sighting_count
        self.match = np.full(count, -1)
        self.used = np.zeros(count, bool)
        self.nis = np.full(count, np.nan)
        self.counts: Counter[str] = Counter()
        self.rejected_in_a_row = 0
        self.history: list[Array] | None = []

    def take_known(self, known: LandmarkMap) -> None:
        """Starts with a known map, whose landmarks are no part of the state."""
        self.known = known.params
        self.kinds += known.kind
        self.offsets += [FIXED] * len(known)
        self.identity += known.id.tolist()
        self.row_in_given += range(len(known))

    def run(self) -> Estimate:
        """Returns what filtering all nodes gives."""
        return self.finish(*self.filter())

    def filter(self) -> tuple[Array, Array]:
        """Returns the poses (N, 3) and covariances (N, 3, 3) as each was known at its time."""
        measurements = self.measurements
        nodes = len(measurements.t)
        pose, cov = np.empty((nodes, 3)), np.empty((nodes, 3, 3))
        starts = {kind: t.starts(nodes) for kind, t in measurements.sightings.items()}
        # what needs no landmark first: a landmark shall start from the best pose of its node
        tables = sorted(measurements.tables(), key=lambda e: MODELS[e[1].kind].dim_landmark > 0)
        for node in range(nodes):
            if node > 0:
                self.predict(node - 1)
            seen = used = 0
            for first, table in tables:
                rows = np.arange(*starts[table.kind][node : node + 2])
                if len(rows):
                    self.take_sightings(node, table, rows, first)
                    seen, used = seen + len(rows), used + int(self.used[first + rows].sum())
            self.notice_being_lost(seen, used)
            pose[node], cov[node] = self.state.mean[:3], self.state.P[:3, :3]
            if self.history is not None:
                self.remember_variances()
        return pose, cov

    def remember_variances(self) -> None:
        """Keeps the landmarks' variances at a node, as long as they are few enough to keep."""
        assert self.history is not None
        self.history.append(np.diagonal(self.state.P)[3:].copy())
        if len(self.measurements.t) * (self.state.size - 3) > LARGEST_HISTORY:
            self.history = None

    def variances_over_time(self) -> Array | None:
        """Returns the landmarks' variances (N, L) at each node, NaN before they were started."""
        if self.history is None:
            return None
        fixed = sum(MODELS[kind].dim_landmark for kind in self.kinds[: len(self.known)])
        out = np.full((len(self.history), fixed + self.state.size - 3), np.nan)
        out[:, :fixed] = 0.0
        for row, variances in zip(out, self.history, strict=True):
            row[fixed : fixed + len(variances)] = variances
        return out

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

    def motion(
        self, here: Array, there: Array, increment: Array, cov: Array
    ) -> tuple[Array, Array, Array]:
        """Returns the linear motion model F, Q and offset; see `transition`."""
        return transition(here, there, increment, cov)

    def residual(
        self, model: Model, pose: Array, params: Array, z: Array
    ) -> tuple[Array, Array, Array]:
        """Returns residuals of sightings with their Jacobians; see `Model.residual`."""
        return model.residual(pose, params, z)

    # ---- sightings -------------------------------------------------------------------------

    def take_sightings(self, node: int, table: Sightings, rows: IntArray, first: int) -> None:
        """Matches one node's sightings of one kind, updates, and starts new landmarks."""
        model = MODELS[table.kind]
        if not model.dim_landmark:
            self.update(node, model, table, rows, np.full(len(rows), -1), first)
            return
        found = self.find(node, model, table, rows, first)
        matched = found >= 0
        self.update(node, model, table, rows[matched], found[matched], first)
        if self.measurements.known is None or self.config.extend_map:
            for row in rows[found == NEW]:
                self.take_new(node, model, table, row, first)
        else:
            self.counts["sighting of no known landmark"] += int(np.sum(found == NEW))
        known = self.config.matching.method == "known"
        reason = "sighting without a true landmark" if known else "sighting between the gates"
        self.counts[reason] += int(np.sum(found == DROPPED))

    def take_new(self, node: int, model: Model, table: Sightings, row: int, first: int) -> None:
        """Starts a landmark, unless one that this node has just started explains the sighting."""
        one = np.array([row])
        found = self.find(node, model, table, one, first)
        if found[0] == NEW:
            if not self.start_landmark(node, model, table, row, first):
                self.counts["sighting that could not start a landmark yet"] += 1
        elif found[0] >= 0 and (self.at or self.config.matching.method == "known"):
            self.update(node, model, table, one, found, first)
        else:
            self.counts["second sighting of a new landmark in one node"] += 1

    def find(
        self, node: int, model: Model, table: Sightings, rows: IntArray, first: int
    ) -> IntArray:
        """Returns the landmark (k,) of each sighting, `NEW` or `DROPPED`."""
        if self.at is not None:
            given = self.at.match[first + rows]
            known = {g: ours for ours, g in enumerate(self.row_in_given)}
            return np.array([known.get(int(g), NEW) if g >= 0 else DROPPED for g in given])
        landmarks = np.flatnonzero([kind == table.kind for kind in self.kinds])
        if not len(landmarks) and self.config.matching.method != "known":
            return np.full(len(rows), NEW)
        e, S = self.innovations(model, table, rows, landmarks)
        identity = np.array([self.identity[m] for m in landmarks], dtype=np.int64)
        found = match(e, S, table.truth[rows], identity, model.angular, self.config.matching)
        matched = found >= 0
        found[matched] = landmarks[found[matched]]
        return found

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
        offsets = np.array([self.offsets[m] for m in landmarks], dtype=np.int64)
        free = offsets != FIXED
        columns = np.where(free, offsets, 0)[:, None] + np.arange(model.dim_landmark)
        params = self.state.mean[columns]
        params[~free] = self.known[landmarks[~free], : model.dim_landmark]
        return columns, params, free[:, None, None].astype(np.float64)

    def linearisation(self, node: int, model: Model, landmarks: IntArray) -> tuple[Array, Array]:
        """Returns the pose (3,) and landmarks (k, l) at which to linearise."""
        if self.at is None:
            return self.state.mean[:3].copy(), self.look_up(model, landmarks)[1]
        if not model.dim_landmark:
            return self.at.pose[node], np.zeros((len(landmarks), 0))
        given = np.array([self.row_in_given[m] for m in landmarks], dtype=np.int64)
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
        state = self.state
        columns, current, free = self.look_up(model, landmarks)
        pose, params = self.linearisation(node, model, landmarks)
        e, J_p, J_l = self.residual(model, pose, params, table.z[rows])
        J_l *= free
        innovation = -e - J_p @ state.deviation(pose)
        innovation -= (J_l @ (current - params)[..., None])[..., 0]
        own = state.correct(innovation, J_p, J_l, columns, table.cov[rows])
        self.match[first + rows] = landmarks
        self.used[first + rows] = True
        self.nis[first + rows] = mahalanobis(innovation, own)

    def start_landmark(
        self, node: int, model: Model, table: Sightings, row: int, first: int
    ) -> bool:
        """Adds a landmark with its full covariance, cross terms included; False if not yet."""
        z, cov = table.z[row], table.cov[row]
        if self.at is None:
            started = model.initialise(self.state.mean[:3], z, cov)
            if started is None:
                return False
            landmark, J_pose, J_z = started
        else:
            given = int(self.at.match[first + row])
            landmark, J_pose, J_z = self.start_at(node, model, z, given)
            self.row_in_given.append(given)
        self.match[first + row] = len(self.kinds)
        self.used[first + row] = True
        self.kinds.append(table.kind)
        self.offsets.append(self.state.add(landmark, J_pose, J_z @ cov @ J_z.T))
        self.identity.append(int(table.truth[row]))
        return True

    def start_at(self, node: int, model: Model, z: Array, given: int) -> tuple[Array, Array, Array]:
        """Returns a new landmark by solving the residual linearised at the given point."""
        assert self.at is not None
        if model.dim_landmark != model.dim_z:
            raise BadMeasurements(
                f"linearise_at: one {model.kind} sighting does not fix a landmark"
            )
        pose, params = self.at.pose[node], self.at.map.params[given, : model.dim_landmark]
        e, J_p, J_l = model.residual(pose, params, z)
        inverse = np.asarray(np.linalg.inv(J_l), dtype=np.float64)
        J_pose = -inverse @ J_p
        return (
            params - inverse @ e + J_pose @ self.state.deviation(pose),
            J_pose,
            inverse,
        )

    def notice_being_lost(self, seen: int, used: int) -> None:
        """Doubles the pose's standard deviations after too many nodes with nothing accepted."""
        if seen:
            self.rejected_in_a_row = 0 if used else self.rejected_in_a_row + 1
        recognises = self.at is None and self.config.matching.method != "known"
        patience = self.config.lost_after if recognises else 0
        if patience and self.rejected_in_a_row >= patience:
            self.counts["lost: every sighting rejected for several nodes"] += 1
            self.rejected_in_a_row = 0
            self.state.inflate_pose(LOST_INFLATION)

    # ---- result ----------------------------------------------------------------------------

    def finish(self, pose: Array, cov: Array) -> Estimate:
        """Returns the state as an estimate; landmarks get their one name only here."""
        m = self.measurements
        dims = [MODELS[kind].dim_landmark for kind in self.kinds]
        known = len(self.known)
        mean, own = self.state.mean, zip(self.offsets[known:], dims[known:], strict=True)
        given = [row[:d] for row, d in zip(self.known, dims, strict=False)]
        params = padded([*given, *(mean[o : o + d] for o, d in own)])
        joint = self.state.joint(3, sum(dims[:known]))
        landmarks, joint = finish_map(m, pose, self.kinds, params, self.match, joint)
        information = position_information(m, pose, landmarks, self.match)
        _, cov_odometry = propagate(m)
        return Estimate(
            method="ekf",
            causal=True,
            t=m.t,
            pose=pose,
            cov_floor=0.5 * (cov + np.swapaxes(cov, 1, 2)),
            map=landmarks,
            cov_joint=joint,
            match=self.match,
            used=self.used,
            nis=self.nis,
            weight=np.ones(len(self.match)),
            unobserved=unobserved_directions(information, joint[:3, :3], cov_odometry[-1]),
            counts={reason: n for reason, n in sorted(self.counts.items()) if n},
            map_variance=self.variances_over_time(),
        )
