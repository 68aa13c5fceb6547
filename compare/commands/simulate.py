"""`graphslam simulate`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE


@dataclass(frozen=True, slots=True)
class Simulate:
    """Record a log in a simulated world.

    Example: graphslam simulate grid --out my-log --seed 1 --no-images
    """

    scenario: Annotated[str, tyro.conf.Positional, arg(metavar="SCENARIO")]
    """A scenario file (.toml), or the name of one that is shipped."""
    out: Annotated[Path, arg(metavar="LOG")]
    """Log folder to write."""
    seed: int = 0
    """Seed of everything random; the same seed gives the same log."""
    no_images: Annotated[tyro.conf.UseCounterAction[int], arg(help_behavior_hint="")] = 0
    """Write sightings.csv, with the true line of each sighting, instead of rendering images."""

    def execute(self) -> int:
        """Writes the log folder and prints its path."""
        from compare.console import Progress
        from frontend.simulate import load_scenario, simulate

        with Progress() as progress:
            scenario = load_scenario(self.scenario)
            show = partial(progress, f"{scenario.name}: simulate")
            folder = simulate(scenario, self.out, self.seed, show, images=not self.no_images)
        print(folder)
        return DONE
