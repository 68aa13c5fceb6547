"""The page and the files that `graphslam study --what-if` writes."""

from __future__ import annotations

import math
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from compare.content import plain
from compare.pages import template
from compare.plots_style import style
from compare.plots_what_if import draw_what_if
from compare.results import whole_folder, write_csv, write_json
from compare.what_if import QUANTITIES, Prediction, WhatIf
from graphslam.errors import BadConfig

FORMAT = "graphslam-what-if/1"
FILE = "what-if.json"
DASH = "–"


def write_what_if(result: WhatIf, name: str, verdict: tuple[str, ...], out: Path) -> Path:
    """Writes report.html, what-if.json, what-if.csv and plots/*; returns the page.

    Args:
        result: what to write.
        name: of the log or scenario.
        verdict: sentences on the run as it is, which method to use and how far to trust it.
        out: that of an earlier one is replaced, any other folder is refused.

    Raises:
        BadConfig: the folder is somebody else's.
        OSError: it cannot be written.
    """
    entries = (result.now, *result.predictions)
    with style():
        plot = draw_what_if(result)
    with whole_folder(out, _check) as folder:
        (folder / "plots").mkdir()
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
            verdict=verdict,
            quantities=list(QUANTITIES),
            rows=[_row(result, entry) for entry in entries],
            left_out=result.left_out,
            plot=plot,
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
        text = f"{value:.3g}°" if field.endswith("deg") else f"{1e3 * value:.3g} mm"
        cells.append(text if entry is result.now else f"{text} (−{gain:.0%})".replace("−-", "+"))
    left = "; ".join(map(str, entry.unobserved)) or "nothing"
    return {"change": entry.change, "cells": cells, "sightings": entry.sightings, "open": left}


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
