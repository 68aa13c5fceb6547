"""The map of corridors: places with lamps, and which of them adjoin. Read strictly from TOML."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import networkx as nx
import numpy as np

from frontend.strict import from_dict, load_toml, nearest
from graphslam.errors import BadConfig
from graphslam.geometry import Array, wrap
from graphslam.measurements import LandmarkMap

FORMAT = "graphslam-places/1"
Kind = Literal["corridor", "corner", "junction", "end-corridor", "door"]
Point = tuple[float, float]

START, GOAL = "start", "goal"


@dataclass(frozen=True, slots=True)
class Tag:
    """A lamp on the ceiling of a place.

    Attributes:
        id: number of the lamp, once on the whole map; the landmark's number in results.
        x: m, floor frame.
        y: m.
        phi_deg: direction of its long axis, degrees.
        dark: whether it is known to be out of order.
    """

    id: int
    x: float
    y: float
    phi_deg: float = 0.0
    dark: bool = False

    def __post_init__(self) -> None:
        if self.id < 0:
            raise BadConfig(f"id = {self.id}: number the lamps from 0")


@dataclass(frozen=True, slots=True)
class Place:
    """One place: a corridor, which has a course, or one of the others, which have a middle.

    Attributes:
        name: what people call it.
        kind: "corridor", "corner", "junction", "end-corridor" or "door".
        course: of a corridor: the corners of its middle line, m, floor frame, two or more.
        at: of the others: the middle, m, floor frame.
        width: of a corridor, m, default 2; of the others the diameter.
        lamps: the lamps on its ceiling.
    """

    name: str
    kind: Kind
    course: tuple[Point, ...] = ()
    at: Point | None = None
    width: float = 2.0
    lamps: tuple[Tag, ...] = ()

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise BadConfig("name is empty; give the place the name that people use")
        if not (math.isfinite(self.width) and self.width > 0):
            raise BadConfig(f"width = {self.width}: must be positive, in metres")
        if (self.kind == "corridor") != (len(self.course) >= 2):
            raise BadConfig(
                f"{self.name!r} is a {self.kind}: a corridor has a course of two points or more, "
                "the other kinds have none"
            )
        if (self.kind == "corridor") == (self.at is not None):
            raise BadConfig(
                f"{self.name!r} is a {self.kind}: a corridor has a course, the other kinds have "
                "`at = [x, y]`"
            )

    def middle_line(self) -> Array:
        """Returns the course (V, 2) of a corridor, or the middle (1, 2) of another place, m."""
        return np.array(self.course if self.at is None else [self.at], float)

    def distance(self, points: Array) -> Array:
        """Returns how far points (..., 2), floor frame, are from the middle line, m."""
        return np.asarray(_to_line(self.middle_line(), np.asarray(points, float))[0])

    def holds(self, points: Array) -> Array:
        """Returns how far (...) inside the place points (..., 2) are, m; negative outside."""
        return 0.5 * self.width - self.distance(points)

    def along(self, point: Array) -> float:
        """Returns the position of a point (2,) along a corridor's course, m; 0 elsewhere."""
        return float(_to_line(self.middle_line(), np.asarray(point, float))[1])

    def on_line(self, s: float) -> Array:
        """Returns the point (2,) of the middle line at position s, m."""
        line = self.middle_line()
        if len(line) == 1:
            return line[0]
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        return np.array([np.interp(s, length, column) for column in line.T])

    def bends(self, s_from: float, s_to: float) -> list[float]:
        """Returns the positions of the course's corners between two positions, in that order, m."""
        line = self.middle_line()
        length = np.cumsum(np.hypot(*np.diff(line, axis=0).T))[:-1] if len(line) > 2 else []
        low, high = sorted((s_from, s_to))
        inside = [float(s) for s in length if low < s < high]
        return inside if s_to >= s_from else inside[::-1]


