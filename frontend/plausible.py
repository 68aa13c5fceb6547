"""Pose fixes held against the odometry between them: which are the robot's, which something else's.

A camera that takes something else for the robot, or one tag for the other, is not noisy: it is
wrong, and an estimator that believes it goes wrong with it. Odometry tells: it knows poorly where
the robot is, but well how it moved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from graphslam.geometry import Array, between, transform_points, wrap
from graphslam.measurements import IntArray, Odometry

TURNED = "pose fix turned by half a turn against odometry: were the tags exchanged?"
CONTRADICTED = "pose fix that odometry contradicts"
BREAKS = "place where odometry and the pose fixes part: wheels slipped, or the robot was lifted"

SIGMAS = 5.0
"""Differences within so many standard deviations contradict nothing."""
BACK = (1, 2, 4, 8, 16, 32, 64)
"""A fix is held against those so many before it in its track: a short way tells jumps, a long one
what creeps."""
LEAST = 10
"""A track that is not the main one needs so many fixes to count."""
MOST_TRACKS = 6
"""Tracks that a fix is tried with, those that grew last first."""


@dataclass(slots=True)
class _Track:
    """Fixes that odometry joins.

    Attributes:
        rows: which they are; -1 is the start.
        moved: whether the robot moved so far within it that fixes which did not move with it, or
            moved backwards, would have fallen out.
    """

    rows: list[int] = field(default_factory=list)
    moved: bool = False


class _Path:
    """Dead reckoning with the growth of its uncertainty, and the fixes on it."""

    def __init__(self, odometry: Odometry, node: IntArray, z: Array, cov: Array) -> None:
        step = odometry.increment
        heading = np.concatenate([[0.0], np.cumsum(step[:, 2])])
        moved = transform_points(
            np.column_stack([np.zeros((len(step), 2)), heading[:-1]]), step[:, :2]
        )
        place = np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
        self.odometry = np.column_stack([place, heading])[node]
        spread = np.trace(odometry.cov[:, :2, :2], axis1=1, axis2=2)
        growth = [np.hypot(step[:, 0], step[:, 1]), spread, odometry.cov[:, 2, 2]]
        self.length, self.spread, self.turn = (
            np.concatenate([[0.0], np.cumsum(column)])[node] for column in growth
        )
        self.z, self.cov = z, cov
        self.variance = np.trace(cov[:, :2, :2], axis1=1, axis2=2)

    def limits(self, i: IntArray, j: int) -> tuple[Array, Array, Array]:
        """Returns how far (k,) fix j may be from where fixes i (k,) and odometry put it: m, rad.

        And how far odometry says that it is from each, m. Uncertainties are added up as if each
        error of the heading acted over the whole way: an upper bound.
        """
        way = self.length[j] - self.length[i]
        heading = self.turn[j] - self.turn[i]
        straight = np.hypot(*(self.odometry[j, :2] - self.odometry[i, :2]).T)
        place = (
            self.spread[j] - self.spread[i] + heading * way**2
            + self.cov[i, 2, 2] * straight**2 + self.variance[i] + self.variance[j]
        )  # fmt: skip
        angle = heading + self.cov[i, 2, 2] + self.cov[j, 2, 2]
        return SIGMAS * np.sqrt(place), SIGMAS * np.sqrt(angle), straight

    def off(self, i: IntArray, j: int) -> Array:
        """Returns fix j (k, 3) as seen from fixes i (k,), less what odometry says; m and rad."""
        seen = between(self.z[i], self.z[j])
        driven = between(self.odometry[i], self.odometry[j])
        return np.column_stack([seen[:, :2] - driven[:, :2], wrap(seen[:, 2] - driven[:, 2])])

    def fits(self, track: _Track, j: int) -> bool:
        """Returns whether fix j goes on a track; notes whether the robot moved enough to tell."""
        i = self.members(track)
        place, angle, straight = self.limits(i, j)
        off = self.off(i, j)
        fits = np.all(np.hypot(off[:, 0], off[:, 1]) <= place) and np.all(
            np.abs(off[:, 2]) <= angle
        )
        if fits:
            # what stood still is off by the way, what is turned round by twice as much
            track.moved |= bool(np.any(straight > place))
        return fits

    def turned(self, track: _Track, j: int) -> bool:
        """Returns whether fix j would have the heading of a track if it were turned round."""
        rows = np.array(track.rows)
        i = rows[[int(np.argmin(np.abs(rows - j)))]]
        angle = self.limits(np.minimum(i, j), int(np.maximum(i, j)[0]))[1]
        return bool(np.abs(wrap(self.off(i, j)[:, 2] - np.pi)) <= angle)

    def members(self, track: _Track) -> IntArray:
        """Returns the fixes of a track that the next one is held against."""
        return np.array([track.rows[-k] for k in BACK if k <= len(track.rows)])


def plausible_fixes(
    odometry: Odometry,
    node: IntArray,
    z: Array,
    cov: Array,
    start: tuple[Array, Array] | None,
) -> tuple[NDArray[np.bool_], Mapping[str, int], IntArray]:
    """Returns which fixes (K,) are the robot's, why others are not, and where odometry broke.

    Fixes form tracks: each belongs to the first whose fixes, with the odometry since, lead to it.
    The main track is that of the start, where the start is known, else the longest. Others count
    where they are long and the robot moved in them: then odometry jumped, not the camera. The rest
    is left out.

    Args:
        odometry: between the nodes.
        node: (K,) node of each fix, not decreasing.
        z: (K, 3) poses, floor frame.
        cov: (K, 3, 3) their covariances as the sensor's noise has them, floor frame.
        start: pose (3,) at node 0 and its covariance (3, 3), where it is known; else None.

    Returns:
        The mask (K,), counts by reason, and the first fix of each track that counts beside the
        main one.
    """
    if start is not None:  # the start is a fix like any other, before all others
        node = np.concatenate([[0], node])
        z, cov = np.concatenate([start[0][None], z]), np.concatenate([start[1][None], cov])
    first = int(start is not None)
    path = _Path(odometry, node, z, cov)
    tracks = [_Track([0])] if first else []
    for j in range(first, len(node)):
        latest = sorted(tracks, key=lambda track: -track.rows[-1])[:MOST_TRACKS]
        longest = sorted(tracks, key=lambda track: -len(track.rows))[:1]
        home = next((t for t in [*longest, *latest, *tracks[:first]] if path.fits(t, j)), None)
        if home is None:
            tracks.append(_Track([j]))
        else:
            home.rows.append(j)
    kept, counts, breaks = np.zeros(len(node), bool), Counter[str](), []
    main = max(tracks, key=lambda track: len(track.rows), default=None)
    if first and len(tracks[0].rows) > 1:
        main = tracks[0]
    for track in tracks:
        other = track is not main
        if not other or (len(track.rows) >= LEAST and track.moved):
            kept[track.rows] = True
            if other and track.rows != [0]:
                breaks.append(track.rows[0] - first)
    for track in tracks:
        if main is None or kept[track.rows[0]] or track.rows == [0] * first:
            continue
        for j in track.rows:
            counts[TURNED if path.turned(main, j) else CONTRADICTED] += 1
    return kept[first:], counts, np.array(breaks, np.int64)
