"""The report's table of methods: which figures it shows, and which of them is best."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from compare.report_tables import DASH, number
from compare.words import noun


@dataclass(frozen=True, slots=True)
class Figure:
    """One row of the summary.

    Attributes:
        label: what it is, with its unit; {one} and {several} stand for what was seen.
        path: keys that lead to it in a method's part of metrics.json.
        scale: factor from there to the unit of the label.
        best: which value is the best one.
    """

    label: str
    path: tuple[str, ...]
    scale: float = 1.0
    best: Callable[[Sequence[float]], float] | None = min


SUMMARY: tuple[tuple[str, str, str, tuple[Figure, ...]], ...] = (
    (
        "paths",
        "Path, from the common start",
        "not aligned",
        (
            Figure("position, RMS error (mm)", ("trajectory", "rmse_m"), 1e3),
            Figure("position, error at the end (mm)", ("trajectory", "final_error_m"), 1e3),
            Figure("heading, RMS error (°)", ("trajectory", "heading_rmse_deg")),
        ),
    ),
    (
        "paths",
        "Path, aligned",
        "after one rigid motion",
        (
            Figure("position, RMS error (mm)", ("trajectory", "aligned_rmse_m"), 1e3),
            Figure("position, error at the end (mm)", ("trajectory", "aligned_final_error_m"), 1e3),
            Figure("heading, RMS error (°)", ("trajectory", "aligned_heading_rmse_deg")),
        ),
    ),
    (
        "maps",
        "Map, aligned",
        "after a rigid motion of its own",
        (
            Figure("offset where seen, RMS (mm)", ("map", "rho_rmse_m"), 1e3),
            Figure("ρ at the origin, RMS (mm)", ("map", "rho_origin_rmse_m"), 1e3),
            Figure("angle, RMS (°)", ("map", "alpha_rmse_deg")),
        ),
    ),
    (
        "maps",
        "In the map",
        "",
        (Figure("{several}", ("landmarks",), best=None),),
    ),
    (
        "maps",
        "Lines",
        "",
        (
            Figure("seen in truth", ("map", "true_lines_seen"), best=None),
            Figure("matched", ("map", "matched"), best=max),
            Figure("missed", ("map", "missed")),
            Figure("spurious", ("map", "spurious")),
            Figure("duplicates", ("map", "duplicates")),
            Figure("out of view", ("map", "unseen"), best=None),
        ),
    ),
    (
        "maps",
        "Points",
        "from the common start, and after a rigid motion of their own",
        (
            Figure("seen in truth", ("points", "true_points_seen"), best=None),
            Figure("matched", ("points", "matched"), best=max),
            Figure("missed", ("points", "missed")),
            Figure("spurious", ("points", "spurious")),
            Figure("duplicates", ("points", "duplicates")),
            Figure("distance, RMS (mm)", ("points", "unaligned_rmse_m"), 1e3),
            Figure("distance, aligned, RMS (mm)", ("points", "rmse_m"), 1e3),
            Figure("NEES, per degree of freedom", ("points", "nees"), best=None),
        ),
    ),
    (
        "matching",
        "Sightings",
        "",
        (
            Figure("used", ("sightings_used",), best=None),
            Figure("matched rightly (%)", ("matching", "right_share"), 100.0, max),
            Figure("of true {several}, taken for nothing", ("matching", "missed")),
            Figure("landmarks beyond one a {one}", ("matching", "needless")),
        ),
    ),
    (
        "consistency",
        "Honesty of the covariance",
        "1 is honest",
        (
            Figure("NEES of the poses, per degree of freedom", ("pose_nees",), best=None),
            Figure("NEES of the map, per degree of freedom", ("map_nees",), best=None),
            Figure("NIS, per degree of freedom", ("nis_per_dof",), best=None),
        ),
    ),
    (
        "variance",
        "Claimed uncertainty",
        "one sigma",
        (
            Figure("position, RMS along the path (mm)", ("position_sigma_m",), 1e3, None),
            Figure("position, at the end (mm)", ("last_position_sigma_m",), 1e3, None),
            Figure("heading, RMS along the path (°)", ("heading_sigma_deg",), best=None),
        ),
    ),
)


def summary(metrics: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Returns the groups of the table of methods, and the page each belongs to.

    Groups without any figure are left out.
    """
    one, several = noun(metrics.get("kinds", ()))
    groups = []
    for page, title, note, figures in SUMMARY:
        rows = [_summary_row(figure, metrics["methods"]) for figure in figures]
        rows = [{**row, "label": row["label"].format(one=one, several=several)} for row in rows]
        rows = [row for row in rows if any(cell["text"] != DASH for cell in row["cells"])]
        if rows:
            groups.append({"page": page, "title": title, "note": note, "rows": rows})
    return groups


def _summary_row(figure: Figure, methods: Mapping[str, Any]) -> dict[str, Any]:
    values = [_at(entry, figure.path) for entry in methods.values()]
    if figure.path == ("landmarks",):
        values = [value or None for value in values]
    scaled = [None if v is None else v if figure.scale == 1.0 else figure.scale * v for v in values]
    known = [value for value in scaled if value is not None]
    texts = [number(value) for value in scaled]
    best = None
    if figure.best is not None and len(known) > 1:
        best = number(figure.best(known))
    apart = len(set(texts) - {DASH}) > 1
    cells = [{"text": text, "best": apart and text == best} for text in texts]
    return {"label": figure.label, "cells": cells}


def _at(entry: Any, path: Sequence[str]) -> Any:
    for key in path:
        entry = None if entry is None else entry.get(key)
    return entry
