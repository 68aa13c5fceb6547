"""From a picture of the floor, or a table of points, to a camera: as a value and in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table
from rich.text import Text

from frontend.calibrate import (
    CameraCalibration,
    KnownPoints,
    calibrate_camera,
    camera_toml,
)
from frontend.calibrate_target import (
    Chessboard,
    chessboard_points,
    dot_points,
    read_image,
    read_lens,
    read_points,
)
from graphslam.arrays import AnyArray
from graphslam.errors import BadConfig
from graphslam.geometry import Array

MOST_ROWS = 30
"""Points printed; of more the worst."""


def calibrate_floor(
    points: Path | None = None,
    dots: Path | None = None,
    chessboard: tuple[int, int] | None = None,
    square: float | None = None,
    board_pose: tuple[float, float, float] | None = None,
    image: Path | None = None,
    image_size: tuple[int, int] | None = None,
    lens: Path | None = None,
    fit_distortion: bool = False,
) -> CameraCalibration:
    """Returns the camera that known points of the floor give; exactly one kind of them is given.

    Args:
        points: table u,v,x,y: raw pixels; m, robot frame.
        dots: table x,y of round dots in the image.
        chessboard: rows and columns of inner corners of a chessboard in the image.
        square: side of its squares, m.
        board_pose: x, y, m, and heading, degrees, of its first corner and row, robot frame.
        image: of the floor, as the camera gives it.
        image_size: (width, height), pixels, where no image tells it.
        lens: TOML file with ``matrix`` and ``distortion``.
        fit_distortion: whether to find one radial coefficient from the same points.

    Raises:
        BadLog: a table cannot be used.
        BadConfig: something is missing, or not in the image.
        UnderConstrained: the points fix no camera.
    """
    if sum(way is not None for way in (points, dots, chessboard)) != 1:
        raise BadConfig("give exactly one of points, dots and chessboard")
    if chessboard is None and (square is not None or board_pose is not None):
        raise BadConfig("square and board pose belong to a chessboard: give --chessboard too")
    known_lens = None if lens is None else read_lens(lens)
    if image is None:
        if points is None:
            raise BadConfig("dots and chessboards are looked for in an image: give --image")
        if image_size is None:
            raise BadConfig(
                "the size of the camera's images is missing: give --image-size or --image"
            )
        return calibrate_camera(read_points(points), image_size, known_lens, fit_distortion)
    grey = read_image(image)
    size = (grey.shape[1], grey.shape[0])
    if image_size is not None and image_size != size:
        raise BadConfig(f"{image}: is {size[0]} x {size[1]} pixels; leave --image-size out")
    if points is not None:
        known = read_points(points)
    elif dots is not None:
        known = dot_points(grey, dots, str(image), known_lens)
    else:
        known = _corners(grey, chessboard, square, board_pose, str(image))
    return calibrate_camera(known, size, known_lens, fit_distortion)


def print_camera(found: CameraCalibration) -> None:
    """Prints errors, by point and in all, what looks wrong, and [camera] for log.toml."""
    console = Console(highlight=False, soft_wrap=False)
    console.print(_by_point(found))
    console.print(_in_all(found))
    for note in found.notes:
        console.print(Text(note))
    console.print(Text(f"\nFor log.toml:\n{camera_toml(found)}"), soft_wrap=True)


def _corners(
    grey: AnyArray,
    chessboard: tuple[int, int] | None,
    square: float | None,
    board_pose: tuple[float, float, float] | None,
    source: str,
) -> KnownPoints:
    assert chessboard is not None, "one of three is given"
    if square is None or board_pose is None:
        raise BadConfig("a chessboard needs --square and --board-pose: its size and its place")
    return chessboard_points(grey, Chessboard(*chessboard, square, board_pose), source)


def _by_point(found: CameraCalibration) -> Table:
    table = _table(f"{found.points.source}: {len(found.points.floor)} points")
    names = ("point", "u px", "v px", "x m", "y m", "error cm", "error px", "left out cm")
    for name in (*names, "left out px"):
        table.add_column(name, justify="right", no_wrap=name not in (*names[5:], "left out px"))
    far = _length(found.error_m)
    shown = np.arange(len(far))
    if len(far) > MOST_ROWS:
        shown = np.sort(np.argsort(-far, kind="stable")[:MOST_ROWS])
        table.caption = f"the {MOST_ROWS} worst of {len(far)}"
    columns = (
        1e2 * far,
        _length(found.error_px),
        1e2 * _length(found.left_out_m),
        _length(found.left_out_px),
    )
    for k in shown.tolist():
        (u, v), (x, y) = found.points.pixel[k], found.points.floor[k]
        cells = (_short(column[k]) for column in columns)
        table.add_row(str(k + 1), f"{u:.2f}", f"{v:.2f}", f"{x:.4f}", f"{y:.4f}", *cells)
    return table


def _in_all(found: CameraCalibration) -> Table:
    table = _table("reprojection error")
    for name in ("", "mean", "root mean square", "worst"):
        table.add_column(name, justify="right" if name else "left")
    rows = (
        ("on the floor, cm", 1e2 * _length(found.error_m)),
        ("in the image, px", _length(found.error_px)),
        ("left out, on the floor, cm", 1e2 * _length(found.left_out_m)),
        ("left out, in the image, px", _length(found.left_out_px)),
    )
    for name, column in rows:
        known = column[np.isfinite(column)]
        if len(known):
            figures = (known.mean(), float(np.sqrt(np.mean(known**2))), known.max())
            table.add_row(name, *(_short(value) for value in figures))
    return table


def _table(title: str) -> Table:
    return Table(title=Text(title), title_justify="left", title_style="bold", box=SIMPLE)


def _length(error: Array) -> Array:
    return np.asarray(np.linalg.norm(error, axis=1))


def _short(value: float) -> str:
    if np.isnan(value):
        return "–"
    return "0.000" if value < 5e-4 else f"{value:.3f}" if value < 10 else f"{value:.1f}"
