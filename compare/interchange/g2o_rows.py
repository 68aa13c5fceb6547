"""The rows of a g2o file, checked one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from compare.interchange.g2o_format import (
    EDGE_LINE,
    EDGE_POSE,
    EDGE_PRIOR,
    FIX,
    NOTE,
    NOTE_SEEN,
    NOTE_TIME,
    VERTEX_LINE,
    VERTEX_POSE,
)
from frontend.strict import read_text
from frontend.table import TABLE_LIMIT
from graphslam.errors import BadLog
from graphslam.geometry import Array
from graphslam.measurements import IntArray

SHAPES = {
    VERTEX_POSE: (1, 3, 0),
    VERTEX_LINE: (1, 2, 0),
    EDGE_PRIOR: (1, 3, 3),
    EDGE_POSE: (2, 3, 3),
    EDGE_LINE: (2, 2, 2),
}
"""Of each element: numbers of vertices, length of its value, size of its information."""
NOTES = {NOTE_TIME: 1, NOTE_SEEN: 2}
"""Of each note of ours: how many numbers it has."""


@dataclass(slots=True)
class Elements:
    """All elements of one sort, in the order of the file.

    Attributes:
        line: (K,) line of each in the file, from 1.
        ids: (K, 1 or 2) vertices.
        value: (K, d) its numbers, in the file's order.
        information: (K, d, d), in the file's order; (K, 0, 0) for vertices.
        note: what notes of ours say about each: name to numbers.
    """

    line: IntArray
    ids: IntArray
    value: Array
    information: Array
    note: Sequence[dict[str, list[float]]]

    def __len__(self) -> int:
        return len(self.line)

    def stretch(self) -> Array:
        """Returns (K, 2) the stretches that notes give, NaN where there is none."""
        none = [np.nan, np.nan]
        rows = [note.get(NOTE_SEEN, none) for note in self.note]
        return np.array(rows, float).reshape(-1, 2)


@dataclass(slots=True)
class _Collected:
    lines: list[int] = field(default_factory=list)
    ids: list[list[int]] = field(default_factory=list)
    numbers: list[list[float]] = field(default_factory=list)
    notes: list[dict[str, list[float]]] = field(default_factory=list)


def read_rows(path: Path) -> tuple[dict[str, Elements], dict[int, int]]:
    """Returns the elements of a g2o file by tag, and the fixed vertices with the lines that say so.

    Tags of edges that are no edges between poses and lines are errors, because a graph without
    them has another optimum; other unknown tags are passed over.

    Raises:
        BadLog: a row cannot be used; the message names file, line and cure.
    """
    found = {tag: _Collected() for tag in SHAPES}
    fixed: dict[int, int] = {}
    note: dict[str, list[float]] = {}
    for number, text in enumerate(read_text(path, BadLog, TABLE_LIMIT).splitlines(), start=1):
        cells = text.split()
        place = f"{path}:{number}"
        if not cells or (cells[0].startswith("#") and cells[0] != NOTE):
            continue
        if cells[0] == NOTE:
            name, *values = cells[1:] or [""]
            if NOTES.get(name) == len(values):
                note[name] = _numbers(place, values)
            continue
        if cells[0] == FIX:
            fixed |= dict.fromkeys(_ids(place, cells[1:]), number)
        elif cells[0] in SHAPES:
            _take(place, cells, found[cells[0]], number, note)
        elif cells[0].startswith("EDGE"):
            raise BadLog(
                f"{place}: {cells[0]} is not read here, and without it the graph has another "
                f"optimum; remove it, or keep to {', '.join(t for t in SHAPES if 'EDGE' in t)}"
            )
        note = {}
    return {tag: _elements(path, tag, rows) for tag, rows in found.items()}, fixed


def _take(
    place: str, cells: list[str], rows: _Collected, number: int, note: dict[str, list[float]]
) -> None:
    tag = cells[0]
    vertices, length, size = SHAPES[tag]
    wanted = length + size * (size + 1) // 2
    values = cells[1 + vertices :]
    if tag == VERTEX_LINE:
        values = values[:wanted]  # what follows names its end points, which are for drawing only
    if len(values) != wanted:
        triangle = f", then the {wanted - length} of the information's upper triangle"
        raise BadLog(
            f"{place}: {tag} has {len(values)} numbers after its {vertices} vertices, {wanted} are "
            f"expected; write {length}{triangle if size else ''}"
        )
    rows.lines.append(number)
    rows.ids.append(_ids(place, cells[1 : 1 + vertices]))
    rows.numbers.append(_numbers(place, values))
    rows.notes.append(note)


def _ids(place: str, cells: Sequence[str]) -> list[int]:
    try:
        return [int(cell) for cell in cells]
    except ValueError:
        raise BadLog(f"{place}: {' '.join(cells)!r} are no vertices; write whole numbers") from None


def _numbers(place: str, cells: Sequence[str]) -> list[float]:
    for cell in cells:
        try:
            usable = bool(np.isfinite(float(cell)))
        except ValueError:
            usable = False
        if not usable:
            raise BadLog(f"{place}: {cell!r} is not a finite number; write it like -0.25 or 1e-3")
    return [float(cell) for cell in cells]


def _elements(path: Path, tag: str, rows: _Collected) -> Elements:
    vertices, length, size = SHAPES[tag]
    line = np.array(rows.lines, np.int64)
    numbers = np.array(rows.numbers, float).reshape(-1, length + size * (size + 1) // 2)
    information = np.zeros((len(line), size, size))
    upper = np.triu_indices(size)
    information[:, upper[0], upper[1]] = information[:, upper[1], upper[0]] = numbers[:, length:]
    if size and len(line):
        scale = np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), 1e-100))
        least = np.linalg.eigvalsh(information / scale[:, :, None] / scale[:, None, :])[:, 0]
        if least.min() < 1e-12:
            raise BadLog(
                f"{path}:{line[np.argmin(least)]}: the information of this {tag} is not positive "
                "definite; give every direction some, small where nothing is known"
            )
    ids = np.array(rows.ids, np.int64).reshape(-1, vertices)
    return Elements(line, ids, numbers[:, :length], information, rows.notes)
