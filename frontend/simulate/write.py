"""The tables of a simulated log's folder (docs/log-format.md)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from frontend.log import LineSightings, Log
from frontend.readers.log_toml import FORMAT
from frontend.simulate.drive import TIME_DECIMALS
from graphslam.geometry import Array
from graphslam.measurements import LandmarkMap

TIME = f"{{:.{TIME_DECIMALS}f}}"
TWELVE_DECIMALS, EXACT = "{:.12f}", "{!r}"


def write_log(folder: Path, log: Log, exact: bool) -> None:
    """Writes log.toml and all tables but images.csv into an empty folder.

    Args:
        folder: where.
        log: with wheels, truth and map.
        exact: whether numbers are written so that reading gives the same bits, or with twelve
            decimals.
    """
    assert log.wheels is not None
    assert log.truth is not None
    assert log.map is not None
    real = EXACT if exact else TWELVE_DECIMALS
    _write(folder / "log.toml", _log_toml(log))
    wheels = _rows([TIME, real, real], np.column_stack([log.wheels.t, log.wheels.angle]))
    _write(folder / "wheels.csv", ["t,left,right", *wheels])
    _write(folder / "map.csv", _map(log.map, real))
    half = 0.5 * log.truth.pose[:, 2]
    columns = [log.truth.t, log.truth.pose[:, :2], np.sin(half), np.cos(half)]
    row = f"{TIME} {real} {real} 0 0 0 {real} {real}"
    _write(folder / "groundtruth.tum", (row.format(*v) for v in np.column_stack(columns).tolist()))
    if log.sightings is not None:
        _write(folder / "sightings.csv", _sightings(log.sightings, real))


def write_images_csv(folder: Path, t: Array, files: Sequence[str]) -> None:
    """Writes images.csv: times (I,), s, and as many paths inside the folder."""
    rows = (f"{TIME.format(when)},{file}" for when, file in zip(t, files, strict=True))
    _write(folder / "images.csv", ["t,file", *rows])


def _rows(formats: Sequence[str], values: Array) -> Iterable[str]:
    row = ",".join(formats)
    return (row.format(*line) for line in values.tolist())


def _map(lines: LandmarkMap, real: str) -> list[str]:
    """Returns map.csv; only where a line ends are there columns for it, empty for endless ones."""
    finite = np.isfinite(lines.extent).any()
    rows = ["line,rho,alpha,s_min,s_max" if finite else "line,rho,alpha"]
    for name, line, extent in zip(
        lines.id.tolist(), lines.params.tolist(), lines.extent.tolist(), strict=True
    ):
        cells = [str(name), *(real.format(v) for v in line)]
        if finite:
            cells += ["" if np.isnan(s) else real.format(s) for s in extent]
        rows.append(",".join(cells))
    return rows


def _sightings(seen: LineSightings, real: str) -> Iterable[str]:
    yield "t,rho,alpha,cov_rr,cov_ra,cov_aa,s_min,s_max,line"
    cov = seen.cov[:, [0, 0, 1], [0, 1, 1]]
    values = np.column_stack([seen.t, seen.z, cov, seen.extent])
    numbers = _rows([TIME, *[real] * (values.shape[1] - 1)], values)
    for row, line in zip(numbers, seen.truth.tolist(), strict=True):
        yield f"{row},{line}"


def _log_toml(log: Log) -> list[str]:
    robot = log.robot
    lines = [f'format = "{FORMAT}"', f'name = "{log.name}"']
    names = ("wheel_radius_left", "wheel_radius_right", "wheel_base", "noise_left", "noise_right")
    assert robot is not None
    lines += ["", "[robot]", *(f"{name} = {_toml(getattr(robot, name))}" for name in names)]
    lines += [f'law = "{robot.law}"', f"slip = {_toml(robot.slip)}"]
    for camera in log.cameras.values():
        lines += ["", "[camera]", f"image_size = {list(camera.image_size)}"]
        for name in ("homography", "matrix", "distortion"):
            array = getattr(camera, name)
            if array is not None:
                lines.append(f"{name} = {_toml(array)}")
    if log.start_given:
        lines += ["", "[start]", f"pose = {_toml(log.start_pose)}", "sigma = [0.0, 0.0, 0.0]"]
    return lines


def _toml(value: float | Sequence[float] | Array) -> str:
    if np.ndim(value) == 0:
        return repr(float(value))  # type: ignore[arg-type]
    return f"[{', '.join(_toml(v) for v in value)}]"  # type: ignore[union-attr]


def _write(path: Path, lines: Iterable[str]) -> None:
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8", newline="\n")
