"""The case of matching that is about closing a loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matching_cases import Case

from frontend.extract import extract
from frontend.log_parts import Wheels
from frontend.simulate import load_scenario, simulate_log
from frontend.simulate.floor import FloorLine
from frontend.simulate.scenario import Motion, Scenario
from graphslam.estimate import Estimate
from graphslam.geometry import position_along

DRIFT_DEG = 20.0
"""How far odometry's heading is off where the loop closes, degrees, to either side."""
AFTER_M = 40.0
"""Way that is driven on after the loop has closed, m."""
LOOP_M = 200.0
EARLY_M, LATE_M = 150.0, 190.0
"""Way before which, and after which, a sighting is of one or the other end of the loop, m."""
LEAST_SIGHTINGS = 2
PIECE_M, ASIDE_M = 0.3, 0.25
"""Half the length of the short lines along the corridor, and how far from its middle they lie."""
TILT_DEG = 30.0
"""How far they are turned from the corridor's direction, degrees, to either side."""


def loop(seed: int) -> Case:
    """Corridors around a block, 200 m: no line is seen again before the loop closes.

    There are no walls, which would hold the heading: every line across the corridor has one short
    line along it, and between these marks the robot sees nothing. The wheels' noise is drawn as it
    is stated, and then turned so that the heading by odometry is off by `DRIFT_DEG` where the loop
    closes.
    """
    scenario = load_scenario("long-loop")
    scenario = replace(
        _with_marks(scenario, np.random.default_rng([seed, 6])),
        path=(*scenario.path[:-1], Motion(forward=AFTER_M)),
    )
    log = simulate_log(scenario, seed)
    assert log.wheels is not None
    assert log.robot is not None
    assert log.truth is not None
    robot, angle = log.robot, log.wheels.angle.copy()
    mean = 0.5 * angle.sum(axis=1) * robot.wheel_radius_left
    at = int(np.searchsorted(mean, LOOP_M))
    heading = (angle[:, 1] - angle[:, 0]) * robot.wheel_radius_left / robot.wheel_base
    true = 2.0 * np.pi
    wanted = np.radians(DRIFT_DEG) * np.random.default_rng([seed, 5]).choice([-1.0, 1.0])
    extra = (wanted - (heading[at] - heading[0] - true)) * mean / mean[at]
    turn = 0.5 * extra * robot.wheel_base / robot.wheel_radius_left
    angle += turn[:, None] * [-1.0, 1.0]
    log = replace(log, wheels=Wheels(log.wheels.t, angle))
    return Case(log, extract(log))


def closings(case: Case, estimate: Estimate) -> tuple[int, int]:
    """Returns how many landmarks join what was seen before and after the loop: rightly, wrongly.

    A landmark joins two lines wrongly where most of its sightings before are of another true line
    than most of those after.
    """
    table = case.measurements.sightings["line"]
    steps = np.hypot(*case.measurements.odometry.increment[:, :2].T)
    way = np.concatenate([[0.0], np.cumsum(steps)])[table.node]
    right = wrong = 0
    for landmark in np.unique(estimate.match[estimate.match >= 0]):
        own = (estimate.match == landmark) & (table.truth >= 0)
        early, late = table.truth[own & (way < EARLY_M)], table.truth[own & (way > LATE_M)]
        if min(len(early), len(late)) >= LEAST_SIGHTINGS:
            same = np.bincount(early).argmax() == np.bincount(late).argmax()
            right, wrong = right + bool(same), wrong + (not same)
    return right, wrong


def _with_marks(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """Returns the scenario without lines along corridors, but one short one at each across."""
    lines = []
    grids = [grid for grid in scenario.grids if np.ptp(grid.stretch or (0.0, np.inf)) < 1.0]
    for grid in grids:
        middle = np.mean(grid.stretch) * (1.0 if grid.alpha_deg == 0.0 else -1.0)
        for rho in grid.first + np.cumsum([0.0, *grid.spacings]):
            along, aside = float(rho), float(middle + rng.uniform(-ASIDE_M, ASIDE_M))
            centre = np.array([along, aside] if grid.alpha_deg == 0.0 else [aside, along])
            alpha = np.radians(90.0 - grid.alpha_deg + rng.uniform(-TILT_DEG, TILT_DEG))
            line = np.array([centre @ [np.cos(alpha), np.sin(alpha)], alpha])
            s = float(position_along(line, centre))
            stretch = (s - PIECE_M, s + PIECE_M)
            lines.append(FloorLine(float(line[0]), float(np.degrees(alpha)), stretch))
    return replace(scenario, lines=tuple(lines), grids=tuple(grids))
