"""The drive: what the wheels do, where that takes the robot, and what the encoders say of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frontend.simulate.scenario import Motion, Scenario
from frontend.write_folder import TIME_DECIMALS
from graphslam.errors import BadConfig
from graphslam.geometry import Array, compose
from graphslam.models.wheels import DifferentialDrive, wheel_increment

MOST_READINGS = 5e7
"""Encoder readings above which a scenario is refused: their arrays take gigabytes."""


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """One drive of a scenario, true and measured.

    Attributes:
        t: (E,) times of all readings and frames, s, increasing.
        pose: (E, 3) true poses at these times, floor frame, m and rad.
        wheel_t: (W,) times of the encoder readings, s, increasing from 0.
        wheel_true: (W, 2) true cumulative angles, left and right, rad.
        wheel_angle: (W, 2) what the encoders say of them, rad.
        frame_t: (I,) times of the frames (images, or sightings without), s, increasing from 0.
        overhead_t: (J,) times of the images of the camera overhead, s, increasing from 0; none
            without one.
        omni_t: (J,) the same of the camera that sees all around.
    """

    t: Array
    pose: Array
    wheel_t: Array
    wheel_true: Array
    wheel_angle: Array
    frame_t: Array
    overhead_t: Array = field(default_factory=lambda: np.zeros(0))
    omni_t: Array = field(default_factory=lambda: np.zeros(0))

    def pose_at_frames(self) -> Array:
        """Returns the true poses (I, 3) at the frames, floor frame."""
        return self.pose_at(self.frame_t)

    def pose_at(self, t: Array) -> Array:
        """Returns the true poses (k, 3) at times (k,) of readings or frames, floor frame."""
        return self.pose[np.searchsorted(self.t, t)]


def drive(scenario: Scenario, wheels: np.random.Generator, slip: np.random.Generator) -> Drive:
    """Returns one drive along the scenario's path.

    The true rotations turn the wheels, slip is added to the motion that follows from them, and
    encoder noise to what is measured of them, each by the law that `increments_from_wheels`
    assumes.

    Args:
        scenario: path, robot, encoder and rates.
        wheels: decides the encoders' noise.
        slip: decides the slip.
    """
    wheel_t, wheel_true = plan(scenario)
    frame_t = _frame_times(scenario.rate, wheel_t[-1])
    overhead = scenario.overhead
    overhead_t = np.zeros(0) if overhead is None else _frame_times(overhead.rate, wheel_t[-1])
    omni = scenario.omni
    omni_t = np.zeros(0) if omni is None else _frame_times(omni.rate, wheel_t[-1])
    looks = np.union1d(np.union1d(frame_t, overhead_t), omni_t)
    t = np.union1d(wheel_t, looks)
    angle = np.column_stack([np.interp(t, wheel_t, column) for column in wheel_true.T])
    steps = np.diff(angle, axis=0)
    pose = _true_poses(steps, scenario, slip)
    if scenario.robot.law == "paper":
        interval = np.searchsorted(looks, t[:-1], side="right") - 1
        error = _paper_noise(steps, interval, scenario.robot, wheels)
        error = error[np.searchsorted(t, wheel_t)]
    else:
        error = _distance_noise(np.diff(wheel_true, axis=0), scenario.robot, wheels)
    measured = wheel_true + error
    if scenario.encoder.ticks:
        tick = 2.0 * math.pi / scenario.encoder.ticks
        measured = np.round(measured / tick) * tick
    return Drive(t, pose, wheel_t, wheel_true, measured, frame_t, overhead_t, omni_t)


def _frame_times(rate: float, end: float) -> Array:
    """Returns the times of so many frames a second from 0 to the end, s."""
    count = math.floor(end * rate + 1e-6) + 1
    t = np.round(np.arange(count) / rate, TIME_DECIMALS)
    return np.asarray(t[t <= end])


def plan(scenario: Scenario) -> tuple[Array, Array]:
    """Returns encoder times (W,) and true cumulative wheel angles (W, 2), s and rad.

    Every motion runs at constant wheel speeds. It lasts a whole number of readings, the nearest to
    what its speed asks for, so that no reading mixes two motions.

    Raises:
        BadConfig: the path takes more readings than fit into memory.
    """
    seconds = scenario.repeat * sum(_extent(motion, scenario)[2] for motion in scenario.path)
    if not seconds * scenario.encoder.rate <= MOST_READINGS:
        raise BadConfig(
            f"path: {seconds * scenario.encoder.rate:.3g} encoder readings, at most "
            f"{MOST_READINGS:.0e} are possible; shorten path or repeat, or lower encoder.rate"
        )
    wheels_of = _wheels_of(scenario.robot)
    pieces = [np.zeros((1, 2))]
    for motion in scenario.path * scenario.repeat:
        length, turn, seconds = _extent(motion, scenario)
        count = max(1, round(seconds * scenario.encoder.rate))
        rotation = wheels_of @ np.array([length, turn])
        pieces.append(pieces[-1][-1] + np.linspace(0.0, 1.0, count + 1)[1:, None] * rotation)
    angle = np.concatenate(pieces)
    return np.round(np.arange(len(angle)) / scenario.encoder.rate, TIME_DECIMALS), angle


def _extent(motion: Motion, scenario: Scenario) -> tuple[float, float, float]:
    """Returns length m, turn rad and duration s of one motion."""
    speed = motion.speed or scenario.speed
    rate = math.radians(motion.turn_rate_deg or scenario.turn_rate_deg)
    if motion.forward is not None:
        return motion.forward, 0.0, abs(motion.forward) / speed
    if motion.turn_deg is not None:
        turn = math.radians(motion.turn_deg)
        return 0.0, turn, abs(turn) / rate
    if motion.arc_deg is not None and motion.radius is not None:
        turn = math.radians(motion.arc_deg)
        length = abs(turn) * motion.radius
        return length, turn, max(length / speed, abs(turn) / rate)
    return 0.0, 0.0, motion.pause or 0.0


def _motion_of(robot: DifferentialDrive) -> Array:
    """Returns (2, 2): wheel rotations (left, right), rad, to arc length m and turn rad.

    Both are linear in the rotations, so they are the derivative of the increment at standstill.
    Source: SantanaSLAM eq. (9).
    """
    return wheel_increment(np.zeros(2), robot)[1][[0, 2]]


def _wheels_of(robot: DifferentialDrive) -> Array:
    """Returns (2, 2): arc length m and turn rad to wheel rotations, rad."""
    return np.linalg.inv(_motion_of(robot))


def _true_poses(steps: Array, scenario: Scenario, rng: np.random.Generator) -> Array:
    """Returns the poses (P + 1, 3) that wheel rotations (P, 2) lead through, slip included.

    Slip strikes in the middle of each step, its variance growing with the metres that the robot
    drives and that its wheels turn.
    """
    robot = scenario.robot
    length, turn = np.abs(steps @ _motion_of(robot).T).T
    metres = length + 0.5 * robot.wheel_base * turn
    slip = rng.standard_normal((len(steps), 3)) * np.sqrt(metres)[:, None] * robot.slip
    half = wheel_increment(0.5 * steps, robot)[0]
    step = compose(compose(half, slip), half)
    start = scenario.start
    theta = math.radians(start.heading_deg) + np.concatenate([[0.0], np.cumsum(step[:, 2])])
    at_origin = np.column_stack([np.zeros((len(steps), 2)), theta[:-1]])
    moves = compose(at_origin, step)[:, :2]
    place = np.array([start.x, start.y]) + np.concatenate(
        [np.zeros((1, 2)), np.cumsum(moves, axis=0)]
    )
    still = np.column_stack([place, np.zeros(len(theta))])
    return compose(still, np.column_stack([np.zeros((len(theta), 2)), theta]))


def _distance_noise(steps: Array, robot: DifferentialDrive, rng: np.random.Generator) -> Array:
    """Returns cumulative errors (W, 2), rad: each reading has variance k^2 |rotation|.

    Source: SantanaLoc eq. (20).
    """
    k = np.array([robot.noise_left, robot.noise_right])
    error = rng.standard_normal(steps.shape) * k * np.sqrt(np.abs(steps))
    return np.concatenate([np.zeros((1, 2)), np.cumsum(error, axis=0)])


def _paper_noise(
    steps: Array, interval: NDArray[np.int64], robot: DifferentialDrive, rng: np.random.Generator
) -> Array:
    """Returns cumulative errors (P + 1, 2), rad: one relative error of std k per frame interval.

    Source: SantanaSLAM eq. (17).
    """
    k = np.array([robot.noise_left, robot.noise_right])
    relative = rng.standard_normal((interval[-1] + 1, 2)) * k
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps * relative[interval], axis=0)])
