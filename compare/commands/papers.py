"""`graphslam papers`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE, FAILED, SOME_FAILED

if TYPE_CHECKING:
    from compare.errata import ErrataStudy

IN_TERMINAL = {
    0: "erratum",
    4: "path error, times",
    5: "NEES, right",
    6: "printed",
    8: "lines twice",
    9: "broke down",
}
"""Columns of `ErrataStudy.rows` that fit a terminal, and what they are called there."""


@dataclass(frozen=True, slots=True)
class Papers:
    """Reproduce the experiments of SantanaLoc and SantanaSLAM, with one report.

    Many runs of each without images, one of each through rendered images; what is there already is
    used again, so that a killed command goes on where it stopped.

    Example: graphslam papers --errata --out results/papers
    """

    out: Annotated[Path, arg(metavar="DIR")] = Path("results") / "papers"
    """Folder to write, or to go on in: report.html, plots, metrics.json, and the runs."""
    runs: int = 20
    """How many runs without images of each experiment; run number N has the seed N."""
    jobs: int = 0
    """Worker processes, one BLAS thread each; 0: as many as the machine has cores. It changes no
    result."""
    errata: Annotated[tyro.conf.UseCounterAction[int], arg(help_behavior_hint="")] = 0
    """Run and print what each misprint of the papers costs, too."""

    def execute(self) -> int:
        """Does what is missing, writes the report, prints what came out."""
        from compare.console import Progress
        from compare.papers import reproduce_papers
        from compare.report_papers import verdict

        with Progress() as progress:
            papers = reproduce_papers(
                self.out, self.runs, errata=bool(self.errata), jobs=self.jobs, progress=progress
            )
        for run in papers.failed[:3]:
            print(f"graphslam: run {run.run} failed: {run.error}", file=sys.stderr)
        for sentence in verdict(papers):
            print(sentence)
        if papers.errata is not None:
            _print_errata(papers.errata)
        print(self.out / "report.html")
        if not papers.failed:
            return DONE
        every = sum(len(study.runs) for study in papers.studies)
        return FAILED if len(papers.failed) == every else SOME_FAILED


def _print_errata(errata: ErrataStudy) -> None:
    """Prints what each misprint costs."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    title = f"What each misprint costs: medians over {errata.runs} seeds (all columns: the report)"
    table = Table(title=Text(title), title_justify="left", title_style="bold")
    for column, heading in IN_TERMINAL.items():
        table.add_column(heading, justify="right" if column else "left", no_wrap=not column)
    for row in errata.rows():
        table.add_row(*(Text(row[column]) for column in IN_TERMINAL))
    Console(highlight=False).print(table)
