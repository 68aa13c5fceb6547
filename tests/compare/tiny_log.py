"""A log folder with sightings and no images: a run over it takes a second."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from graphslam.baseline import integrate
from tests.worlds import GRID, drive

SETTINGS = """format = "graphslam-log/1"
name = "{name}"

[robot]
wheel_radius_left = 0.04
wheel_radius_right = 0.04
wheel_base = 0.2
slip = [0.004, 0.004, 0.01]

[start]
pose = [0.5, 0.5, 0.1]
"""


def write_tiny_log(
    folder: Path, seed: int = 1, nodes: int = 60, truth: bool = True, name: str = "tiny"
) -> Path:
    """Writes a drive over the lines of `tests.worlds.GRID`; returns the folder.

    With ``truth`` the true path, the true lines and each sighting's true line are in it too.
    """
    measurements, true_pose = drive(seed, nodes, start_sigma=1e-9)
    t = np.round(measurements.t, 6)
    odometry = integrate(measurements.start_pose, measurements.odometry.increment)
    table = measurements.sightings["line"]
    sightings = np.column_stack(
        [t[table.node], table.z, table.cov[:, 0, 0], table.cov[:, 0, 1], table.cov[:, 1, 1]]
    )
    columns = "t,rho,alpha,cov_rr,cov_ra,cov_aa,s_min,s_max"
    sightings = np.column_stack([sightings, table.extent])
    if truth:
        columns, sightings = columns + ",line", np.column_stack([sightings, table.truth])
        half = 0.5 * true_pose[:, 2]
        zero = np.zeros((nodes, 3))
        tum = np.column_stack([t, true_pose[:, :2], zero, np.sin(half), np.cos(half)])
        lines = np.column_stack([np.arange(len(GRID)), GRID])
    folder.mkdir(parents=True)
    (folder / "log.toml").write_text(SETTINGS.format(name=name))
    _write(folder / "odometry.csv", "t,x,y,theta", np.column_stack([t, odometry]))
    _write(folder / "sightings.csv", columns, sightings)
    if truth:
        _write(folder / "groundtruth.tum", None, tum, " ")
        _write(folder / "map.csv", "line,rho,alpha", lines)
    return folder


def _write(path: Path, header: str | None, rows: np.ndarray, separator: str = ",") -> None:
    whole = np.all(rows == np.round(rows), axis=0)
    texts = [
        separator.join(
            str(int(v)) if w else repr(float(v)) for v, w in zip(row, whole, strict=True)
        )
        for row in rows
    ]
    path.write_text("\n".join([*([] if header is None else [header]), *texts]) + "\n")
