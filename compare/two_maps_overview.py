"""Short tables of a comparison: every map against the first, and alignments that fit as well."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from compare.metrics import rms
from compare.report_tables import DASH, fixed, number
from compare.two_maps import MapPair
from compare.two_maps_words import expected, motion_figures, probability
from graphslam.geometry import Array

OVERVIEW_HEADINGS = (
    "common lines", "only first", "only second", "offset RMS (mm)", "expected (mm)",
    "χ² / freedom", "p", "path RMS (mm)", "aligned (mm)",
)  # fmt: skip
"""Headings of `overview_rows`, the second's name aside."""
ALTERNATIVE_HEADINGS = (
    "x (m)", "y (m)", "turn (°)", "lines", "in agreement (m)", "offset RMS (mm)",
    "χ² / freedom", "p",
)  # fmt: skip
"""Headings of `alternative_rows`."""


def overview_rows(pairs: Sequence[MapPair]) -> list[dict[str, Any]]:
    """Returns one row of texts for each pair: how each differs from the first."""
    return [{"label": pair.b.label, "cells": _cells(pair)} for pair in pairs]


def _cells(pair: MapPair) -> list[str]:
    test, path = pair.test, pair.path
    tested = test is not None and bool(test.freedom) and pair.relation.independent
    lines = [DASH] * 4 if test is None else [
        number(len(test.matches)), number(len(pair.only_a)), number(len(pair.only_b)),
        number(1e3 * rms(test.offset)),
    ]  # fmt: skip
    chance = [DASH] * 3
    if test is not None and tested:
        chance = [
            number(1e3 * expected(test)), number(test.per_freedom), _chance(test.probability)
        ]  # fmt: skip
    paths = [DASH] * 2
    if path is not None:
        paths = [number(1e3 * rms(path.distance)), number(1e3 * path.aligned_rms_m)]
    return [*lines, *chance, *paths]


def _chance(value: float) -> str:
    return probability(value).removeprefix("p ").removeprefix("= ")


def alternatives(pair: MapPair) -> list[dict[str, Any]]:
    """Returns all alignments that fit equally well for comparison.json, the one taken first."""
    assert pair.choice is not None
    return [
        {
            **motion_content(alignment.motion),
            "in_question": k < pair.choice.in_question,
            "matched": len(alignment.matches),
            "agree_m": alignment.agree_m,
            "offset_rms_m": rms(test.offset),
            "chi2": test.chi2,
            "freedom": test.freedom,
            "probability": test.probability,
        }
        for k, (alignment, test) in enumerate(
            zip(pair.alternatives, pair.choice.tests, strict=True)
        )
    ]


def alternative_rows(pair: MapPair) -> list[list[str]]:
    """Returns the table of alignments that fit equally well as texts; empty where only one does."""
    if len(pair.alternatives) < 2:
        return []
    return [
        [
            fixed(row["x_m"], 3),
            fixed(row["y_m"], 3),
            fixed(row["turn_deg"], 2),
            number(row["matched"]),
            fixed(row["agree_m"], 2),
            fixed(1e3 * row["offset_rms_m"], 2),
            number(row["chi2"] / row["freedom"] if row["freedom"] else None),
            _chance(row["probability"]) if row["freedom"] else DASH,
        ]
        for row in alternatives(pair)
    ]


def motion_content(motion: Array) -> dict[str, float]:
    """Returns a motion (3,) for JSON."""
    x, y, turn = motion_figures(motion)
    return {"x_m": x, "y_m": y, "turn_deg": turn}
