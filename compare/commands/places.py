"""`graphslam places`."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE, FAILED, ConfigFile
from frontend.config import ExtractConfig


@dataclass(frozen=True, slots=True)
class Places:
    """Look at a map of corridors: its places, the way from one to another, where a log starts.

    Without options: the places and their lamps. `graphslam run LOG --places MAP` tells where the
    robot was, by name, and which lamps are out of order.

    Example: graphslam places building.toml --start lift --goal lab
    """

    map: Annotated[Path, tyro.conf.Positional, arg(metavar="MAP")]
    """Map of corridors, .toml (docs/lamps.md)."""
    start: Annotated[str | None, arg(metavar="PLACE", help_behavior_hint="")] = None
    """Where the way begins; with --goal."""
    goal: Annotated[str | None, arg(metavar="PLACE", help_behavior_hint="")] = None
    """Where the way ends; with --start."""
    locate: Annotated[Path | None, arg(metavar="LOG", help_behavior_hint="")] = None
    """Find where this log started, from the lamps in it alone. Exit code 1: not decided."""
    config_file: ConfigFile = None
    """TOML file of settings, as `graphslam config` prints them; flags override it."""
    extract: ExtractConfig = field(default_factory=ExtractConfig)
    """Recording to measurements, for --locate."""

    def execute(self) -> int:
        """Prints what was asked for."""
        from compare.places.building import read_building
        from compare.places.text import print_building, print_route
        from graphslam.errors import BadConfig

        building = read_building(self.map)
        if (self.start is None) != (self.goal is None):
            raise BadConfig("--start and --goal come together: give both")
        if self.locate is not None:
            return self._locate(self.locate)
        if self.start is not None and self.goal is not None:
            print_route(building, self.start, self.goal)
        else:
            print_building(building)
        return DONE

    def _locate(self, path: Path) -> int:
        from compare.config import RunConfig
        from compare.console import Progress
        from compare.opening import open_as
        from compare.places.building import read_building
        from compare.places.start import find_start
        from compare.places.text import print_answer
        from frontend.extract import extract

        with Progress() as progress:
            log = open_as(path, RunConfig(extract=self.extract), progress)
            tell = partial(progress, f"{log.name}: extract")
            measurements = extract(log, self.extract, tell)
        answer = find_start(
            read_building(self.map),
            measurements,
            next(iter(log.looking_at("ceiling").values()), None),
        )
        print_answer(answer)
        return DONE if answer.decided else FAILED
