"""What a study answers: efficiency, honesty, and which method is enough at which noise."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from compare.consistency import (
    STATES,
    Consistency,
    Innovations,
    Overconfidence,
    Surprise,
    band,
    overconfidence,
    pooled,
    surprise,
)
from compare.study import CURVES, POINTS, Study
from compare.study_figures import BOUNDS
from compare.verdict import WORTH_M, WORTH_SHARE
from compare.words import listed, metres
from frontend.simulate import NoiseLevel
from graphslam.geometry import Array

QUANTITIES = {
    "last pose": ("final_error_m", "from the common start"),
    "map": ("map_rmse_m", "after its own rigid motion"),
    "path": ("aligned_rmse_m", "aligned"),
}
"""What filter and smoother are compared by: figure and frame, as in the verdict of one run."""
OFTEN = 0.5
"""What more than this share of the runs say of their line directions is said of all."""


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
        innovations: squared innovations along the way, all runs taken together; None for methods
            that predict no sightings.
    """

    noise: NoiseLevel
    method: str
    curve: Consistency | None
    pose: float
    map: float
    map_start: float
    innovations: Innovations | None

    @property
    def surprise(self) -> Surprise | None:
        """From where on innovations exceed what it expects; None if nowhere."""
        return None if self.innovations is None else surprise(self.innovations)

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
            _innovations(result, level, method),
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


def _innovations(result: Study, level: NoiseLevel, method: str) -> Innovations | None:
    share, nis, freedom = (
        np.array([result.column(level, f"{method}.{name}.{k:02}") for k in range(POINTS)]).T
        for name in ("share", "innovation", "freedom")
    )
    known = np.isfinite(share).all(axis=1) if share.size else np.zeros(0, bool)
    if not known.any():
        return None
    runs = zip(share[known], nis[known], freedom[known], strict=True)
    return pooled([Innovations(*columns) for columns in runs])


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else math.nan


def answers(result: Study) -> list[str]:
    """Returns, for each level of noise, which method is enough for what, and who is overconfident.

    RMS errors over all runs are compared in the figures that the verdict of one run compares, and a
    difference matters as there.
    """
    sentences = []
    for level in result.noise:
        at = f"Noise {level}: " if len(result.noise) > 1 else ""
        said = [*_neither(result, level), *_filter_or_smooth(result, level)]
        sentences += [at + text for text in (*said, *_honest(result, level))]
    return sentences


def _neither(result: Study, level: NoiseLevel) -> Iterator[str]:
    """Yields that no method helps, where most runs have a direction that no sighting fixes."""
    angles = result.column(level, "neither_deg")
    known = np.radians(angles[np.isfinite(angles)])
    if len(known) > OFTEN * len(angles):
        mean = 0.5 * np.degrees(np.angle(np.exp(2j * known).mean())) % 180.0
        yield (
            f"do neither before adding a second line direction: in {len(known)} of {len(angles)} "
            f"runs no line fixes the position along one direction, on average {mean:.0f}° (floor "
            "frame)."
        )


@dataclass(frozen=True, slots=True)
class _Pair:
    """The filter's and the smoother's errors in one quantity, m: RMS over the runs, and median."""

    quantity: str
    rms: tuple[float, float]
    median: tuple[float, float]

    @property
    def figures(self) -> str:
        text = f"{metres(self.rms[0])} against {metres(self.rms[1])}"
        if _matters(*self.rms) != _matters(*self.median):
            text += f", in the median run {metres(self.median[0])} and {metres(self.median[1])}"
        return f"{self.quantity} ({text}; {QUANTITIES[self.quantity][1]})"


def _pairs(result: Study, level: NoiseLevel) -> Iterator[_Pair]:
    for quantity, (figure, _) in QUANTITIES.items():
        both = np.array([result.column(level, f"{m}.{figure}") for m in ("ekf", "smoother")])
        both = both[:, np.isfinite(both).all(axis=0)] if both.size else both
        if both.size:
            before, after = np.sqrt(np.mean(both**2, axis=1)).tolist()
            middle = np.median(both, axis=1).tolist()
            yield _Pair(quantity, (before, after), (middle[0], middle[1]))


def _filter_or_smooth(result: Study, level: NoiseLevel) -> Iterator[str]:
    pairs = list(_pairs(result, level)) if {"ekf", "smoother"} <= set(result.methods) else []
    if not pairs:
        return
    better = [p for p in pairs if _matters(*p.rms) and p.rms[1] < p.rms[0]]
    worse = [p for p in pairs if _matters(*p.rms) and p.rms[1] > p.rms[0]]
    enough = [p for p in pairs if not _matters(*p.rms)]
    parts = []
    if better:
        cuts = [f"by {1.0 - p.rms[1] / p.rms[0]:.0%} for the {p.figures}" for p in better]
        parts.append(f"smooth: it cuts the error {listed(cuts)}")
    if worse:
        parts.append(f"smoothing makes worse the {listed([p.figures for p in worse])}")
    if enough:
        parts.append(f"the filter is enough for the {listed([p.figures for p in enough])}")
    runs = len(result.at(level))
    yield (
        "; ".join(parts) + f". (RMS over {runs} runs, the filter's error first; a difference "
        f"matters above {WORTH_SHARE:.0%} and {metres(WORTH_M)}.)"
    )


def _matters(before: float, after: float) -> bool:
    size = abs(after - before)
    return bool(size > WORTH_M and size > WORTH_SHARE * max(before, after))


def _honest(result: Study, level: NoiseLevel) -> Iterator[str]:
    for entry in honesties(result):
        if entry.noise != level:
            continue
        if entry.curve is not None:
            nees = f"mean NEES of the poses {entry.pose:.3g}"
            found = entry.overconfidence
            what = f"is {found}" if found else "shows no overconfidence"
            yield f"{entry.method} {what} ({nees})."
        if entry.surprise is not None:
            yield f"{entry.method} is {entry.surprise}."


def limits(state: str, runs: int) -> tuple[float, float]:
    """Returns the chi-square band of a mean over ``runs`` runs of the NEES of one of `STATES`."""
    return band(3.0 if state == STATES[3] else 1.0, runs)
