"""Log folders (docs/log-format.md): their tables and log.toml from a `Log`, and their images."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from frontend.camera import Camera
from frontend.log import DEFAULT_CAMERA, UNKNOWN_WHEELS, AnyCamera, Log
from frontend.log_parts import BearingSightings, LampSightings, LineSightings, PoseFixes
from frontend.omni import BearingCorrection, OmniCamera
from frontend.overhead import OverheadCamera
from frontend.readers.log_toml import FORMAT
from graphslam.geometry import Array
from graphslam.measurements import LandmarkMap

TIME_DECIMALS = 9
"""Decimals of times, s, as bags have; simulated times are used as they are written."""
TIME = f"{{:.{TIME_DECIMALS}f}}"
TWELVE_DECIMALS, EXACT = "{:.12f}", "{!r}"


def write_log(folder: Path, log: Log, exact: bool) -> None:
    """Writes log.toml and all tables but images.csv into an empty folder.

    Args:
        folder: where.
        log: the recording.
        exact: whether numbers are written so that reading gives the same bits, or with twelve
            decimals; times have nine, as bags have.
    """
    real, time = EXACT if exact else TWELVE_DECIMALS, TIME
    _write(folder / "log.toml", log_toml(log))
    if log.wheels is not None:
        wheels = _rows([time, real, real], np.column_stack([log.wheels.t, log.wheels.angle]))
        _write(folder / "wheels.csv", ["t,left,right", *wheels])
    if log.odometry is not None:
        poses = np.column_stack([log.odometry.t, log.odometry.pose])
        _write(folder / "odometry.csv", ["t,x,y,theta", *_rows([time, real, real, real], poses)])
    if log.map is not None:
        write_map(folder / "map.csv", log.map, real)
    if log.truth is not None:
        half = 0.5 * log.truth.pose[:, 2]
        columns = [log.truth.t, log.truth.pose[:, :2], np.sin(half), np.cos(half)]
        row = f"{time} {real} {real} 0 0 0 {real} {real}"
        rows = (row.format(*v) for v in np.column_stack(columns).tolist())
        _write(folder / "groundtruth.tum", rows)
    if log.sightings is not None:
        _write(folder / "sightings.csv", _sightings(log.sightings, time, real))
    if log.pose_fixes is not None:
        _write(folder / "tags.csv", _tags(log.pose_fixes, time, real))
    if log.lamps is not None:
        _write(folder / "lamps.csv", _lamps(log.lamps, time, real))
    if log.bearings is not None:
        _write(folder / "bearings.csv", _bearings(log.bearings, time, real))
    if log.landmarks is not None:
        write_landmarks(folder / "landmarks.csv", log.landmarks, real)


def write_images_csv(
    folder: Path, t: Array, files: Sequence[str], cameras: Sequence[str] = ()
) -> None:
    """Writes images.csv: times (I,), s, and as many paths inside the folder and names of cameras.

    Without cameras, all are of the default one.
    """
    if set(cameras) <= {DEFAULT_CAMERA}:
        rows = (f"{TIME.format(when)},{file}" for when, file in zip(t.tolist(), files, strict=True))
        _write(folder / "images.csv", ["t,file", *rows])
        return
    parts = zip(t.tolist(), files, cameras, strict=True)
    rows = (f"{TIME.format(when)},{file},{camera}" for when, file, camera in parts)
    _write(folder / "images.csv", ["t,file,camera", *rows])


def write_map(path: Path, lines: LandmarkMap, real: str = EXACT) -> None:
    """Writes map.csv."""
    _write(path, _map(lines, real))


def write_landmarks(path: Path, known: LandmarkMap, real: str = EXACT) -> None:
    """Writes landmarks.csv."""
    _write(path, _landmarks(known, real))


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


def _sightings(seen: LineSightings, time: str, real: str) -> Iterable[str]:
    late = bool(np.any(seen.t_received != seen.t))
    received = ",t_received" if late else ""
    yield f"t,rho,alpha,cov_rr,cov_ra,cov_aa,s_min,s_max,line{received}"
    cov = seen.cov[:, [0, 0, 1], [0, 1, 1]]
    values = np.column_stack([seen.t, seen.z, cov, seen.extent])
    numbers = _rows([time, *[real] * (values.shape[1] - 1)], values)
    rows = zip(numbers, seen.truth.tolist(), seen.t_received.tolist(), strict=True)
    for row, line, when in rows:
        row = row.replace("nan", "")
        yield f"{row},{line},{time.format(when)}" if late else f"{row},{line}"


def _tags(fixes: PoseFixes, time: str, real: str) -> Iterable[str]:
    yield "t,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt,t_received"
    rows, columns = np.triu_indices(3)
    values = np.column_stack([fixes.t, fixes.z, fixes.cov[:, rows, columns], fixes.t_received])
    yield from _rows([time, *[real] * 9, time], values)


def _lamps(lamps: LampSightings, time: str, real: str) -> Iterable[str]:
    yield "t,x,y,phi,cov_xx,cov_xy,cov_xp,cov_yy,cov_yp,cov_pp,landmark,t_received"
    rows, columns = np.triu_indices(3)
    cov, truth, received = lamps.cov[:, rows, columns], lamps.truth, lamps.t_received
    values = np.column_stack([lamps.t, lamps.z, cov, truth, received])
    yield from _rows([time, *[real] * 9, "{:.0f}", time], values)


def _bearings(seen: BearingSightings, time: str, real: str) -> Iterable[str]:
    yield "t,bearing,sigma,label,landmark,t_received"
    sigma = np.sqrt(seen.cov[:, 0, 0])
    numbers = _rows([time, real, real], np.column_stack([seen.t, seen.z, sigma]))
    columns = seen.label.tolist(), seen.truth.tolist(), seen.t_received.tolist()
    for row, label, landmark, when in zip(numbers, *columns, strict=True):
        yield f"{row},{label},{landmark},{time.format(when)}"


def _landmarks(known: LandmarkMap, real: str) -> Iterable[str]:
    yield "landmark,kind,x,y,phi,label"
    rows = zip(known.id.tolist(), known.kind, known.params, known.label.tolist(), strict=True)
    for name, kind, params, label in rows:
        cells = [real.format(float(v)) if np.isfinite(v) else "" for v in params]
        yield ",".join([str(name), kind, *[*cells, ""][:3], str(label)])


def log_toml(log: Log) -> list[str]:
    """Returns the lines of a log.toml."""
    return [f'format = "{FORMAT}"', f"name = {text(log.name)}", *description(log)]


def text(value: str) -> str:
    """Returns a text as TOML has it."""
    return json.dumps(value, ensure_ascii=False)


def description(log: Log) -> list[str]:
    """Returns the lines of [robot], of the cameras and of [start], in log.toml and robot files."""
    lines: list[str] = []
    names = ("wheel_radius_left", "wheel_radius_right", "wheel_base", "noise_left", "noise_right")
    if log.robot is not None and log.robot != replace(UNKNOWN_WHEELS, slip=log.robot.slip):
        lines += ["", "[robot]", *(f"{name} = {toml(getattr(log.robot, name))}" for name in names)]
        lines.append(f'law = "{log.robot.law}"')
    elif log.robot is not None:
        lines += ["", "[robot]"]
    if log.robot is not None:
        lines.append(f"slip = {toml(log.robot.slip)}")
    for name, camera in log.cameras.items():
        lines += ["", *camera_toml(name, camera)]
    if log.bearing_correction != BearingCorrection():
        lines += ["", "[bearings]", *correction_toml(log.bearing_correction)]
    if log.start_given:
        pose, sigma = toml(log.start_pose), toml(log.start_sigma)
        lines += ["", "[start]", f"pose = {pose}", f"sigma = {sigma}"]
    return lines


def camera_toml(name: str, camera: AnyCamera) -> Iterable[str]:
    """Yields the lines of a camera, in log.toml and robot files."""
    if isinstance(camera, OmniCamera):
        return _omni(name, camera)
    return _overhead(name, camera) if isinstance(camera, OverheadCamera) else _plane(name, camera)


def _plane(name: str, camera: Camera) -> Iterable[str]:
    """Yields the lines of a camera that looks at floor or ceiling."""
    yield "[camera]" if name == DEFAULT_CAMERA else f"[cameras.{text(name)}]"
    yield f"image_size = {list(camera.image_size)}"
    if name != DEFAULT_CAMERA:
        yield f'looks_at = "{camera.looks_at}"'
    yield from _lens(camera)
    if camera.delay_s:
        yield f"delay = {toml(camera.delay_s)}"
    if camera.ignore_px:
        yield f"ignore_px = {[list(corners) for corners in camera.ignore_px]}"


def _lens(camera: Camera) -> Iterable[str]:
    for key in ("homography", "matrix", "distortion"):
        array = getattr(camera, key)
        if array is not None:
            yield f"{key} = {toml(array)}"
    if camera.lens != "plain":
        yield f'lens = "{camera.lens}"'


def _overhead(name: str, eye: OverheadCamera) -> Iterable[str]:
    """Yields the lines of a camera that watches the robot from above, and of its tags."""
    table = f"cameras.{text(name)}"
    yield from (f"[{table}]", 'looks_at = "overhead"')
    yield f"image_size = {list(eye.image_size)}"
    yield from _lens(eye.camera)
    if eye.delay_s:
        yield f"delay = {toml(eye.delay_s)}"
    if eye.position is not None:
        yield f"position = {toml(eye.position)}"
    yield from ("", f"[{table}.tags]")
    for key in ("front", "centre", "diameter", "height"):
        value = getattr(eye.tags, key)
        if value is not None:
            yield f"{key} = {toml(value)}"


def _omni(name: str, camera: OmniCamera) -> Iterable[str]:
    """Yields the lines of a camera that sees all around."""
    yield from (f"[cameras.{text(name)}]", 'looks_at = "omni"')
    yield f"image_size = {list(camera.image_size)}"
    yield f"centre = {toml(camera.centre)}"
    yield f"heading_deg = {toml(camera.heading_deg)}"
    yield f"mirrored = {str(camera.mirrored).lower()}"
    if camera.ring_px is not None:
        yield f"ring_px = {toml(camera.ring_px)}"
    if camera.correction != BearingCorrection():
        yield from correction_toml(camera.correction)
    if camera.delay_s:
        yield f"delay = {toml(camera.delay_s)}"
    for colour in camera.colours:
        yield from ("", f"[[cameras.{text(name)}.colours]]", f"label = {colour.label}")
        yield from (f"low = {list(colour.low)}", f"high = {list(colour.high)}")
        yield f"name = {text(colour.name)}"


def correction_toml(correction: BearingCorrection) -> list[str]:
    """Returns the lines of a correction of directions, in log.toml."""
    pairs = [list(map(float, pair)) for pair in correction.harmonics_deg]
    return [f"offset_deg = {toml(correction.offset_deg)}", f"harmonics_deg = {pairs}"]


def toml(value: float | Sequence[float] | Array) -> str:
    """Returns a number, or numbers in any nesting, as TOML has them."""
    if np.ndim(value) == 0:
        return repr(float(value))  # type: ignore[arg-type]
    return f"[{', '.join(toml(v) for v in value)}]"  # type: ignore[union-attr]


def _write(path: Path, lines: Iterable[str]) -> None:
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8", newline="\n")
