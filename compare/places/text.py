"""What `graphslam places` prints."""

from __future__ import annotations

import math

from rich.console import Console
from rich.table import Table
from rich.text import Text

from compare.places.building import Building
from compare.places.route import plan_route
from compare.places.start import Answer


def print_building(building: Building) -> None:
    """Prints the places, what they adjoin, and their lamps."""
    graph = building.graph()
    table = Table(title=Text(building.name), title_justify="left", title_style="bold")
    for heading in ("place", "kind", "leads to"):
        table.add_column(heading)
    table.add_column("lamps", justify="right")
    table.add_column("out of order", justify="right")
    for place in building.places:
        dark = sum(lamp.dark for lamp in place.lamps)
        beside = ", ".join(graph.neighbors(place.name))
        cells = [place.name, place.kind, beside, str(len(place.lamps)), str(dark or "–")]
        table.add_row(*map(Text, cells))
    Console(highlight=False).print(table)


def print_route(building: Building, start: str, goal: str) -> None:
    """Prints the way from one place to another in words, and its length."""
    route = plan_route(building, start, goal)
    print(f"{route}  ({route.length_m:.1f} m)")


def print_answer(answer: Answer) -> None:
    """Prints where a robot started, or where it may have."""
    print(answer)
    if answer.decided and not (answer.starts[0].missing or answer.starts[0].extra):
        return
    table = Table()
    for heading in ("place", "x (m)", "y (m)", "heading (°)", "probability", "lamps seen"):
        table.add_column(heading, justify="left" if heading == "place" else "right")
    table.add_column("missing", justify="right")
    table.add_column("not on the map", justify="right")
    for start in answer.starts:
        x, y, theta = start.pose
        table.add_row(
            Text(start.place),
            f"{x:.2f}",
            f"{y:.2f}",
            f"{math.degrees(theta):.0f}",
            f"{start.probability:.3f}",
            " ".join(map(str, start.lamps)),
            " ".join(map(str, start.missing)) or "–",
            str(start.extra or "–"),
        )
    Console(highlight=False).print(table)
