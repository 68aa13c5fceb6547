"""The tables of a log folder, one function per file: columns, defaults and checks of each.

Those of points and their sightings are in `point_tables`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path, PureWindowsPath

import numpy as np

from frontend.log import DEFAULT_CAMERA
from frontend.log_parts import ImageList, LineSightings, PoseFixes, PoseTrack, Wheels
from frontend.quaternions import yaw
from frontend.strict import nearest
from frontend.table import Table, read_columns, read_table
from graphslam.geometry import Array, wrap
from graphslam.measurements import LandmarkMap
from graphslam.models.line import LINE

LINE_SIGMA = (0.005, math.radians(0.5))
"""Noise of sightings.csv where it gives none: rho in m, alpha in rad."""
TAG_SIGMA = (0.01, 0.01, math.radians(2.0))
"""Noise of tags.csv where it gives none: x and y in m, theta in rad."""

LINE_COV = ("cov_rr", "cov_ra", "cov_aa")
POSE_COV = ("cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt")
EXTENT = ("s_min", "s_max")


def read_wheels(path: Path) -> Wheels:
    """Returns ``wheels.csv``."""
    table = read_table(path, ("t", "left", "right"), least=2)
    table.check_times()
    return Wheels(table.numbers["t"], table.stack("left", "right"))


def read_odometry(path: Path) -> PoseTrack:
    """Returns ``odometry.csv``."""
    table = read_table(path, ("t", "x", "y", "theta"), least=2)
    table.check_times()
    return PoseTrack(table.numbers["t"], table.stack("x", "y", "theta"))


def read_images(path: Path, cameras: Collection[str]) -> ImageList:
    """Returns ``images.csv``; every file listed is there and inside the folder.

    Args:
        path: the table.
        cameras: names that its column ``camera`` may hold.
    """
    table = read_table(path, ("t", "file"), ("camera",), text=("file", "camera"), least=1)
    table.check_times(repeats=True)
    camera = table.texts.get("camera", (DEFAULT_CAMERA,) * len(table))
    last: dict[str, float] = {}
    for row, (t, name) in enumerate(zip(table.numbers["t"].tolist(), camera, strict=True)):
        if name not in cameras:
            cure = nearest(name, cameras) if cameras else "describe it there as [camera]"
            raise table.error(row, f"log.toml describes no camera {name!r}; {cure}")
        if last.get(name) == t:
            raise table.error(row, f"t = {t:.12g} repeats an image's time; keep one of each time")
        last[name] = t
    root = path.parent.resolve()
    parent_of = cache(lambda parent: (root / parent).resolve())  # images share few folders
    files = tuple(_image_file(table, row, root, parent_of) for row in range(len(table)))
    return ImageList(table.numbers["t"], files, camera)


def _image_file(table: Table, row: int, root: Path, parent_of: Callable[[Path], Path]) -> Path:
    """Returns where an image lies, links followed; it may not leave the folder ``root``."""
    text = table.texts["file"][row]
    shown = repr(text if len(text) <= 80 else text[:77] + "...")
    if not text:
        raise table.error(row, "file is empty; write the image's path inside the log folder")
    given = Path(text)
    if given.is_absolute() or PureWindowsPath(text).drive:
        raise table.error(row, f"{shown} is an absolute path; write it from the log folder on")
    try:
        path = parent_of(given.parent) / given.name
        if path.is_symlink() or given.name == "..":
            path = path.resolve()
        inside, there = path.is_relative_to(root), path.is_file()
    except (OSError, RuntimeError, ValueError):  # too long, links in a circle, a zero byte
        raise table.error(row, f"{shown} is not a usable path; rename the file") from None
    if not inside:
        raise table.error(row, f"{shown} leaves the log folder; move the image into it")
    if not there:
        raise table.error(row, f"there is no image file {shown}; add it, or remove the row")
    return path


def read_sightings(path: Path, known: LandmarkMap | None) -> LineSightings:
    """Returns ``sightings.csv``.

    Args:
        path: the table.
        known: the log's map, whose lines the column ``line`` names, or None.
    """
    table = read_table(
        path,
        ("t", "rho", "alpha"),
        (LINE_COV, EXTENT, "line", "t_received"),
        whole=("line",),
        blank=EXTENT,
    )
    table.check_times(repeats=True)
    check_radians(table)
    truth = table.numbers.get("line", np.full(len(table), -1.0))
    table.check(truth < -1, "line = {line} is not a line; write its number in map.csv, or -1")
    if known is not None:
        unknown = (truth >= 0) & ~np.isin(truth, known.id)
        table.check(unknown, "line = {line} is not in map.csv; add it there, or write -1")
    return LineSightings(
        t=table.numbers["t"],
        z=table.stack("rho", "alpha"),
        cov=covariances(table, LINE_COV, LINE_SIGMA),
        extent=_extents(table),
        truth=truth,
        t_received=received(table),
    )


def read_tags(path: Path) -> PoseFixes:
    """Returns ``tags.csv``."""
    table = read_table(path, ("t", "x", "y", "theta"), (POSE_COV, "t_received"))
    table.check_times(repeats=True)
    z = table.stack("x", "y", "theta")
    return PoseFixes(
        table.numbers["t"], z, covariances(table, POSE_COV, TAG_SIGMA), received(table)
    )


def read_truth(path: Path) -> PoseTrack:
    """Returns ``groundtruth.tum`` seen from above: position and yaw of each pose."""
    table = read_columns(path, ("t", "x", "y", "z", "qx", "qy", "qz", "qw"), least=1)
    table.check_times()
    q = table.stack("qx", "qy", "qz", "qw")
    norm = np.linalg.norm(q, axis=1)
    table.check(
        np.abs(norm - 1) > 1e-3,
        "the quaternion {qx} {qy} {qz} {qw} has not the norm 1; the order is t x y z qx qy qz qw",
    )
    pose = np.column_stack([table.stack("x", "y"), wrap(yaw(q / norm[:, None]))])
    return PoseTrack(table.numbers["t"], pose)


def read_map(path: Path) -> LandmarkMap:
    """Returns ``map.csv``, lines made canonical; the covariances of a run's map are not used."""
    table = read_table(
        path,
        ("line", "rho", "alpha"),
        (EXTENT, LINE_COV, "sightings"),
        whole=("line", "sightings"),
        blank=(*EXTENT, *LINE_COV),
    )
    check_radians(table)
    ids = table.numbers["line"]
    table.check(ids < 0, "line = {line} is negative; number the lines from 0")
    first = np.zeros(len(table), bool)
    first[np.unique(ids, return_index=True)[1]] = True
    table.check(~first, "line = {line} is there twice; give every line a number of its own")
    lines, extent, _ = LINE.canonical(table.stack("rho", "alpha"), _extents(table))
    nothing = np.zeros(len(table), np.int64)
    return LandmarkMap(ids.astype(np.int64), ("line",) * len(table), lines, extent, nothing)


