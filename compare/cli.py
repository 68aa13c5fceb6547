"""The command `graphslam`. Nothing heavy is imported until a command runs."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import dataclass, field, fields, is_dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import tyro
from tyro.conf import arg, subcommand
from tyro.constructors import (
    ConstructorRegistry,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from compare.config import RunConfig, field_docs, load_config, to_toml
from frontend.config import ExtractConfig
from graphslam.config import MatchingConfig
from graphslam.errors import GraphSlamError

DONE, FAILED, USAGE, SOME_FAILED, INTERRUPTED = 0, 1, 2, 3, 130

SHORT_FLAGS = {
    (ExtractConfig, "from_s"): arg(
        name="from", prefix_name=False, metavar="SECONDS", help_behavior_hint=""
    ),
    (ExtractConfig, "to_s"): arg(
        name="to", prefix_name=False, metavar="SECONDS", help_behavior_hint=""
    ),
    (ExtractConfig, "every"): arg(name="every", prefix_name=False, metavar="N"),
    (MatchingConfig, "method"): arg(name="matching", prefix_name=False),
}
"""Options that are used so often that they have a flag without the path of their table."""

Log = Annotated[Path, tyro.conf.Positional, arg(metavar="LOG")]
Logs = Annotated[
    tuple[Path, ...], tyro.conf.Positional, arg(metavar="LOG ...", help_behavior_hint="(required)")
]
Folder = Annotated[Path, arg(metavar="DIR")]
ResultFolder = Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")]
ConfigFile = Annotated[Path | None, arg(name="config", metavar="FILE", help_behavior_hint="")]


@dataclass(frozen=True, slots=True)
class Run:
    """Extract, estimate, compare, report: the main job."""

    logs: Logs
    """Log folders. Several run one after the other; one that fails does not stop the rest."""
    out: ResultFolder = None
    """Where results go. One log: its result folder, by default results/<log name>. Several: each
    in DIR/<log name>, with an overview in DIR/index.html; by default results."""
    config_file: ConfigFile = None
    """TOML file of settings, as `graphslam config` prints them; flags override it."""
    settings: Annotated[RunConfig, arg(name="")] = field(default_factory=RunConfig)
    """Settings of the run."""

    def execute(self) -> int:
        """Runs the logs and prints what came out of each."""
        if not self.logs:
            print("graphslam: error: run needs a log; see graphslam run --help", file=sys.stderr)
            return USAGE
        from compare.console import Progress, print_result
        from compare.run import run_log, run_logs

        with Progress() as progress:
            if len(self.logs) == 1:
                result = run_log(self.logs[0], self.out, self.settings, progress)
            else:
                outcomes = run_logs(self.logs, self.out, self.settings, progress)
        if len(self.logs) == 1:
            print_result(result)
            return DONE
        for outcome in outcomes:
            if outcome.result is not None:
                print_result(outcome.result)
            else:
                _complain(outcome.error, outcome.path)
        failed = sum(outcome.result is None for outcome in outcomes)
        return DONE if not failed else FAILED if failed == len(outcomes) else SOME_FAILED


@dataclass(frozen=True, slots=True)
class Extract:
    """Turn a log into measurements, and stop there."""

    log: Log
    """Log folder."""
    out: Folder
    """Folder to write: run.json, measurements.npz and sightings.csv."""
    config_file: ConfigFile = None
    """TOML file of settings, as `graphslam config` prints them; flags override it."""
    extract: ExtractConfig = field(default_factory=ExtractConfig)
    """Recording to measurements."""

    def execute(self) -> int:
        """Writes the folder and prints what was seen."""
        from compare.console import Progress, print_extracted
        from compare.run import extract_log

        with Progress() as progress:
            result = extract_log(self.log, self.out, RunConfig(extract=self.extract), progress)
        print_extracted(result)
        return DONE


@dataclass(frozen=True, slots=True)
class Simulate:
    """Record a log in a simulated world."""

    scenario: Annotated[str, tyro.conf.Positional, arg(metavar="SCENARIO")]
    """A scenario file (.toml), or the name of one that is shipped."""
    out: Annotated[Path, arg(metavar="LOG")]
    """Log folder to write."""
    seed: int = 0
    """Seed of everything random; the same seed gives the same log."""

    def execute(self) -> int:
        """Writes the log folder and prints its path."""
        from compare.console import Progress
        from frontend.simulate import load_scenario, simulate

        with Progress() as progress:
            scenario = load_scenario(self.scenario)
            show = partial(progress, f"{scenario.name}: simulate")
            folder = simulate(scenario, self.out, self.seed, show)
        print(folder)
        return DONE


@dataclass(frozen=True, slots=True)
class Report:
    """Write report.html and plots of a result folder again, from its files alone."""

    folder: Annotated[Path, tyro.conf.Positional, arg(metavar="DIR")]
    """A folder that `graphslam run` wrote."""

    def execute(self) -> int:
        """Rewrites the report and prints its path."""
        from compare.report import rebuild_report

        print(rebuild_report(self.folder))
        return DONE


@dataclass(frozen=True, slots=True)
class Config:
    """Print every setting with its default, unit and meaning, as TOML for --config."""

    def execute(self) -> int:
        """Prints the defaults."""
        print(to_toml(RunConfig()), end="")
        return DONE


Command = Run | Extract | Simulate | Report | Config


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line and returns its exit code.

    0 done, 1 failed, 2 wrong usage, 3 some of several logs failed, 130 interrupted. Errors are one
    line on standard error; GRAPHSLAM_TRACEBACK=1 adds the traceback.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        if arguments == ["--version"]:
            print(f"graphslam {version('floorline-slam')}")
            return DONE
        return parse(arguments).execute()
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else FAILED if stop.code else DONE
    except KeyboardInterrupt:
        print("graphslam: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        sys.stdout = open(os.devnull, "w")  # noqa: PTH123, SIM115  the reader left; flush nowhere
        return FAILED
    except Exception as error:
        _complain(error)
        return FAILED


def parse(arguments: Sequence[str]) -> Command:
    """Returns the command that arguments name, its settings from defaults, file and flags.

    Raises:
        BadConfig: the file of --config cannot be used.
        SystemExit: wrong usage (2), or help was asked for (0).
    """
    file = _config_file(arguments)
    settings = RunConfig() if file is None else load_config(file)
    missing: Any = tyro.MISSING
    run = Run(logs=missing, settings=settings)
    extract = Extract(log=missing, out=missing, extract=settings.extract)
    commands = (
        Annotated[Run, subcommand("run", default=run)]
        | Annotated[Extract, subcommand("extract", default=extract)]
        | Annotated[Simulate, subcommand("simulate")]
        | Annotated[Report, subcommand("report")]
        | Annotated[Config, subcommand("config")]
    )
    registry = ConstructorRegistry()
    registry.struct_rule(_dataclass_rule)
    with registry:
        command: Command = tyro.cli(
            commands,  # type: ignore[arg-type]
            prog="graphslam",
            description="SLAM with straight lines for wheeled robots: should you filter or smooth "
            "your log, and how good is your map?",
            args=list(arguments),
            config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.FlagConversionOff),
        )
    return command


def _config_file(arguments: Sequence[str]) -> Path | None:
    for this, following in zip(arguments, [*arguments[1:], ""], strict=False):
        if this.startswith("--config="):
            return Path(this.removeprefix("--config="))
        if this == "--config" and following:
            return Path(following)
    return None


def _dataclass_rule(info: StructTypeInfo) -> StructConstructorSpec | None:
    """Makes flags of a dataclass: help from field docstrings, whole, and `SHORT_FLAGS`."""
    package = str(getattr(info.type, "__module__", "")).partition(".")[0]
    if not is_dataclass(info.type) or package not in ("compare", "frontend", "graphslam"):
        return None
    hints, docs = get_type_hints(info.type, include_extras=True), field_docs(info.type)
    specs = []
    for f in fields(info.type):
        hint, short = hints[f.name], SHORT_FLAGS.get((info.type, f.name))
        specs.append(
            StructFieldSpec(
                name=f.name,
                type=hint if short is None else Annotated[hint, short],
                default=_default(f, info.default),
                helptext=docs.get(f.name),
            )
        )
    return StructConstructorSpec(instantiate=info.type, fields=tuple(specs))


def _default(f: Any, instance: Any) -> Any:
    if is_dataclass(instance):
        return getattr(instance, f.name)
    if f.default is not NO_DEFAULT:
        return f.default
    factory: Callable[[], Any] | Any = f.default_factory
    return tyro.MISSING if factory is NO_DEFAULT else factory()


def _complain(error: BaseException | None, log: Path | None = None) -> None:
    """Prints one line about an error, and how to report it if it is not the user's."""
    if os.environ.get("GRAPHSLAM_TRACEBACK") == "1":
        traceback.print_exception(error)
    if isinstance(error, GraphSlamError):
        text = str(error)
    elif isinstance(error, OSError):
        text = f"{error.filename or 'a file'}: {error.strerror or error}"
    else:
        text = (
            f"{type(error).__name__}: {error}; this is a defect of graphslam: please report it "
            "with what the same command prints under GRAPHSLAM_TRACEBACK=1"
        )
    where = "" if log is None or str(log) in text else f"{log}: "
    print(f"graphslam: error: {where}{' '.join(text.split())}", file=sys.stderr)
