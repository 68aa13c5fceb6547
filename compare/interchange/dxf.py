"""A floor plan as DXF of release 12, which every CAD program reads: 1 drawing unit = 1 m."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from graphslam.geometry import Array
from graphslam.plan import Layer, plan_box

COLOURS = (5, 1, 3, 6, 4, 2)
"""AutoCAD's numbers of the layers' colours, in turn: blue, red, green, magenta, cyan, yellow."""
LABEL_HEIGHT = 0.015
"""Of the longer side of the plan."""

Pairs = Iterator[tuple[int, object]]


def dxf_text(layers: Sequence[Layer]) -> str:
    """Returns a DXF drawing: segments as LINE, longer polylines as POLYLINE, labels as TEXT.

    Release 12 has no field for the unit; a comment at the head says that it is the metre.
    """
    low, high = plan_box([points for layer in layers for points in layer.polylines])
    names = [layer_name(layer.name) for layer in layers]
    pairs = [
        *_header(low, high),
        *_tables(names),
        (0, "SECTION"),
        (2, "ENTITIES"),
        *(
            pair
            for layer, name in zip(layers, names, strict=True)
            for pair in _entities(layer, name, LABEL_HEIGHT * float((high - low).max()))
        ),
        (0, "ENDSEC"),
        (0, "EOF"),
    ]
    return "".join(f"{code:>3}\n{value}\n" for code, value in pairs)


def layer_name(name: str) -> str:
    """Returns a name that release 12 allows: capitals, digits, $ - _, at most 31 of them."""
    return re.sub(r"[^A-Z0-9$_-]+", "_", name.upper()).strip("_")[:31] or "0"


def _header(low: Array, high: Array) -> Pairs:
    yield from [(999, "graphslam floor plan; 1 drawing unit = 1 metre")]
    yield from [(0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009")]
    for name, corner in (("$EXTMIN", low), ("$EXTMAX", high)):
        yield from [(9, name), *_point(corner)]
    yield 0, "ENDSEC"


def _tables(names: Sequence[str]) -> Pairs:
    yield from [(0, "SECTION"), (2, "TABLES")]
    yield from [(0, "TABLE"), (2, "LTYPE"), (70, 1), (0, "LTYPE"), (2, "CONTINUOUS"), (70, 0)]
    yield from [(3, "Solid line"), (72, 65), (73, 0), (40, 0.0), (0, "ENDTAB")]
    yield from [(0, "TABLE"), (2, "LAYER"), (70, len(names))]
    for i, name in enumerate(names):
        colour = COLOURS[i % len(COLOURS)]
        yield from [(0, "LAYER"), (2, name), (70, 0), (62, colour), (6, "CONTINUOUS")]
    yield from [(0, "ENDTAB"), (0, "ENDSEC")]


def _entities(layer: Layer, name: str, label_height: float) -> Pairs:
    for points, label in zip(layer.polylines, layer.labels, strict=True):
        if len(points) == 2:
            yield from [(0, "LINE"), (8, name), *_point(points[0]), *_point(points[1], 11)]
        else:
            yield from [(0, "POLYLINE"), (8, name), (66, 1), *_point(np.zeros(2)), (70, 0)]
            for point in points:
                yield from [(0, "VERTEX"), (8, name), *_point(point)]
            yield from [(0, "SEQEND"), (8, name)]
        if label:
            yield from [(0, "TEXT"), (8, name), *_point(points.mean(axis=0))]
            yield from [(40, _number(label_height)), (1, label)]


def _point(point: Array, code: int = 10) -> Pairs:
    for offset, value in zip((0, 10, 20), (*point.tolist(), 0.0), strict=True):
        yield code + offset, _number(value)


def _number(value: float) -> str:
    return f"{value:.6f}"
