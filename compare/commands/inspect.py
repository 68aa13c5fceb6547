"""`graphslam inspect`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from compare.commands.common import DONE, Log, ResultFolder
from frontend.config import DetectorConfig

if TYPE_CHECKING:
    from compare.console import Progress
    from frontend.log import Log as OpenLog


@dataclass(frozen=True, slots=True)
class Inspect:
    """Tell what a log holds, what it lacks for which method, and what looks wrong in it.

    Writes a picture of some frames with the lines seen in them; of a bag also a proposed robot
    file. Findings do not change the exit code.

    Example: graphslam inspect my-log
    """

    log: Log
    """Log folder, or bag."""
    out: ResultFolder = None
    """Folder for the picture and inspection.json, by default results/<log name>-inspect."""
    robot: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """Robot file of a bag (docs/bags.md)."""
    detector: DetectorConfig = field(default_factory=DetectorConfig)
    """How to look for lines."""

    def execute(self) -> int:
        """Prints what was found, and where the picture is."""
        from compare.console import Progress
        from compare.inspection import check_inspection, print_inspection, write_inspection
        from frontend.inspect import inspect

        with Progress() as progress:
            log, proposal = self._open(progress)
            if log is None:
                return DONE
            out = Path("results") / f"{log.name}-inspect" if self.out is None else self.out
            check_inspection(out)
            found = inspect(log, self.detector, partial(progress, f"{log.name}: inspect"))
        picture = write_inspection(log, found, out, proposal)
        print_inspection(found)
        print(out if picture is None else picture)
        return DONE

    def _open(self, progress: Progress) -> tuple[OpenLog | None, str | None]:
        """Returns the log, and a robot file for it if it is a bag.

        Of a bag, prints what it holds; where no log can be made of it yet, writes the proposal.
        """
        from frontend.log import open_log
        from frontend.readers.bag_files import is_bag

        if (self.log / "log.toml").exists() or not is_bag(self.log):
            return open_log(self.log, self.robot), None
        from compare.inspection import write_proposal
        from compare.opening import reading
        from compare.survey import ROBOT_FILE, print_survey
        from frontend.readers.bag import bag_name, open_collected, open_content, robot_of
        from frontend.survey import survey
        from graphslam.errors import BadLog

        robot = robot_of(self.robot)
        content = open_content(self.log, reading(progress, self.log.name))
        told = survey(content, robot)
        out = self.out or Path("results") / f"{bag_name(self.log, robot)}-inspect"
        print_survey(told, out / ROBOT_FILE)
        try:
            return open_collected(content, robot, self.robot), told.proposal
        except BadLog as missing:
            print(f"graphslam: warning: no log can be made of it yet: {missing}", file=sys.stderr)
            write_proposal(out, told.proposal)
            return None, None
