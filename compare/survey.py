"""`graphslam inspect BAG`: what a bag holds, for people, and the proposed robot file."""

from __future__ import annotations

from pathlib import Path

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table
from rich.text import Text

from frontend.survey import Survey

ROBOT_FILE = "robot.toml"


def print_survey(found: Survey, proposal: Path) -> None:
    """Prints what a bag holds and what is missing, to standard output."""
    console = Console(highlight=False)
    table = Table(title=Text(found.path.name), title_justify="left", title_style="bold", box=SIMPLE)
    for name in ("topic", "type", "messages", "Hz", "MB", "becomes"):
        right = name in ("messages", "Hz", "MB")
        table.add_column(name, justify="right" if right else "left", overflow="fold")
    for row in found.topics:
        rate = f"{row.mean_hz:.3g}" if row.mean_hz == row.mean_hz else "–"
        cells = (f"{row.count:,}", rate, f"{row.bytes / 1e6:.2f}", row.use or "–")
        table.add_row(Text(row.topic), Text(row.type.rpartition("/")[2]), *cells)
    console.print(table)
    for frame in found.frames:
        console.print(Text(f"tf: {frame}"))
    for loss in found.losses:
        console.print(Text(f"could not be read: {loss}"))
    if found.missing:
        console.print(Text("what no message says", style="bold"))
        for line in found.missing:
            console.print(Text(f"  {line}"))
    console.print(Text(f"proposed robot file, for --robot: {proposal}"), soft_wrap=True)
