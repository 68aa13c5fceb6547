"""Maps from files: the columns of ``map.csv``, or all that an estimate knows of its map."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from compare.interchange.g2o_read import read_g2o
from frontend.readers import folder_tables
from frontend.readers.folder_tables import EXTENT, LINE_COV
from frontend.table import Table, read_table
from graphslam.arrays import frozen
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.measurements import LandmarkMap
from graphslam.models.line import LINE

MAP_FILE, ESTIMATE_FILE = "map.csv", "estimate.npz"


@dataclass(frozen=True, slots=True)
class MapFile:
    """A map with what its file says about how well it is known.

    Attributes:
        path: the file it was read from.
        landmarks: the map, canonical, in the order of the file; `sightings` as the file counts
            them, 0 where it does not.
        cov: (L, L) covariance of all parameters in the order of `landmarks` (a line: rho, alpha),
            m², m·rad and rad², frame of the file. A known landmark has 0. NaN in the rows and
            columns of landmarks whose covariance the file does not give.
        joint: whether correlations between landmarks are known; without, they stand as 0.
    """

    path: Path
    landmarks: LandmarkMap
    cov: Array
    joint: bool

    def __post_init__(self) -> None:
        size = int(self.landmarks.offsets()[-1]) - 3
        object.__setattr__(self, "cov", frozen("cov", self.cov, (size, size), float, True))

    def landmark_cov(self, landmark: int) -> Array:
        """Returns the covariance (l, l) of one landmark's parameters, NaN where not known."""
        first, last = self.landmarks.offsets()[landmark : landmark + 2] - 3
        return self.cov[first:last, first:last]

    @property
    def known_cov(self) -> bool:
        """Whether the covariance of every landmark is known."""
        return not bool(np.isnan(self.cov).any())


def read_map(path: Path | str) -> LandmarkMap:
    """Returns the landmarks of a map file; see `read_map_file`."""
    return read_map_file(path).landmarks


def read_map_file(path: Path | str) -> MapFile:
    """Returns a map and its covariance.

    Args:
        path: a ``map.csv``; an ``estimate.npz``; a g2o graph, ``*.g2o``; or a folder: one method's
            folder of a run (its estimate.npz, which holds correlations too), or any folder with a
            map.csv.

    Raises:
        BadLog: the table or graph cannot be used; the message names file, line and cure.
        BadMeasurements: the estimate cannot be used.
        BadConfig: there is no map at this place.
    """
    file = _map_in(Path(path))
    read = {".npz": _of_estimate, ".g2o": _of_graph}.get(file.suffix, _of_table)
    return read(file)


def _map_in(path: Path) -> Path:
    if not path.is_dir():
        return path
    for name in (ESTIMATE_FILE, MAP_FILE):
        if (path / name).is_file():
            return path / name
    methods = sorted(inner.parent.name for inner in path.glob(f"*/{ESTIMATE_FILE}"))
    if methods:
        raise BadConfig(
            f"{path}: is a run of several methods; name one of its maps: "
            + ", ".join(str(path / name) for name in methods)
        )
    raise BadConfig(f"{path}: holds no {MAP_FILE}; give a map.csv, or the folder of one method")


def _of_estimate(path: Path) -> MapFile:
    estimate = Estimate.load(path)
    return MapFile(path, estimate.map, estimate.cov_joint[3:, 3:], joint=True)


def _of_graph(path: Path) -> MapFile:
    landmarks = read_g2o(path).landmarks
    size = int(landmarks.offsets()[-1]) - 3
    return MapFile(path, landmarks, np.full((size, size), np.nan), joint=False)


def _of_table(path: Path) -> MapFile:
    landmarks = folder_tables.read_map(path)
    table = read_table(
        path,
        ("line", "rho", "alpha"),
        (EXTENT, LINE_COV, "sightings"),
        whole=("line", "sightings"),
        blank=(*EXTENT, *LINE_COV),
    )
    _, _, J = LINE.canonical(table.stack("rho", "alpha"), np.full((len(table), 2), np.nan))
    blocks = J @ _covariances(table) @ np.swapaxes(J, 1, 2)
    cov = np.zeros((2 * len(table), 2 * len(table)))
    for row, block in enumerate(blocks):
        at = slice(2 * row, 2 * row + 2)
        cov[at, at] = block
    unknown = np.repeat(np.isnan(blocks).any(axis=(1, 2)), 2)
    cov[unknown[:, None] | unknown[None, :]] = np.nan
    counted = table.numbers.get("sightings", np.zeros(len(table)))
    table.check(counted < 0, "sightings = {sightings} is negative; write how often it was seen")
    landmarks = LandmarkMap(
        landmarks.id, landmarks.kind, landmarks.params, landmarks.extent, counted.astype(np.int64)
    )
    return MapFile(path, landmarks, cov, joint=False)


def _covariances(table: Table) -> Array:
    """Returns (M, 2, 2) covariances; NaN where the cells are empty, 0 where they are: known."""
    cov = np.full((len(table), 2, 2), np.nan)
    if LINE_COV[0] not in table:
        return cov
    entries = table.stack(*LINE_COV)
    given = np.isfinite(entries)
    table.check(
        given.any(axis=1) & ~given.all(axis=1),
        f"has some of {', '.join(LINE_COV)}; write all three, or none",
    )
    rr, ra, aa = entries.T
    usable = (rr > 0) & (aa > 0) & (ra**2 < rr * aa)
    known = (entries == 0).all(axis=1)
    shown = ", ".join(f"{name} = {{{name}}}" for name in LINE_COV)
    table.check(
        given.all(axis=1) & ~usable & ~known,
        f"{shown} is no covariance; give rho and alpha positive variances (m², m·rad, rad²), or 0 "
        "in all three for a line that is known exactly",
    )
    cov[:, [0, 0, 1, 1], [0, 1, 0, 1]] = entries[:, [0, 1, 1, 2]]
    return cov
