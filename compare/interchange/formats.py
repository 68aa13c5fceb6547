"""Names of formats and tables; a module of its own, so that ``--help`` needs nothing heavy."""

from __future__ import annotations

from typing import Literal, get_args

Format = Literal[
    "tum", "g2o", "dxf", "svg", "csv", "json", "latex", "rerun",
    "folder", "mcap", "rosbag1", "rosbag2",
]  # fmt: skip
RECORDINGS: tuple[str, ...] = ("folder", "mcap", "rosbag1", "rosbag2")
"""Formats of recordings: they are made of a log; all others of a result."""
Table = Literal["figures", "map", "path"]
TABLES: tuple[str, ...] = get_args(Table)
