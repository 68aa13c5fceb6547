"""What the report's tables of matches, facts and rejections say, and its numbers, as texts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from compare.clock import LATENCY
from compare.pages import method_entry
from compare.record import Record
from graphslam.models import MODELS

DASH = "–"


def number(value: float | int | None, digits: int = 3) -> str:
    """Returns a number with ``digits`` significant digits, integers whole, None as a dash."""
    if value is None or not math.isfinite(value):
        return DASH
    if isinstance(value, int):
        text = f"{value:,}"
    elif abs(value) >= 10 ** (digits - 1):
        text = f"{value:,.0f}"
    elif abs(value) < 0.5e-6:
        text = "0"
    else:
        decimals = digits - 1 - math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
        text = f"{value:.{min(decimals, 6)}f}"
    return text.replace("-", "−")


def fixed(value: float | None, decimals: int) -> str:
    """Returns a number with so many decimals, None as a dash."""
    if value is None or not math.isfinite(value):
        return DASH
    return f"{round(value, decimals) + 0.0:.{decimals}f}".replace("-", "−")


def matching(metrics: Mapping[str, Any]) -> dict[str, Any] | None:
    """Returns the table of what sightings were taken for; None where nothing tells."""
    tables = {n: m["matching"] for n, m in metrics["methods"].items() if m["matching"]}
    if not tables:
        return None
    found: dict[str, dict[tuple[str, int], Any]] = {
        name: {(row["kind"], row["true_landmark"]): row for row in table["landmarks"]}
        for name, table in tables.items()
    }
    keys = sorted(set().union(*found.values()))
    rows = [
        {"line": key[1], "methods": [_matching_cells(found[name].get(key)) for name in tables]}
        for key in keys
    ]
    totals = [
        {
            **table,
            "incorrect": table["identifications"] - table["correct"],
            "hit_rate": table["right_share"],
        }
        for table in tables.values()
    ]
    rows.append({"line": "all", "methods": [_matching_cells(total) for total in totals]})
    return {"methods": list(tables), "rows": rows}


def _matching_cells(row: Mapping[str, Any] | None) -> list[str]:
    if row is None:
        return [DASH] * 7
    rate = DASH if row["hit_rate"] is None else f"{row['hit_rate']:.1%}"
    counts = [number(row[k]) for k in ("identifications", "correct", "incorrect")]
    rest = [number(row.get(k)) for k in ("unknown", "missed", "needless")]
    return [*counts, rate, *rest]


def facts(record: Record) -> list[dict[str, str]]:
    """Returns what the head of the report says about the log."""
    measurements = record.measurements
    increment = measurements.odometry.increment
    driven = float(np.hypot(increment[:, 0], increment[:, 1]).sum())
    tables = [table for _, table in measurements.tables()]
    return [
        {"label": "Nodes", "value": f"{len(measurements.t):,}"},
        {"label": "Duration", "value": f"{measurements.t[-1] - measurements.t[0]:,.1f} s"},
        {"label": "Distance by odometry", "value": f"{driven:,.2f} m"},
        *(
            {"label": f"Sightings of {MODELS[table.kind].noun[1]}", "value": f"{len(table):,}"}
            for table in tables
        ),
        {"label": "Truth", "value": _truth(record)},
        *(
            {"label": f"Engine of the {name}", "value": engine}
            for name, engine in record.info.get("engine", {}).items()
        ),
        {"label": "Version", "value": str(record.info["versions"]["floorline-slam"])},
    ]


def _truth(record: Record) -> str:
    parts = ["path"] if record.has_true_pose else []
    if len(record.truth.lines):
        parts.append(f"{len(record.truth.lines)} lines")
    if len(record.truth.points):
        parts.append(f"{len(record.truth.points)} points")
    return " and ".join(parts) or "none"


def quantities(record: Record) -> list[dict[str, str]]:
    """Returns what methods found besides path and map, with its unit in the name, and one sigma."""
    return [
        {
            "by": name,
            "quantity": quantity,
            "value": f"{value:.4f}",
            "sigma": f"{sigma:.4f}" if sigma > 0 else DASH,
        }
        for name, found in record.info.get("quantities", {}).items()
        for quantity, (value, sigma) in found.items()
    ]


def rejected(record: Record) -> list[dict[str, str]]:
    """Returns what was left out, by whom and why."""
    named = {"front-end": record.info["rejected"], **record.info["counts"]}
    return [
        {"by": by, "reason": reason, "count": number(int(count))}
        for by, counts in named.items()
        for reason, count in counts.items()
        if count
    ]


def latency(record: Record) -> list[dict[str, Any]]:
    """Returns how late each method tells a pose, how good that is, and how long a node took.

    Nothing where no method goes from node to node. Errors are those of poses as they were told,
    after one rigid motion of the whole path.
    """
    figures = record.timings.get("latency", {})
    return [
        {**method_entry(name), "cells": [*_lag(record, name), *_node_times(figures.get(name))]}
        for name in (record.estimates if figures else ())
    ]


def _lag(record: Record, name: str) -> list[str]:
    if record.estimates[name].causal:
        after = "0"
    elif name == "fixed-lag":
        after = f"{record.info['config']['incremental']['lag_s']:g}"
    else:
        after = "whole log"
    errors = record.metrics["methods"][name]["trajectory"] or {}
    path = errors.get("aligned_rmse_m")
    return [
        after,
        number(None if path is None else 1e3 * path),
        number(errors.get("aligned_heading_rmse_deg")),
    ]


def _node_times(figures: Mapping[str, float] | None) -> list[str]:
    return [f"{figures[name]:.2f}" if figures else DASH for name in LATENCY]


def timings(seconds: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Returns the time of each stage, and of all together."""
    seconds = {stage: value for stage, value in seconds.items() if stage != "latency"}
    rows = [{"stage": k, "seconds": f"{v:.2f}", "total": False} for k, v in seconds.items()]
    total = f"{sum(seconds.values()):.2f}"
    return [*rows, {"stage": "all", "seconds": total, "total": True}]