def check_radians(table: Table, name: str = "alpha") -> None:
    """Refuses what looks like degrees; angles that were added up over a turn or two pass."""
    message = f"{name} = {{{name}}} is beyond two full turns; write radians"
    table.check(np.abs(table.numbers[name]) > 4 * math.pi, message)


def _extents(table: Table) -> Array:
    """Returns (K, 2) the stretches ``s_min, s_max``; NaN where they are absent or empty."""
    if "s_min" not in table:
        return np.full((len(table), 2), np.nan)
    extent = table.stack("s_min", "s_max")
    known = np.isfinite(extent)
    table.check(known[:, 0] != known[:, 1], "has one of s_min and s_max; write both, or none")
    message = "s_min = {s_min} is beyond s_max = {s_max}; exchange them"
    table.check(extent[:, 0] > extent[:, 1], message)
    return extent


def received(table: Table) -> Array:
    """Returns (K,) when each row became available, s: ``t`` where the table does not say."""
    t = table.numbers["t"]
    received = table.numbers.get("t_received", t)
    message = "t_received = {t_received} is before t = {t}; nothing arrives before it happens"
    table.check(received < t, message)
    return received


def covariances(table: Table, names: tuple[str, ...], sigma: tuple[float, ...]) -> Array:
    """Returns (K, d, d) covariances from the columns of the upper triangle, or diag(sigma^2)."""
    d = len(sigma)
    if names[0] not in table:
        return np.broadcast_to(np.diag(np.square(sigma)), (len(table), d, d)).copy()
    cov = np.zeros((len(table), d, d))
    rows, columns = np.triu_indices(d)
    cov[:, rows, columns] = cov[:, columns, rows] = table.stack(*names)
    variance = np.diagonal(cov, axis1=1, axis2=2)
    shown = ", ".join(f"{name} = {{{name}}}" for name in names)
    message = (
        f"{shown} is no covariance; give every direction a positive variance (m², m·rad, rad²)"
    )
    table.check(~np.all(variance > 0, axis=1), message)
    scale = 1 / np.sqrt(variance)
    correlation = cov * scale[:, :, None] * scale[:, None, :]
    table.check(np.linalg.eigvalsh(correlation)[:, 0] < 1e-12, message)
    return cov
