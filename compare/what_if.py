"""What would help: the bound of a run recomputed for floors, wheels and cameras it did not have."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from compare.bound import Bound, bound_of
from compare.situation import (
    Situation,
    node_times_twice,
    sightings_used,
    situation_of,
    with_better_wheels,
    with_crossing_lines,
    with_sharper_sightings,
    with_twice_the_frames,
)
from compare.truth import Truth, truth_of
from compare.verdict import WORTH_SHARE
from frontend.nodes import odometry_at
from graphslam.config import Engine
from graphslam.errors import BadConfig, UnderConstrained
from graphslam.estimate import Estimate, Unobserved
from graphslam.measurements import Measurements, Odometry

if TYPE_CHECKING:
    from compare.config import RunConfig
    from compare.run import Progress
    from frontend.config import NoiseConfig
    from frontend.log import Log

HALF = 0.5
QUANTITIES = {"last pose": "final_m", "map": "map_m", "path": "path_m", "heading": "heading_deg"}
"""Name of each quantity and the field of `compare.bound.Bound` that holds it."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """What the bound would be after one change.

    Attributes:
        change: what is changed, in words.
        bound: the bound then; that of the lines that there are now, for the map.
        sightings: sightings that would count.
        unobserved: directions of the last position that would stay open.
    """

    change: str
    bound: Bound
    sightings: int
    unobserved: tuple[Unobserved, ...]


@dataclass(frozen=True, slots=True)
class WhatIf:
    """The bound of a run, and what would make it smaller.

    Attributes:
        now: the run as it is.
        predictions: one a change.
        left_out: changes that could not be judged, and why.
    """

    now: Prediction
    predictions: tuple[Prediction, ...]
    left_out: tuple[str, ...]

    def gain(self, prediction: Prediction, quantity: str) -> float:
        """Returns by which part a change makes the bound of one of `QUANTITIES` smaller."""
        field = QUANTITIES[quantity]
        return 1.0 - float(getattr(prediction.bound, field) / getattr(self.now.bound, field))

    def sentences(self) -> list[str]:
        """Returns the answer in words: what is not observed, and what helps most with what."""
        said = [f"As it is, {direction}." for direction in self.now.unobserved]
        for quantity, field in list(QUANTITIES.items())[:3]:
            now = 1e3 * getattr(self.now.bound, field)
            ranked = sorted(self.predictions, key=lambda p: -self.gain(p, quantity))
            if not ranked or not np.isfinite(now):
                continue
            best, gain = ranked[0], self.gain(ranked[0], quantity)
            if gain > WORTH_SHARE:
                then = 1e3 * getattr(best.bound, field)
                said.append(
                    f"{quantity.capitalize()}: {best.change} would help most: the best possible "
                    f"RMS error falls from {now:.3g} mm to {then:.3g} mm, by {gain:.0%}."
                )
            else:
                said.append(
                    f"{quantity.capitalize()}: none of these changes lowers the best possible RMS "
                    f"error of {now:.3g} mm by more than {WORTH_SHARE:.0%}."
                )
        return said


def what_if(
    log: Log,
    measurements: Measurements,
    estimate: Estimate,
    noise: NoiseConfig,
    engine: Engine = "auto",
) -> WhatIf:
    """Returns the bound of a run at its truth, or at an estimate without one, and after changes.

    Nothing is simulated and nothing estimated: each change alters which sightings there are, or the
    covariances of sightings and increments, and the information is summed up anew.

    Args:
        log: the recording.
        measurements: extracted from it.
        estimate: the smoother's, for its matches, and for path and map where there is no truth.
        noise: the wheels' noise that ``measurements`` were extracted with.
        engine: who computes.

    Raises:
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    truth = truth_of(log, measurements)
    situation = situation_of(measurements, truth, estimate)
    now = _predicted("as it is", situation, situation, truth, engine)
    predictions, left_out = [], []
    for change in _changes(log, situation, noise):
        try:
            words, changed = change()
            predictions.append(_predicted(words, changed, situation, truth, engine))
        except (BadConfig, UnderConstrained) as error:
            left_out.append(str(error))
    return WhatIf(now, tuple(predictions), tuple(left_out))


Change = Callable[[], tuple[str, Situation]]


def _changes(log: Log, now: Situation, noise: NoiseConfig) -> Iterator[Change]:
    def crossing() -> tuple[str, Situation]:
        changed, degrees, spacing = with_crossing_lines(now)
        return f"lines every {spacing:.2g} m with normals along {degrees:.0f}°", changed

    yield crossing
    yield lambda: ("twice the frame rate", with_twice_the_frames(now, _odometry(log, now, noise)))
    yield lambda: ("half the noise of the sightings", with_sharper_sightings(now, HALF))
    yield lambda: ("half the noise of the wheels", with_better_wheels(now, HALF))


def _odometry(log: Log, now: Situation, noise: NoiseConfig) -> Odometry:
    t = np.sort(np.concatenate([now.measurements.t, node_times_twice(now.measurements.t)]))
    return odometry_at(log, t, noise)


def _predicted(
    words: str, situation: Situation, before: Situation, truth: Truth, engine: Engine
) -> Prediction:
    from graphslam.smoother.bound import cramer_rao

    measurements, match = situation.measurements, situation.match
    found = cramer_rao(measurements, match, situation.pose, situation.landmarks.params, engine)
    rows = np.arange(len(before.landmarks))
    bound = bound_of(found, measurements, situation.at, truth, rows)
    return Prediction(words, bound, sightings_used(situation), found.unobserved)


def what_if_log(
    path: str, config: RunConfig, progress: Progress | None = None
) -> tuple[str, WhatIf, tuple[str, ...]]:
    """Returns name, bounds and verdict of a log, or of the run with seed 0 of a scenario.

    Args:
        path: a log, a scenario file, or the name of a scenario that is shipped.
        config: how to extract and to estimate.
        progress: told about each stage.

    Raises:
        BadConfig, BadLog: it is neither, or cannot be used.
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    from compare.comparison import compare
    from compare.methods import run_methods
    from compare.run import on_known_map, open_as
    from frontend.extract import extract
    from frontend.simulate import load_scenario, scenario_names, simulate_log

    place = Path(path)
    if place.suffix == ".toml" or (path in scenario_names() and not place.exists()):
        log = simulate_log(load_scenario(path))
    else:
        log = open_as(path, config, progress)
    inside = None if progress is None else partial(progress, f"{log.name}: extract")
    measurements = extract(log, config.extract, inside)
    measurements = on_known_map(measurements, config.known_map)
    methods = replace(config, methods=("odometry", "ekf", "smoother"))
    estimates, failed = run_methods(measurements, methods, lambda name, call: call())
    for error in failed.values():
        raise error
    engine = config.smoother.engine
    judged = compare(log, measurements, list(estimates.values()), engine)
    noise = config.extract.noise
    result = what_if(log, measurements, estimates["smoother"], noise, engine)
    return log.name, result, judged.verdict
