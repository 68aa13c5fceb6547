"""The folder that a run writes: formats of its files, and how it comes to its place whole."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from compare.folders import recover, working_folder, writing
from graphslam.arrays import AnyArray
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.measurements import Measurements, Sightings
from graphslam.models.line import LINE

RUN_FORMAT = "graphslam-run/1"

Columns = Mapping[str, Sequence[Any] | AnyArray]
"""A table: columns of equal length by name."""

UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Entries of a pose covariance in the order of `trajectory.csv`."""


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Writes JSON with numbers that are not finite as null; equal content gives equal bytes."""
    path.write_text(json_text(content), encoding="utf-8", newline="\n")


def json_text(content: Mapping[str, Any]) -> str:
    """Returns the content of a JSON file, as `write_json` writes it."""
    return json.dumps(_plain(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_csv(path: Path, columns: Columns) -> None:
    """Writes columns of equal length; floats by their shortest exact text, NaN and None empty."""
    path.write_text(csv_text(columns), encoding="utf-8", newline="\n")


def csv_text(columns: Columns) -> str:
    """Returns the content of a CSV file, as `write_csv` writes it."""
    texts = [[_text(value) for value in np.asarray(column).tolist()] for column in columns.values()]
    rows = [",".join(columns), *(",".join(row) for row in zip(*texts, strict=True))]
    return "\n".join(rows) + "\n"


def write_sightings(path: Path, measurements: Measurements, table: Sightings) -> None:
    """Writes line sightings as a log folder's ``sightings.csv``: what the detector saw."""
    columns: dict[str, AnyArray] = {
        "t": measurements.t[table.node],
        "rho": table.z[:, 0],
        "alpha": table.z[:, 1],
        **_covariance_columns(table.cov),
    }
    if not np.isnan(table.extent).all():
        columns |= {"s_min": table.extent[:, 0], "s_max": table.extent[:, 1]}
    write_csv(path, columns | {"line": table.truth, "t_received": table.t_received})


def write_estimate(
    folder: Path, measurements: Measurements, estimate: Estimate, true_landmark: AnyArray
) -> None:
    """Writes one method's folder.

    Args:
        folder: made here; must not exist.
        measurements: what the estimate was made from.
        estimate: the method's result.
        true_landmark: (K,) true landmark of each sighting, -1 where unknown.
    """
    folder.mkdir()
    write_tum(folder / "trajectory.tum", estimate.t, estimate.pose)
    write_csv(folder / "trajectory.csv", trajectory_columns(estimate))
    write_csv(folder / "map.csv", map_columns(estimate))
    if any(kind != LINE.kind for kind in estimate.map.kind):
        write_csv(folder / "landmarks.csv", landmark_columns(estimate))
    _write_matches(folder / "matches.csv", measurements, estimate, true_landmark)
    estimate.save(folder / "estimate.npz")


def write_tum(path: Path, t: Array, pose: Array) -> None:
    """Writes times (N,) and poses (N, 3) as rows ``t x y z qx qy qz qw``, z = 0."""
    path.write_text(tum_text(t, pose), encoding="utf-8", newline="\n")


def tum_text(t: Array, pose: Array) -> str:
    """Returns the content of a TUM file, as `write_tum` writes it."""
    half = 0.5 * pose[:, 2]
    zero = np.zeros(len(t))
    columns = [t, pose[:, 0], pose[:, 1], zero, zero, zero, np.sin(half), np.cos(half)]
    rows = (" ".join(map(_text, row)) for row in np.column_stack(columns).tolist())
    return "".join(row + "\n" for row in rows)


def trajectory_columns(estimate: Estimate) -> dict[str, AnyArray]:
    """Returns the columns of ``trajectory.csv``: times, poses and covariances, floor frame."""
    pose = dict(zip(("x", "y", "theta"), estimate.pose.T, strict=True))
    cov = {f"cov_{'xyt'[a]}{'xyt'[b]}": estimate.cov_floor[:, a, b] for a, b in UPPER}
    return {"t": estimate.t, **pose, **cov}


def map_columns(estimate: Estimate) -> dict[str, AnyArray]:
    """Returns the columns of ``map.csv``: the lines with their covariances, floor frame."""
    rows, lines = estimate.map.of_kind("line")
    cov = np.array([estimate.landmark_cov(int(row)) for row in rows]).reshape(-1, 2, 2)
    extent = estimate.map.extent[rows]
    return {
        "line": estimate.map.id[rows],
        "rho": lines[:, 0] if len(rows) else np.zeros(0),
        "alpha": lines[:, 1] if len(rows) else np.zeros(0),
        **_covariance_columns(cov),
        "s_min": extent[:, 0],
        "s_max": extent[:, 1],
        "sightings": estimate.map.sightings[rows],
    }


