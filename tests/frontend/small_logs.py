"""Small log folders written by tests."""

from __future__ import annotations

from pathlib import Path

ROBOT = """
[robot]
wheel_radius_left = 0.05
wheel_radius_right = 0.05
wheel_base = 0.2
"""
CAMERA = """
[camera]
image_size = [32, 24]
homography = [[0.0, -20.0, 16.0], [-20.0, 0.0, 30.0], [0.0, 0.0, 1.0]]
"""
LOG_TOML = 'format = "graphslam-log/1"\n' + ROBOT
WHEELS = "t,left,right\n0,0,0\n1,10,10\n2,20,22\n3,31,33\n"


def write_log(folder: Path, **files: str | bytes | None) -> Path:
    """Writes a log folder: a robot and four wheel readings, then ``files``; returns the folder.

    Names are given with ``_`` for the dot before the ending (``sightings_csv``); None leaves a file
    out.
    """
    content: dict[str, str | bytes | None] = {"log_toml": LOG_TOML, "wheels_csv": WHEELS, **files}
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in content.items():
        if data is not None:
            path = folder / ".".join(name.rsplit("_", 1))
            path.write_bytes(data.encode() if isinstance(data, str) else data)
    return folder
