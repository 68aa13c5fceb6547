"""`graphslam export`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE
from compare.interchange.formats import RECORDINGS, Format, Table


@dataclass(frozen=True, slots=True)
class Export:
    """Write a result for other programs, or a log as another recording.

    Of a result: tum, the path; g2o, poses, lines and what was measured, as a graph; dxf, svg, the
    floor plan in metres; csv, json, latex, a table; rerun, images, paths, covariances and maps on
    one timeline (needs the extra `view`). Of a log or bag: folder, a log folder; mcap; rosbag1;
    rosbag2 (SQLite); beside a bag its robot file.

    Example: graphslam export results/my-log --to dxf --out floor.dxf

    Example: graphslam export drive.bag --robot robot.toml --to folder --out my-log
    """

    result: Annotated[Path, tyro.conf.Positional, arg(metavar="RESULT|LOG")]
    """A folder that `graphslam run` wrote, or one method's folder in it; or a log."""
    to: Annotated[Format, arg(metavar="FORMAT")]
    """tum, g2o, dxf, svg, csv, json, latex or rerun; folder, mcap, rosbag1 or rosbag2."""
    out: Annotated[Path, arg(metavar="FILE")]
    """File to write, which is replaced if it is there; for folder and rosbag2 a folder, which must
    not be there."""
    robot: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """Robot file of a bag (docs/bags.md)."""
    method: Annotated[str | None, arg(metavar="METHOD", help_behavior_hint="")] = None
    """Whose path or map; by default the smoother's if there is one, else the last method's. With
    --to tum also truth: the true poses at the nodes."""
    table: Table = "figures"
    """What csv, json and latex show: the figures of all methods, or one method's map or path (not
    in latex)."""

    def execute(self) -> int:
        """Writes the file and prints its path."""
        if self.to in RECORDINGS:
            return self._recording()
        from compare.interchange.export import export

        print(export(self.result, self.to, self.out, self.method, self.table))
        return DONE

    def _recording(self) -> int:
        from compare.config import RunConfig
        from compare.console import Progress
        from compare.interchange.recording import export_recording
        from compare.opening import open_as
        from frontend.config import ExtractConfig

        with Progress() as progress:
            extract = ExtractConfig(robot=None if self.robot is None else str(self.robot))
            log = open_as(self.result, RunConfig(extract=extract), progress)
            show = partial(progress, f"{log.name}: write {self.to}")
            written, notes = export_recording(log, self.to, self.out, show)
        for note in (*log.warnings, *notes):
            print(f"graphslam: warning: {log.name}: {note}", file=sys.stderr)
        for path in written:
            print(path)
        return DONE
