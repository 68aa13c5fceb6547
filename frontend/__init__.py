"""The front-end: recordings to measurements.

The names below are imported when they are first used, so that ``import frontend`` costs nothing.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

_EXPORTS = {
    "Camera": "frontend.camera",
    "extract": "frontend.extract",
    "inspect": "frontend.inspect",
    "load_scenario": "frontend.simulate",
    "open_log": "frontend.log",
    "simulate": "frontend.simulate",
    "simulate_log": "frontend.simulate",
    "simulate_measurements": "frontend.simulate",
}

__all__ = sorted(_EXPORTS)


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_EXPORTS[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """A package whose submodules do not hide the functions of the same name.

    After importing ``frontend.extract`` Python binds that module to ``frontend.extract``;
    ``from frontend import extract`` shall give the function whatever was imported before.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _EXPORTS and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
