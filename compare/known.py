"""Measurements with landmarks that a file knows: a map of lines, or of corridors with lamps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from compare.map_files import read_map
from graphslam.measurements import Measurements

if TYPE_CHECKING:
    from compare.places.building import Building


def on_known_map(measurements: Measurements, path: str | None) -> Measurements:
    """Returns measurements with the landmarks of a map file as known ones, beside the log's own.

    Raises:
        BadConfig: the file is no map.
    """
    if path is None:
        return measurements
    known = read_map(path)
    if measurements.known is not None:
        known = known.joined(measurements.known)
    return replace(measurements, known=known)


def on_building(measurements: Measurements, building: Building, landmarks: str) -> Measurements:
    """Returns measurements with the lamps of a map of corridors as known ones.

    Not where lamps are known already, nor where ``landmarks`` says that they are to be mapped.
    """
    known, lamps = measurements.known, building.landmarks()
    if landmarks != "known" or not len(lamps) or (known is not None and "lamp" in known.kind):
        return measurements
    return replace(measurements, known=lamps if known is None else known.joined(lamps))
