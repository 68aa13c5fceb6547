"""The page and the files that `graphslam study --what-if` writes."""

from __future__ import annotations

import math
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from compare.comparison import Comparison, MethodMetrics
from compare.content import plain
from compare.pages import template
from compare.plots_style import style
from compare.plots_what_if import draw_plan, draw_what_if
from compare.results import whole_folder, write_csv, write_json
from compare.what_if import QUANTITIES, Prediction, WhatIf
from compare.words import metres
from graphslam.errors import BadConfig
from graphslam.estimate import Unobserved

FORMAT = "graphslam-what-if/1"
FILE = "what-if.json"
DASH = "–"
FIRST = 3
"""Sentences of the verdict that the page shows at once; the others unfold."""


def write_what_if(result: WhatIf, name: str, judged: Comparison, out: Path) -> Path:
    """Writes report.html, what-if.json, what-if.csv and plots/*; returns the page.

    Args:
        result: what to write.
        name: of the log or scenario.
        judged: the run as it is, for its verdict and for what the methods reach now.
        out: that of an earlier one is replaced, any other folder is refused.

    Raises:
        BadConfig: the folder is somebody else's.
        OSError: it cannot be written.
    """
    entries = (result.now, *result.predictions)
    with style():
        plots = [draw_what_if(result), draw_plan(result)]
    with whole_folder(out, _check) as folder:
        (folder / "plots").mkdir()
        for plot in plots:
            _write(folder / "plots" / f"{plot.name}.svg", plot.standalone())
            write_csv(folder / "plots" / f"{plot.name}.csv", plot.data)
        write_csv(folder / "what-if.csv", _columns(result))
        content = {"format": FORMAT, "name": name, "sentences": result.sentences()}
        content["predictions"] = [asdict(entry) for entry in entries]
        write_json(folder / FILE, plain(content | {"left_out": result.left_out}))
        html = template("what_if.html").render(
            title=name,
            version=version("floorline-slam"),
            at=result.now.bound.at,
            sentences=result.sentences(),
            verdict=judged.verdict,
            first=FIRST,
            quantities=list(QUANTITIES),
            rows=[_row(result, entry) for entry in entries],
            reached=[_reached(entry) for entry in judged.methods if entry.trajectory is not None],
            left_out=result.left_out,
            plots=plots,
        )
        _write(folder / "report.html", html)
    return out / "report.html"


def _check(folder: Path) -> None:
    if (folder.exists() or folder.is_symlink()) and not (folder / FILE).is_file():
        raise BadConfig(
            f"{folder}: exists and holds no {FILE} of ours, so it is not replaced; give another "
            "--out, or move it away"
        )


def _columns(result: WhatIf) -> dict[str, list[Any]]:
    entries = (result.now, *result.predictions)
    columns: dict[str, list[Any]] = {
        "change": [entry.change for entry in entries],
        "how": [entry.how for entry in entries],
        "sightings": [entry.sightings for entry in entries],
        "unobserved": ["; ".join(map(str, entry.unobserved)) for entry in entries],
    }
    for quantity, field in QUANTITIES.items():
        columns[field] = [getattr(entry.bound, field) for entry in entries]
        gains = [result.gain(entry, quantity) for entry in entries]
        columns[f"{field.rpartition('_')[0]}_gain"] = gains
    return columns


def _row(result: WhatIf, entry: Prediction) -> dict[str, Any]:
    cells = []
    for quantity, field in QUANTITIES.items():
        value, gain = float(getattr(entry.bound, field)), result.gain(entry, quantity)
        if not math.isfinite(value):
            cells.append(DASH)
            continue
        text = f"{value:.3g}°" if field.endswith("deg") else metres(value)
        cells.append(text if entry is result.now else f"{text} (−{gain:.0%})".replace("−-", "+"))
    left = ", ".join(_short(direction) for direction in entry.unobserved) or "nothing"
    own = {"change": entry.change, "how": entry.how, "open": left}
    return own | {"cells": cells, "sightings": entry.sightings}


def _short(entry: Unobserved) -> str:
    if entry.stretch is not None:
        return f"{metres(entry.stretch.length_m)} of the way"
    named = entry.direction != (0.0, 0.0)
    return f"{entry.quantity} along {entry.angle_deg:.0f}°" if named else entry.quantity


def _reached(m: MethodMetrics) -> dict[str, Any]:
    """Returns what a method's errors are now, in the quantities and the frame of the bound."""
    assert m.trajectory is not None, "errors need a true path"
    offset = math.nan if m.map is None else m.map.unaligned_rho_rmse_m
    lengths = (m.trajectory.final_error_m, offset, m.trajectory.rmse_m)
    cells = [metres(value) if math.isfinite(value) else DASH for value in lengths]
    return {"method": m.method, "cells": [*cells, f"{m.trajectory.heading_rmse_deg:.3g}°"]}


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
