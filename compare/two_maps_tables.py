"""Tables of a comparison of two maps, and the content of its comparison.json."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from compare.content import plain
from compare.metrics import rms
from compare.report_tables import DASH, fixed, number
from compare.two_maps import MapPair
from compare.two_maps_overview import alternatives, motion_content
from compare.two_maps_sources import Source
from compare.two_maps_words import (
    CERTAINTY,
    expected,
    in_sigmas,
    reasons,
    smaller_sigma,
    verdict,
)
from compare.two_paths import PathDifference

FORMAT = "graphslam-map-comparison/1"


def facts(source: Source) -> dict[str, str]:
    """Returns what the head of the report says about a source."""
    return {
        "label": source.label,
        "what": source.what,
        "lines": number(len(source.map)) if len(source.map) else DASH,
        "certainty": CERTAINTY[source.certainty] if len(source.map) else DASH,
        "poses": number(len(source.t)) if len(source.t) else DASH,
    }


def line_headings(pair: MapPair) -> list[str]:
    """Returns the headings of `line_rows`, the number in the first map aside."""
    sigma = "σ" if pair.relation.independent else "own σ"
    return [
        "line of the second", "ρ (m)", "α (°)", "Δρ (mm)", "common (m)", f"offset ± {sigma} (mm)",
        f"in {sigma}", f"Δα ± {sigma} (°)", f"in {sigma}",
    ]  # fmt: skip


def line_columns(pair: MapPair) -> dict[str, Any]:
    """Returns the differences of all matched lines, one a row; units in the names."""
    test, alignment = pair.test, pair.alignment
    assert test is not None
    assert alignment is not None
    i, j = test.matches.T
    sigma = test.sigma if pair.relation.independent else smaller_sigma(test)
    share = in_sigmas(test, pair.relation.independent)
    return {
        "first": [pair.a.label] * len(i),
        "second": [pair.b.label] * len(i),
        "line_first": pair.a.line_id[i],
        "line_second": pair.b.line_id[j],
        "rho_first_m": pair.a.map.lines[i, 0],
        "alpha_first_deg": np.degrees(pair.a.map.lines[i, 1]),
        "common_m": np.maximum(alignment.common[:, 1] - alignment.common[:, 0], 0.0),
        "d_rho_mm": 1e3 * test.d_line[:, 0],
        "offset_mm": 1e3 * test.offset,
        "sigma_offset_mm": 1e3 * sigma[:, 0],
        "offset_in_sigma": share[:, 0],
        "d_alpha_deg": np.degrees(test.d_line[:, 1]),
        "sigma_alpha_deg": np.degrees(sigma[:, 1]),
        "alpha_in_sigma": share[:, 1],
        "own_sigma_offset_first_mm": 1e3 * test.sigma_a[:, 0],
        "own_sigma_offset_second_mm": 1e3 * test.sigma_b[:, 0],
    }


def line_rows(pair: MapPair) -> list[dict[str, Any]]:
    """Returns the table of matched lines as texts."""
    table = line_columns(pair)
    rows = []
    for k in range(len(table["line_first"])):
        row = {name: column[k] for name, column in table.items()}
        cells = [
            str(row["line_second"]),
            fixed(row["rho_first_m"], 4),
            fixed(row["alpha_first_deg"], 2),
            fixed(row["d_rho_mm"], 2),
            fixed(row["common_m"], 2),
            f"{fixed(row['offset_mm'], 2)} ± {fixed(row['sigma_offset_mm'], 2)}",
            fixed(row["offset_in_sigma"], 1),
            f"{fixed(row['d_alpha_deg'], 3)} ± {fixed(row['sigma_alpha_deg'], 3)}",
            fixed(row["alpha_in_sigma"], 1),
        ]
        rows.append({"label": str(row["line_first"]), "cells": cells})
    return rows


def table_caption(pair: MapPair) -> str:
    """Returns what the columns of `line_rows` mean."""
    text = (
        "ρ and α: the first map’s line in its own frame. Differences are second minus first after "
        "the rigid motion that fits best, by the name the line has in the second map’s frame: Δρ "
        "about that map’s origin, the offset across the line at the middle of the stretch that "
        "both saw (“common”), Δα in angle. "
    )
    if pair.relation.independent:
        return text + (
            "σ: standard deviation of the difference by both maps’ covariances, the frame’s share "
            "taken out."
        )
    return text + (
        "Own σ: the smaller of both maps’ own standard deviations, the frame’s share taken out; "
        "the two maps’ errors are correlated, so their difference has a smaller σ that is not "
        "known."
    )


def numbers(path: PathDifference) -> dict[str, Any]:
    """Returns the paths' difference for comparison.json."""
    worst = int(np.argmax(path.distance))
    return {
        "common_times": len(path.t),
        "position_rms_m": rms(path.distance),
        "position_max_m": path.distance[worst],
        "position_max_at_s": path.t[worst],
        "last_position_m": path.distance[-1],
        "heading_rms_deg": math.degrees(rms(path.difference[:, 2])),
        "aligned_position_rms_m": path.aligned_rms_m,
    }


