"""What looks wrong in a log: each finding with its reason and its cure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from frontend.config import DetectorConfig
from frontend.log import Log
from frontend.moves import Moves
from frontend.nodes import odometry_label
from frontend.turning import TurnCheck
from frontend.view import View
from graphslam.geometry import Array

if TYPE_CHECKING:
    from frontend.sample import Frame

FASTEST_MPS = 5.0
FASTEST_TURN = 4.0 * math.pi  # rad/s: two turns a second
BASE_OVER_RADIUS = (1.2, 60.0)
RADII_RATIO = 1.1
RADIUS_M = (0.002, 1.0)
GAP_STEPS, GAP_WHEELS_S, GAP_IMAGES_S = 10.0, 0.5, 3.0
JUMP_SHARE = 0.4  # of the speed before and after, that a step across a jump of the clock shows
UNEVEN = 0.5  # spread of steps over the median step


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that looks wrong.

    Attributes:
        about: the file, the table of log.toml or the part that it is about.
        found: what was found, with figures.
        reason: why that looks wrong.
        cure: what to do.
    """

    about: str
    found: str
    reason: str
    cure: str


@dataclass(frozen=True, slots=True)
class Evidence:
    """What findings are made from.

    Attributes:
        log: the recording.
        moves: its odometry.
        views: what its floor cameras see.
        frames: the sample of frames.
        turns: turning of wheels against lines, or None.
        detector: what lines were looked for with.
    """

    log: Log
    moves: Moves
    views: tuple[View, ...]
    frames: tuple[Frame, ...]
    turns: TurnCheck | None
    detector: DetectorConfig


def odometry_findings(evidence: Evidence) -> Iterator[Finding]:
    """Yields what looks wrong in radii and base, speeds, and times."""
    yield from _robot(evidence)
    yield from _speeds(evidence)
    yield from _times(evidence)


def _robot(evidence: Evidence) -> Iterator[Finding]:
    robot = evidence.log.robot
    if robot is None or evidence.log.wheels is None:
        return
    radii = np.array([robot.wheel_radius_left, robot.wheel_radius_right])
    where, metres = (
        f"{evidence.log.described} [robot]",
        "write radii and base in metres; a radius is half a diameter",
    )
    if radii.min() < RADIUS_M[0] or radii.max() > RADIUS_M[1]:
        yield Finding(
            where,
            f"wheel radii {radii[0]:g} m and {radii[1]:g} m",
            f"wheels of robots have radii of {RADIUS_M[0]:g} m to {RADIUS_M[1]:g} m",
            metres,
        )
    proportion = robot.wheel_base / radii.mean()
    if not BASE_OVER_RADIUS[0] <= proportion <= BASE_OVER_RADIUS[1]:
        yield Finding(
            where,
            f"wheel_base {robot.wheel_base:g} m is {proportion:.3g} times the wheel radius",
            f"{BASE_OVER_RADIUS[0]:g} to {BASE_OVER_RADIUS[1]:g} times is what robots have",
            metres,
        )
    if radii.max() / radii.min() > RADII_RATIO:
        yield Finding(
            where,
            f"wheel radii {radii[0]:g} m and {radii[1]:g} m differ by "
            f"{100 * (radii.max() / radii.min() - 1):.0f} %",
            "the robot would drive circles when both wheels turn alike",
            "measure both wheels, or drive straight and compare the angles",
        )


def _speeds(evidence: Evidence) -> Iterator[Finding]:
    moves, about = evidence.moves, odometry_label(evidence.log)
    if not moves.length.any() and not moves.turn.any():
        yield Finding(
            about, "the wheels never turn", "nothing moves", "check the encoders, or record a drive"
        )
        return
    usual, fast = np.percentile(moves.speed, 95), np.flatnonzero(moves.speed > FASTEST_MPS)
    if usual > FASTEST_MPS:
        yield Finding(
            about,
            f"the robot drives at {usual:.3g} m/s",
            f"robots on wheels drive at less than {FASTEST_MPS:g} m/s",
            "write angles in rad, not in ticks or degrees, radii in metres, and times in seconds",
        )
    elif len(fast):
        yield Finding(
            about,
            f"{len(fast)} readings jump; the first, after t = {moves.t[fast[0]]:.12g} s, by "
            f"{moves.length[fast[0]]:.3g} m",
            f"that is faster than {FASTEST_MPS:g} m/s",
            "unwrap the counter of the encoder where it overflows or restarts",
        )
    turning = np.percentile(np.abs(moves.turn) / np.diff(moves.t), 95)
    if turning > FASTEST_TURN and usual <= FASTEST_MPS:
        yield Finding(
            about,
            f"the robot turns at {math.degrees(turning):.0f} degrees a second",
            "that is faster than two turns a second",
            "check wheel_base (in metres) in log.toml",
        )


