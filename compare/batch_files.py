"""The files of a batch: its tables, for programs and for people."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from compare.batch_table import BATCH_FIGURES
from compare.folders import whole_file
from compare.results import write_csv, write_json
from graphslam.errors import BadConfig

if TYPE_CHECKING:
    from compare.batch import Batch

BATCH_FORMAT = "graphslam-batch/1"
TABLE, SUMMARY, CONTENT, PAGE = "batch.csv", "summary.csv", "batch.json", "batch.html"


def check_batch_folder(out: Path) -> None:
    """Raises BadConfig where ``out`` is no folder, or holds our files' names but not our files."""
    if out.exists() and not out.is_dir():
        raise BadConfig(f"{out}: is not a folder; give another --out")
    present = [name for name in (CONTENT, TABLE, SUMMARY, PAGE) if (out / name).exists()]
    if present and not _is_ours(out / CONTENT):
        raise BadConfig(
            f"{out / present[0]}: was not written by this program, so it is not replaced; give "
            "another --out"
        )


def _is_ours(path: Path) -> bool:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("format") == BATCH_FORMAT


def write_batch(result: Batch) -> None:
    """Writes batch.json, batch.csv, summary.csv and batch.html; equal batches, equal bytes."""
    from compare.report_batch import batch_page

    with whole_file(result.folder / CONTENT) as path:
        write_json(path, _content(result))
    with whole_file(result.folder / TABLE) as path:
        write_csv(path, _table(result))
    with whole_file(result.folder / SUMMARY) as path:
        write_csv(path, _quoted(_summary(result)))
    with whole_file(result.folder / PAGE) as path:
        path.write_text(batch_page(result), encoding="utf-8", newline="\n")


def _content(result: Batch) -> dict[str, Any]:
    """Returns the content of batch.json."""
    return {
        "format": BATCH_FORMAT,
        "version": version("floorline-slam"),
        "config": asdict(result.config),
        "sweep": [dict(point.values) for point in result.points],
        "logs": [log.name for log in result.logs],
        "methods": result.methods,
        "results": [
            {**_place(result, row.point), "log": row.log, "method": row.method, **row.values}
            for row in result.rows
        ],
        "summary": _records(_summary(result)),
        "log_by_log": [
            {
                **_place(result, duel.point),
                "figure": duel.figure.name,
                "first": duel.first,
                "second": duel.second,
                "logs": duel.logs,
                "second_better": duel.second_better,
                "median_ratio": duel.median_ratio,
                "p": duel.p,
            }
            for duel in result.duels
        ],
        "failures": [
            {
                **_place(result, failure.point),
                "log": failure.log,
                "method": failure.method or None,
                "reason": failure.reason,
            }
            for failure in result.failures
        ],
    }


def _place(result: Batch, point: int) -> dict[str, str]:
    return dict(result.points[point].values)


def _places(result: Batch, points: Sequence[int]) -> dict[str, list[Any]]:
    """Returns a column for each swept setting."""
    keys = [key for key, _ in result.points[0].values]
    return {key: [_place(result, point)[key] for point in points] for key in keys}


def _table(result: Batch) -> dict[str, list[Any]]:
    """Returns the columns of batch.csv."""
    columns = _places(result, [row.point for row in result.rows])
    columns["log"] = [row.log for row in result.rows]
    columns["method"] = [row.method for row in result.rows]
    for figure in BATCH_FIGURES:
        columns[figure.name] = [row.values[figure.name] for row in result.rows]
    return _quoted(columns)


def _summary(result: Batch) -> dict[str, list[Any]]:
    """Returns the columns of summary.csv."""
    entries = [entry.summary for entry in result.summary]
    return {
        **_places(result, [entry.point for entry in result.summary]),
        "method": [entry.method for entry in entries],
        "figure": [entry.figure.name for entry in entries],
        "logs": [entry.runs for entry in entries],
        "median": [entry.median for entry in entries],
        "mean": [entry.mean for entry in entries],
        "worst": [entry.worst for entry in entries],
    }


def _records(columns: dict[str, list[Any]]) -> list[dict[str, Any]]:
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _quoted(columns: Mapping[str, list[Any]]) -> dict[str, list[Any]]:
    """Returns columns whose texts are quoted where they hold what CSV needs quotes for."""
    return {_cell(name): [_cell(value) for value in column] for name, column in columns.items()}


def _cell(value: Any) -> Any:
    if isinstance(value, str) and any(character in value for character in ',"\n'):
        return '"' + value.replace('"', '""') + '"'
    return value
