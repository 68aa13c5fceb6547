"""The way from one place to another, in words: 'follow the corridor past four lamps, turn left'."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import networkx as nx
import numpy as np

from compare.places.building import START, Building, Place
from graphslam.errors import BadConfig
from graphslam.geometry import Array, wrap

STRAIGHT_DEG, ROUND_DEG = 35.0, 145.0
"""Turns below the first are none, beyond the second they are about-turns."""
NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten",
           "eleven", "twelve")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Leg:
    """The way through one place.

    Attributes:
        place: its name.
        kind: its kind.
        length_m: of the way through it.
        lamps: numbers of the lit lamps that one passes, in order.
        dark: numbers of the lamps known to be out of order that one passes, in order.
        turn_deg: turn before it, degrees, left positive; 0 of the first leg.
    """

    place: str
    kind: str
    length_m: float
    lamps: tuple[int, ...]
    dark: tuple[int, ...]
    turn_deg: float


@dataclass(frozen=True, slots=True)
class Route:
    """The shortest way from one place to another.

    Attributes:
        start: name.
        goal: name.
        legs: the places that it leads through, from start to goal.
    """

    start: str
    goal: str
    legs: tuple[Leg, ...]

    @property
    def length_m(self) -> float:
        """Length of the way, m."""
        return sum(leg.length_m for leg in self.legs)

    def steps(self) -> tuple[str, ...]:
        """Returns what to do, one step after the other."""
        if self.start == self.goal:
            return (f"you are there: {self.goal}",)
        steps: list[str] = []
        for number, leg in enumerate(self.legs):
            last = number == len(self.legs) - 1
            steps += _steps(leg, number == 0, last)
        return tuple(steps)

    def __str__(self) -> str:
        return ", ".join(self.steps())


def plan_route(building: Building, start: str, goal: str, at: Array | None = None) -> Route:
    """Returns the shortest way from one place to another.

    Args:
        building: the map of corridors.
        start: name of the place where one is.
        goal: name of the place where one wants to be.
        at: (2,) where in the start one is, m, floor frame; None: in its middle.

    Raises:
        BadConfig: a place is not on the map, or no way leads there.
    """
    first, _ = building.place(start), building.place(goal)
    gates = building.gates()
    if at is not None:
        gates.nodes[(START, start)]["at"] = first.on_line(first.along(at))
        for gate in list(gates[(START, start)]):
            s = [first.along(gates.nodes[node]["at"]) for node in (gate, (START, start))]
            gates.edges[(START, start), gate]["length"] = abs(s[1] - s[0]) + 1e-6
    try:
        nodes = nx.shortest_path(gates, (START, start), (START, goal), weight="length")
    except nx.NetworkXNoPath:
        raise BadConfig(
            f"no way leads from {start!r} to {goal!r} on the map {building.name!r}; add the ways "
            "between their places"
        ) from None
    return Route(start, goal, tuple(_legs(building, gates, nodes)))


def _legs(building: Building, gates: nx.Graph, nodes: list[tuple[str, str]]) -> list[Leg]:
    """Returns the legs along a path of gates, each with the turn before it."""
    legs: list[Leg] = []
    heading: float | None = None
    for one, other in pairwise(nodes):
        place = building.place(gates.edges[one, other]["place"])
        enter, leave = (gates.nodes[node]["at"] for node in (one, other))
        points = _points(place, enter, leave)
        steps = np.diff(points, axis=0)
        steps = steps[np.hypot(*steps.T) > 1e-3]
        turn = 0.0
        if len(steps):
            first, last = (math.atan2(step[1], step[0]) for step in (steps[0], steps[-1]))
            turn = 0.0 if heading is None else math.degrees(wrap(first - heading))
            heading = last
        lamps, dark = _passed(place, enter, leave)
        length = float(np.hypot(*steps.T).sum()) if len(steps) else 0.0
        legs.append(Leg(place.name, place.kind, length, lamps, dark, turn))
    return _turning_at_places(legs)


def _turning_at_places(legs: list[Leg]) -> list[Leg]:
    """Returns legs that turn at corners and junctions, not behind them."""
    for i in range(1, len(legs) - 1):
        if legs[i].kind != "corridor":
            turn = legs[i].turn_deg + legs[i + 1].turn_deg
            legs[i] = replace(legs[i], turn_deg=turn)
            legs[i + 1] = replace(legs[i + 1], turn_deg=0.0)
    return legs


def _points(place: Place, enter: Array, leave: Array) -> Array:
    """Returns the way (V, 2) through a place, m."""
    if place.kind != "corridor":
        return np.array([enter, place.middle_line()[0], leave])
    s = [place.along(enter), place.along(leave)]
    between = [place.on_line(v) for v in (s[0], *place.bends(*s), s[1])]
    return np.array(between)


def _passed(place: Place, enter: Array, leave: Array) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Returns the numbers of the lit and of the dark lamps between two points of a place."""
    s_from, s_to = place.along(enter), place.along(leave)
    low, high = sorted((s_from, s_to))
    passed = []
    for lamp in place.lamps:
        s = place.along(np.array([lamp.x, lamp.y]))
        if place.kind != "corridor" or low <= s <= high:
            passed.append((abs(s - s_from), lamp))
    ordered = [lamp for _, lamp in sorted(passed, key=lambda entry: entry[0])]
    return (
        tuple(lamp.id for lamp in ordered if not lamp.dark),
        tuple(lamp.id for lamp in ordered if lamp.dark),
    )


def _steps(leg: Leg, first: bool, last: bool) -> list[str]:
    """Returns the words for one leg."""
    turn = _turn(leg.turn_deg)
    if last:
        into = f"into the door {leg.place!r}" if leg.kind == "door" else f"to {leg.place!r}"
        if leg.kind == "corridor":
            return [f"{turn} into the corridor {leg.place!r}" if turn else f"go on {into}"]
        return [f"{turn} {into}" if turn else f"go on {into}"]
    if leg.kind != "corridor":
        if first:
            return [f"leave {leg.place!r}"]
        return [f"{turn} at {leg.place!r}" if turn else f"go straight on at {leg.place!r}"]
    follow = f"follow the corridor {leg.place!r}{past(len(leg.lamps), len(leg.dark))}"
    return [turn, follow] if turn else [follow]


def _turn(turn_deg: float) -> str:
    if abs(turn_deg) <= STRAIGHT_DEG:
        return ""
    if abs(turn_deg) >= ROUND_DEG:
        return "turn round"
    return "turn left" if turn_deg > 0 else "turn right"


def past(lit: int, dark: int) -> str:
    """Returns ' past four lamps' for so many lamps, and how many more are out of order."""
    if not lit and not dark:
        return ""
    text = f" past {number_word(lit)} lamp{'' if lit == 1 else 's'}"
    return text + (f" ({number_word(dark)} more out of order)" if dark else "")


def number_word(count: int) -> str:
    """Returns a small number as a word."""
    return NUMBERS[count] if count < len(NUMBERS) else str(count)
