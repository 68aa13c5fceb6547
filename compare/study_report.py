"""The files of a study that people read: tables, plots, one page."""

from __future__ import annotations

import math
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from compare.consistency import FREEDOM, STATES, band
from compare.folders import whole_file
from compare.pages import method_entry, template
from compare.plots_study import draw_study
from compare.plots_style import style
from compare.results import write_csv
from compare.study import Study
from compare.study_answers import (
    Efficiency,
    Honesty,
    answers,
    efficiencies,
    honesties,
    limits,
)

DASH = "–"


def write_study(result: Study, out: Path) -> Path:
    """Writes efficiency.csv, consistency.csv, plots/* and report.html; returns the last.

    Equal studies give equal bytes.
    """
    near, honest = efficiencies(result), honesties(result)
    with whole_file(out / "efficiency.csv") as path:
        write_csv(path, _efficiency_columns(near))
    with whole_file(out / "consistency.csv") as path:
        write_csv(path, _consistency_columns(honest))
    with style():
        plots = draw_study(result)
    (out / "plots").mkdir(exist_ok=True)
    for plot in plots:
        with whole_file(out / "plots" / f"{plot.name}.svg") as path:
            _write(path, plot.standalone())
        with whole_file(out / "plots" / f"{plot.name}.csv") as path:
            write_csv(path, plot.data)
    html = template("study.html").render(
        title=result.scenario,
        version=version("floorline-slam"),
        runs=len(result.runs) // len(result.noise),
        failed=len(result.failed),
        noise=[str(level) for level in result.noise],
        answers=answers(result),
        efficiency=[_efficiency_row(entry) for entry in near],
        honesty=[_honesty_row(entry) for entry in honest],
        plots=plots,
    )
    with whole_file(out / "report.html") as path:
        _write(path, html)
    return out / "report.html"


def _efficiency_columns(entries: list[Efficiency]) -> dict[str, list[Any]]:
    return {
        "noise": [str(e.noise) for e in entries],
        "method": [e.method for e in entries],
        "quantity": [e.quantity for e in entries],
        "unit": [e.unit for e in entries],
        "rms_error": [e.error for e in entries],
        "bound": [e.bound for e in entries],
        "efficiency": [e.ratio for e in entries],
        "standard_error": [e.scatter for e in entries],
    }


def _consistency_columns(entries: list[Honesty]) -> dict[str, list[Any]]:
    """Returns mean NEES and NIS and their bands, one row a level, method, state and distance."""
    rows = [
        (e, state, column, k)
        for e in entries
        if e.curve is not None
        for column, state in enumerate(STATES)
        for k in range(len(e.curve.distance))
    ]
    curves = [e.curve for e, *_ in rows if e.curve is not None]
    bands = [limits(state, curve.runs) for (_, state, *_), curve in zip(rows, curves, strict=True)]
    errors = {
        "noise": [str(e.noise) for e, *_ in rows],
        "method": [e.method for e, *_ in rows],
        "state": [state for _, state, *_ in rows],
        "distance_m": [c.distance[k] for (*_, k), c in zip(rows, curves, strict=True)],
        "per_dof": [c.nees[k, column] for (_, _, column, k), c in zip(rows, curves, strict=True)],
        "low": [low for low, _ in bands],
        "high": [high for _, high in bands],
        "freedom": [
            c.runs * FREEDOM[column] for (*_, column, _), c in zip(rows, curves, strict=True)
        ],
    }
    expected = _innovation_columns(entries)
    return {name: [*errors[name], *expected[name]] for name in errors}


def _innovation_columns(entries: list[Honesty]) -> dict[str, list[Any]]:
    """Returns the same columns for NIS: of all runs together, in each share of the way."""
    rows = [
        (e, e.innovations, k)
        for e in entries
        if e.innovations is not None
        for k in np.flatnonzero(e.innovations.freedom > 0)
    ]
    bands = [band(float(found.freedom[k])) for _, found, k in rows]
    return {
        "noise": [str(e.noise) for e, *_ in rows],
        "method": [e.method for e, *_ in rows],
        "state": ["innovation" for _ in rows],
        "distance_m": [found.distance[k] for _, found, k in rows],
        "per_dof": [found.nis[k] for _, found, k in rows],
        "low": [low for low, _ in bands],
        "high": [high for _, high in bands],
        "freedom": [found.freedom[k] for _, found, k in rows],
    }


def _efficiency_row(entry: Efficiency) -> dict[str, Any]:
    scale, unit = (1e3, "mm") if entry.unit == "m" else (1.0, "°")
    cells = [f"{_three(scale * v)} {unit}" if v == v else DASH for v in (entry.error, entry.bound)]
    ratio = f"{entry.ratio:.2f} ± {entry.scatter:.2f}" if math.isfinite(entry.ratio) else DASH
    return {
        "noise": str(entry.noise),
        "method": method_entry(entry.method),
        "quantity": entry.quantity,
        "cells": [*cells, ratio],
    }


def _honesty_row(entry: Honesty) -> dict[str, Any]:
    nis = math.nan if entry.innovations is None else entry.innovations.total
    numbers = (entry.pose, entry.map, entry.map_start, nis)
    found = [str(said) for said in (entry.overconfidence, entry.surprise) if said]
    return {
        "noise": str(entry.noise),
        "method": method_entry(entry.method),
        "cells": [_three(value) if math.isfinite(value) else DASH for value in numbers],
        "verdict": "; ".join(found) or (DASH if entry.curve is None else "none found"),
    }


def _three(number: float) -> str:
    return f"{number:.0f}" if abs(number) >= 999.5 else f"{number:.3g}"


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
