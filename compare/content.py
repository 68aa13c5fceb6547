"""The content of metrics.json: plain types, None where a figure is not defined."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from compare.agreement import Agreement, MapAgreement
from compare.comparison import Comparison, MethodMetrics
from compare.consistency import Overconfidence, Surprise
from compare.maps import MapLines, MapMetrics
from compare.matching import MatchingTable
from compare.points import PointMetrics
from compare.verdict_methods import alarms
from graphslam.estimate import Unobserved

METRICS_FORMAT = "graphslam-metrics/1"
DIGITS = 12
"""Significant digits of floats in metrics.json."""


def comparison_content(comparison: Comparison) -> dict[str, Any]:
    """Returns a comparison in types that JSON knows, floats rounded to `DIGITS`."""
    truth = comparison.truth
    content = {
        "format": METRICS_FORMAT,
        "log": comparison.log,
        "nodes": comparison.nodes,
        "kinds": comparison.kinds,
        "truth": {
            "path": len(truth.t) > 0,
            "lines": len(truth.lines),
            "points": len(truth.points),
            "lines_seen": None if truth.seen is None else truth.line_id[truth.seen],
            "sightings_labelled": truth.labelled,
        },
        "methods": {entry.method: _method(entry) for entry in comparison.methods},
        "bound": None if comparison.bound is None else _columns(comparison.bound),
        "agreement": [_agreement(entry) for entry in comparison.agreement],
        "verdict": comparison.verdict,
        "alarms": list(alarms(comparison.methods)),
    }
    return dict(plain(content))


def plain(value: Any) -> Any:
    """Returns ``value`` in types that JSON knows, floats rounded to `DIGITS`, not finite: None."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, tuple | list):
        return [plain(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") + 0.0 if math.isfinite(value) else None
    return value


def _columns(instance: Any, *left_out: str) -> dict[str, Any]:
    names = [f.name for f in fields(instance) if f.name not in left_out]
    return {name: getattr(instance, name) for name in names}


def _rows(columns: Mapping[str, Any]) -> list[dict[str, Any]]:
    lists = [np.asarray(column).tolist() for column in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*lists, strict=True)]


def _method(entry: MethodMetrics) -> dict[str, Any]:
    return {
        **_columns(
            entry,
            *("method", "trajectory", "map", "matching", "unobserved"),
            *("consistency", "innovations", "points"),
        ),
        "trajectory": None if entry.trajectory is None else _columns(entry.trajectory),
        "map": None if entry.map is None else _map(entry.map),
        "map_nees": None if entry.map is None else entry.map.nees,
        "map_nees_freedom": None if entry.map is None else entry.map.nees_freedom,
        "map_start_nees": None if entry.map is None else entry.map.start_nees,
        "points": None if entry.points is None else _points(entry.points),
        "overconfident": _told(entry.overconfidence),
        "innovation_nis": None if entry.innovations is None else entry.innovations.total,
        "surprised": _told(entry.surprise),
        "matching": None if entry.matching is None else _matching(entry.matching),
        "unobserved": [_unobserved(u) for u in entry.unobserved],
    }


def _unobserved(entry: Unobserved) -> dict[str, Any]:
    where = {} if entry.stretch is None else {"stretch": _columns(entry.stretch)}
    return _columns(entry, "stretch") | where | {"text": str(entry)}


def _told(entry: Overconfidence | Surprise | None) -> dict[str, Any] | None:
    return None if entry is None else _columns(entry) | {"text": str(entry)}


def _map(entry: MapMetrics) -> dict[str, Any]:
    figures = _columns(entry, "nees", "nees_freedom", "start_nees", "lines")
    return {**figures, "lines": _rows(_line_columns(entry.lines))}


def _points(entry: PointMetrics) -> dict[str, Any]:
    table = entry.points
    columns = {
        "row": table.row,
        "kind": table.kind,
        "status": table.status,
        "true_point": [i if i >= 0 else None for i in table.true_id.tolist()],
        "x_m": table.place[:, 0],
        "y_m": table.place[:, 1],
        "dx_m": table.error[:, 0],
        "dy_m": table.error[:, 1],
        "sigma_x_m": np.sqrt(table.cov[:, 0, 0]),
        "sigma_y_m": np.sqrt(table.cov[:, 1, 1]),
        "sightings": table.sightings,
    }
    return {**_columns(entry, "points"), "points": _rows(columns)}


def _line_columns(lines: MapLines) -> dict[str, Any]:
    return {
        "row": lines.row,
        "status": lines.status,
        "true_line": [i if i >= 0 else None for i in lines.true_id.tolist()],
        "rho_true_m": lines.true_line[:, 0],
        "alpha_true_deg": np.degrees(lines.true_line[:, 1]),
        "rho_m": lines.line[:, 0],
        "alpha_deg": np.degrees(lines.line[:, 1]),
        "offset_m": lines.offset,
        "d_rho_m": lines.d_line[:, 0],
        "d_alpha_deg": np.degrees(lines.d_line[:, 1]),
        "sigma_offset_m": lines.sigma_offset,
        "sigma_alpha_deg": np.degrees(lines.sigma_alpha),
        "sightings": lines.sightings,
    }


def _matching(table: MatchingTable) -> dict[str, Any]:
    columns = {
        "kind": table.kind,
        "true_landmark": table.true_id,
        "identifications": table.identifications,
        "correct": table.correct,
        "incorrect": table.incorrect,
        "hit_rate": table.hit_rate,
        "unknown": table.unknown,
        "missed": table.missed,
        "needless": table.needless,
    }
    return {
        "right_share": table.right_share,
        "identifications": int(table.identifications.sum()),
        "correct": int(table.correct.sum()),
        "unknown": table.unknown_total,
        "missed": int(table.missed.sum()),
        "needless": table.needless_total,
        "landmarks": _rows(columns),
    }


def _agreement(entry: Agreement) -> dict[str, Any]:
    return {
        **_columns(entry, "map"),
        "map": None if entry.map is None else _map_agreement(entry.map),
    }


def _map_agreement(entry: MapAgreement) -> dict[str, Any]:
    columns = {
        "row_first": entry.row_a,
        "row_second": entry.row_b,
        "offset_m": entry.offset,
        "d_alpha_deg": np.degrees(entry.d_alpha),
        "offset_sigmas": entry.offset_sigmas,
        "alpha_sigmas": entry.alpha_sigmas,
    }
    return {
        "lines": len(entry.row_a),
        "only_first": entry.only_a,
        "only_second": entry.only_b,
        "offset_rms_m": entry.offset_rms_m,
        "alpha_rms_deg": entry.alpha_rms_deg,
        "sigmas_rms": entry.sigmas_rms,
        "differences": _rows(columns),
    }
