"""`graphslam run` and `graphslam extract`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from compare.commands.common import (
    DONE,
    FAILED,
    SOME_FAILED,
    USAGE,
    ConfigFile,
    Folder,
    Log,
    Logs,
    ResultFolder,
    complain,
)
from compare.config import RunConfig
from frontend.config import ExtractConfig


@dataclass(frozen=True, slots=True)
class Run:
    """Extract, estimate, compare, report: the main job.

    Example: graphslam run my-log --every 2 --ekf.matching.gate 9
    """

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
        from compare.run import run_log
        from compare.run_many import run_logs

        with Progress() as progress:
            if len(self.logs) == 1:
                result = run_log(self.logs[0], self.out, self.settings, progress)
            else:
                outcomes = run_logs(self.logs, self.out, self.settings, progress)
        if len(self.logs) == 1:
            print_result(result)
            return FAILED if result.failed else DONE
        for outcome in outcomes:
            if outcome.result is not None:
                print_result(outcome.result)
            else:
                complain(outcome.error, outcome.path)
        failed = sum(o.result is None or bool(o.result.failed) for o in outcomes)
        return DONE if not failed else FAILED if failed == len(outcomes) else SOME_FAILED


@dataclass(frozen=True, slots=True)
class Extract:
    """Turn a log into measurements, and stop there.

    Example: graphslam extract my-log --out measurements/my-log --overlay pictures/my-log
    """

    log: Log
    """Log folder."""
    out: Folder
    """Folder to write: run.json, measurements.npz and sightings.csv."""
    overlay: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="")] = None
    """Folder to write a picture of every image to, with the lines seen in it, in the image and on
    the floor; it must be empty or absent."""
    config_file: ConfigFile = None
    """TOML file of settings, as `graphslam config` prints them; flags override it."""
    extract: ExtractConfig = field(default_factory=ExtractConfig)
    """Recording to measurements."""

    def execute(self) -> int:
        """Writes the folder and prints what was seen."""
        from compare.console import Progress, print_extracted
        from compare.run import extract_log

        with Progress() as progress:
            config = RunConfig(extract=self.extract)
            result = extract_log(self.log, self.out, config, progress, self.overlay)
        print_extracted(result)
        return DONE
