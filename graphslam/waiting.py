"""Sightings that cannot start a landmark yet: the filter keeps the poses that they were made from.

A copy of the pose stays in the state, with all its correlations (stochastic cloning), until enough
sightings of one landmark are there. Then all of them count: the part of them that fixes the
landmark starts it, the part that no landmark explains corrects the poses. To first order this is
what a smoother makes of the same sightings.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from graphslam.association import gate_for
from graphslam.geometry import Array, wrap
from graphslam.measurements import IntArray, Sightings
from graphslam.models import Model
from graphslam.models.base import Delayed

if TYPE_CHECKING:
    from graphslam.ekf import Filter

NOT_YET = "sighting that could not start a landmark yet"
NO_LANDMARK = "sighting that does not fit the others of the landmark it should start"
THINNED = "sighting left out while its landmark could not start"

MOST_SIGHTINGS = 12
"""Of one landmark that are kept waiting; beyond it every second one is left out."""
MOST_TRACKS = 30
"""Landmarks that wait at a time; the one unseen for longest goes first."""
STALE = 40
"""Nodes after which a landmark that waits, and is not seen again, is forgotten."""
CLEARER = 0.5
"""Of two waiting landmarks the likelier one is taken if it is unlike by less than this share of the
other's."""
WORST_CONDITION = 1e4
"""With a given linearisation: condition number up to which sightings start a landmark."""


@dataclass(slots=True)
class Track:
    """Sightings of one landmark that has not started.

    Attributes:
        kind: of the sightings.
        name: what tells it apart where matches are given: true identity, or landmark; else -1.
        label: of the sightings; -1 for none.
        rows: in the table of sightings.
        nodes: of the sightings, in order.
    """

    kind: str
    name: int
    label: int
    rows: list[int] = field(default_factory=list)
    nodes: list[int] = field(default_factory=list)


