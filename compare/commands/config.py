"""`graphslam config`."""

from __future__ import annotations

from dataclasses import dataclass

from compare.commands.common import DONE
from compare.config import RunConfig, to_toml


@dataclass(frozen=True, slots=True)
class Config:
    """Print every setting with its default, unit and meaning, as TOML for --config.

    Example: graphslam config > mine.toml
    """

    def execute(self) -> int:
        """Prints the defaults."""
        print(to_toml(RunConfig()), end="")
        return DONE
