"""The page of a batch: which method is the better one over all logs, and what each log gave."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from hashlib import sha256
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from compare.batch_job import has_report
from compare.batch_table import BATCH_FIGURES, COMPARED, Duel, Row
from compare.pages import method_entry, source, template
from compare.plots_batch import box_plots
from compare.report_tables import DASH, number
from compare.study import Figure, Summary

if TYPE_CHECKING:
    from compare.batch import Batch

EACH_LOG = {"aligned_rmse_m": "path", "map_rmse_m": "map", "pose_nees": "NEES"}
EACH_LOG_CLAIMED = {
    "position_sigma_m": "path σ",
    "last_position_sigma_m": "last σ",
    "landmarks": "landmarks",
}
"""Figures in the table of logs and what they are called there: with truth in any of them, and
without."""
CERTAIN = 0.05
"""Probability from which on an uneven count of logs is called explicable by chance."""


def batch_page(batch: Batch) -> str:
    """Returns batch.html; equal batches give equal text."""
    script = source("pages.js")
    return str(
        template("batch.html").render(
            title=_title(batch),
            facts=_facts(batch),
            sentences=verdict(batch),
            methods=[method_entry(name) for name in batch.methods],
            sweep=[point.label for point in batch.points] if batch.points[0].values else [],
            summary=_summary(batch),
            plot=box_plots(batch),
            duels=[_duel(batch, duel) for duel in batch.duels],
            logs=_logs(batch),
            failures=_failures(batch),
            script=script,
            script_hash=base64.b64encode(sha256(script.encode()).digest()).decode(),
        )
    )


def verdict(batch: Batch) -> list[str]:
    """Returns what follows from the table, in sentences: the better method, or the better value."""
    if len(batch.points) > 1:
        return _best_values(batch)
    return [_sentence(duel) for duel in batch.duels if "odometry" not in (duel.first, duel.second)]


def _sentence(duel: Duel) -> str:
    what = "path" if duel.figure.name == "aligned_rmse_m" else "map"
    better, other, wins = duel.second, duel.first, duel.second_better
    ratio = duel.median_ratio
    if 2 * wins < duel.logs:
        better, other, wins, ratio = other, better, duel.logs - wins, 1.0 / ratio
    if 2 * wins == duel.logs:
        lead = f"{better} and {other} have the smaller {what} error in {wins} logs each"
        return f"{lead}, {better}’s being {number(ratio)} times {other}’s in the median."
    chance = ""
    if duel.p >= CERTAIN:
        few = wins == duel.logs
        chance = ": too few logs to be sure" if few else ": chance may explain it"
    return (
        f"{better} has the smaller {what} error in {wins} of {duel.logs} logs, {number(ratio)} "
        f"times {other}’s in the median (two-sided sign test: p = {number(duel.p, 2)}{chance})."
    )


def _best_values(batch: Batch) -> list[str]:
    """Returns for each figure compared where in the sweep each method's median is smallest."""
    found = []
    for figure in [figure for figure in BATCH_FIGURES if figure.name in COMPARED]:
        parts = []
        for method in batch.methods:
            known = [
                entry
                for entry in batch.summary
                if (entry.summary.figure, entry.summary.method) == (figure, method)
                and entry.summary.runs
            ]
            medians = [entry.summary.median for entry in known]
            if medians and min(medians) < max(medians):
                best = known[medians.index(min(medians))]
                parts.append(
                    f"{method} at {batch.points[best.point].label} "
                    f"({number(figure.scale * min(medians))} {figure.unit})"
                )
        if parts:
            found.append(f"Smallest median {figure.label}: {'; '.join(parts)}.")
    return found


def _title(batch: Batch) -> str:
    logs = f"{len(batch.logs)} log{'s' if len(batch.logs) != 1 else ''}"
    points = len(batch.points)
    return logs if points == 1 else f"{logs} under {points} settings"


