"""The report: one HTML file, readable without a network, and an overview of several runs."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from compare import report_tables as tables
from compare.pages import method_entry, source, template
from compare.plots import draw
from compare.record import Record
from compare.report_landmarks import landmark_table, nothing_judged, point_table
from compare.report_quality import lines_per_node, most_seen_line, within_limits, worst_residuals
from compare.report_replay import REPLAY_NOTE, replay_json
from compare.report_summary import summary
from compare.results import write_csv
from compare.words import landmark_kinds, noun
from graphslam.errors import BadConfig

SCRIPTS = ("pages.js", "drawing.js", "replay.js")
MARK = '<meta name="generator" content="graphslam">'


@dataclass(frozen=True, slots=True)
class IndexEntry:
    """One line of the overview.

    Attributes:
        name: of the log.
        folder: of its result, beside the overview; None where it failed.
        metrics: content of its metrics.json.
        error: why it failed.
    """

    name: str
    folder: str | None
    metrics: Mapping[str, Any]
    error: str


def write_report(record: Record, folder: Path) -> None:
    """Writes report.html and plots/* of a run into its folder; equal records, equal bytes.

    All that depends on how long the run took stands between ``<!-- timings -->`` and
    ``<!-- /timings -->``.
    """
    plots = draw(record)
    directory = folder / "plots"
    directory.mkdir(exist_ok=True)
    for plot in plots.values():
        _write(directory / f"{plot.name}.svg", plot.standalone())
        write_csv(directory / f"{plot.name}.csv", plot.data)
    landmarks, points = landmark_table(record), point_table(record)
    matching = tables.matching(record.metrics)
    for table in (landmarks, matching, points):
        if table is not None:
            table["methods"] = [method_entry(name) for name in table["methods"]]
    script = "\n".join(source(name) for name in SCRIPTS)
    kinds = landmark_kinds(record.measurements)
    seen = noun(kinds)
    html = template("report.html").render(
        name=record.info["log"]["name"],
        digest=record.info["log"]["digest"],
        version=record.info["versions"]["floorline-slam"],
        facts=tables.facts(record),
        verdict=record.metrics["verdict"],
        alarms=record.metrics.get("alarms", ()),
        methods=[method_entry(name) for name in record.estimates],
        summary=summary(record.metrics),
        seen=seen,
        lines="line" in kinds,
        true_points=len(record.true_points) > 0,
        nothing=nothing_judged(record),
        landmarks=landmarks,
        matching=matching,
        points=points,
        warnings=record.info["warnings"],
        unobserved=_unobserved(record),
        rejected=tables.rejected(record),
        quantities=tables.quantities(record),
        timings=tables.timings(record.timings),
        latency=tables.latency(record),
        check=record.info.get("check"),
        places=record.info.get("places"),
        plots=plots,
        known={name: method_entry(name) for name in record.estimates},
        has_truth=record.has_true_pose or len(record.true_lines) > 0,
        frames=record.frames is not None,
        within=within_limits(record),
        per_node=lines_per_node(record),
        most_seen=most_seen_line(record),
        worst=worst_residuals(record),
        replay=replay_json(record),
        replay_note=REPLAY_NOTE,
        script=script,
        script_hash=base64.b64encode(sha256(script.encode()).digest()).decode(),
    )
    _write(folder / "report.html", html)


def rebuild_report(folder: Path | str) -> Path:
    """Writes a run's report and plots again from the files in its folder; returns the report.

    Raises:
        BadConfig: the folder is not one of a run, or holds measurements only.
        BadMeasurements: one of its files is missing or was changed.
    """
    folder = Path(folder)
    write_report(Record.load(folder), folder)
    return folder / "report.html"


def check_index(folder: Path) -> None:
    """Raises BadConfig where ``folder`` holds an index.html that `write_index` did not write."""
    index = folder / "index.html"
    if index.exists() and MARK not in index.read_text(encoding="utf-8", errors="replace")[:2000]:
        raise BadConfig(f"{index}: was not written by this program; give another --out")


def write_index(folder: Path, entries: Sequence[IndexEntry]) -> Path:
    """Writes ``index.html``, an overview of the runs in ``folder``, and returns its path."""
    columns = [column for column in _index_columns(entries) if any(column["cells"])]
    rows = [
        {
            "name": entry.name,
            "folder": entry.folder,
            "cells": [tables.number(column["cells"][i]) for column in columns],
            "verdict": entry.error or next(iter(entry.metrics["verdict"]), ""),
        }
        for i, entry in enumerate(entries)
    ]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "index.html"
    _write(path, template("index.html").render(rows=rows, columns=columns))
    return path


def _index_columns(entries: Sequence[IndexEntry]) -> list[dict[str, Any]]:
    """Returns for each method its columns of path and map errors (mm), None where unknown."""
    names = dict.fromkeys(name for entry in entries for name in entry.metrics.get("methods", {}))
    figures = (("path", "trajectory", "aligned_rmse_m"), ("map", "map", "rho_rmse_m"))
    return [
        {
            "method": method_entry(name),
            "title": title,
            "cells": [_mm(e, name, *keys) for e in entries],
        }
        for name in names
        for title, *keys in figures
    ]


def _mm(entry: IndexEntry, method: str, part: str, key: str) -> float | None:
    value = ((entry.metrics.get("methods", {}).get(method) or {}).get(part) or {}).get(key)
    return None if value is None else 1e3 * value


def _unobserved(record: Record) -> list[str]:
    return [
        f"{name}: {direction['text']}"
        for name, figures in record.metrics["methods"].items()
        if figures["sightings_used"]
        for direction in figures["unobserved"]
    ]


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
