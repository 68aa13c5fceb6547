"""What a study answers: efficiency, honesty, and which method is enough at which noise."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from compare.consistency import (
    STATES,
    Consistency,
    Overconfidence,
    band,
    overconfidence,
)
from compare.study import CURVES, POINTS, Study
from compare.study_figures import BOUNDS
from compare.verdict import WORTH_M, WORTH_SHARE
from frontend.simulate import NoiseLevel
from graphslam.geometry import Array

QUANTITIES = ("last pose", "map", "path")


@dataclass(frozen=True, slots=True)
class Efficiency:
    """How near one method comes to the bound in one quantity.

    Attributes:
        noise: level of noise.
        method: name of the method.
        quantity: "path", "last pose", "heading" or "map".
        unit: of the next two, "m" or "deg".
        error: RMS error over all runs, from the common start.
        bound: RMS over all runs of what no estimator undercuts on average; NaN where unknown.
        scatter: standard error of the efficiency, from the scatter between runs.
    """

    noise: NoiseLevel
    method: str
    quantity: str
    unit: str
    error: float
    bound: float
    scatter: float

    @property
    def ratio(self) -> float:
        """Error over bound: 1 is the best there is."""
        return self.error / self.bound if self.bound > 0 else math.nan


@dataclass(frozen=True, slots=True)
class Honesty:
    """Whether one method's covariances are as large as its errors, over all runs.

    Attributes:
        noise: level of noise.
        method: name of the method.
        curve: squared errors over covariances along the way, mean of the runs; None where the start
            is not known.
        pose: mean NEES of the poses per degree of freedom.
        map: the same of the map, up to a rigid motion.
        map_start: the same of the map, in the start's frame.
    """

    noise: NoiseLevel
    method: str
    curve: Consistency | None
    pose: float
    map: float
    map_start: float

    @property
    def overconfidence(self) -> Overconfidence | None:
        """In which coordinate, how much and from where on; None in none."""
        return None if self.curve is None else overconfidence(self.curve)


def efficiencies(result: Study) -> list[Efficiency]:
    """Returns one entry for each level, method and quantity."""
    return [
        _efficiency(result, level, method, *names)
        for level in result.noise
        for method in result.methods
        for names in BOUNDS
    ]


def _efficiency(
    result: Study, level: NoiseLevel, method: str, quantity: str, figure: str, field: str
) -> Efficiency:
    error = result.column(level, f"{method}.{figure}")
    bound = result.column(level, f"bound.{field}")
    known = np.isfinite(error)
    squares, bounds = error[known] ** 2, bound[known] ** 2
    mean, limit = (float(np.mean(v)) if len(v) else math.nan for v in (squares, bounds))
    scatter = math.nan
    if len(squares) > 1 and limit > 0 and mean > 0:
        relative = float(np.std(squares, ddof=1)) / math.sqrt(len(squares)) / mean
        scatter = 0.5 * relative * math.sqrt(mean / limit)
    unit = "deg" if figure.endswith("deg") else "m"
    return Efficiency(level, method, quantity, unit, math.sqrt(mean), math.sqrt(limit), scatter)


def honesties(result: Study) -> list[Honesty]:
    """Returns one entry for each level and method."""
    return [
        Honesty(
            level,
            method,
            _curve(result, level, method),
            *(
                _mean(result.column(level, f"{method}.{name}"))
                for name in ("pose_nees", "map_nees", "map_start_nees")
            ),
        )
        for level in result.noise
        for method in result.methods
    ]


def _curve(result: Study, level: NoiseLevel, method: str) -> Consistency | None:
    distance = np.array([result.column(level, f"distance.{k:02}") for k in range(POINTS)])
    values = np.array(
        [
            [result.column(level, f"{method}.{state}.{k:02}") for state in CURVES]
            for k in range(POINTS)
        ]
    )
    known = np.isfinite(values).all(axis=(0, 1)) if values.size else np.zeros(0, bool)
    if not known.any():
        return None
    return Consistency(
        distance[:, known].mean(axis=1), values[..., known].mean(axis=2), int(known.sum())
    )


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else math.nan


def answers(result: Study) -> list[str]:
    """Returns, for each level of noise, which method is enough for what, and who is overconfident.

    A difference of RMS errors over all runs matters as in `compare.verdict`.
    """
    sentences = []
    table = {(e.noise, e.method, e.quantity): e for e in efficiencies(result)}
    for level in result.noise:
        at = f"Noise {level}: " if len(result.noise) > 1 else ""
        if {"ekf", "smoother"} <= set(result.methods):
            pairs = {
                name: (table[level, "ekf", name].error, table[level, "smoother", name].error)
                for name in QUANTITIES
            }
            sentences.append(at + _filter_or_smooth(pairs))
        sentences += [at + text for text in _honest(result, level)]
    return sentences


def _filter_or_smooth(pairs: dict[str, tuple[float, float]]) -> str:
    enough = [name for name, pair in pairs.items() if not _matters(*pair)]
    better = [
        f"cuts the {name}'s RMS error by {1.0 - pair[1] / pair[0]:.0%}"
        for name, pair in pairs.items()
        if _matters(*pair) and pair[1] < pair[0]
    ]
    worse = [name for name, pair in pairs.items() if _matters(*pair) and pair[1] > pair[0]]
    parts = []
    if enough:
        parts.append(f"the filter is enough for the {_and(enough)}")
    if better:
        parts.append(f"smoothing {_and(better)}")
    if worse:
        parts.append(f"smoothing makes the {_and(worse)} worse")
    return "; ".join(parts) + f" (what matters: above {WORTH_SHARE:.0%} and {1e3 * WORTH_M:g} mm)."


def _matters(before: float, after: float) -> bool:
    size = abs(after - before)
    return bool(size > WORTH_M and size > WORTH_SHARE * max(before, after))


def _honest(result: Study, level: NoiseLevel) -> Iterator[str]:
    for entry in honesties(result):
        if entry.noise != level or entry.curve is None:
            continue
        found = entry.overconfidence
        if found is not None:
            yield f"{entry.method} is {found} (mean NEES of the poses {entry.pose:.3g})."
        else:
            yield (
                f"{entry.method} shows no overconfidence (mean NEES of the poses {entry.pose:.3g})."
            )


def _and(words: list[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def limits(state: str, runs: int) -> tuple[float, float]:
    """Returns the chi-square band of a mean over ``runs`` runs of the NEES of one of `STATES`."""
    return band(3.0 if state == STATES[3] else 1.0, runs)
