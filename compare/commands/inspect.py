"""`graphslam inspect`."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from compare.commands.common import DONE, Log, ResultFolder
from frontend.config import DetectorConfig


@dataclass(frozen=True, slots=True)
class Inspect:
    """Tell what a log holds, what it lacks for which method, and what looks wrong in it.

    Writes a picture of some frames with the lines seen in them. Findings do not change the exit
    code.

    Example: graphslam inspect my-log
    """

    log: Log
    """Log folder."""
    out: ResultFolder = None
    """Folder for the picture and inspection.json, by default results/<log name>-inspect."""
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    """How to look for lines."""

    def execute(self) -> int:
        """Prints what was found, and where the picture is."""
        from compare.console import Progress
        from compare.inspection import check_inspection, print_inspection, write_inspection
        from frontend.inspect import inspect
        from frontend.log import open_log

        log = open_log(self.log)
        out = Path("results") / f"{log.name}-inspect" if self.out is None else self.out
        check_inspection(out)
        with Progress() as progress:
            found = inspect(log, self.detector, partial(progress, f"{log.name}: inspect"))
        picture = write_inspection(log, found, out)
        print_inspection(found)
        print(out if picture is None else picture)
        return DONE
