"""The cases that methods of matching are judged on: seeded, one function each.

Every function takes a seed and returns a `Case`. Cases that need a recording (`recorded`) take its
folder, which is not part of the project.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from frontend.config import ExtractConfig
from frontend.extract import extract
from frontend.log import Log, open_log
from frontend.log_parts import Wheels
from frontend.simulate import load_scenario, simulate_log
from frontend.simulate.scenario import Motion, Start
from graphslam.measurements import IntArray, Measurements
from graphslam.models.wheels import DifferentialDrive

WRONG_SHARE = 0.07
"""Share of wrong matches, as SantanaSLAM Table 2 has them."""
FINE_NOISE = 28.0
"""Odometry noise of `fine_grid`, stated and drawn, as a multiple of the scenario's."""
FINE_RATE = 2.0
"""Frames per second of `fine_grid`."""
FINE_MISS = 0.4
"""Probability in `fine_grid` that a line in view is not seen."""
FINE_LAPS = 3
"""Laps of `fine_grid`."""
SLIP_M = 0.1
"""How far one wheel turns without driving in `wheel_slip`, m."""
SLIP_S = 0.5
"""How long that takes, s."""
VIEWS = 40
"""Legs of `random_views`, each in a random direction."""


@dataclass(frozen=True, slots=True)
class Case:
    """One run to be estimated, and what is true about it.

    Attributes:
        log: the recording, with its truth; None where nothing is judged.
        measurements: what estimators eat; sightings carry their true lines, for judging.
        labels: (K,) line that each sighting is said to be of, by the ids of the log's map, where
            the case proposes matches; None where methods are to find them.
    """

    log: Log | None
    measurements: Measurements
    labels: IntArray | None = None

    def labelled(self) -> Measurements:
        """Returns measurements whose sightings name the lines of ``labels`` as their true ones.

        Matching `known` then takes the proposed matches as they are.
        """
        assert self.labels is not None, "the case proposes no matches"
        table = self.measurements.sightings["line"]
        return replace(self.measurements, sightings={"line": replace(table, truth=self.labels)})


def clean(seed: int) -> Case:
    """Twelve lines, 56 m, the noise that is stated: nothing that should go wrong."""
    return _case(simulate_log(load_scenario("grid"), seed))


def wrong_matches(seed: int) -> Case:
    """Twelve lines, 28 m; 7 % of the true matches are replaced by a line that was seen before.

    A line's first sighting keeps its name, so that every name stands for one line.
    """
    case = _case(simulate_log(replace(load_scenario("grid"), repeat=1), seed))
    table = case.measurements.sightings["line"]
    rng = np.random.default_rng([seed, 1])
    labels = table.truth.copy()
    first = np.unique(labels, return_index=True)[1]
    later = np.setdiff1d(np.arange(len(labels)), first)
    later = later[table.node[later] > table.node[0]]
    for row in rng.choice(later, round(WRONG_SHARE * len(labels)), replace=False):
        before = np.unique(table.truth[table.node < table.node[row]])
        others = before[before != table.truth[row]]
        if len(others):
            labels[row] = rng.choice(others)
    return replace(case, labels=labels)


def fine_grid(seed: int) -> Case:
    """Lines every 0.33 m both ways, and odometry that does not tell one from the next."""
    scenario = load_scenario("periodic")
    assert scenario.camera is not None
    scenario = replace(
        scenario,
        repeat=FINE_LAPS,
        camera=replace(scenario.camera, rate=FINE_RATE),
        sightings=replace(scenario.sightings, miss_rate=FINE_MISS),
        robot=scaled(scenario.robot, FINE_NOISE),
    )
    return _case(simulate_log(scenario, seed))


def wheel_slip(seed: int) -> Case:
    """The clean case's first 28 m; in mid-run one wheel, drawn by the seed, slips by 0.1 m."""
    log = simulate_log(replace(load_scenario("grid"), repeat=1), seed)
    assert log.wheels is not None
    assert log.robot is not None
    rng = np.random.default_rng([seed, 2])
    side, sign = int(rng.integers(2)), float(rng.choice([-1.0, 1.0]))
    t = log.wheels.t
    begin = rng.uniform(0.4, 0.6) * t[-1]
    radius = (log.robot.wheel_radius_left, log.robot.wheel_radius_right)[side]
    angle = log.wheels.angle.copy()
    angle[:, side] += sign * SLIP_M / radius * np.clip((t - begin) / SLIP_S, 0.0, 1.0)
    return _case(replace(log, wheels=Wheels(t, angle)))


def random_views(seed: int) -> Case:
    """The clean case's lines from a walk in random directions: half of all views are twins."""
    scenario = load_scenario("grid")
    rng = np.random.default_rng([seed, 3])
    place, heading = np.array([2.5, 2.5]), 0.0
    path: list[Motion] = []
    for _ in range(VIEWS):
        goal = rng.uniform(0.5, 4.5, 2)
        bearing = np.arctan2(*(goal - place)[::-1])
        turn = np.degrees(np.angle(np.exp(1j * (bearing - heading))))
        path += [Motion(turn_deg=float(turn)), Motion(forward=float(np.hypot(*(goal - place))))]
        place, heading = goal, bearing
    scenario = replace(scenario, repeat=1, path=tuple(path), start=Start(2.5, 2.5))
    return _case(simulate_log(scenario, seed))


def recorded(folder: Path, every: int = 1, odometry: float = 1.0, seed: int | None = None) -> Case:
    """A recording, thinned, or with worse odometry.

    Args:
        folder: of the log.
        every: takes each so-manieth image.
        odometry: multiple of the stated noise of the wheels.
        seed: where given, the noise that is stated beyond the log's own is also added to the
            wheels.
    """
    log = open_log(folder)
    assert log.robot is not None
    if seed is not None and odometry > 1.0:
        log = replace(log, wheels=_noisier(log, odometry, np.random.default_rng([seed, 4])))
    log = replace(log, robot=scaled(log.robot, odometry))
    return Case(log, extract(log, ExtractConfig(every=every)))


def scaled(robot: DifferentialDrive, factor: float) -> DifferentialDrive:
    """Returns a drive whose standard deviations are multiplied by ``factor``."""
    return replace(
        robot,
        noise_left=factor * robot.noise_left,
        noise_right=factor * robot.noise_right,
        slip=tuple(factor * sigma for sigma in robot.slip),
    )


def _case(log: Log) -> Case:
    return Case(log, extract(log))


def _noisier(log: Log, factor: float, rng: np.random.Generator) -> Wheels:
    """Returns wheel readings with so much noise added that it is ``factor`` times the stated."""
    assert log.wheels is not None
    assert log.robot is not None
    steps = np.diff(log.wheels.angle, axis=0)
    k = np.array([log.robot.noise_left, log.robot.noise_right])
    error = rng.standard_normal(steps.shape) * k * np.sqrt((factor**2 - 1.0) * np.abs(steps))
    drift = np.concatenate([np.zeros((1, 2)), np.cumsum(error, axis=0)])
    return Wheels(log.wheels.t, log.wheels.angle + drift)