class Waiting:
    """All that waits in one run of the filter.

    Attributes:
        tracks: in order of appearance.
        places: where the copy of each node's pose stands in the state, by node.
    """

    def __init__(self, run: Filter) -> None:
        self.run = run
        self.tracks: list[Track] = []
        self.places: dict[int, int] = {}

    def __bool__(self) -> bool:
        return bool(self.tracks)

    def columns(self) -> IntArray:
        """Returns the entries of the state that are copies of poses."""
        return self._columns(list(self.places))

    def take(self, node: int, model: Model, table: Sightings, row: int, first: int) -> int | None:
        """Keeps a sighting; returns the landmark that it starts with earlier ones, None if none."""
        assert isinstance(model, Delayed), "its own sighting did not start it"
        run = self.run
        name = -1
        if run.at is not None:
            name = int(run.at.match[first + row])
        elif not run.recognises:
            name = int(table.truth[row])
        track = self._track(node, model, table, row, name)
        if track is None:
            run.counts[NOT_YET] += 1
            return None
        if node not in self.places:
            pose = run.state.mean[:3].copy()
            self.places[node] = run.state.add(pose, np.eye(3), np.zeros((3, 3)))
        track.rows.append(row)
        track.nodes.append(node)
        started = self._start(track, model, table, first)
        if started is None and len(track.rows) > MOST_SIGHTINGS:
            run.counts[THINNED] += len(track.rows[1:-1:2])
            del track.rows[1:-1:2], track.nodes[1:-1:2]
        return started

    def after_node(self, node: int) -> None:
        """Forgets what was not seen for long, and copies that nothing waits for."""
        run = self.run
        if run.recognises:
            stale = [t for t in self.tracks if t.nodes[-1] < node - STALE]
            spare = sorted(self.tracks, key=lambda t: t.nodes[-1])[:-MOST_TRACKS]
            self.forget([*stale, *(t for t in spare if t not in stale)], NOT_YET)
        self._drop_copies()

    def forget(self, tracks: list[Track], reason: str) -> None:
        """Gives up tracks and counts their sightings."""
        self.run.counts[reason] += sum(len(track.rows) for track in tracks)
        self.tracks = [track for track in self.tracks if track not in tracks]

    def forget_all(self) -> None:
        """Gives up all that waits and takes the copies out of the state."""
        self.forget(self.tracks, NOT_YET)
        self._drop_copies()

    def close_gap(self, at: int, length: int) -> None:
        """Moves up the places behind ``length`` entries that were taken out of the state."""
        self.places = {n: p - length if p > at else p for n, p in self.places.items()}

    # ---- which track -----------------------------------------------------------------------

    def _track(
        self, node: int, model: Delayed, table: Sightings, row: int, name: int
    ) -> Track | None:
        """Returns the track of a sighting, new where it has none; None where it is unclear."""
        label = int(table.label[row])
        near = [t for t in self.tracks if t.kind == table.kind and t.name == name]
        if self.run.recognises:
            same = [t for t in near if t.label == label or -1 in (t.label, label)]
            same = [t for t in same if t.nodes[-1] != node]
            unlike = [self._unlike(track, model, table, row) for track in same]
            order = np.argsort(unlike, kind="stable")
            near = [same[i] for i in order if unlike[i] <= 1.0]
            if len(near) > 1 and unlike[order[0]] > CLEARER * unlike[order[1]]:
                return None
        if not near:
            near = [Track(table.kind, name, label)]
            self.tracks.append(near[0])
        return near[0]

    def _unlike(self, track: Track, model: Delayed, table: Sightings, row: int) -> float:
        place = self.places[track.nodes[-1]]
        then, now = self.run.state.mean[place : place + 3], self.run.state.mean[:3]
        return model.unlike(then, table.z[track.rows[-1]], now, table.z[row])

    # ---- starting --------------------------------------------------------------------------

    def _start(self, track: Track, model: Model, table: Sightings, first: int) -> int | None:
        """Starts a landmark from all sightings of a track; None where they do not suffice yet."""
        run = self.run
        rows, columns = np.array(track.rows), self._columns(track.nodes)
        place = columns.reshape(-1, 3)
        poses, landmark = self._linearisation(track, model, table, place)
        if landmark is None:
            return None
        at = np.array(track.nodes)
        measured = run.measure_waiting(model, at, poses, landmark, table.z[rows], table.cov[rows])
        if measured is None:
            return None
        e, J_p, J_l = measured
        whiten = np.linalg.inv(np.linalg.cholesky(table.cov[rows]))
        A = (whiten @ J_l).reshape(-1, model.dim_landmark)
        B = scipy.linalg.block_diag(*(whiten @ J_p))
        if len(A) < model.dim_landmark or not np.linalg.cond(A) < WORST_CONDITION:
            return None

        def residual() -> Array:
            """Returns the whitened residuals, linear in the copies of the poses."""
            off = run.state.mean[place] - poses
            off[:, 2] = wrap(off[:, 2])
            return np.asarray((whiten @ (e + (J_p @ off[..., None])[..., 0])[..., None]).ravel())

        Q, R = np.linalg.qr(A, mode="complete")
        fixes, left = Q[:, : model.dim_landmark], Q[:, model.dim_landmark :]
        if left.shape[1] and not self._correct(left.T @ residual(), left.T @ B, columns):
            self.forget([track], NO_LANDMARK)
            return None
        solve = -np.linalg.solve(R[: model.dim_landmark], fixes.T)
        offset = run.state.add(
            landmark + solve @ residual(), solve @ B, solve @ solve.T, columns=columns
        )
        added = run.roster.add(
            table.kind, offset, int(table.truth[rows[-1]]), max(track.name, -1), track.label
        )
        run.roster.seen[added] += len(rows) - 1  # the last is noted as any other sighting
        run.match[first + rows], run.used[first + rows] = added, True
        self.tracks.remove(track)
        return added

    def _linearisation(
        self, track: Track, model: Model, table: Sightings, place: IntArray
    ) -> tuple[Array, Array | None]:
        run, rows = self.run, np.array(track.rows)
        if run.at is not None:
            landmark = run.at.map.params[track.name, : model.dim_landmark]
            return run.at.pose[track.nodes], landmark
        assert isinstance(model, Delayed), "its own sighting did not start it"
        poses = run.state.mean[place]
        relative = self._relative_covariance(place, poses)
        return poses, model.initialise_from(poses, relative, table.z[rows], table.cov[rows])

    def _correct(self, e: Array, J: Array, columns: IntArray) -> bool:
        """Corrects the copies of poses by what no landmark explains; False where it is too much."""
        run, size = self.run, len(e)
        if run.recognises:
            S = J @ run.state.P[np.ix_(columns, columns)] @ J.T + np.eye(size)
            if e @ np.linalg.solve(S, e) > gate_for(run.config.matching.gate, size):
                return False
        nothing = np.zeros((1, size, 3))
        run.state.correct(-e[None], nothing, J[None], columns[None], np.eye(size)[None])
        return True

    def _relative_covariance(self, place: IntArray, poses: Array) -> Array:
        """Returns the covariance (3 k, 3 k) of copies of poses as seen from the last of them."""
        count = len(place)
        T = np.eye(3 * count)
        for i, (dx, dy, _) in enumerate(poses - poses[-1]):
            T[3 * i : 3 * i + 3, -3:] -= np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0, 0, 1.0]])
        columns = place.ravel()
        return np.asarray(T @ self.run.state.P[np.ix_(columns, columns)] @ T.T)

    # ---- copies of poses -------------------------------------------------------------------

    def _columns(self, nodes: list[int]) -> IntArray:
        first = np.array([self.places[node] for node in nodes], np.int64)
        return (first[:, None] + np.arange(3)).ravel()

    def _drop_copies(self) -> None:
        needed = {node for track in self.tracks for node in track.nodes}
        for node in [node for node in self.places if node not in needed]:
            at = self.places.pop(node)
            self.run.state.remove(at, 3)
            self.run.roster.close_gap(at, 3)
            self.close_gap(at, 3)