def _facts(batch: Batch) -> list[dict[str, str]]:
    jobs = len(batch.logs) * len(batch.points)
    facts = [
        {"label": "Logs", "value": f"{len(batch.logs):,}"},
        {"label": "Results", "value": f"{jobs - batch.failed_jobs:,} of {jobs:,}"},
        {"label": "Failed", "value": f"{batch.failed_jobs:,}"},
    ]
    facts += [
        {"label": "Swept", "value": f"{key}: {', '.join(values)}"}
        for key, values in _swept(batch).items()
    ]
    return [*facts, {"label": "Version", "value": version("floorline-slam")}]


def _swept(batch: Batch) -> Mapping[str, list[str]]:
    swept: dict[str, dict[str, None]] = {}
    for point in batch.points:
        for key, value in point.values:
            swept.setdefault(key, {})[value] = None
    return {key: list(values) for key, values in swept.items()}


def _summary(batch: Batch) -> list[dict[str, Any]]:
    """Returns for each figure that is known its rows: one a point, median, mean, worst, logs."""
    entries = {
        (entry.point, entry.summary.method, entry.summary.figure.name): entry.summary
        for entry in batch.summary
    }
    groups = []
    for figure in BATCH_FIGURES:
        rows = []
        for point, settings in enumerate(batch.points):
            found = [entries[point, method, figure.name] for method in batch.methods]
            if any(summary.runs for summary in found):
                cells = [_summary_cells(summary) for summary in found]
                rows.append({"label": settings.label, "cells": cells})
        if rows:
            groups.append({"label": _label(figure), "rows": rows})
    return groups


def _summary_cells(summary: Summary) -> list[str]:
    values = (summary.median, summary.mean, summary.worst)
    return [*(_number(summary.figure.scale * value) for value in values), number(summary.runs)]


def _number(value: float) -> str:
    """Returns a figure as a text, counts without decimals."""
    return number(int(value) if value.is_integer() else value)


def _label(figure: Figure) -> str:
    return f"{figure.label} ({figure.unit})" if figure.unit else figure.label


def _duel(batch: Batch, duel: Duel) -> dict[str, Any]:
    return {
        "label": batch.points[duel.point].label,
        "figure": duel.figure.label,
        "first": duel.first,
        "second": duel.second,
        "cells": [
            number(duel.logs),
            number(duel.second_better),
            number(duel.median_ratio),
            number(duel.p, 2),
        ],
    }


def _logs(batch: Batch) -> dict[str, Any]:
    """Returns the table of logs: a row for each log and point, columns by method."""
    figures = _shown(batch.rows, EACH_LOG) or _shown(batch.rows, EACH_LOG_CLAIMED)
    by_place = {(row.point, row.log, row.method): row for row in batch.rows}
    rows = []
    for log in batch.logs:
        for point, settings in enumerate(batch.points):
            found = [by_place.get((point, log.name, method)) for method in batch.methods]
            if any(found):
                folder = batch.result_folder(point, log.name)
                page = folder.relative_to(batch.folder) / "report.html"
                rows.append(
                    {
                        "log": log.name,
                        "page": page.as_posix() if has_report(folder) else None,
                        "label": settings.label,
                        "methods": [_figures(row, figures) for row in found],
                    }
                )
    named = EACH_LOG | EACH_LOG_CLAIMED
    headings = [{"label": named[figure.name], "unit": figure.unit} for figure in figures]
    return {"headings": headings, "rows": rows}


def _shown(rows: Sequence[Row], names: Mapping[str, str]) -> list[Figure]:
    return [
        figure
        for figure in BATCH_FIGURES
        if figure.name in names and any(not math.isnan(row.values[figure.name]) for row in rows)
    ]


def _figures(row: Row | None, figures: Sequence[Figure]) -> list[str]:
    return [
        DASH if row is None else _number(figure.scale * row.values[figure.name])
        for figure in figures
    ]


def _failures(batch: Batch) -> list[dict[str, str]]:
    return [
        {
            "log": failure.log,
            "label": batch.points[failure.point].label,
            "what": failure.method or "the whole log",
            "reason": failure.reason,
        }
        for failure in batch.failures
    ]
