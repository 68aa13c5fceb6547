"""The floor and the drive on which the papers' misprints are compared with what is right."""

from __future__ import annotations

import numpy as np

from frontend.simulate.drive import Drive, plan
from frontend.simulate.floor import LineGrid
from frontend.simulate.scenario import Motion, Scenario, Start
from frontend.simulate.sensors import Encoder, SightingSpec
from frontend.simulate.sightings import draw_sightings
from frontend.simulate.world import floor_lines
from graphslam.baseline import integrate
from graphslam.geometry import Array
from graphslam.measurements import LandmarkMap, Measurements, Odometry, Sightings
from graphslam.models.line import LINE
from graphslam.models.wheels import DifferentialDrive, increments_from_wheels, wheel_increment

SMALLEST_READING = 2.0**-27
"""Wheel angles are read in multiples of this, 7.5e-9 rad; differences of them are exact."""
RATE = 8.0
"""Frames and encoder readings per second; SantanaLoc reads both together."""
START_SIGMA = 1e-6
"""Standard deviation of the start, which is known, m and rad."""


def errata_scenario() -> Scenario:
    """Returns the floor and the drive: straights, curves, half a turn, and the same way back.

    The robot sees all lines within 0.9 m of it, each from both sides, with the papers' noise of
    rho. There is no slip: wheel noise is all that the papers know.
    """
    straight, left, right = (
        Motion(forward=1.6),
        Motion(arc_deg=90.0, radius=0.5),
        Motion(arc_deg=-90.0, radius=0.5),
    )
    return Scenario(
        "graphslam-scenario/1",
        "errata",
        DifferentialDrive(0.042, 0.042, 0.2, 0.03, 0.03, "paper", (0.0, 0.0, 0.0)),
        ((straight, left) * 4 + (Motion(turn_deg=180.0),) + (right, straight) * 4),
        start=Start(0.3, 0.2, 0.0),
        grids=(
            LineGrid(alpha_deg=0.0, first=-0.5, spacings=(1.1, 0.9, 1.2)),
            LineGrid(alpha_deg=90.0, first=-0.4, spacings=(1.2, 0.8, 1.1)),
        ),
        speed=0.2,
        turn_rate_deg=30.0,
        encoder=Encoder(RATE),
        sightings=SightingSpec(reach=0.9, rate=RATE),
    )


def draw_run(scenario: Scenario, seed: int, known: bool) -> tuple[Measurements, Array]:
    """Returns measurements of one drive, and its true poses (N, 3).

    The encoders read what was commanded, and the wheels turn by that plus noise, as SantanaSLAM
    (11) has it: so wheels that should turn alike read alike.

    Args:
        scenario: with frames at the encoder's readings and noise by the law "paper".
        seed: decides the noise of wheels and sightings.
        known: whether the lines are known, as in SantanaLoc.
    """
    wheels, sight = np.random.SeedSequence(seed).spawn(2)
    t, commanded = plan(scenario)
    robot, said = scenario.robot, np.round(commanded / SMALLEST_READING) * SMALLEST_READING
    k = np.array([robot.noise_left, robot.noise_right], float)
    steps = np.diff(said, axis=0)
    turned = steps * (1.0 + k * np.random.default_rng(wheels).standard_normal(steps.shape))
    start = np.array([scenario.start.x, scenario.start.y, np.radians(scenario.start.heading_deg)])
    truth = integrate(start, wheel_increment(turned, robot)[0])
    angle = np.concatenate([said[:1], said[0] + np.cumsum(turned, axis=0)])
    run = Drive(t, truth, t, angle, said, t)
    odometry = Odometry(*increments_from_wheels(t, said, t, robot), t, said)
    cov = START_SIGMA**2 * np.eye(3)
    table = {LINE.kind: _sightings(scenario, run, sight)}
    return Measurements(t, start, cov, odometry, table, _map(scenario) if known else None), truth


def _sightings(scenario: Scenario, run: Drive, seed: np.random.SeedSequence) -> Sightings:
    seen = draw_sightings(scenario, run, seed)
    node = np.searchsorted(run.frame_t, seen.t)
    return Sightings(
        kind=LINE.kind,
        node=node,
        z=seen.z,
        cov=seen.cov,
        extent=seen.extent,
        t_received=seen.t_received,
        quality=np.full(len(node), np.nan),
        source=node,
        truth=seen.truth,
    )


def _map(scenario: Scenario) -> LandmarkMap:
    lines = floor_lines(scenario)
    count = len(lines)
    lines, extent, _ = LINE.canonical(lines, np.full((count, 2), np.nan))
    return LandmarkMap(np.arange(count), (LINE.kind,) * count, lines, extent, np.zeros(count, int))
