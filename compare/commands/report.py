"""`graphslam report`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE


@dataclass(frozen=True, slots=True)
class Report:
    """Write report.html and plots of a result folder again, from its files alone.

    Example: graphslam report results/my-log
    """

    folder: Annotated[Path, tyro.conf.Positional, arg(metavar="DIR")]
    """A folder that `graphslam run` wrote."""

    def execute(self) -> int:
        """Rewrites the report and prints its path."""
        from compare.report import rebuild_report

        print(rebuild_report(self.folder))
        return DONE
