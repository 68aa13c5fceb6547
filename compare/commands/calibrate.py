"""`graphslam calibrate`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE, USAGE, ConfigFile, Log
from graphslam.errors import BadConfig


@dataclass(frozen=True, slots=True)
class Calibrate:
    """Find the noise of sightings and wheels that fits a log, and write it as settings.

    From ground truth where the log has it, else from the filter's innovations.

    Example: graphslam calibrate my-log --noise --out noise.toml
    """

    log: Log
    """Log folder."""
    noise: Annotated[tyro.conf.UseCounterAction[int], arg(help_behavior_hint="")] = 0
    """What to calibrate: the noise. Nothing else can be calibrated yet."""
    out: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """TOML file of settings to write, for `graphslam run LOG --config FILE`."""
    config_file: ConfigFile = None
    """TOML file of settings to begin from, as `graphslam config` prints them."""

    def execute(self) -> int:
        """Prints what fits and, where asked to, writes it."""
        if not self.noise:
            print("graphslam: error: calibrate needs --noise: what to find", file=sys.stderr)
            return USAGE
        from compare.calibration import calibrate_noise, noise_toml, print_noise
        from compare.config import RunConfig, load_config
        from compare.console import Progress
        from compare.folders import whole_file, writing
        from frontend.log import open_log

        if self.out is not None and self.out.is_dir():
            raise BadConfig(f"{self.out}: is a folder; give a file to --out")
        log = open_log(self.log)
        config = RunConfig() if self.config_file is None else load_config(self.config_file)
        with Progress() as progress:
            found = calibrate_noise(log, config, progress)
        print_noise(found, log)
        if self.out is not None:
            with writing(self.out):
                self.out.parent.mkdir(parents=True, exist_ok=True)
                with whole_file(self.out) as beside:
                    beside.write_text(noise_toml(found, log.name), encoding="utf-8")
            print(self.out)
        return DONE
