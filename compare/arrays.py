"""Results are values: their arrays cannot be written to."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np


def freeze_arrays(instance: Any) -> None:
    """Replaces every array of a frozen dataclass by a read-only copy; for ``__post_init__``."""
    for f in fields(instance):
        value = getattr(instance, f.name)
        if isinstance(value, np.ndarray):
            value = value.copy()
            value.flags.writeable = False
            object.__setattr__(instance, f.name, value)
