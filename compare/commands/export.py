"""`graphslam export`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE
from compare.interchange.formats import Format, Table


@dataclass(frozen=True, slots=True)
class Export:
    """Write a result for other programs: evo, g2o, CAD, a spreadsheet, a paper.

    tum: the path. g2o: poses, lines and what was measured, as a graph. dxf, svg: the floor plan in
    metres. csv, json, latex: a table.

    Example: graphslam export results/my-log --to dxf --out floor.dxf
    """

    result: Annotated[Path, tyro.conf.Positional, arg(metavar="RESULT")]
    """A folder that `graphslam run` wrote, or one method's folder in it."""
    to: Annotated[Format, arg(metavar="FORMAT")]
    """tum, g2o, dxf, svg, csv, json or latex."""
    out: Annotated[Path, arg(metavar="FILE")]
    """File to write; one that is there is replaced."""
    method: Annotated[str | None, arg(metavar="METHOD", help_behavior_hint="")] = None
    """Whose path or map; by default the smoother's if there is one, else the last method's. With
    --to tum also truth: the true poses at the nodes."""
    table: Table = "figures"
    """What csv, json and latex show: the figures of all methods, or one method's map or path (not
    in latex)."""

    def execute(self) -> int:
        """Writes the file and prints its path."""
        from compare.interchange.export import export

        print(export(self.result, self.to, self.out, self.method, self.table))
        return DONE
