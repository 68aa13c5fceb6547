"""The constant offset between the clocks of camera and wheels: estimated, with its sigma.

Coarsely by correlation: the lines turn in the image as the wheels turn the robot, so the offset is
where both agree best (`frontend.turning`), then where the smoother's cost is least on a grid.
Finely by the smoother with matches held fixed: each sighting is taken from where the wheels'
velocity brings the robot a little earlier or later, and the odometry between the images stays as it
is. The least cost is the estimate, its curvature there the information about it; the images are
moved by what was found, and again until nothing is left to move.

The odometry must not be cut anew for each offset that is tried: where a cut falls within a reading
of the encoders, its noise is shared by two increments, and the cost falls by several units whatever
the clocks say, most half way between two readings.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.text import Text

from compare.config import RunConfig, to_toml
from frontend.extract import extract
from frontend.log import Log
from frontend.moves import moves_of
from frontend.nodes import odometry_at, odometry_times
from frontend.turning import LARGEST_SHIFT_S, check_turns
from graphslam.errors import BadLog
from graphslam.estimate import Estimate
from graphslam.geometry import (
    Array,
    between,
    interpolate_poses,
    line_to_floor,
    twist_motion,
)
from graphslam.measurements import Measurements
from graphslam.models.line import LINE

Progress = Callable[[str, int, int], None]

GRIDS = ((0.04, 5), (0.01, 4))
"""Searches along a grid, one after the other: its step, s, and how many steps either way."""
STEP_S = 0.005
"""Distance of the three points that the last parabola goes through, s."""
VELOCITY_S = 0.25
"""Velocities are means over this time either way, s: the noise of the encoders in shorter ones
would count as information about the clocks."""
ROUNDS, STILL_S = 8, 2e-4
"""How often at most the images are moved, and a move, s, after which they are not moved again."""
MARGIN_S = 0.5
"""Images this close to the ends of the wheel record are left out, s: offsets may not move them
over it."""
LEAPS = 8
"""How often a grid may be moved on where the least cost lies at its border."""


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """What was found.

    Attributes:
        offset_s: to add to the times of images and sightings, s.
        sigma_s: its standard deviation, s, from the curvature of the cost, with the noise scaled
            to the residuals where they are larger than stated, and with the last move where the
            images were still moved by more than `STILL_S`.
        coarse_s: the same by correlation of the turning, s; NaN where too little turned.
        nodes: images or moments of sightings used.
        sightings: line sightings used.
        cost_at_zero: half the sum of squared normalised residuals without an offset.
        cost: the same at the offset found.
    """

    offset_s: float
    sigma_s: float
    coarse_s: float
    nodes: int
    sightings: int
    cost_at_zero: float
    cost: float


def estimate_time_offset(
    log: Log, config: RunConfig | None = None, progress: Progress | None = None
) -> TimeOffset:
    """Returns the offset between the clocks of a log's camera and wheels.

    Args:
        log: the recording, as it was recorded; an offset of its settings is not counted.
        config: detector, noise and matching; None for the defaults.
        progress: told about each stage.

    Raises:
        BadLog: the log shows too few lines, or turns too little, to tell.
    """
    config, tell = config or RunConfig(), progress or (lambda *ignored: None)
    log = replace(log, pose_fixes=None)
    settings = replace(config.extract, camera_offset_s=0.0)
    plain = extract(log, settings, lambda done, total: tell(f"{log.name}: extract", done, total))
    coarse = _coarse(log, plain)
    begin = 0.0 if math.isnan(coarse) else coarse
    first, last = odometry_times(log)[[0, -1]] + [MARGIN_S, -MARGIN_S]
    inside = replace(
        settings,
        from_s=max(first - begin, -np.inf if settings.from_s is None else settings.from_s),
        to_s=min(last - begin, np.inf if settings.to_s is None else settings.to_s),
    )
    profile = _Profile(log, config, extract(log, inside))
    offset, total = begin, len(GRIDS) + 1
    for number, (step, reach) in enumerate(GRIDS):
        tell(f"{log.name}: time offset", number, total)
        offset = profile.search(offset, step, reach)
    tell(f"{log.name}: time offset", len(GRIDS), total)
    profile.match_at(offset)
    for _ in range(ROUNDS):
        move, sigma = profile.parabola(offset)
        offset += move
        if abs(move) < STILL_S:
            break
    tell(f"{log.name}: time offset", total, total)
    return TimeOffset(
        offset_s=offset,
        sigma_s=sigma,
        coarse_s=coarse,
        nodes=len(profile.base.t),
        sightings=profile.used,
        cost_at_zero=profile.cost(0.0),
        cost=profile.cost(offset),
    )


def offset_toml(found: TimeOffset, config: RunConfig, name: str) -> str:
    """Returns settings with the offset as TOML that `graphslam run --config` takes.

    Args:
        found: the offset.
        config: all other settings.
        name: of the log.
    """
    rounded = round(found.offset_s, 6)
    changed = replace(config, extract=replace(config.extract, camera_offset_s=rounded))
    return (
        f"# Clock of the camera against the wheels of the log {name}: "
        f"{1e3 * found.offset_s:+.2f} ms, sigma {1e3 * found.sigma_s:.2f} ms.\n\n{to_toml(changed)}"
    )


def print_offset(found: TimeOffset, log: Log) -> None:
    """Prints what was found, to standard output."""
    console = Console(highlight=False)
    sense = "late" if found.offset_s < 0 else "early"
    console.print(
        Text(
            f"{log.name}: the images are stamped {1e3 * abs(found.offset_s):.1f} ms {sense} "
            f"against the wheels, sigma {1e3 * found.sigma_s:.2f} ms (1 sigma, 68 %); "
            f"{found.nodes} images, {found.sightings} line sightings"
        )
    )
    if abs(found.offset_s) < 2.0 * found.sigma_s:
        console.print(Text("that is below 2 sigma: no offset is as likely, none need be set"))
    if not math.isnan(found.coarse_s):
        console.print(Text(f"by correlation of the turning: {1e3 * found.coarse_s:+.0f} ms"))
    console.print(
        Text(f"cost of the smoother without it {found.cost_at_zero:.1f}, with it {found.cost:.1f}")
    )
    console.print(
        Text(
            f"\nFor [time] in log.toml or the robot file:\ncamera_offset = {found.offset_s:.4f}\n"
            f"or for one run: --extract.camera-offset-s {found.offset_s:.4f}\n"
        ),
        soft_wrap=True,
    )


def _coarse(log: Log, plain: Measurements) -> float:
    """Returns the offset by correlation of turning, s; NaN where too little turned."""
    lines, moves = plain.sightings.get("line"), moves_of(log)
    if lines is None or not len(lines):
        raise BadLog(
            f"{log.folder}: no line is seen, so nothing tells the camera's clock; see graphslam "
            "inspect"
        )
    alphas = [lines.z[lines.node == node, 1] for node in range(len(plain.t))]
    sigma = float(np.sqrt(np.median(lines.cov[:, 1, 1])))
    found = check_turns(moves.t, moves.heading, plain.t, alphas, sigma)
    return math.nan if found is None else found.shift_s


class _Profile:
    """The smoother's least cost as a function of the offset, matches held fixed."""

    def __init__(self, log: Log, config: RunConfig, base: Measurements) -> None:
        self.log, self.config, self.base = log, config, base
        self.used = 0
        self._at: Estimate | None = None
        smoother = replace(config.smoother, engine="chain", rematch=False, robust="none")
        self._smoother = smoother

    def match_at(self, offset: float) -> None:
        """Makes matches by filter and smoother at an offset, which hold from then on."""
        from graphslam.ekf import run_ekf
        from graphslam.smoother import smooth

        moved = self.moved(offset)
        filtered = run_ekf(moved, self.config.ekf)
        again = replace(self.config.smoother, engine="chain", rematch=True)
        self._at = smooth(moved, filtered, again)
        self.used = int(np.count_nonzero(self._at.used))
        if self.used - len(self._at.map.kind) < 2:
            raise BadLog(
                f"{self.log.folder}: hardly a line is seen twice, so nothing tells the camera's "
                "clock; see graphslam inspect"
            )

    def moved(self, offset: float) -> Measurements:
        """Returns odometry and sightings of lines with all images moved by an offset, s."""
        base, noise = self.base, self.config.extract.noise
        t = base.t + offset
        lines = base.sightings[LINE.kind]
        lines = replace(lines, t_received=lines.t_received + offset)
        odometry = odometry_at(self.log, t, noise)
        return replace(base, t=t, odometry=odometry, sightings={LINE.kind: lines})

    def cost(self, offset: float) -> float:
        """Returns half the sum of squared normalised residuals at the best path and map."""
        return self._least(self.moved(offset))

    def _least(self, measurements: Measurements) -> float:
        from graphslam.smoother import smooth

        assert self._at is not None, "matched before"
        return smooth(measurements, self._at, self._smoother).cost

    def search(self, offset: float, step: float, reach: int) -> float:
        """Returns the offset of the least cost on a grid about one, matches made there.

        Where it is at the grid's border, matches are made there and the grid is moved on.
        """
        for _ in range(LEAPS):
            self.match_at(offset)
            places = [offset + k * step for k in range(-reach, reach + 1)]
            least = int(np.argmin([self.cost(place) for place in places]))
            offset = places[least]
            if 0 < least < 2 * reach:
                return offset
            if abs(offset) > LARGEST_SHIFT_S:
                break
        raise BadLog(
            f"{self.log.folder}: no offset below {LARGEST_SHIFT_S:g} s fits: the robot turns too "
            "little while lines are seen, or the clocks are further apart; drive some turns, or "
            "see graphslam inspect"
        )

    def parabola(self, offset: float) -> tuple[float, float]:
        """Returns how much further, s, the cost is least, and the standard deviation of that, s."""
        moved = self.moved(offset)
        velocity = velocity_at(self.log, moved.t)
        low, middle, high = (
            self._least(_taken_later(moved, velocity, k * STEP_S)) for k in (-1, 0, 1)
        )
        curvature = (high - 2.0 * middle + low) / STEP_S**2
        if not curvature > 0.0:
            raise BadLog(
                f"{self.log.folder}: the cost hardly depends on the offset: the robot turns too "
                "little while lines are seen; drive some turns"
            )
        move = float(np.clip(-(high - low) / (2.0 * STEP_S * curvature), -0.02, 0.02))
        assert self._at is not None, "matched before"
        freedom = max(1, 2 * self.used - 2 * len(self._at.map.kind))
        scale = max(1.0, 2.0 * middle / freedom)
        still = move if abs(move) > STILL_S else 0.0
        return move, math.hypot(math.sqrt(scale / curvature), still)


