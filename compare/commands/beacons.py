"""`graphslam beacons`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE


@dataclass(frozen=True, slots=True)
class Beacons:
    """Tell where bearings to known beacons fix the pose, how well, and where one more helps most.

    Draws the expected error ellipse over the field, with the circle through three beacons on which
    their bearings fix nothing. It takes no recording, only where the beacons stand.

    Example: graphslam beacons landmarks.csv --sigma-deg 0.2 --field 0 0 1.0 0.7
    """

    landmarks: Annotated[Path, tyro.conf.Positional, arg(metavar="LANDMARKS")]
    """landmarks.csv, or a log folder that holds one; its landmarks of kind bearing count."""
    sigma_deg: float = 0.2
    """Standard deviation of a bearing, degrees."""
    field: Annotated[
        tuple[float, float, float, float] | None,
        arg(metavar="X0 Y0 X1 Y1", help_behavior_hint=""),
    ] = None
    """Where the robot drives, m: lower left and upper right corner; absent: the rectangle around
    the beacons."""
    out: Annotated[Path, arg(metavar="DIR")] = Path("results") / "beacons"
    """Folder for beacons.svg and beacons.csv, the numbers behind it."""

    def execute(self) -> int:
        """Prints what was found, and where the picture is."""
        from compare.beacons import advise, told

        found = advise(self.landmarks, self.sigma_deg, self.field)
        for sentence in told(found):
            print(sentence)
        print(found.write(self.out))
        return DONE
