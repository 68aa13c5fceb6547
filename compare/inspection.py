"""What `graphslam inspect` shows and writes."""

from __future__ import annotations

import json
import math
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from compare.results import whole_folder, write_json
from compare.survey import ROBOT_FILE
from frontend.inspect import Inspection, Source
from frontend.log import Log
from frontend.overlay import contact_sheet, write_picture
from graphslam.errors import BadConfig

FORMAT = "graphslam-inspection/1"
WHOLE_NAME = 15
"""Names of files up to this long are not broken over two lines of the table."""
SINCE_1970 = 1e8
"""Times beyond this, s, count from 1970; they are shown from the first on."""
FILE, PICTURE = "inspection.json", "lines.jpg"


def write_inspection(
    log: Log, inspection: Inspection, out: Path, proposal: str | None = None
) -> Path | None:
    """Writes ``inspection.json`` and a contact sheet of frames with their lines, if there are any.

    Args:
        log: that was inspected.
        inspection: what was found.
        out: the folder; that of an earlier inspection is replaced, any other is refused.
        proposal: of a bag, the text of a proposed robot file.

    Returns:
        The picture, or None where the log has no image to show.

    Raises:
        BadConfig: the folder is somebody else's.
        OSError: it cannot be written.
    """
    picture = contact_sheet(log, inspection.frames)
    with whole_folder(out, check_inspection) as folder:
        content = {"format": FORMAT, **_plain(inspection), "folder": log.folder.name}
        write_json(folder / FILE, content)
        if proposal is not None:
            (folder / ROBOT_FILE).write_text(proposal, encoding="utf-8")
        if picture is not None:
            write_picture(folder / PICTURE, picture)
    return None if picture is None else out / PICTURE


def write_proposal(out: Path, proposal: str) -> None:
    """Writes a proposed robot file for a bag that is no log yet; the same folder, else empty."""
    with whole_folder(out, check_inspection) as folder:
        write_json(folder / FILE, {"format": FORMAT})
        (folder / ROBOT_FILE).write_text(proposal, encoding="utf-8")


def check_inspection(folder: Path) -> None:
    """Raises BadConfig where ``folder`` exists and holds no earlier inspection."""
    if not (folder.exists() or folder.is_symlink()):
        return
    try:
        content = json.loads((folder / FILE).read_text(encoding="utf-8"))
        ours = isinstance(content, dict) and content.get("format") == FORMAT
    except (OSError, ValueError, RecursionError):
        ours = False
    if not ours:
        raise BadConfig(
            f"{folder}: exists and is no earlier inspection (no {FILE} of ours), so it is not "
            "replaced; give another --out, or move it away"
        )


def print_inspection(inspection: Inspection) -> None:
    """Prints an inspection to standard output; overlap is with the times of the odometry."""
    console = Console(highlight=False)
    console.print(_sources(inspection))
    console.print(_figures(inspection))
    console.print(_needs(inspection))
    if inspection.warnings:
        console.print(Text("warnings", style="bold"))
        for warning in inspection.warnings:
            console.print(Text(f"  {warning}"))
    if not inspection.findings:
        console.print("nothing looks wrong")
        return
    console.print(Text(f"what looks wrong: {len(inspection.findings)}", style="bold"))
    for number, finding in enumerate(inspection.findings, start=1):
        console.print(
            Text.assemble(
                f"{number}. ",
                (finding.about, "bold"),
                f": {finding.found}\n   why: {finding.reason}\n   cure: {finding.cure}",
            )
        )


def _table(title: str, *columns: str, numbers: bool = False) -> Table:
    table = Table(title=Text(title), title_justify="left", title_style="bold", box=SIMPLE)
    for number, column in enumerate(columns):
        justify: Literal["left", "right"] = "right" if numbers and number else "left"
        table.add_column(column, justify=justify, overflow="fold")
    return table


def _sources(inspection: Inspection) -> Table:
    columns = ("file", "rows", "from s", "to s", "Hz", "jitter ms", "longest step s", "overlap")
    first = min((source.first_s for source in inspection.sources), default=0.0)
    zero = first if first > SINCE_1970 else 0.0
    since = f", times from t = {zero:.2f} s on" if zero else ""
    table = _table(inspection.name + since, *columns, numbers=True)
    longest = max((len(source.file) for source in inspection.sources), default=0)
    table.columns[0].min_width = min(longest, WHOLE_NAME)
    table.collapse_padding, table.pad_edge = True, False
    for source in inspection.sources:
        cells = (f"{source.rows:,}", *_times(source, zero), f"{source.overlap:.0%}")
        table.add_row(source.file, *cells)
    return table


def _times(source: Source, zero: float) -> tuple[str, ...]:
    begin, end = f"{source.first_s - zero:.2f}", f"{source.last_s - zero:.2f}"
    if math.isnan(source.rate_hz):
        return begin, end, "–", "–", "–"
    gap = f"{source.gap_s:.3g}"
    if source.gap_s * source.rate_hz > 2:
        gap += f" after {source.gap_at_s - zero:.2f}"
    return begin, end, f"{source.rate_hz:.4g}", f"{1e3 * source.jitter_s:.1f}", gap


def _figures(inspection: Inspection) -> Table:
    table = _table("motion, camera and lines", "what", "figure")
    turned, net = np.degrees([inspection.turned_rad, inspection.net_turn_rad])
    median, most = inspection.speed_mps
    table.add_row("driven", f"{inspection.driven_m:.2f} m")
    table.add_row("turned", f"{turned:.0f}°, left less right {net:+.0f}°")
    table.add_row("speed", f"{median:.2f} m/s, at most {most:.2f} m/s")
    if np.isfinite(inspection.wheel_rate).all():
        left, right = inspection.wheel_rate
        table.add_row("fastest wheel", f"left {left:.1f} rad/s, right {right:.1f} rad/s")
    for view in inspection.views:
        table.add_row(
            f"camera {escape(view.camera)}",
            f"{view.image_size[0]} x {view.image_size[1]} pixels, {view.area_m2:.3g} m² of floor "
            f"from {view.nearest_m:.2f} m on, {1e3 * view.pixel_m:.3g} mm a pixel",
        )
    if inspection.images:
        bad = sum(not frame.readable for frame in inspection.frames)
        table.add_row("images", f"{inspection.images:,}, unreadable in the sample: {bad}")
    if inspection.frames:
        counts = [len(frame.z) for frame in inspection.frames]
        table.add_row(
            "lines a frame",
            f"{np.mean(counts):.1f} ({min(counts)} to {max(counts)}) in {len(counts)} frames",
        )
    if inspection.turns is not None:
        table.add_row(
            "lines seen turning",
            f"{inspection.turns.turned}, as the wheels say: {inspection.turns.agree:.0%}",
        )
    return table


def _needs(inspection: Inspection) -> Table:
    table = _table("what it is good for", "purpose", "missing")
    for need in inspection.needs:
        table.add_row(need.purpose, Text(", ".join(need.missing) or "nothing"))
    return table


def _plain(value: Any) -> Any:
    """Returns dataclasses as dictionaries, all the way down."""
    if is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value
