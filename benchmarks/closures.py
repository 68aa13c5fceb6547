"""Judges the loops that a map keeps by relative poses that somebody else measured.

Where both ends of a relation see a wall of the map, the relation says whether it is one wall: laid
by it, the two sightings must lie on one line. Nothing of the estimate's own opinion is believed but
which sightings are of one wall, and the step from a row to the relation's place between two rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphslam.estimate import Estimate
from graphslam.geometry import (
    Array,
    compose,
    interpolate_poses,
    inverse,
    line_to_floor,
    line_to_robot,
    points_on_line,
    transform_points,
    wrap,
)
from graphslam.measurements import IntArray, Measurements

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
        lines, ends = walls.common(first, second, np.array(motion))
        turns = _turn(lines, ends)
        turn = float(np.median(turns)) if len(turns) else 0.0
        if abs(turn) < MOST_TURN:
            ends = transform_points(_about(np.array(motion[:2]), -turn), ends)
        bad = _is_off(lines, ends)
        count += 1, len(bad) > 0, len(bad), bad.sum(), 2 * bad.sum() > len(bad)
    return Closures(*count.tolist())


class _Walls:
    """The sightings that an estimate uses, to be seen from places between its rows."""

    def __init__(self, measurements: Measurements, estimate: Estimate) -> None:
        ((_, table),) = measurements.tables()
        self.pose, self.match = estimate.pose, np.where(estimate.used, estimate.match, -1)
        self.row = np.arange(len(self.pose), dtype=float)
        self.starts = table.starts(len(self.pose))
        seen_from = self.pose[table.node]
        self.line = line_to_floor(table.z, seen_from)
        ends = points_on_line(table.z[:, None], table.extent)
        self.ends = transform_points(seen_from[:, None], ends)

    def common(self, first: float, second: float, motion: Array) -> tuple[Array, Array]:
        """Returns lines (k, 2) from one place, and ends (k, 2, 2) from another, of common walls.

        All in the frame of the first place, the second where ``motion`` (3,) says.
        """
        one, other = self._beside(first), self._beside(second)
        a, b = np.nonzero(self.match[one][:, None] == self.match[other])
        here, there = interpolate_poses(np.array([first, second]), self.row, self.pose)
        ends = transform_points(compose(motion, inverse(there)), self.ends[other[b]])
        return line_to_robot(self.line[one[a]], here), ends

    def _beside(self, place: float) -> IntArray:
        """Returns the sightings of the rows beside a place that are of a wall of the map."""
        low, high = int(np.floor(place)), int(np.ceil(place))
        near = np.arange(self.starts[low], self.starts[low + 1])
        if high > low:
            near = np.concatenate([near, np.arange(self.starts[high], self.starts[high + 1])])
        return near[self.match[near] >= 0]


def _about(point: Array, turn: float) -> Array:
    """Returns the motion (3,) that turns about a point."""
    moved = point - transform_points(np.array([0.0, 0.0, turn]), point)
    return np.array([*moved, turn])


def _turn(lines: Array, ends: Array) -> Array:
    """Returns the angles (k,), rad, from lines (k, 2) to those through two ends, modulo pi."""
    along = ends[:, 1] - ends[:, 0]
    return 0.5 * wrap(2.0 * (np.arctan2(-along[:, 0], along[:, 1]) - lines[:, 1]))


def _is_off(lines: Array, ends: Array) -> NDArray[np.bool_]:
    """Returns whether stretches' middles lie off lines (k, 2), or have another direction."""
    normal = np.column_stack([np.cos(lines[:, 1]), np.sin(lines[:, 1])])
    off = np.abs(np.sum(ends.mean(axis=1) * normal, axis=1) - lines[:, 0])
    return (off > OFF_M) | (np.abs(_turn(lines, ends)) > np.radians(OFF_DEG))
