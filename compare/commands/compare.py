"""`graphslam compare`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE, USAGE, ResultFolder
from graphslam.line_maps.config import AlignmentConfig

if TYPE_CHECKING:
    from compare.two_maps import MapPair

Near = Annotated[tuple[float, float, float] | None, arg(metavar="X Y DEG", help_behavior_hint="")]

PRINTED = {
    0: "other’s",
    4: "common (m)",
    5: "offset ± σ (mm)",
    6: "in σ",
    7: "Δα ± σ (°)",
    8: "in σ",
}
"""Columns of the table of lines that fit on a terminal."""


@dataclass(frozen=True, slots=True)
class Compare:
    """Hold maps and paths against the first of them: results, map files or truth, in any mix.

    A run's folder stands for its smoother; DIR/ekf for its filter; a log folder for its truth;
    estimate.npz, map.csv, *.g2o and *.tum for themselves. Lines are matched after a rigid alignment
    that needs no start value.

    Example: graphslam compare results/monday results/friday
    """

    maps: Annotated[
        tuple[Path, ...],
        tyro.conf.Positional,
        arg(metavar="A B ...", help_behavior_hint="(required)"),
    ]
    """What to compare: all others with A, in A's frame."""
    out: ResultFolder = None
    """Folder for report.html, comparison.json, lines.csv and plots; by default
    results/compare-<A>-<B>."""
    near: Near = None
    """Where the others' frame lies in A's, about: metres, metres and degrees. For floors that fit
    in several positions; by default all positions are searched."""
    alignment: AlignmentConfig = field(default_factory=AlignmentConfig)
    """When lines agree."""

    def execute(self) -> int:
        """Writes the folder and prints verdicts and tables."""
        if len(self.maps) < 2:
            print(
                "graphslam: error: compare needs at least two maps; see graphslam compare --help",
                file=sys.stderr,
            )
            return USAGE
        from compare.two_maps import compare_maps

        out = default_folder(self.maps) if self.out is None else self.out
        for pair in compare_maps(self.maps, out, self.near, self.alignment):
            _print_pair(pair)
        print(out / "report.html")
        return DONE


def default_folder(maps: tuple[Path, ...]) -> Path:
    """Returns the folder for a comparison for which none was given."""
    names = [path.resolve().stem if path.is_file() else path.resolve().name for path in maps[:2]]
    return Path("results") / f"compare-{'-'.join(names)}"


def _print_pair(pair: MapPair) -> None:
    """Prints the verdict, its reasons and the table of lines."""
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from compare.two_maps_tables import line_rows
    from compare.two_maps_words import path_sentence, reasons, verdict

    console = Console(highlight=False)
    console.print(Text(f"{pair.a.label} against {pair.b.label}", style="bold"))
    if pair.test is not None:
        table = Table("line", box=SIMPLE)
        for heading in PRINTED.values():
            table.add_column(heading, justify="right", no_wrap=True)
        for row in line_rows(pair):
            table.add_row(row["label"], *(row["cells"][k] for k in PRINTED))
        console.print(table)
        if not pair.relation.independent:
            console.print(Text("σ: the surer map’s own, the frame’s share taken out"))
    console.print(Text(verdict(pair), style="bold"))
    path = [] if pair.path is None else [path_sentence(pair.path)]
    for sentence in [*reasons(pair), *path]:
        console.print(Text(sentence))
