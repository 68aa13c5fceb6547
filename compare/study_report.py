"""The files of a study that people read: tables, plots, one page."""

from __future__ import annotations

import math
from importlib.metadata import version
from pathlib import Path
from typing import Any

from compare.consistency import STATES
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
    """Returns mean NEES and its band at each distance, one row a level, method, state, distance."""
    rows = [
        (e, state, column, k)
        for e in entries
        if e.curve is not None
        for column, state in enumerate(STATES)
        for k in range(len(e.curve.distance))
    ]
    curves = [e.curve for e, *_ in rows if e.curve is not None]
    bands = [limits(state, curve.runs) for (_, state, *_), curve in zip(rows, curves, strict=True)]
    return {
        "noise": [str(e.noise) for e, *_ in rows],
        "method": [e.method for e, *_ in rows],
        "state": [state for _, state, *_ in rows],
        "distance_m": [c.distance[k] for (*_, k), c in zip(rows, curves, strict=True)],
        "nees_per_dof": [
            c.nees[k, column] for (_, _, column, k), c in zip(rows, curves, strict=True)
        ],
        "low": [low for low, _ in bands],
        "high": [high for _, high in bands],
        "runs": [c.runs for c in curves],
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
    numbers = (entry.pose, entry.map, entry.map_start)
    found = entry.overconfidence
    return {
        "noise": str(entry.noise),
        "method": method_entry(entry.method),
        "cells": [_three(value) if math.isfinite(value) else DASH for value in numbers],
        "verdict": DASH if entry.curve is None else str(found) if found else "none found",
    }


def _three(number: float) -> str:
    return f"{number:.0f}" if abs(number) >= 999.5 else f"{number:.3g}"


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
