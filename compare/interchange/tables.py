"""A run's figures, map and path as tables for other programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from compare.record import Record
from compare.results import Columns, csv_text, json_text, map_columns, trajectory_columns

TABLE_FORMAT = "graphslam-table/1"


def figures_columns(metrics: Mapping[str, Any]) -> Columns:
    """Returns one row a method with every single figure of ``metrics.json``.

    Columns are named by the keys that lead there, joined by points (``trajectory.rmse_m``); a
    figure that a method has not is None.
    """
    rows = [{"method": name, **_single(entry)} for name, entry in metrics["methods"].items()]
    names = list(dict.fromkeys(name for row in rows for name in row))
    trees = {name for name in names if any(other.startswith(f"{name}.") for other in names)}
    return {name: [row.get(name) for row in rows] for name in names if name not in trees}


def table_columns(record: Record, table: str, method: str) -> Columns:
    """Returns the columns of one table of a run: "figures", "map" or "path"."""
    if table == "figures":
        return figures_columns(record.metrics)
    columns = {"map": map_columns, "path": trajectory_columns}[table]
    return columns(record.estimates[method])


def table_csv(record: Record, table: str, method: str) -> str:
    """Returns a table as CSV; what is not known is an empty cell."""
    return csv_text(table_columns(record, table, method))


def table_json(record: Record, table: str, method: str) -> str:
    """Returns a table as JSON: columns by name; a map with the joint covariance of its lines.

    ``cov`` has the rows rho, alpha of the first line, then of the second, ... in m², m·rad, rad².
    """
    columns = table_columns(record, table, method)
    content: dict[str, Any] = {
        "format": TABLE_FORMAT,
        "log": record.metrics["log"],
        "table": table,
        "method": None if table == "figures" else method,
        "columns": {name: list(column) for name, column in columns.items()},
    }
    if table == "map":
        content["cov"] = _line_covariance(record, method)
    return json_text(content)


def _line_covariance(record: Record, method: str) -> Any:
    estimate = record.estimates[method]
    rows, _ = estimate.map.of_kind("line")
    first = estimate.map.offsets()[rows]
    at = [place for start in first.tolist() for place in (start, start + 1)]
    return estimate.cov_joint[at][:, at]


def _single(entry: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Returns the single values of a tree, by their paths; lists are left out."""
    found: dict[str, Any] = {}
    for key, value in entry.items():
        if isinstance(value, Mapping):
            found |= _single(value, f"{prefix}{key}.")
        elif not isinstance(value, list | tuple):
            found[prefix + key] = value
    return found
