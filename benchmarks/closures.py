"""Judges the loops that a map keeps by relative poses that somebody else measured.

Where both ends of a relation see a wall of the map, the relation says whether it is one wall: laid
by it, the two sightings must lie on one line. Nothing of the estimate's own opinion is believed but
which sightings are of one wall, and the step from a row to the relation's place between two rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graphslam.estimate import Estimate
from graphslam.geometry import (
    Array,
    interpolate_poses,
    inverse,
    line_to_floor,
    line_to_robot,
    points_on_line,
    transform_points,
    wrap,
)
from graphslam.measurements import Measurements

LOOP_M = 15.0
"""Way between the ends of a relation from which it is one across a loop, m."""
OFF_M, OFF_DEG = 0.3, 8.0
"""Two sightings farther apart than this are of two walls, whatever the relations' own errors."""
MOST_TURN = np.radians(15.0)
"""A relation between rows is off by a turn of as much, where the robot turns: what all walls agree
on up to this, rad, is taken for its error."""


@dataclass(frozen=True, slots=True)
class Closures:
    """What became of the relations across loops.

    Attributes:
        relations: how many there are.
        closed: at how many of them the map holds walls that both ends see.
        walls: how many walls that makes, one for each relation.
        wrong_walls: how many of these are two walls by the relation.
        wrong: relations at which most of the common walls are two.
    """

    relations: int
    closed: int
    walls: int
    wrong_walls: int
    wrong: int

    def __str__(self) -> str:
        return (
            f"{self.closed} of {self.relations} relations across loops have walls in common; "
            f"{self.wrong_walls} of {self.walls} such walls are two; "
            f"{self.wrong} relations rest on wrong ones"
        )


def judge(measurements: Measurements, estimate: Estimate, relations: Array) -> Closures:
    """Returns what relations (K, >= 5) `row, row, dx, dy, dtheta` say of an estimate's matches."""
    driven = measurements.driven()
    walls = _Walls(measurements, estimate)
    row = np.arange(len(driven), dtype=float)
    count = np.zeros(5, int)
    for first, second, *motion in relations[:, :5].tolist():
        if abs(np.interp(first, row, driven) - np.interp(second, row, driven)) < LOOP_M:
            continue
        pairs = [
            (line, transform_points(np.array(motion), ends))
            for landmark, line in walls.at(first)
            for other, ends in walls.stretches(second)
            if landmark == other
        ]
        turn = float(np.median([_turn(line, ends) for line, ends in pairs])) if pairs else 0.0
        if abs(turn) < MOST_TURN:
            about = _about(np.array(motion[:2]), -turn)
            pairs = [(line, transform_points(about, ends)) for line, ends in pairs]
        bad = [_is_off(line, ends) for line, ends in pairs]
        count += 1, bool(bad), len(bad), sum(bad), 2 * sum(bad) > len(bad)
    return Closures(*count.tolist())


class _Walls:
    """The sightings that an estimate uses, seen from places between its rows."""

    def __init__(self, measurements: Measurements, estimate: Estimate) -> None:
        ((_, self.table),) = measurements.tables()
        self.pose, self.match = estimate.pose, np.where(estimate.used, estimate.match, -1)
        self.starts = self.table.starts(len(self.pose))

    def at(self, place: float) -> list[tuple[int, Array]]:
        """Returns landmark and line (2,) of each sighting of the rows beside, from that place."""
        origin = self._pose_at(place)
        return [
            (m, line_to_robot(line_to_floor(self.table.z[k], pose), origin))
            for k, m, pose in self._beside(place)
        ]

    def stretches(self, place: float) -> list[tuple[int, Array]]:
        """Returns landmark and ends (2, 2) of the stretch of each sighting, from that place."""
        origin = inverse(self._pose_at(place))
        return [
            (
                m,
                transform_points(
                    origin,
                    transform_points(pose, points_on_line(self.table.z[k], self.table.extent[k])),
                ),
            )
            for k, m, pose in self._beside(place)
        ]

    def _pose_at(self, place: float) -> Array:
        return interpolate_poses(
            np.array([place]), np.arange(len(self.pose), dtype=float), self.pose
        )[0]

    def _beside(self, place: float) -> list[tuple[int, int, Array]]:
        rows = sorted({int(np.floor(place)), int(np.ceil(place))})
        return [
            (k, int(self.match[k]), self.pose[row])
            for row in rows
            for k in range(self.starts[row], self.starts[row + 1])
            if self.match[k] >= 0
        ]


def _about(point: Array, turn: float) -> Array:
    """Returns the motion (3,) that turns about a point."""
    moved = point - transform_points(np.array([0.0, 0.0, turn]), point)
    return np.array([*moved, turn])


def _turn(line: Array, ends: Array) -> float:
    """Returns the angle, rad, from a line (2,) to the one through two ends (2, 2), modulo pi."""
    along = ends[1] - ends[0]
    return 0.5 * float(wrap(2.0 * (np.arctan2(-along[0], along[1]) - line[1])))


def _is_off(line: Array, ends: Array) -> bool:
    """Returns whether a stretch's middle lies off a line (2,), or its direction is another one."""
    off = ends.mean(axis=0) @ [np.cos(line[1]), np.sin(line[1])] - line[0]
    return abs(off) > OFF_M or abs(_turn(line, ends)) > np.radians(OFF_DEG)
