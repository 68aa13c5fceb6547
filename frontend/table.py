"""Strict tables of numbers: CSV with a header, and white-space separated files such as TUM.

Every message names the file, the line and the cure. Cells are converted a block of rows at a time;
only a block that holds an error is looked at cell by cell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from frontend.rows import Blocks, Lines, column_blocks, csv_blocks, header
from frontend.strict import nearest, read_text
from graphslam.errors import BadLog
from graphslam.geometry import Array

TABLE_LIMIT = 512 * 2**20  # bytes: days of wheel readings, yet no surprise for the memory

LARGEST = 1e12
"""Largest magnitude of a number in a table: beyond it lie wrong units (nanoseconds since 1970 for
seconds) and, further out, overflow in the estimators."""


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of a file, and where each row stood.

    Attributes:
        path: the file.
        line: (K,) line number of each row in the file, from 1.
        numbers: (K,) columns of numbers by name; NaN only where a cell may be, and is, empty.
        texts: columns of texts by name.
    """

    path: Path
    line: Lines
    numbers: Mapping[str, Array]
    texts: Mapping[str, tuple[str, ...]]

    def __len__(self) -> int:
        return len(self.line)

    def __contains__(self, column: str) -> bool:
        return column in self.numbers or column in self.texts

    def stack(self, *columns: str) -> Array:
        """Returns columns side by side, (K, number of columns)."""
        return np.column_stack([self.numbers[name] for name in columns])

    def check(self, bad: NDArray[np.bool_], message: str) -> None:
        """Raises BadLog at the first row that ``bad`` (K,) marks.

        Args:
            bad: mask of the rows.
            message: what is wrong and how to mend it; ``{column}`` stands for the row's value.
        """
        if bad.any():
            row = int(np.argmax(bad))
            values = {name: f"{column[row]:.12g}" for name, column in self.numbers.items()}
            raise self.error(row, message.format_map({**values, **self._texts_at(row)}))

    def error(self, row: int, message: str) -> BadLog:
        """Returns an error that names the file and the line of a row."""
        return BadLog(f"{self.path}:{self.line[row]}: {message}")

    def check_times(self, repeats: bool = False) -> None:
        """Raises BadLog unless the column ``t`` increases; where ``repeats``, does not decrease."""
        step = np.diff(self.numbers["t"], prepend=-np.inf)
        self.check(step < 0, "t = {t} runs backwards; sort the rows by time, or correct the clock")
        if not repeats:
            self.check(step == 0, "t = {t} repeats the time above; keep one row of each time")

    def _texts_at(self, row: int) -> dict[str, str]:
        return {name: column[row] for name, column in self.texts.items()}


def read_table(
    path: Path,
    required: Sequence[str],
    optional: Sequence[str | tuple[str, ...]] = (),
    *,
    text: Sequence[str] = (),
    whole: Sequence[str] = (),
    blank: Sequence[str] = (),
    least: int = 0,
) -> Table:
    """Returns a CSV file's columns; the order of columns in the file is free.

    Args:
        path: the file: UTF-8, comma separated, names of the columns in the first line.
        required: columns that must be there.
        optional: columns that may be there; those in a tuple come together or not at all.
        text: columns that hold texts; all others hold finite numbers.
        whole: columns that hold whole numbers.
        blank: columns whose cells may be empty.
        least: fewest rows.

    Raises:
        BadLog: anything is otherwise; the message names file, line and cure.
    """
    content = read_text(path, BadLog, TABLE_LIMIT)
    names = header(path, content)
    _check_header(path, names, required, optional)
    blocks = csv_blocks(path, content, names)
    table = _convert(path, names, blocks, set(text), set(blank))
    _check_length(table, least)
    for name in whole:
        if name in table:
            column = table.numbers[name]
            message = f"{name} = {{{name}}} is not a whole number; write one"
            table.check(np.isfinite(column) & (column != np.round(column)), message)
    return table


def read_columns(path: Path, names: Sequence[str], least: int = 0) -> Table:
    """Returns the columns of a white-space separated file without header; ``#`` starts a comment.

    Args:
        path: the file, UTF-8.
        names: what its columns mean, in order; every row has all of them.
        least: fewest rows.

    Raises:
        BadLog: anything is otherwise; the message names file, line and cure.
    """
    content = read_text(path, BadLog, TABLE_LIMIT)
    table = _convert(path, names, column_blocks(path, content, names), set(), set())
    _check_length(table, least)
    return table


