"""The command `graphslam`. Nothing heavy is imported until a command runs."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Protocol, get_type_hints

import tyro
from tyro.conf import arg, subcommand
from tyro.constructors import (
    ConstructorRegistry,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from compare.commands.batch import Batch
from compare.commands.beacons import Beacons
from compare.commands.calibrate import Calibrate
from compare.commands.common import DONE, FAILED, INTERRUPTED, complain
from compare.commands.compare import Compare
from compare.commands.config import Config
from compare.commands.export import Export
from compare.commands.inspect import Inspect
from compare.commands.merge import Merge
from compare.commands.papers import Papers
from compare.commands.places import Places
from compare.commands.play import Play
from compare.commands.report import Report
from compare.commands.run import Extract, Run
from compare.commands.simulate import Simulate
from compare.commands.study import Study
from compare.config import RunConfig, field_docs, load_config
from frontend.config import ExtractConfig
from graphslam.config import MatchingConfig, SmootherConfig

SHORT_FLAGS = {
    (ExtractConfig, "from_s"): arg(
        name="from", prefix_name=False, metavar="SECONDS", help_behavior_hint=""
    ),
    (ExtractConfig, "to_s"): arg(
        name="to", prefix_name=False, metavar="SECONDS", help_behavior_hint=""
    ),
    (ExtractConfig, "robot"): arg(
        name="robot", prefix_name=False, metavar="FILE", help_behavior_hint=""
    ),
    (ExtractConfig, "every"): arg(name="every", prefix_name=False, metavar="N"),
    (SmootherConfig, "check"): arg(name="check", prefix_name=False),
    (MatchingConfig, "method"): arg(name="matching", prefix_name=False),
    (SmootherConfig, "robust"): arg(name="robust", prefix_name=False),
    (SmootherConfig, "rematch"): arg(name="rematch", prefix_name=False),
    (Study, "what_if"): arg(name="what-if"),
}
"""Options that are used so often that they have a flag without the path of their table. Only they
are switches where they are true or false; the others take `True` or `False`, as the file does."""


class Command(Protocol):
    """A subcommand, filled from flags."""

    def execute(self) -> int:
        """Does the work and returns the exit code."""
        ...


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
        complain(error)
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
    study = Study(scenario=missing, out=missing, settings=settings)
    play = Play(log=missing, settings=settings)
    batch = Batch(logs=missing, out=missing, settings=settings)
    places = Places(map=missing, extract=settings.extract)
    commands = (
        Annotated[Run, subcommand("run", default=run)]
        | Annotated[Extract, subcommand("extract", default=extract)]
        | Annotated[Batch, subcommand("batch", default=batch)]
        | Annotated[Play, subcommand("play", default=play)]
        | Annotated[Simulate, subcommand("simulate")]
        | Annotated[Study, subcommand("study", default=study)]
        | Annotated[Inspect, subcommand("inspect")]
        | Annotated[Calibrate, subcommand("calibrate")]
        | Annotated[Beacons, subcommand("beacons")]
        | Annotated[Compare, subcommand("compare")]
        | Annotated[Merge, subcommand("merge")]
        | Annotated[Papers, subcommand("papers")]
        | Annotated[Places, subcommand("places", default=places)]
        | Annotated[Report, subcommand("report")]
        | Annotated[Export, subcommand("export")]
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
            config=(tyro.conf.OmitSubcommandPrefixes,),
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
        if short is None and hint is bool:
            short = tyro.conf.FlagConversionOff
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