def content(pairs: Sequence[MapPair]) -> dict[str, Any]:
    """Returns comparisons in types that JSON knows, floats rounded, not finite ones None."""
    sources = [pairs[0].a, *(pair.b for pair in pairs)]
    found = {
        "format": FORMAT,
        "sources": [
            {
                **facts(s),
                "path": str(s.path),
                "lines": len(s.map),
                "poses": len(s.t),
                "path_error_by_truth_m": s.truth_errors[0],
                "map_error_by_truth_m": s.truth_errors[1],
            }
            for s in sources
        ],
        "pairs": [_pair(pair) for pair in pairs],
    }
    return dict(plain(found))


def _pair(pair: MapPair) -> dict[str, Any]:
    test, alignment, unsure = pair.test, pair.alignment, pair.ambiguity
    return {
        "first": pair.a.label,
        "second": pair.b.label,
        "verdict": verdict(pair),
        "because": reasons(pair),
        "tied": pair.tied,
        "same_measurements": pair.relation.same_measurements,
        "same_log": pair.relation.same_log,
        "independent": pair.relation.independent,
        "motion": motion_content(pair.motion),
        "alignment": alignment
        and {
            "matched": len(alignment.matches),
            "parts": len(alignment.parts),
            "only_first": pair.a.line_id[pair.only_a],
            "only_second": pair.b.line_id[pair.only_b],
            "agree_m": alignment.agree_m,
            "conflict_m": alignment.conflict_m,
            "expected_m": alignment.expected_m,
            "fixed": alignment.fixed,
            "cov_motion": alignment.cov,
        },
        "ambiguity": unsure
        and {
            "unique": unsure.unique,
            "second_over_best": unsure.ratio,
            "equal": alternatives(pair),
            "more": unsure.more,
            "periods_m": unsure.periods,
            "turns_deg": np.degrees(unsure.turns),
            "slide": unsure.slide,
            "in_question": pair.choice and pair.choice.in_question,
        },
        "test": test
        and {
            "chi2": test.chi2,
            "freedom": test.freedom,
            "probability": test.probability,
            "covariance_factor": test.scale,
            "largest_in_own_sigma": test.own,
            "excess_m": test.excess,
            "offset_rms_m": rms(test.offset),
            "offset_rms_expected_m": expected(test),
            "alpha_rms_deg": math.degrees(rms(test.d_line[:, 1])),
        },
        "lines": [] if test is None else _rows(line_columns(pair)),
        "path": None if pair.path is None else numbers(pair.path),
        "no_path": pair.no_path or None,
    }


def _rows(columns: dict[str, Any]) -> list[dict[str, Any]]:
    lists = zip(*(np.asarray(v).tolist() for v in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in lists]