def _check_header(
    path: Path, names: list[str], required: Sequence[str], optional: Sequence[str | tuple[str, ...]]
) -> None:
    groups = [(entry,) if isinstance(entry, str) else entry for entry in optional]
    known = [*required, *(name for group in groups for name in group)]
    cure = f"the first line must name the columns: {','.join(required)}"
    if not set(names) & set(known):
        found = "names no known column" if any(names) else "is empty"
        raise BadLog(f"{path}:1: {found}; {cure}")
    for name in names:
        if name not in known:
            shown = name if len(name) <= 40 else name[:37] + "..."
            raise BadLog(f"{path}:1: {shown!r} is not a known column; {nearest(shown, known)}")
        if names.count(name) > 1:
            raise BadLog(f"{path}:1: column {name!r} is there twice; remove one")
    for name in required:
        if name not in names:
            raise BadLog(f"{path}:1: column {name!r} is missing; {cure}")
    for group in groups:
        missing = [name for name in group if name not in names]
        if missing and len(missing) < len(group):
            raise BadLog(
                f"{path}:1: column {missing[0]!r} is missing; "
                f"{', '.join(group)} come together or not at all"
            )


def _check_length(table: Table, least: int) -> None:
    if len(table) < least:
        raise BadLog(
            f"{table.path}: has {len(table)} rows of data and needs at least {least}; "
            "record more, or remove the file"
        )


def _convert(
    path: Path, names: Sequence[str], blocks: Blocks, text: set[str], blank: set[str]
) -> Table:
    line: list[Lines] = []
    numbers: dict[str, list[Array]] = {name: [] for name in names if name not in text}
    texts: dict[str, list[str]] = {name: [] for name in names if name in text}
    for lines, rows in blocks:
        line.append(lines)
        for name, column in zip(names, zip(*rows, strict=True), strict=bool(rows)):
            if name in texts:
                texts[name] += [cell.strip() for cell in column]
                continue
            values = _numbers(column, name in blank)
            if values is None:
                raise _bad_cell(path, name, lines, column, name in blank)
            numbers[name].append(values)
    empty = np.zeros(0)
    return Table(
        path,
        np.concatenate([np.zeros(0, np.int64), *line]),
        MappingProxyType({k: np.concatenate([empty, *v]) for k, v in numbers.items()}),
        MappingProxyType({k: tuple(v) for k, v in texts.items()}),
    )


def _numbers(cells: Sequence[str], may_be_blank: bool) -> Array | None:
    """Returns the cells as numbers, NaN where blank; None where a cell is not a usable number."""
    joined = "".join(cells)
    if "_" in joined or not joined.isascii():  # Python takes 1_000 and other scripts' digits
        return None
    try:
        if not may_be_blank:
            values = np.array(list(map(float, cells)))
            return values if np.all(np.abs(values) <= LARGEST) else None
        filled = np.array([not c.isspace() and c != "" for c in cells])
        values = np.array([float(c) if f else np.nan for c, f in zip(cells, filled, strict=True)])
        return values if np.all(np.abs(values[filled]) <= LARGEST) else None
    except ValueError:
        return None


def _bad_cell(
    path: Path, name: str, lines: Lines, cells: Sequence[str], may_be_blank: bool
) -> BadLog:
    """Returns the error of the first cell that is not a usable number."""
    row = next(i for i, cell in enumerate(cells) if _numbers((cell,), may_be_blank) is None)
    cell = cells[row].strip()
    place, shown = f"{path}:{lines[row]}", repr(cell if len(cell) <= 40 else cell[:37] + "...")
    try:
        value = float(cell) if cell.isascii() and "_" not in cell else None
    except ValueError:
        value = None
    if not cell:
        return BadLog(f"{place}: {name} is empty; write a number, or remove the row")
    if value is None:
        return BadLog(f"{place}: {name} = {shown} is not a number; write it like -0.25 or 1e-3")
    if np.isfinite(value) and abs(value) > LARGEST:
        return BadLog(
            f"{place}: {name} = {shown} is beyond {LARGEST:g}; use seconds, metres and radians"
        )
    return BadLog(f"{place}: {name} = {shown} is not finite; write a number, or remove the row")
