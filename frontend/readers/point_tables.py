"""The tables of a log folder about landmarks that are no lines, and about their sightings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from frontend.log_parts import BearingSightings, LampSightings
from frontend.readers.folder_tables import check_radians, covariances, received
from frontend.strict import nearest
from frontend.table import Table, read_table
from graphslam.geometry import Array
from graphslam.measurements import LandmarkMap
from graphslam.models.bearing import BEARING
from graphslam.models.lamp import LAMP

KINDS = (BEARING.kind, LAMP.kind)
"""Kinds of landmarks that landmarks.csv may hold."""
LAMP_SIGMA = (0.02, 0.02, math.radians(2.0))
"""Noise of lamps.csv where it gives none: x and y in m, phi in rad."""
POINT_COV = ("cov_xx", "cov_xy", "cov_yy")
LAMP_COV = ("cov_xx", "cov_xy", "cov_xp", "cov_yy", "cov_yp", "cov_pp")


def read_bearings(path: Path, known: LandmarkMap | None) -> BearingSightings:
    """Returns ``bearings.csv``.

    Args:
        path: the table.
        known: the log's landmarks, which the column ``landmark`` names, or None.
    """
    table = read_table(
        path,
        ("t", "bearing", "sigma"),
        ("landmark", "label", "t_received"),
        whole=("landmark", "label"),
    )
    table.check_times(repeats=True)
    check_radians(table, "bearing")
    table.check(table.numbers["sigma"] <= 0, "sigma = {sigma} is not positive; write radians")
    table.check(table.numbers["sigma"] > math.pi, "sigma = {sigma} is beyond pi; write radians")
    none = np.full(len(table), -1.0)
    label, truth = table.numbers.get("label", none), table.numbers.get("landmark", none)
    table.check(label < -1, "label = {label} is no label; write 0 or more, or -1 for none")
    _check_named(table, truth, known, BEARING.kind)
    return BearingSightings(
        t=table.numbers["t"],
        z=table.stack("bearing"),
        cov=np.square(table.numbers["sigma"])[:, None, None],
        label=label,
        truth=truth,
        t_received=received(table),
    )


def read_lamps(path: Path, known: LandmarkMap | None) -> LampSightings:
    """Returns ``lamps.csv``.

    Args:
        path: the table.
        known: the log's landmarks, which the column ``landmark`` names, or None.
    """
    table = read_table(
        path, ("t", "x", "y", "phi"), (LAMP_COV, "landmark", "t_received"), whole=("landmark",)
    )
    table.check_times(repeats=True)
    check_radians(table, "phi")
    truth = table.numbers.get("landmark", np.full(len(table), -1.0))
    _check_named(table, truth, known, LAMP.kind)
    return LampSightings(
        t=table.numbers["t"],
        z=table.stack("x", "y", "phi"),
        cov=covariances(table, LAMP_COV, LAMP_SIGMA),
        truth=truth,
        t_received=received(table),
    )


def read_landmarks(path: Path) -> LandmarkMap:
    """Returns ``landmarks.csv``: known landmarks of kinds that are points, not lines."""
    table = read_table(
        path,
        ("landmark", "kind", "x", "y"),
        ("phi", "label", *POINT_COV, "cov_pp", "sightings"),
        text=("kind",),
        whole=("landmark", "label", "sightings"),
        blank=("phi", *POINT_COV, "cov_pp"),
    )
    ids, kinds = table.numbers["landmark"], table.texts["kind"]
    phi = table.numbers.get("phi", np.full(len(table), np.nan))
    for row, kind in enumerate(kinds):
        if kind not in KINDS:
            raise table.error(row, f"kind = {kind!r} is not read; {nearest(kind, KINDS)}")
    lamp = np.array([kind == LAMP.kind for kind in kinds], bool)
    table.check(lamp & np.isnan(phi), "phi is missing; write the direction of the lamp's axis, rad")
    table.check(~lamp & ~np.isnan(phi), "phi = {phi}, but only a lamp has an axis; leave it empty")
    if "phi" in table:
        check_radians(table, "phi")
    table.check(ids < 0, "landmark = {landmark} is negative; number the landmarks from 0")
    label = table.numbers.get("label", np.full(len(table), -1.0))
    table.check(label < -1, "label = {label} is no label; write 0 or more, or -1 for none")
    first = np.zeros(len(table), bool)
    named = np.column_stack([lamp, ids])  # two kinds may have one number
    first[np.unique(named, axis=0, return_index=True)[1]] = True
    table.check(~first, "landmark = {landmark} is there twice; give each a number of its own")
    place = table.stack("x", "y")
    return LandmarkMap(
        ids.astype(np.int64),
        kinds,
        np.column_stack([place, phi]) if lamp.any() else place,
        np.full((len(table), 2), np.nan),
        np.zeros(len(table), np.int64),
        label.astype(np.int64),
    )


def _check_named(table: Table, truth: Array, known: LandmarkMap | None, kind: str) -> None:
    """Raises BadLog where the column ``landmark`` names none of a kind in landmarks.csv."""
    table.check(truth < -1, "landmark = {landmark} is no landmark; write its number, or -1")
    if known is not None:
        ids = known.id[known.of_kind(kind)[0]]
        message = (
            f"landmark = {{landmark}} is no {kind} in landmarks.csv; add it there, or write -1"
        )
        table.check((truth >= 0) & ~np.isin(truth, ids), message)
