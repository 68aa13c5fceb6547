"""``scans.npz`` of a log folder: scans of a laser, read without pickle and without surprises."""

from __future__ import annotations

import math
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontend.recorded import Scan, ScanList
from graphslam.errors import BadLog
from graphslam.geometry import Array

LARGEST = 2**30
"""Bytes that the arrays may take in memory, whatever the file declares."""
REQUIRED = ("t", "ranges", "angle_min", "angle_step")
OPTIONAL = ("range_min", "range_max", "duration", "sensor_pose")


@dataclass(frozen=True, slots=True)
class TableScan:
    """A row of scans.npz.

    Attributes:
        table: all scans of the file.
        row: which one.
    """

    table: ScanTable
    row: int

    @property
    def name(self) -> str:
        """File and row."""
        return f"scans.npz row {self.row}"

    def scan(self) -> Scan | None:
        """Returns the scan."""
        one = {name: float(column[self.row]) for name, column in self.table.about.items()}
        return Scan(np.asarray(self.table.ranges[self.row], float), **one)


@dataclass(frozen=True, slots=True)
class ScanTable:
    """The arrays of the file.

    Attributes:
        ranges: (K, B) m.
        about: (K,) the other fields of `Scan`.
    """

    ranges: NDArray[Any]
    about: dict[str, Array]


def read_scans(path: Path) -> ScanList:
    """Returns ``scans.npz``.

    Arrays: ``t`` (K,) s, ``ranges`` (K, B) m, ``angle_min`` and ``angle_step`` one number or (K,),
    rad; where given ``range_min``, ``range_max`` (m), ``duration`` (s) likewise, and
    ``sensor_pose`` (3,), the laser in the robot frame (m, rad).

    Raises:
        BadLog: the file contradicts the format; the message names the array and the cure.
    """
    arrays = _load(path)
    for name in REQUIRED:
        if name not in arrays:
            raise BadLog(f"{path}: array {name!r} is missing; it holds {', '.join(REQUIRED)}")
    for name in arrays:
        if name not in (*REQUIRED, *OPTIONAL):
            raise BadLog(f"{path}: {name!r} is not a known array; known: {', '.join(OPTIONAL)}")
    t, ranges = arrays["t"], arrays["ranges"]
    if t.ndim != 1 or ranges.ndim != 2 or len(t) != len(ranges) or not len(t):
        raise BadLog(
            f"{path}: t has shape {t.shape} and ranges {ranges.shape}; write (K,) and (K, B) for K "
            "scans of B beams"
        )
    t = t.astype(float)
    if not np.isfinite(t).all() or np.any(np.diff(t) < 0):
        raise BadLog(f"{path}: t runs backwards, or holds NaN; sort the scans by time")
    about = {}
    for name in (*REQUIRED[2:], *OPTIONAL[:3]):
        if name in arrays:
            value = arrays[name].astype(float)
            if value.shape not in ((), (len(t),)) or np.isnan(value).any():
                raise BadLog(f"{path}: {name} must be one number or one for each scan, none NaN")
            about[name] = np.broadcast_to(value, t.shape)
    pose = arrays.get("sensor_pose", np.zeros(3)).astype(float)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise BadLog(f"{path}: sensor_pose must be x, y and heading in the robot frame, m and rad")
    table = ScanTable(ranges, about)
    return ScanList(t, tuple(TableScan(table, row) for row in range(len(t))), pose)


def write_scans(path: Path, scans: ScanList) -> int:
    """Writes scans as ``scans.npz``; returns how many could not be read and were left out.

    Beams that some scans lack are NaN.
    """
    every = ((t, place.scan()) for t, place in zip(scans.t, scans.place, strict=True))
    read = [(t, scan) for t, scan in every if scan is not None]
    beams = max((len(one.ranges) for _, one in read), default=0)
    ranges = np.full((len(read), beams), np.nan, np.float32)
    for row, (_, one) in enumerate(read):
        ranges[row, : len(one.ranges)] = one.ranges
    names = ("angle_min", "angle_step", "range_min", "range_max", "duration")
    about = {name: np.array([getattr(one, name) for _, one in read]) for name in names}
    times = np.array([t for t, _ in read])
    with path.open("wb") as stream:
        np.savez(stream, t=times, ranges=ranges, sensor_pose=scans.sensor_pose, **about)
    return len(scans.t) - len(read)


def _load(path: Path) -> dict[str, NDArray[Any]]:
    """Returns the arrays of an .npz, compressed or not, whose headers are believed only so far."""
    arrays, total = {}, 0
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                name = entry.filename.removesuffix(".npy")
                with archive.open(entry) as stream:
                    version = np.lib.format.read_magic(stream)
                    reader = np.lib.format.read_array_header_1_0
                    if version != (1, 0):
                        reader = np.lib.format.read_array_header_2_0
                    shape, order, dtype = reader(stream)
                    if dtype.hasobject or dtype.kind not in "fiu":
                        raise BadLog(
                            f"{path}: array {name!r} holds no plain numbers ({dtype}); write floats"
                        )
                    size = math.prod(shape) * dtype.itemsize
                    total += size
                    if total > LARGEST or min(shape, default=0) < 0:
                        raise BadLog(
                            f"{path}: array {name!r} of shape {shape} takes the file beyond "
                            f"{LARGEST // 2**20} MiB; split the log, or write ranges as float32"
                        )
                    data = stream.read(size)
                if len(data) != size:
                    raise BadLog(
                        f"{path}: array {name!r} declares shape {shape}, which is more than the "
                        "file holds; write it again"
                    )
                array = np.frombuffer(data, dtype)
                arrays[name] = array.reshape(shape, order="F" if order else "C")
    except (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError) as error:
        raise BadLog(f"{path}: is not an .npz that can be read ({error}); write it again") from None
    except zipfile.BadZipFile as error:
        raise BadLog(f"{path}: is not an .npz that can be read ({error}); write it again") from None
    return arrays
