"""Paths from TUM files."""

from __future__ import annotations

from pathlib import Path

from frontend.log_parts import PoseTrack
from frontend.readers.folder_tables import read_truth


def read_tum(path: Path | str) -> PoseTrack:
    """Returns the path of a TUM file seen from above: times, and poses ``(x, y, yaw)``.

    Raises:
        BadLog: the file cannot be used; the message names file, line and cure.
    """
    return read_truth(Path(path))