@dataclass(frozen=True, slots=True)
class Building:
    """The map of corridors of one floor of a building.

    Attributes:
        format: the version of this format.
        name: of the floor.
        places: the places.
        ways: pairs of names of places that adjoin.
    """

    format: Literal["graphslam-places/1"]
    name: str
    places: tuple[Place, ...]
    ways: tuple[tuple[str, str], ...]

    def __post_init__(self) -> None:
        names = [place.name for place in self.places]
        for name in names:
            if names.count(name) > 1:
                raise BadConfig(f"the place {name!r} is there twice; give each its own name")
        ids = [lamp.id for place in self.places for lamp in place.lamps]
        for number in ids:
            if ids.count(number) > 1:
                raise BadConfig(f"lamp {number} is there twice; give each lamp a number of its own")
        for way in self.ways:
            for name in way:
                if name not in names:
                    raise BadConfig(f"ways: there is no place {name!r}; {nearest(name, names)}")
        if not self.places:
            raise BadConfig("there are no places: list them as [[places]]")

    def place(self, name: str) -> Place:
        """Returns the place of a name.

        Raises:
            BadConfig: there is none; the message names the nearest.
        """
        for place in self.places:
            if place.name == name:
                return place
        cure = nearest(name, [place.name for place in self.places])
        raise BadConfig(f"there is no place {name!r} on the map {self.name!r}; {cure}")

    def lamps(self) -> tuple[Tag, ...]:
        """Returns the lamps of all places, by number."""
        tags = (lamp for place in self.places for lamp in place.lamps)
        return tuple(sorted(tags, key=lambda lamp: lamp.id))

    def landmarks(self) -> LandmarkMap:
        """Returns the lamps as known landmarks, those out of order too."""
        lamps = self.lamps()
        rows = [(lamp.x, lamp.y, wrap(math.radians(lamp.phi_deg))) for lamp in lamps]
        return LandmarkMap(
            id=np.array([lamp.id for lamp in lamps], np.int64),
            kind=("lamp",) * len(lamps),
            params=np.array(rows, float).reshape(-1, 3),
            extent=np.full((len(lamps), 2), np.nan),
            sightings=np.zeros(len(lamps), np.int64),
        )

    def place_of(self, lamp: int) -> str:
        """Returns the name of the place with a lamp; empty where none has it."""
        return next((p.name for p in self.places for tag in p.lamps if tag.id == lamp), "")

    def graph(self) -> nx.Graph:
        """Returns the topological map: names as nodes, each with its `Place`, ways as edges."""
        graph = nx.Graph()
        for place in self.places:
            graph.add_node(place.name, place=place)
        graph.add_edges_from(self.ways)
        return graph

    def gates(self) -> nx.Graph:
        """Returns the metric map behind it: gates between places as nodes, ways through as edges.

        A node is ``(name, name)`` with its point ``at``, (2,) m; an edge has the ``place`` that it
        leads through and its ``length``, m. Places themselves are nodes ``(START, name)``.
        """
        graph = nx.Graph()
        gates: dict[str, list[tuple[str, str]]] = {place.name: [] for place in self.places}
        for a, b in self.ways:
            at = _gate(self.place(a), self.place(b))
            graph.add_node((a, b), at=at)
            gates[a].append((a, b))
            gates[b].append((a, b))
        for place in self.places:
            ends = gates[place.name]
            middle = place.on_line(0.5 * _length(place.middle_line()))
            graph.add_node((START, place.name), at=middle)
            for i, one in enumerate(ends):
                for other in [*ends[:i], (START, place.name)]:
                    s = [place.along(graph.nodes[node]["at"]) for node in (one, other)]
                    graph.add_edge(one, other, place=place.name, length=abs(s[1] - s[0]) + 1e-6)
        return graph


def read_building(path: Path | str) -> Building:
    """Returns a map of corridors.

    Raises:
        BadConfig: the file cannot be read, or says something it must not.
    """
    path = Path(path)
    return from_dict(Building, load_toml(path), str(path))


def _gate(a: Place, b: Place) -> Array:
    """Returns the point (2,) where one goes from a place to another: on a corridor's middle line.

    Of two corridors, the point of the first nearest to the second.
    """
    if a.kind != "corridor":
        a, b = b, a
    line = a.middle_line()
    if a.kind != "corridor":
        return np.asarray(0.5 * (line[0] + b.middle_line()[0]))
    if b.kind != "corridor":
        return a.on_line(a.along(b.middle_line()[0]))
    s = np.linspace(0.0, _length(line), 2001)
    points = np.array([a.on_line(float(v)) for v in s])
    return np.asarray(points[np.argmin(b.distance(points))])


def _length(line: Array) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum()) if len(line) > 1 else 0.0


def _to_line(line: Array, points: Array) -> tuple[Array, Array]:
    """Returns the distances (...) of points (..., 2) from a polyline (V, 2), and where along it."""
    if len(line) == 1:
        away = points - line[0]
        return np.hypot(away[..., 0], away[..., 1]), np.zeros(points.shape[:-1])
    start, step = line[:-1], np.diff(line, axis=0)
    length = np.hypot(*step.T)
    offset = points[..., None, :] - start
    part = np.clip(np.sum(offset * step, axis=-1) / length**2, 0.0, 1.0)
    away = offset - part[..., None] * step
    distance = np.hypot(away[..., 0], away[..., 1])
    nearest_one = distance.argmin(axis=-1)[..., None]
    before = np.concatenate([[0.0], np.cumsum(length)[:-1]])
    along = before + part * length
    take = lambda values: np.take_along_axis(values, nearest_one, axis=-1)[..., 0]  # noqa: E731
    return take(distance), take(along)
