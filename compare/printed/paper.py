"""The printed results of one paper, read from the file that holds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from typing import Literal

from frontend.strict import from_dict, load_toml, nearest
from graphslam.errors import BadConfig

FILES = {
    "Atali": "atali.toml",
    "SantanaLoc": "santana_loc.toml",
    "SantanaSLAM": "santana_slam.toml",
}
"""File of each paper, by its key."""


@dataclass(frozen=True, slots=True)
class PrintedValue:
    """One number.

    Attributes:
        value: as printed.
        unit: of it.
        place: where in the paper, and how it is to be read where that is not plain.
        quote: the words of the paper that hold it.
    """

    value: float
    unit: str
    place: str
    quote: str


@dataclass(frozen=True, slots=True)
class PrintedTable:
    """One table, or what the text lists.

    Attributes:
        title: a few words.
        place: where in the paper.
        columns: names, ending with the unit where there is one.
        rows: as printed.
    """

    title: str
    place: str
    columns: tuple[str, ...]
    rows: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        if any(len(row) != len(self.columns) for row in self.rows):
            raise BadConfig(f"{self.title}: every row needs {len(self.columns)} cells")

    def column(self, name: str) -> tuple[float, ...]:
        """Returns the cells under a name, from above.

        Raises:
            BadConfig: there is no such column.
        """
        if name not in self.columns:
            raise BadConfig(f"{self.title}: no column {name!r}; {nearest(name, self.columns)}")
        at = self.columns.index(name)
        return tuple(row[at] for row in self.rows)


@dataclass(frozen=True, slots=True)
class PrintedFigure:
    """One figure; its curves are pictures, so only what the text says of them is known.

    Attributes:
        caption: its printed beginning, or a part of it.
        shows: what is drawn.
        values: keys of the values that the text reads from it.
    """

    caption: str
    shows: str
    values: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PrintedPaper:
    """All that a paper prints of its results.

    Attributes:
        format: the version of this format.
        paper: its key.
        title: as printed.
        values: numbers of the text, by key.
        tables: by key.
        figures: by number, "1" and up.
    """

    format: Literal["graphslam-printed/1"]
    paper: str
    title: str
    values: Mapping[str, PrintedValue]
    tables: Mapping[str, PrintedTable]
    figures: Mapping[str, PrintedFigure] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for number, figure in self.figures.items():
            for key in figure.values:
                if key not in self.values:
                    raise BadConfig(f"figure {number}: no value {key!r} is printed")

    def value(self, key: str) -> float:
        """Returns one printed number.

        Raises:
            BadConfig: it is not printed.
        """
        if key not in self.values:
            raise BadConfig(f"{self.paper} prints no {key!r}; {nearest(key, self.values)}")
        return self.values[key].value


def printed_paper(key: str) -> PrintedPaper:
    """Returns what a paper prints of its results, by its key in `FILES`.

    Raises:
        BadConfig: no such paper is typed in.
    """
    if key not in FILES:
        raise BadConfig(f"{key}: the results of this paper are not here; {nearest(key, FILES)}")
    with resources.as_file(resources.files("compare.printed") / FILES[key]) as file:
        return from_dict(PrintedPaper, load_toml(file), str(file.name))
