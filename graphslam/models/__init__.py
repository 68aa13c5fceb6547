"""Sensor and motion models: one file each, values and Jacobians from one call, pure functions.

`MODELS` maps a kind of sighting to its model. Filter, graph and comparison look kinds up here and
know none of them by name: a new sensor is a new file and a new entry.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from graphslam.models.base import Model
from graphslam.models.bearing import BEARING
from graphslam.models.lamp import LAMP
from graphslam.models.line import LINE
from graphslam.models.pose_fix import POSE_FIX

MODELS: Mapping[str, Model] = MappingProxyType({m.kind: m for m in (BEARING, LAMP, LINE, POSE_FIX)})

__all__ = ["MODELS", "Model"]
