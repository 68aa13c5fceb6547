"""What the command line shows: progress on a terminal, a table at the end."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from contextlib import ExitStack
from types import TracebackType
from typing import TYPE_CHECKING, Any

from rich import progress as bars
from rich.console import Console
from rich.table import Table
from rich.text import Text

from compare.compiling import told_when_compiling
from compare.words import noun
from graphslam.models import MODELS

if TYPE_CHECKING:
    from compare.run import RunResult

JUDGED = {
    "aligned path RMSE": (("trajectory", "aligned_rmse_m"),),
    "final error": (("trajectory", "final_error_m"),),
    "map RMSE": (("map", "rho_rmse_m"), ("points", "rmse_m")),
}
"""Columns of the table at the end: keys in a method's part of metrics.json; the first tells."""
CLAIMED = {"path sigma": (("position_sigma_m",),), "final sigma": (("last_position_sigma_m",),)}
"""The same where there is no truth: what the methods claim."""


class Progress:
    """Shows the stage of a run on standard error where that is a terminal, else nothing."""

    def __init__(self) -> None:
        self._bar: bars.Progress | None = None
        self._task: bars.TaskID | None = None
        self._open = ExitStack()

    def __enter__(self) -> Progress:
        if sys.stderr.isatty():
            columns = (
                bars.TextColumn("{task.description}"),
                bars.BarColumn(),
                bars.MofNCompleteColumn(),
                bars.TimeElapsedColumn(),
            )
            self._bar = bars.Progress(*columns, console=Console(stderr=True), transient=True)
            self._open.enter_context(self._bar)
            say = self._bar.console.print
            self._open.enter_context(told_when_compiling(lambda text: say(f"graphslam: {text}")))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.close()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Notes that ``done`` of ``total`` parts of a stage are done."""
        if self._bar is None:
            return
        if self._task is None:
            self._task = self._bar.add_task(stage, total=total)
        self._bar.update(self._task, description=stage, completed=done, total=total)


def print_result(result: RunResult) -> None:
    """Prints warnings and alarms to standard error; figures, verdict and report to output."""
    from compare.verdict_methods import alarms

    assert result.comparison is not None
    warn(result.log.name, (*result.warnings, *alarms(result.comparison.methods)))
    metrics = result.comparison.to_dict()
    table = Table(title=Text(result.log.name), title_justify="left", title_style="bold")
    table.add_column("method")
    judged = any(m["trajectory"] or m["map"] for m in metrics["methods"].values())
    for heading in (*(JUDGED if judged else CLAIMED), noun(result.comparison.kinds)[1]):
        table.add_column(heading, justify="right")
    for name, figures in metrics["methods"].items():
        shown = JUDGED.values() if judged else CLAIMED.values()
        count = str(figures["landmarks"]) if figures["landmarks"] else "–"
        table.add_row(name, *(millimetres(first_of(figures, paths)) for paths in shown), count)
    console = Console(highlight=False, soft_wrap=False)
    console.print(table)
    if metrics["verdict"]:
        console.print(Text(metrics["verdict"][0]))
    for sentence in result.places:
        console.print(Text(sentence))
    if result.check is not None:
        console.print(Text(result.check))
    print(result.folder / "report.html")


def print_extracted(result: RunResult) -> None:
    """Prints what a log was turned into, to standard output."""
    warn(result.log.name, result.warnings)
    measurements = result.measurements
    tables = measurements.sightings.items()
    counts = ", ".join(f"{len(t)} of {MODELS[kind].noun[1]}" for kind, t in tables)
    print(f"{result.log.name}: {len(measurements.t)} nodes, sightings: {counts or 'none'}")
    for reason, count in measurements.rejected.items():
        print(f"left out: {count} {reason}")
    print(result.folder)


def warn(name: str, warnings: Iterable[str]) -> None:
    """Prints what is doubtful about a log, or what was made of it, to standard error."""
    for warning in warnings:
        print(f"graphslam: warning: {name}: {warning}", file=sys.stderr)


def first_of(figures: Any, paths: tuple[tuple[str, ...], ...]) -> Any:
    """Returns the figure at the first of some paths of keys that leads to one; else None."""
    for path in paths:
        found = figures
        for key in path:
            found = None if found is None else found[key]
        if found is not None:
            return found
    return None


def millimetres(metres: Any) -> str:
    """Returns a length with three significant digits in mm, or a dash for None."""
    if metres is None:
        return "–"
    value = 1e3 * metres
    return f"{value:,.0f} mm" if abs(value) >= 100 else f"{value:#.3g} mm"
