"""Rows of cells from text files, a block at a time, with the line numbers that they stood on."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graphslam.errors import BadLog

BLOCK = 10_000  # rows at a time

Lines = NDArray[np.int64]
Blocks = Iterator[tuple[Lines, list[list[str]]]]
"""Line numbers (K,), from 1, and the cells of as many rows."""


def header(path: Path, content: str) -> list[str]:
    """Returns the names in the first line of a CSV file, [] where it is empty."""
    first = io.StringIO(content, newline="").readline()
    try:
        return [name.strip() for name in next(csv.reader([first]), [])]
    except csv.Error as reason:
        raise BadLog(f"{path}:1: is not CSV ({reason}); name the columns, by commas") from None


def csv_blocks(path: Path, content: str, names: Sequence[str]) -> Blocks:
    """Yields the rows below the header; empty lines are accepted at the end only.

    Raises:
        BadLog: a row has too few or too many cells, or the file is not CSV.
    """
    reader = csv.reader(io.StringIO(content, newline=""), strict=True)
    first, empty = 2, 0
    try:
        next(reader)
        while rows := list(islice(reader, BLOCK)):
            lines = np.arange(first, first + len(rows))
            if reader.line_num != lines[-1]:
                raise BadLog(
                    f"{path}:{_broken_line(content)}: a quoted text goes on in the next line; "
                    "close its quotes"
                )
            first += len(rows)
            if set(map(len, rows)) != {len(names)} or empty:
                rows, empty = _without_end(path, rows, lines, empty)
                lines = lines[: len(rows)]
                _check_width(path, rows, lines, names)
            yield lines, rows
    except csv.Error as reason:
        raise BadLog(
            f"{path}:{_broken_line(content)}: is not CSV ({reason}); separate cells by commas and "
            "close every quote"
        ) from None


def _broken_line(content: str) -> int:
    """Returns the line of the first row that is not CSV, or does not end where its line ends."""
    reader = csv.reader(io.StringIO(content, newline=""), strict=True)
    line = 0
    try:
        for line, _ in enumerate(reader, start=1):
            if reader.line_num != line:
                return line
    except csv.Error:
        return line + 1
    return line


def _without_end(
    path: Path, rows: list[list[str]], lines: Lines, empty: int
) -> tuple[list[list[str]], int]:
    """Returns the rows without empty ones at the end, and the first empty line so far, or 0."""
    kept: list[list[str]] = []
    for line, cells in zip(lines, rows, strict=True):
        if not "".join(cells).strip() and len(cells) <= 1:
            empty = empty or int(line)
        elif empty:
            raise BadLog(f"{path}:{empty}: is empty; remove the empty line")
        else:
            kept.append(cells)
    return kept, empty


def column_blocks(path: Path, content: str, names: Sequence[str]) -> Blocks:
    """Yields the rows of a white-space separated file; empty lines and ``#`` comments are skipped.

    Raises:
        BadLog: a row has too few or too many cells.
    """
    source = enumerate(io.StringIO(content), start=1)
    while block := list(islice(source, BLOCK)):
        numbered = [(line, text.split()) for line, text in block]
        numbered = [(line, cells) for line, cells in numbered if cells and cells[0][0] != "#"]
        lines = np.array([line for line, _ in numbered], np.int64)
        rows = [cells for _, cells in numbered]
        _check_width(path, rows, lines, names)
        yield lines, rows


def _check_width(path: Path, rows: list[list[str]], lines: Lines, names: Sequence[str]) -> None:
    for line, cells in zip(lines, rows, strict=True):
        if len(cells) != len(names):
            raise BadLog(
                f"{path}:{line}: has {len(cells)} cells where {len(names)} are expected "
                f"({','.join(names)}); write one for each"
            )
