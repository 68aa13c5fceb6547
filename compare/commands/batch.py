"""`graphslam batch`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE, FAILED, SOME_FAILED, USAGE, ConfigFile, Logs
from compare.config import RunConfig

if TYPE_CHECKING:
    from compare.batch import Batch as Result

PRINTED = ("aligned_rmse_m", "map_rmse_m", "pose_nees")
PRINTED_CLAIMED = ("position_sigma_m", "last_position_sigma_m", "landmarks")
"""Figures printed at the end: with truth in any log, and without."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Run many logs in parallel, with one table and one report of all.

    What is there already, of the same input, configuration and version, is kept: a killed batch
    goes on where it stopped when the same command is given again.

    Example: graphslam batch logs/* --out batches/monday --jobs 8 --sweep ekf.gate=5,9,14
    """

    logs: Logs
    """Logs; folders that hold logs; patterns in quotes; or .txt files with one of these a line. One
    that fails does not stop the rest."""
    out: Annotated[Path, arg(metavar="DIR")]
    """Folder to write, or to go on in: a result folder for each log, batch.csv, summary.csv,
    batch.json and batch.html."""
    jobs: int = 0
    """Worker processes, one BLAS thread each; 0: as many as the machine has cores. It changes no
    result."""
    dask: Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="")] = None
    """Let the workers of this Dask scheduler do the work (tcp://host:8786) instead. They must see
    logs and DIR under the same paths."""
    sweep: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        arg(metavar="NAME=VALUE,VALUE", help_behavior_hint="(repeatable)"),
    ] = ()
    """Run every log under each of these values of a setting; given several times, under all
    combinations."""
    no_reports: Annotated[tyro.conf.UseCounterAction[int], arg(help_behavior_hint="")] = 0
    """Leave out each log's own report.html and plots: faster; `graphslam report` makes them."""
    config_file: ConfigFile = None
    """TOML file of settings, as `graphslam config` prints them; flags override it."""
    settings: Annotated[RunConfig, arg(name="")] = field(default_factory=RunConfig)
    """Settings of each run."""

    def execute(self) -> int:
        """Does what is missing, writes the tables and prints their summary."""
        if not self.logs:
            print(
                "graphslam: error: batch needs a log; see graphslam batch --help", file=sys.stderr
            )
            return USAGE
        from compare.batch import batch
        from compare.batch_workers import thread_warnings
        from compare.console import Progress

        if self.dask is not None:
            for warning in thread_warnings(self.dask):
                print(f"graphslam: warning: {warning}", file=sys.stderr)
        with Progress() as progress:
            result = batch(
                self.logs,
                self.out,
                self.settings,
                sweep=self.sweep,
                jobs=self.jobs,
                dask=self.dask,
                reports=not self.no_reports,
                progress=progress,
            )
        for failure in result.failures:
            where = ", ".join(filter(None, (failure.log, result.points[failure.point].label)))
            method = f"{failure.method}: " if failure.method else ""
            print(f"graphslam: error: {where}: {method}{failure.reason}", file=sys.stderr)
        _print_summary(result)
        if not result.failures:
            return DONE
        every = len(result.logs) * len(result.points)
        return FAILED if result.failed_jobs == every else SOME_FAILED


def _print_summary(result: Result) -> None:
    """Prints median, mean and worst of the main figures, the verdict, and where the page is."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from compare.report_batch import verdict

    whole = [entry for entry in result.summary if entry.summary.runs]
    names = [n for n in PRINTED if any(e.summary.figure.name == n for e in whole)]
    title = f"{len(result.logs)} logs; median / mean / worst"
    table = Table(title=Text(title), title_justify="left", title_style="bold")
    swept = bool(result.points[0].values)
    for heading in (*(["setting"] if swept else []), "method"):
        table.add_column(heading, no_wrap=True)
    rows: dict[tuple[int, str], list[str]] = {}
    for name in names or PRINTED_CLAIMED:
        entries = [e for e in result.summary if e.summary.figure.name == name]
        figure = entries[0].summary.figure
        table.add_column(f"{figure.label} ({figure.unit})" if figure.unit else figure.label)
        for entry in entries:
            s = entry.summary
            numbers = [figure.scale * value for value in (s.median, s.mean, s.worst)]
            rows.setdefault((entry.point, s.method), []).append(_cell(numbers))
    for (point, method), cells in rows.items():
        table.add_row(*([result.points[point].short_label] if swept else []), method, *cells)
    console = Console(highlight=False)
    console.print(table)
    for sentence in verdict(result)[:4]:
        console.print(Text(sentence))
    print(_account(result))
    print(result.folder / "batch.html")


def _cell(numbers: Sequence[float]) -> str:
    from compare.report_tables import DASH, number

    texts = [number(value) for value in numbers]
    return DASH if set(texts) == {DASH} else " / ".join(texts)


def _account(result: Result) -> str:
    """Returns what this call did."""
    parts = [f"{result.computed} computed", f"{result.kept} already there"]
    if result.failures:
        parts.append(f"{result.failed_jobs} failed")
    return ", ".join(parts)
