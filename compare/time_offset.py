"""The constant offset between the clocks of camera and wheels: estimated, with its sigma.

Coarsely by correlation: the lines turn in the image as the wheels turn the robot, so the offset is
where both agree best (`frontend.turning`). Finely by the smoother: moving all images by an offset
changes the odometry between them and nothing else, so with matches held fixed the smoother's cost
is a smooth function of the offset; its minimum is the estimate, and its curvature there the
information about it.
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
from graphslam.measurements import Measurements

Progress = Callable[[str, int, int], None]

GRIDS = ((0.04, 5), (0.01, 4))
"""Searches along a grid, one after the other: its step, s, and how many steps either way."""
STEP_S = 0.005
"""Distance of the three points that the last parabola goes through, s."""
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
            to the residuals where they are larger than stated.
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
    offset, _ = profile.parabola(offset, 2 * STEP_S)
    offset, sigma = profile.parabola(offset, STEP_S)
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
        """Returns the measurements with all images moved by an offset, s."""
        base, noise = self.base, self.config.extract.noise
        t = base.t + offset
        tables = {
            kind: replace(table, t_received=table.t_received + offset)
            for kind, table in base.sightings.items()
        }
        return replace(base, t=t, odometry=odometry_at(self.log, t, noise), sightings=tables)

    def cost(self, offset: float) -> float:
        """Returns half the sum of squared normalised residuals at the best path and map."""
        from graphslam.smoother import smooth

        assert self._at is not None, "matched before"
        return smooth(self.moved(offset), self._at, self._smoother).cost

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

    def parabola(self, offset: float, step: float) -> tuple[float, float]:
        """Returns the minimum of a parabola through three offsets, and its sigma, s."""
        low, middle, high = (self.cost(offset + k * step) for k in (-1, 0, 1))
        curvature = (high - 2.0 * middle + low) / step**2
        if not curvature > 0.0:
            raise BadLog(
                f"{self.log.folder}: the cost hardly depends on the offset: the robot turns too "
                "little while lines are seen; drive some turns"
            )
        move = -(high - low) / (2.0 * step * curvature)
        assert self._at is not None, "matched before"
        freedom = max(1, 2 * self.used - 2 * len(self._at.map.kind))
        scale = max(1.0, 2.0 * middle / freedom)
        return offset + float(np.clip(move, -2.0 * step, 2.0 * step)), math.sqrt(scale / curvature)