def landmark_columns(estimate: Estimate) -> dict[str, AnyArray | Sequence[Any]]:
    """Returns the columns of ``landmarks.csv``: what is no line, with its covariance, floor frame.

    ``phi`` and its variance are there where a kind has an axis, empty for the others.
    """
    rows = [row for row, kind in enumerate(estimate.map.kind) if kind != LINE.kind]
    params = np.full((len(rows), 3), np.nan)
    width = min(3, estimate.map.params.shape[1])
    params[:, :width] = estimate.map.params[rows, :width]
    cov = np.full((len(rows), 3, 3), np.nan)
    for at, row in zip(cov, rows, strict=True):
        own = estimate.landmark_cov(row)
        at[: len(own), : len(own)] = own
    has_axis = bool(np.isfinite(params[:, 2]).any())
    phi = {"phi": params[:, 2]} if has_axis else {}
    sigma = {"cov_pp": cov[:, 2, 2]} if has_axis else {}
    return {
        "landmark": estimate.map.id[rows],
        "kind": [estimate.map.kind[row] for row in rows],
        "x": params[:, 0],
        "y": params[:, 1],
        **phi,
        "cov_xx": cov[:, 0, 0],
        "cov_xy": cov[:, 0, 1],
        "cov_yy": cov[:, 1, 1],
        **sigma,
        "label": estimate.map.label[rows],
        "sightings": estimate.map.sightings[rows],
    }


def write_bearings(path: Path, measurements: Measurements, table: Sightings) -> None:
    """Writes directions as a log folder's ``bearings.csv``: what the detector saw."""
    columns: dict[str, AnyArray] = {
        "t": measurements.t[table.node],
        "bearing": table.z[:, 0],
        "sigma": np.sqrt(table.cov[:, 0, 0]),
        "label": table.label,
        "landmark": table.truth,
    }
    write_csv(path, columns | {"t_received": table.t_received})


def write_lamps(path: Path, measurements: Measurements, table: Sightings) -> None:
    """Writes lamps as a log folder's ``lamps.csv``: what the detector saw."""
    place = dict(zip(("x", "y", "phi"), table.z.T, strict=True))
    cov = {f"cov_{'xyp'[a]}{'xyp'[b]}": table.cov[:, a, b] for a, b in UPPER}
    columns = {"t": measurements.t[table.node], **place, **cov, "landmark": table.truth}
    write_csv(path, columns | {"t_received": table.t_received})


def _write_matches(
    path: Path, measurements: Measurements, estimate: Estimate, true_landmark: AnyArray
) -> None:
    tables = [table for _, table in measurements.tables()]
    node = np.concatenate([np.zeros(0, np.int64), *(table.node for table in tables)])
    ids = np.append(estimate.map.id, -1)
    write_csv(
        path,
        {
            "t": measurements.t[node],
            "node": node,
            "kind": [table.kind for table in tables for _ in range(len(table))],
            "sighting": [row for table in tables for row in range(len(table))],
            "landmark": ids[estimate.match],
            "true_landmark": true_landmark,
            "nis": estimate.nis,
            "weight": estimate.weight,
        },
    )


def _covariance_columns(cov: Array) -> dict[str, AnyArray]:
    return {"cov_rr": cov[:, 0, 0], "cov_ra": cov[:, 0, 1], "cov_aa": cov[:, 1, 1]}


def _text(value: Any) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return "" if value is None else str(value)


def _plain(value: Any) -> Any:
    """Returns ``value`` in types that JSON knows."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


# ---- the folder as a whole --------------------------------------------------------------------


def read_run(folder: Path) -> dict[str, Any]:
    """Returns the content of a run folder's ``run.json``.

    Raises:
        BadConfig: the folder is not one that a run wrote.
    """
    recover(folder)
    path = folder / "run.json"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        ours = isinstance(content, dict) and content.get("format") == RUN_FORMAT
    except (OSError, ValueError, RecursionError):
        ours = False
    if not ours:
        raise BadConfig(f"{folder}: holds no run.json of a run; give a folder that `run` wrote")
    return content


def check_replaceable(folder: Path) -> None:
    """Raises BadConfig where ``folder`` exists and is not the folder of an earlier run."""
    recover(folder)
    if not (folder.exists() or folder.is_symlink()):
        return
    try:
        read_run(folder)
    except BadConfig:
        raise BadConfig(
            f"{folder}: exists and was not written by this program (no run.json of ours), so it is "
            "not replaced; give another --out, or move it away"
        ) from None


@contextmanager
def whole_folder(folder: Path, check: Callable[[Path], None] = check_replaceable) -> Iterator[Path]:
    """Gives an empty folder beside ``folder`` to fill; it takes the final name when all is written.

    An earlier run's folder is replaced then, and only then. If filling fails nothing is left; what
    a killed process left is removed by the next one that writes the same folder.

    Args:
        folder: the final place.
        check: raises BadConfig where the folder exists and may not be replaced.

    Raises:
        BadConfig: see ``check``.
        OSError: the folder cannot be written; the message names the place and the cure.
    """
    folder = folder.resolve()
    check(folder)
    recover(folder)
    with writing(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        with working_folder(folder) as beside:
            fresh, old = beside / "new", beside / "old"
            fresh.mkdir()
            with writing(folder, fresh):
                yield fresh
            check(folder)
            if folder.exists():
                folder.rename(old)
            try:
                fresh.rename(folder)
            except OSError:
                if old.exists():
                    old.rename(folder)
                raise
