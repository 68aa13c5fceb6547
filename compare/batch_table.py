"""The table of a batch: what its result folders say, summed up by method and setting."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from compare.results import read_run
from compare.study import FIGURES, Figure, Summary
from graphslam.errors import GraphSlamError

CLAIMED = (
    Figure("position_sigma_m", "path sigma, claimed", "mm", 1e3, lambda m: m.position_sigma_m),
    Figure(
        "last_position_sigma_m", "last sigma, claimed", "mm", 1e3, lambda m: m.last_position_sigma_m
    ),
    Figure("heading_sigma_deg", "heading sigma, claimed", "°", 1.0, lambda m: m.heading_sigma_deg),
    Figure("landmarks", "landmarks in the map", "", 1.0, lambda m: m.landmarks, min),
    Figure("sightings_used", "sightings used", "", 1.0, lambda m: m.sightings_used, min),
)
"""What is known without truth, too."""
BATCH_FIGURES = (*FIGURES, *CLAIMED)
COMPARED = ("aligned_rmse_m", "map_rmse_m")
"""Figures by which methods are held against each other log by log; the smaller the better."""


@dataclass(frozen=True, slots=True)
class Row:
    """One method on one log.

    Attributes:
        point: number of the swept values in the batch.
        log: name of the log.
        method: name of the method.
        values: by name of the figure; NaN where it is not defined.
    """

    point: int
    log: str
    method: str
    values: dict[str, float]


@dataclass(frozen=True, slots=True)
class Failure:
    """A log, or one method on it, that gave no result.

    Attributes:
        point: number of the swept values in the batch.
        log: name of the log.
        method: the method that failed; empty where the whole log did.
        reason: what was found, where, and what to do.
    """

    point: int
    log: str
    method: str
    reason: str


@dataclass(frozen=True, slots=True)
class PointSummary:
    """One figure of one method over all logs that define it, at one point of a sweep.

    Attributes:
        point: number of the swept values in the batch.
        summary: method, figure, in how many logs it is defined, median, mean and worst.
    """

    point: int
    summary: Summary


@dataclass(frozen=True, slots=True)
class Duel:
    """Two methods held against each other by one figure on every log that both define it for.

    Attributes:
        point: number of the swept values in the batch.
        figure: which figure; the smaller the better.
        first: name of a method.
        second: name of another.
        logs: logs that define it for both and in which they differ.
        second_better: in how many of them the second has the smaller figure.
        median_ratio: median over the logs of the second's figure over the first's; NaN without any.
        p: probability that so uneven a count comes by chance from equal methods (two-sided sign
            test); NaN without logs.
    """

    point: int
    figure: Figure
    first: str
    second: str
    logs: int
    second_better: int
    median_ratio: float
    p: float


def read_result(folder: Path, point: int, log: str) -> tuple[list[Row], list[Failure]]:
    """Returns the rows of a result folder, and the methods that failed in it.

    Raises:
        GraphSlamError: the folder does not hold the result of a run.
    """
    info = read_run(folder)
    try:
        text = (folder / "metrics.json").read_text(encoding="utf-8")
        metrics = json.loads(text, object_hook=lambda entry: SimpleNamespace(**entry))
        rows = [
            Row(point, log, name, _values(entry)) for name, entry in vars(metrics.methods).items()
        ]
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise GraphSlamError(
            f"{folder / 'metrics.json'}: is damaged ({error}); remove the folder {folder} to "
            "compute it again"
        ) from error
    failed = info.get("failed", {})
    return rows, [Failure(point, log, name, reason) for name, reason in failed.items()]


def _values(method: Any) -> dict[str, float]:
    """Returns the figures of one method in metrics.json, where map NEES stands beside the map."""
    if method.map is not None:
        method.map.nees = method.map_nees
    found = {figure.name: figure.of(method) for figure in BATCH_FIGURES}
    return {name: math.nan if value is None else float(value) for name, value in found.items()}


def summarise(rows: Sequence[Row], points: int, methods: Sequence[str]) -> list[PointSummary]:
    """Returns median, mean and worst of each figure of each method at each point of a sweep."""
    table = []
    for point in range(points):
        for method in methods:
            mine = [row for row in rows if row.point == point and row.method == method]
            for figure in BATCH_FIGURES:
                found = [row.values[figure.name] for row in mine]
                table.append(PointSummary(point, _summary(method, figure, found)))
    return table


def _summary(method: str, figure: Figure, found: Sequence[float]) -> Summary:
    known = [value for value in found if not math.isnan(value)]
    if not known:
        return Summary(method, figure, 0, math.nan, math.nan, math.nan)
    middle, mean = float(np.median(known)), float(np.mean(known))
    return Summary(method, figure, len(known), middle, mean, figure.worst(known))


def duels(rows: Sequence[Row], points: int, methods: Sequence[str]) -> list[Duel]:
    """Returns how any two methods compare log by log, in the figures of `COMPARED`."""
    figures = [figure for figure in BATCH_FIGURES if figure.name in COMPARED]
    found = []
    for point in range(points):
        by_method = {
            method: {
                row.log: row.values for row in rows if (row.point, row.method) == (point, method)
            }
            for method in methods
        }
        for figure in figures:
            for first, second in combinations(methods, 2):
                duel = _duel(point, figure, first, second, by_method)
                if duel.logs:
                    found.append(duel)
    return found


def _duel(
    point: int,
    figure: Figure,
    first: str,
    second: str,
    by_method: dict[str, dict[str, dict[str, float]]],
) -> Duel:
    from scipy.stats import binomtest

    a, b = by_method[first], by_method[second]
    common = [(a[log][figure.name], b[log][figure.name]) for log in a if log in b]
    pairs = [(x, y) for x, y in common if x != y and not math.isnan(x + y)]
    better = sum(y < x for x, y in pairs)
    ratios = [y / x for x, y in pairs if x > 0]
    return Duel(
        point,
        figure,
        first,
        second,
        len(pairs),
        better,
        float(np.median(ratios)) if ratios else math.nan,
        float(binomtest(better, len(pairs)).pvalue) if pairs else math.nan,
    )