def velocity_at(log: Log, t: Array) -> Array:
    """Returns the velocity (N, 3) by odometry about times (N,), ``(v_x, v_y, omega)``, robot frame.

    Means over `VELOCITY_S` either way; m/s and rad/s.
    """
    moves = moves_of(log)
    ends = [interpolate_poses(t + way * VELOCITY_S, moves.t, moves.pose()) for way in (-1, 1)]
    step = between(*ends)
    # the chord lies along the arc's middle, where its twist points forward
    half = 0.5 * step[:, 2]
    c, s = np.cos(half), np.sin(half)
    x, y = c * step[:, 0] + s * step[:, 1], -s * step[:, 0] + c * step[:, 1]
    arc = 1.0 / np.sinc(half / math.pi)
    return np.column_stack([arc * x, arc * y, step[:, 2]]) / (2.0 * VELOCITY_S)


def _taken_later(measurements: Measurements, velocity: Array, later: float) -> Measurements:
    """Returns the sightings of lines as if taken from where the robot is ``later`` s later.

    Only their values change; what a shift of some millimetres does to the covariances is left out.
    """
    lines = measurements.sightings[LINE.kind]
    z = line_to_floor(lines.z, twist_motion(later * velocity[lines.node]))
    return replace(measurements, sightings={LINE.kind: replace(lines, z=z)})