# ---- times ------------------------------------------------------------------------------------


def _times(evidence: Evidence) -> Iterator[Finding]:
    log, moves = evidence.log, evidence.moves
    yield from _odometry_gaps(moves, odometry_label(log))
    yield from _uneven(odometry_label(log), moves.t)
    times = {log.labels["sightings"]: None if log.sightings is None else log.sightings.t}
    if log.images is not None:
        times[log.labels["images"]] = log.images.t[log.images_of("floor")]
    for file, all_times in times.items():
        if all_times is None or not len(all_times):
            continue
        t = np.unique(all_times)
        yield from _outside(file, t, moves.t, odometry_label(log))
        if file == log.labels["images"]:
            yield from _uneven(file, t)
            step = np.diff(t, prepend=t[0])
            gaps = np.flatnonzero(step > max(GAP_IMAGES_S, GAP_STEPS * float(np.median(step))))
            if len(gaps):
                first = gaps[0]
                yield Finding(
                    file,
                    f"{len(gaps)} gaps; the first, after t = {t[first - 1]:.12g} s, lasts "
                    f"{step[first]:.3g} s",
                    "without images only odometry tells where the robot goes",
                    "look whether the camera stopped, or whether its clock jumped",
                )


def _outside(file: str, t: Array, known: Array, odometry: str) -> Iterator[Finding]:
    """Yields what lies outside the odometry's record: all, the beginning, or the end."""
    early, late = np.count_nonzero(t < known[0]), np.count_nonzero(t > known[-1])
    where = f"{odometry} lasts from t = {known[0]:.12g} s to {known[-1]:.12g} s"
    if early + late == len(t):
        yield Finding(
            file,
            f"no time in common: {file} lasts from t = {t[0]:.12g} s to {t[-1]:.12g} s, {where}",
            "nothing can be estimated",
            "give both one clock, in seconds",
        )
        return
    if early:
        yield Finding(
            file,
            f"{early} of {len(t)} times are before the first row of {odometry}",
            f"{where}; these frames are not used",
            f"start to record {odometry} before {file}, or remove these rows",
        )
    if late:
        yield Finding(
            file,
            f"{late} of {len(t)} times are after the last row of {odometry}",
            f"{where}; these frames are not used",
            f"stop to record {odometry} after {file}, or remove these rows",
        )


def _odometry_gaps(moves: Moves, file: str) -> Iterator[Finding]:
    """Yields long steps: the clock jumped where the wheels hardly moved in them, else a gap."""
    step = np.diff(moves.t)
    for row in np.flatnonzero(step > max(GAP_WHEELS_S, GAP_STEPS * float(np.median(step))))[:1]:
        near = np.concatenate([moves.speed[max(0, row - 3) : row], moves.speed[row + 1 : row + 4]])
        when = f"t = {moves.t[row]:.12g} s, {step[row]:.3g} s without a reading"
        if len(near) and moves.speed[row] < JUMP_SHARE * near.min():
            yield Finding(
                file,
                f"the clock jumps: {when}",
                "the robot moves before and after, but hardly in between",
                "take the times from a clock that does not jump (monotonic)",
            )
        else:
            yield Finding(
                file,
                f"a gap: {when}",
                "motion in between is taken as an even arc",
                "record odometry without a break",
            )


def _uneven(file: str, t: Array) -> Iterator[Finding]:
    step = np.diff(t)
    if len(step) < 10:
        return
    low, high = np.percentile(step, [16, 84])
    if 0.5 * (high - low) > UNEVEN * np.median(step):
        yield Finding(
            file,
            f"uneven times: the middle 68 % of the steps range from {low:.3g} s to {high:.3g} s",
            "such times tell when data arrived, not when it was measured",
            "use the times of the measurement, for example the driver's",
        )
