"""`graphslam study`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE, FAILED, SOME_FAILED, ConfigFile
from compare.config import RunConfig

if TYPE_CHECKING:
    from compare.study import Study as Result
    from compare.study import Summary


@dataclass(frozen=True, slots=True)
class Study:
    """Simulate one scenario many times and judge every method on each run, without images.

    A killed study goes on where it stopped when the same command is given again.

    Example: graphslam study grid --runs 200 --noise 1 2 4 --out studies/grid
    Example: graphslam study my-log --what-if --out studies/what-if
    """

    scenario: Annotated[str, tyro.conf.Positional, arg(metavar="SCENARIO")]
    """A scenario file (.toml), the name of one that is shipped, or the study.json of a study: it is
    done again, and the settings on the command line do not count."""
    out: Annotated[Path, arg(metavar="DIR")]
    """Folder to write, or to go on in: report.html, study.json, runs.jsonl, tables and plots."""
    runs: int = 200
    """How many runs at each level of noise; run number N has the seed N."""
    noise: tuple[str, ...] = ("1",)
    """Levels of noise: factors on all standard deviations of the scenario, as 2, or on those of
    wheels and of sightings, as 2.5:2."""
    what_if: bool = False
    """Instead of many runs, one: how well its path, last pose and map can be known at all, and what
    lines across, twice the frames, half the noise of sightings or of wheels would change. SCENARIO
    may then be a log, too."""
    jobs: int = 0
    """Worker processes, one BLAS thread each; 0: as many as the machine has cores. It changes no
    result."""
    config_file: ConfigFile = None
    """TOML file of settings, as `graphslam config` prints them; flags override it."""
    settings: Annotated[RunConfig, arg(name="")] = field(default_factory=RunConfig)
    """Settings of each run."""

    def execute(self) -> int:
        """Does the runs that are missing, writes the tables and prints the summary."""
        from compare.console import Progress

        if self.what_if:
            return self._what_if()
        from compare.study import read_study, study
        from compare.study_answers import answers
        from frontend.simulate import NoiseLevel, load_scenario

        if Path(self.scenario).suffix == ".json":
            scenario, settings, levels, runs = read_study(Path(self.scenario))
        else:
            scenario, settings, runs = load_scenario(self.scenario), self.settings, self.runs
            levels = tuple(NoiseLevel.parse(text) for text in self.noise)
        with Progress() as progress:
            result = study(
                scenario,
                runs,
                self.out,
                settings,
                noise=levels,
                jobs=self.jobs,
                progress=progress,
            )
        for run in result.failed[:3]:
            print(f"graphslam: {result.name(run)} failed: {run.error}", file=sys.stderr)
        _print_summary(result)
        print("\n".join(answers(result)))
        print(self.out / "report.html")
        if not result.failed:
            return DONE
        return FAILED if len(result.failed) == len(result.runs) else SOME_FAILED

    def _what_if(self) -> int:
        """Writes what would help one log, or one run of a scenario, and prints the answer."""
        from compare.console import Progress
        from compare.what_if import what_if_log
        from compare.what_if_report import write_what_if

        with Progress() as progress:
            name, result, judged = what_if_log(self.scenario, self.settings, progress)
        page = write_what_if(result, name, judged, self.out)
        print("\n".join(result.sentences()))
        print(page)
        return DONE


def _print_summary(result: Result) -> None:
    """Prints median, mean and worst of each figure, one table a level, one column a method."""
    for level in result.noise:
        _print_level(result, str(level))


def _print_level(result: Result, level: str) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    good = len(result.runs) - len(result.failed)
    title = f"{result.scenario}: {good} of {len(result.runs)} runs; median / mean / worst"
    if len(result.noise) > 1:
        title += f"; noise {level}"
    table = Table(title=Text(title), title_justify="left", title_style="bold")
    table.add_column("")
    for method in result.methods:
        table.add_column(method, justify="right")
    here = [entry for entry in result.summary if entry.noise == level]
    entries = {(entry.method, entry.figure.name): entry for entry in here}
    for first in here[: len(here) // len(result.methods)]:
        figure = first.figure
        label = f"{figure.label} ({figure.unit})" if figure.unit else figure.label
        cells = [_cell(entries[method, figure.name]) for method in result.methods]
        table.add_row(label, *cells)
    Console(highlight=False).print(table)


def _cell(entry: Summary) -> str:
    if not entry.runs:
        return "–"
    numbers = (entry.median, entry.mean, entry.worst)
    return " / ".join(_three_digits(entry.figure.scale * number) for number in numbers)


def _three_digits(number: float) -> str:
    return f"{number:.0f}" if abs(number) >= 999.5 else f"{number:.3g}"
