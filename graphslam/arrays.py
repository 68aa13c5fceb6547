"""Checks and storage of the arrays that cross module boundaries."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from graphslam.errors import BadMeasurements
from graphslam.geometry import Array

AnyArray = NDArray[Any]


def frozen(
    name: str,
    value: Any,
    shape: tuple[int | None, ...],
    dtype: type = float,
    allow_nan: bool = False,
) -> AnyArray:
    """Returns a read-only, contiguous copy of ``value`` after checking its shape and finiteness.

    Args:
        name: what to call it in an error.
        value: anything NumPy turns into an array.
        shape: expected shape; None accepts any length.
        dtype: expected type.
        allow_nan: whether NaN may stand for 'unknown'.

    Raises:
        BadMeasurements: the shape is another, or a value is not finite.
    """
    array: AnyArray = np.array(value, dtype=dtype, order="C")
    fits = array.ndim == len(shape) and all(
        want is None or want == got for want, got in zip(shape, array.shape, strict=True)
    )
    if not fits:
        want = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise BadMeasurements(f"{name} has shape {array.shape}; expected {want}")
    if dtype is float:
        bad = np.isinf(array) if allow_nan else ~np.isfinite(array)
        if bad.any():
            where = tuple(int(i) for i in np.argwhere(bad)[0])
            raise BadMeasurements(f"{name}{list(where)} = {array[where]}: must be finite")
    array.flags.writeable = False
    return array


def check_covariances(name: str, cov: Array) -> None:
    """Raises BadMeasurements unless all ``cov`` (..., d, d) are symmetric, positive definite."""
    if not cov.size:
        return
    largest = np.abs(cov).max(axis=(-1, -2), keepdims=True)
    if np.any(np.abs(cov - np.swapaxes(cov, -1, -2)) > 1e-9 * largest):
        raise BadMeasurements(f"{name} is not symmetric")
    try:
        np.linalg.cholesky(cov)
    except np.linalg.LinAlgError:
        smallest = np.linalg.eigvalsh(cov)[..., 0]
        row = int(np.argmin(smallest))
        raise BadMeasurements(
            f"{name}[{row}] is not positive definite (smallest eigenvalue {smallest.min():.3g}); "
            "give every direction some noise"
        ) from None


def save_arrays(path: Path | str, arrays: Mapping[str, AnyArray]) -> None:
    """Writes arrays to an uncompressed .npz without pickle; equal input gives equal bytes."""
    path = Path(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy")  # its date is constant: 1980
            with archive.open(entry, "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, np.asanyarray(array), allow_pickle=False)


def load_arrays(path: Path | str) -> dict[str, AnyArray]:
    """Returns the arrays of an uncompressed .npz, refusing pickles and sizes the file cannot hold.

    Raises:
        BadMeasurements: the file is not such an archive, or a header claims more than is there.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as archive:
            return {
                entry.filename.removesuffix(".npy"): _load_entry(archive, entry, path)
                for entry in archive.infolist()
            }
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise BadMeasurements(
            f"{path}: cannot be read ({error}); it must be an .npz written by this project"
        ) from error


def _load_entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, path: Path) -> AnyArray:
    if entry.compress_type != zipfile.ZIP_STORED or entry.file_size > path.stat().st_size:
        raise BadMeasurements(
            f"{path}: entry {entry.filename} is compressed or larger than its file"
        )
    with archive.open(entry) as stream:
        shape, dtype = _header(stream)
        if dtype.hasobject:
            raise BadMeasurements(f"{path}: entry {entry.filename} holds Python objects; refused")
        if math.prod(shape) * dtype.itemsize > entry.file_size:
            raise BadMeasurements(
                f"{path}: entry {entry.filename} claims shape {shape}; file is short"
            )
    with archive.open(entry) as stream:
        return np.lib.format.read_array(stream, allow_pickle=False)


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    else:
        shape, _, dtype = np.lib.format.read_array_header_2_0(stream)
    return shape, dtype
