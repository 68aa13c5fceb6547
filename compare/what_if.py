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
from compare.verdict import WORTH_M, WORTH_SHARE
from compare.words import listed, metres
from frontend.nodes import odometry_at
from graphslam.config import Engine
from graphslam.errors import BadConfig, UnderConstrained
from graphslam.estimate import Estimate, Unobserved
from graphslam.geometry import Array
from graphslam.measurements import Measurements, Odometry
from graphslam.models.line import LINE

if TYPE_CHECKING:
    from compare.clock import Progress
    from compare.comparison import Comparison
    from compare.config import RunConfig
    from frontend.config import NoiseConfig
    from frontend.log import Log

HALF = 0.5
QUANTITIES = {"last pose": "final_m", "map": "map_m", "path": "path_m", "heading": "heading_deg"}
"""Name of each quantity and the field of `compare.bound.Bound` that holds it."""
LENGTHS = ("last pose", "map", "path")
"""Those that are lengths, in the order in which they are spoken of."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """What the bound would be after one change.

    Attributes:
        change: what is changed, in words.
        how: what an owner can do for it; empty for the run as it is.
        bound: the bound then; that of the lines that there are now, for the map.
        sightings: sightings that would count.
        unobserved: directions of the last position that would stay open.
    """

    change: str
    how: str
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
        added: (n, 2) the lines across that the first prediction adds; empty where it was left out.
        situation: the run as it is, for its plan.
    """

    now: Prediction
    predictions: tuple[Prediction, ...]
    left_out: tuple[str, ...]
    added: Array
    situation: Situation

    def gain(self, prediction: Prediction, quantity: str) -> float:
        """Returns by which part a change makes the bound of one of `QUANTITIES` smaller."""
        field = QUANTITIES[quantity]
        return 1.0 - float(getattr(prediction.bound, field) / getattr(self.now.bound, field))

    def matters(self, prediction: Prediction, quantity: str) -> bool:
        """Returns whether a change makes a bound (m) smaller by what `compare.verdict` calls so."""
        field = QUANTITIES[quantity]
        fall = getattr(self.now.bound, field) - getattr(prediction.bound, field)
        return bool(fall > WORTH_M and self.gain(prediction, quantity) > WORTH_SHARE)

    def sentences(self) -> list[str]:
        """Returns the answer in words: what is not observed, what to do first, what it brings."""
        said = [f"As it is, {direction}." for direction in self.now.unobserved]
        judged = [q for q in LENGTHS if np.isfinite(getattr(self.now.bound, QUANTITIES[q]))]
        best = {q: self._best(q) for q in judged}
        wanted = [entry.change for entry in best.values() if entry is not None]
        if judged and not wanted:
            said.append(
                "Nothing needs to change: sightings and wheels already hold all that matters here."
            )
        elif wanted:
            first = max(dict.fromkeys(wanted), key=wanted.count)
            entry = next(e for e in self.predictions if e.change == first)
            said.append(f"Do this first: {entry.how}.")
        return said + [self._said_of(quantity, best[quantity]) for quantity in judged]

    def _best(self, quantity: str) -> Prediction | None:
        """Returns the change that lowers a bound most, None where none matters."""
        ranked = sorted(self.predictions, key=lambda p: -self.gain(p, quantity))
        return next((entry for entry in ranked if self.matters(entry, quantity)), None)

    def _said_of(self, quantity: str, best: Prediction | None) -> str:
        field = QUANTITIES[quantity]
        now = metres(getattr(self.now.bound, field))
        if best is None:
            return (
                f"{quantity.capitalize()}: the best possible RMS error is {now}, and none of these "
                f"changes lowers it by more than {WORTH_SHARE:.0%} and {metres(WORTH_M)}."
            )
        then, gain = metres(getattr(best.bound, field)), self.gain(best, quantity)
        others = [
            f"{entry.change} by {self.gain(entry, quantity):.0%}"
            for entry in self.predictions
            if entry is not best and self.matters(entry, quantity)
        ]
        return (
            f"{quantity.capitalize()}: {best.change} would help most: the best possible RMS error "
            f"falls from {now} to {then}, by {gain:.0%}"
            + (f"; {listed(others)}." if others else "; no other change matters.")
        )


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
    now = _predicted("as it is", "", situation, situation, truth, engine)
    predictions, left_out, added = [], [], np.zeros((0, 2))
    for change in _changes(log, situation, noise):
        try:
            words, how, changed = change()
            predictions.append(_predicted(words, how, changed, situation, truth, engine))
        except (BadConfig, UnderConstrained) as error:
            left_out.append(str(error))
            continue
        new = changed.landmarks.params[len(situation.landmarks) :, : LINE.dim_landmark]
        added = new if len(new) else added
    return WhatIf(now, tuple(predictions), tuple(left_out), added, situation)


Change = Callable[[], tuple[str, str, Situation]]


def _changes(log: Log, now: Situation, noise: NoiseConfig) -> Iterator[Change]:
    def crossing() -> tuple[str, str, Situation]:
        changed, degrees, spacing = with_crossing_lines(now)
        run = (degrees + 90.0) % 180.0
        return (
            f"lines every {spacing:.2g} m with normals along {degrees:.0f}°",
            f"lay lines (tape will do) that run along {run:.0f}° of the floor frame, "
            f"{spacing:.2g} m apart, across the robot's way; the plan shows them",
            changed,
        )

    def frames() -> tuple[str, str, Situation]:
        gap = float(np.median(np.diff(now.measurements.t)))
        how = f"take {2.0 / gap:.3g} frames a second instead of {1.0 / gap:.3g}"
        return "twice the frame rate", how, with_twice_the_frames(now, _odometry(log, now, noise))

    yield crossing
    yield frames
    yield lambda: (
        "half the noise of the sightings",
        "see lines twice as sharply: twice the pixels on the same floor, or a view half as wide; "
        "even light; a camera calibrated anew",
        with_sharper_sightings(now, HALF),
    )
    yield lambda: (
        "half the noise of the wheels",
        "slip half as much: turn more slowly, harder tyres, finer encoders, wheels calibrated anew",
        with_better_wheels(now, HALF),
    )


def _odometry(log: Log, now: Situation, noise: NoiseConfig) -> Odometry:
    t = np.sort(np.concatenate([now.measurements.t, node_times_twice(now.measurements.t)]))
    return odometry_at(log, t, noise)


def _predicted(
    words: str, how: str, situation: Situation, before: Situation, truth: Truth, engine: Engine
) -> Prediction:
    from graphslam.smoother.bound import cramer_rao

    measurements, match = situation.measurements, situation.match
    found = cramer_rao(measurements, match, situation.pose, situation.landmarks.params, engine)
    rows = np.arange(len(before.landmarks))
    bound = bound_of(found, measurements, situation.at, truth, rows)
    return Prediction(words, how, bound, sightings_used(situation), found.unobserved)


def what_if_log(
    path: str, config: RunConfig, progress: Progress | None = None
) -> tuple[str, WhatIf, Comparison]:
    """Returns name, bounds and comparison of a log, or of the run with seed 0 of a scenario.

    Args:
        path: a log, a scenario file, or the name of a scenario that is shipped.
        config: how to extract and to estimate.
        progress: told about each stage.

    Raises:
        BadConfig, BadLog: it is neither, or cannot be used.
        UnderConstrained: the measurements do not determine every pose and landmark.
    """
    from compare.comparison import compare
    from compare.known import on_known_map
    from compare.methods import run_methods
    from compare.opening import open_as
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
    return log.name, result, judged
