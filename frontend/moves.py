"""The motion of a robot from reading to reading of its odometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frontend.log import Log
from graphslam.geometry import Array, between, transform_points
from graphslam.models.wheels import wheel_increment

MOVING_MPS = 0.01  # slower than this counts as standing
TURN_STEP_S = 0.5  # turns are added up over steps of this


@dataclass(frozen=True, slots=True)
class Moves:
    """Motion by odometry, a row for each step from one reading to the next.

    Attributes:
        t: (W,) times of the readings, s.
        place: (W, 2) position at each, m, starting at the origin.
        heading: (W,) heading at each, rad, starting at 0, not wrapped.
        length: (W-1,) distance driven in each step, m.
        turn: (W-1,) turn in each step, rad.
    """

    t: Array
    place: Array
    heading: Array
    length: Array
    turn: Array

    @property
    def speed(self) -> Array:
        """(W-1,) speed in each step, m/s."""
        return self.length / np.diff(self.t)

    def typical_speed(self) -> tuple[float, float]:
        """Returns the median speed while moving, 0 where it never does, and the largest, m/s."""
        moving = self.speed[self.speed > MOVING_MPS]
        return float(np.median(moving)) if len(moving) else 0.0, float(self.speed.max())

    def turned(self) -> float:
        """Returns the turns either way added up, rad, encoder noise averaged over `TURN_STEP_S`."""
        t = np.append(np.arange(self.t[0], self.t[-1], TURN_STEP_S), self.t[-1])
        return float(np.abs(np.diff(self.heading_at(t))).sum())

    def pose(self) -> Array:
        """Returns the poses (W, 3) at the readings, m and rad, heading not wrapped."""
        return np.column_stack([self.place, self.heading])

    def heading_at(self, t: Array) -> Array:
        """Returns the headings at times (...), rad, not wrapped; held beyond the readings."""
        return np.interp(t, self.t, self.heading)


def moves_of(log: Log) -> Moves:
    """Returns the motion by the wheels of a log, or without any by its foreign odometry."""
    if log.wheels is not None and log.robot is not None:
        t, step = log.wheels.t, wheel_increment(np.diff(log.wheels.angle, axis=0), log.robot)[0]
    else:
        assert log.odometry is not None, "a log without odometry cannot be made"
        t, step = log.odometry.t, between(log.odometry.pose[:-1], log.odometry.pose[1:])
    heading = np.concatenate([[0.0], np.cumsum(step[:, 2])])
    at = np.column_stack([np.zeros((len(step), 2)), heading[:-1]])
    moved = transform_points(at, step[:, :2])
    place = np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    return Moves(t, place, heading, np.hypot(step[:, 0], step[:, 1]), step[:, 2])
