"""Known points of the floor from files, and from an image of a chessboard or of dots."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from frontend.calibrate import KnownPoints, Lens
from frontend.calibrate_dots import find_dots, without_bias
from frontend.calibrate_fit import FEWEST_POINTS
from frontend.calibrate_matching import dots_of_points, nearest_dots
from frontend.calibrate_upright import upright
from frontend.camera import Camera
from frontend.images import read_grey
from frontend.log import DEFAULT_CAMERA
from frontend.strict import from_dict, load_toml
from frontend.table import read_table
from graphslam.errors import BadConfig
from graphslam.geometry import Array, transform_points

WINDOW = 0.4
"""Half the window in which a corner is refined, as a share of the shortest side of a square."""
WINDOW_PX = (3, 12)
"""And at least and at most, pixels."""


@dataclass(frozen=True, slots=True)
class Chessboard:
    """A chessboard lying on the floor.

    Attributes:
        rows: of inner corners, where four squares meet.
        columns: of inner corners.
        square: side of a square, m.
        pose: where the corner of the first row and column lies (x, y), m, and the direction along
            that row (heading), degrees, robot frame; further rows follow to the left of it.
    """

    rows: int
    columns: int
    square: float
    pose: tuple[float, float, float]

    def __post_init__(self) -> None:
        if min(self.rows, self.columns) < 3:
            raise BadConfig(
                f"chessboard = {self.rows} {self.columns}: has at least 3 rows and 3 columns of "
                "inner corners, one less than squares"
            )
        if not (math.isfinite(self.square) and self.square > 0):
            raise BadConfig(f"square = {self.square}: must be a length above 0, m")
        if not all(map(math.isfinite, self.pose)):
            raise BadConfig(f"board pose = {list(self.pose)}: must be finite")

    def corners(self) -> Array:
        """Returns (rows, columns, 2) inner corners, robot frame, m."""
        row, column = np.mgrid[: self.rows, : self.columns]
        x, y, heading_deg = self.pose
        pose = np.array([x, y, math.radians(heading_deg)])
        return transform_points(pose, self.square * np.stack([column, row], -1).astype(float))


@dataclass(frozen=True, slots=True)
class _LensTable:
    """The keys of a lens, as they stand in log.toml."""

    matrix: tuple[
        tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]
    ]
    distortion: tuple[float, ...]
    lens: Literal["plain", "fisheye"] = "plain"


def read_points(path: Path) -> KnownPoints:
    """Returns the points of a CSV file u,v,x,y: raw pixels, and metres in the robot frame.

    Raises:
        BadLog: the file cannot be used; the message names the line.
    """
    table = read_table(path, ("u", "v", "x", "y"), least=FEWEST_POINTS)
    return KnownPoints(table.stack("u", "v"), table.stack("x", "y"), str(path))


def read_lens(path: Path) -> Lens:
    """Returns ``matrix``, ``distortion`` and ``lens`` of a TOML file, at its top or under [camera].

    Raises:
        BadConfig: the file says something else.
    """
    content = load_toml(path)
    inside = content.get("camera", content)
    wanted = {key: inside[key] for key in ("matrix", "distortion", "lens") if key in inside}
    table = from_dict(_LensTable, wanted, str(path))
    return Lens(np.array(table.matrix), np.array(table.distortion), table.lens)


def read_image(path: Path) -> NDArray[np.uint8]:
    """Returns an image as (H, W) grey levels.

    Raises:
        BadConfig: it cannot be read.
    """
    grey = read_grey(path)
    if grey is None:
        raise BadConfig(f"{path}: cannot be read as an image; give a whole PNG or JPEG file")
    return grey


def chessboard_points(grey: NDArray[np.uint8], board: Chessboard, source: str) -> KnownPoints:
    """Returns the inner corners of a chessboard, to a fraction of a pixel.

    Which corner is the first follows from its pose, and from forward being up in the image.

    Args:
        grey: (H, W) image.
        board: what lies on the floor.
        source: of the image, for messages.

    Raises:
        BadConfig: no such board is in the image, or it is mirrored.
    """
    seen = _corners_seen(grey, board)
    if seen is None:
        raise BadConfig(
            f"{source}: no chessboard of {board.rows} x {board.columns} inner corners is "
            "seen; show all of it with a white border, sharp and evenly lit, and count the corners "
            "where four squares meet"
        )
    ways = [seen, seen[::-1], seen[:, ::-1], seen[::-1, ::-1]]
    if board.rows == board.columns:
        ways += [way.transpose(1, 0, 2) for way in ways]
    floor = board.corners().reshape(-1, 2)
    pixel, _ = upright([way.reshape(-1, 2) for way in ways], [floor] * len(ways))
    return KnownPoints(pixel, floor, source)


def dot_points(
    grey: NDArray[np.uint8], places: Path, source: str, lens: Lens | None = None
) -> KnownPoints:
    """Returns dots, to a fraction of a pixel, whose places on the floor a CSV file x,y tells.

    Columns u,v beside them, roughly where each dot is in the image, help where the dots alone do
    not tell which is which.

    Args:
        grey: (H, W) image.
        places: file with x,y, robot frame, m; u,v raw pixels.
        source: of the image, for messages.
        lens: of the camera, where it is known.

    Raises:
        BadLog: the file cannot be used.
        BadConfig: dots and points do not fit.
    """
    table = read_table(places, ("x", "y"), (("u", "v"),), least=FEWEST_POINTS)
    floor, dots, width = table.stack("x", "y"), find_dots(grey), grey.shape[1]
    where = f"{source}, {places}"
    if "u" in table:
        raw = nearest_dots(dots, table.stack("u", "v"), width, where)
    else:
        raw = dots_of_points(dots, floor, width, where)
    area = dots.area[np.linalg.norm(raw[:, None] - dots.pixel, axis=2).argmin(axis=1)]
    ideal = raw if lens is None else _undistorted(raw, lens, grey)
    return KnownPoints(raw + without_bias(ideal, area, floor) - ideal, floor, where)


def _undistorted(pixel: Array, lens: Lens, grey: NDArray[np.uint8]) -> Array:
    size = (grey.shape[1], grey.shape[0])
    only_lens = Camera(
        DEFAULT_CAMERA, "floor", size, np.eye(3), lens.matrix, lens.distortion, lens.model
    )
    return only_lens.undistort(pixel)


def _corners_seen(grey: NDArray[np.uint8], board: Chessboard) -> Array | None:
    """Returns (rows, columns, 2) pixels of inner corners in some order of rows and columns."""
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    seen, corners = cv2.findChessboardCornersSB(grey, size, flags=flags)
    if not seen:
        seen, corners = cv2.findChessboardCorners(grey, size)
    if not seen:
        return None
    corners = np.asarray(corners, np.float32).reshape(board.rows, board.columns, 2)
    steps = [np.linalg.norm(np.diff(corners, axis=axis), axis=2).min() for axis in (0, 1)]
    window = int(np.clip(WINDOW * min(steps), *WINDOW_PX))
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-4)
    fine = cv2.cornerSubPix(grey, corners.reshape(-1, 1, 2), (window, window), (-1, -1), stop)
    return np.asarray(fine, float).reshape(board.rows, board.columns, 2)
