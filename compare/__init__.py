"""Estimates to answers: errors, consistency, agreement, and which method to use.

Names are imported when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "Comparison": "compare.comparison",
    "compare": "compare.comparison",
    "compare_maps": "compare.two_maps",
    "export": "compare.interchange.export",
    "load_result": "compare.record",
    "merge_maps": "compare.merge",
    "read_g2o": "compare.interchange.g2o_read",
    "read_map": "compare.map_files",
    "read_map_file": "compare.map_files",
    "read_tum": "compare.interchange.tum",
    "run_log": "compare.run",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'compare' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
