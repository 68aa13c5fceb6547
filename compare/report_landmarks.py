"""What the report's tables of landmarks say, against the truth where there is one, as texts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from compare.record import Record
from compare.report_tables import DASH, fixed, number
from compare.words import landmark_kinds, noun


def landmark_table(record: Record) -> dict[str, Any] | None:
    """Returns the table of lines, against the truth where there is one; None without lines."""
    methods = {n: m["map"] for n, m in record.metrics["methods"].items() if m["map"]}
    if methods:
        return _against_truth(record, methods)
    return _without_truth(record)


def _against_truth(record: Record, maps: Mapping[str, Any]) -> dict[str, Any]:
    truth = record.truth
    by_line: dict[str, dict[int, Any]] = {}
    spurious: dict[str, list[Any]] = {}
    for name, figures in maps.items():
        first = [row for row in figures["lines"] if row["status"] in ("matched", "unseen")]
        by_line[name] = {row["true_line"]: row for row in reversed(first)}
        spurious[name] = [r for r in figures["lines"] if r not in by_line[name].values()]
    rows = []
    for i, line in enumerate(truth.line_id.tolist()):
        found = [by_line[name].get(line) for name in maps]
        if any(found):
            known = [fixed(truth.lines[i, 0], 4), fixed(math.degrees(truth.lines[i, 1]), 2)]
            rows.append({"line": line, "truth": known, "methods": [_cells(row) for row in found]})
    for k in range(max(len(extra) for extra in spurious.values())):
        found = [extra[k] if k < len(extra) else None for extra in spurious.values()]
        rows.append({"line": "extra", "truth": [DASH, DASH], "methods": [_cells(r) for r in found]})
    return {
        "title": "Landmarks",
        "truth": True,
        "methods": list(maps),
        "headings": ["ρ (m)", "α (°)", "offset ± σ (mm)", "Δα ± σ (°)", "seen"],
        "rows": rows,
        "caption": "ρ and α in the truth’s frame, after the map’s own rigid motion. Offset and Δα: "
        "estimate minus truth, the offset across the line at the middle of the seen stretch, with "
        "the method’s own σ. Seen: sightings behind the line. Extra: lines that are duplicates or "
        "no true lines.",
    }


def point_table(record: Record) -> dict[str, Any] | None:
    """Returns the table of points against the truth; None where there are none to judge."""
    maps = {n: m["points"] for n, m in record.metrics["methods"].items() if m["points"]}
    if not maps:
        return None
    truth, rows = record.truth, []
    for i, name in enumerate(truth.point_id.tolist()):
        found = [_point(figures, truth.point_kind[i], name) for figures in maps.values()]
        if any(found):
            known = [fixed(value, 3) for value in truth.points[i].tolist()]
            cells = [_point_cells(row) for row in found]
            one = noun([truth.point_kind[i]])[0]
            rows.append({"line": f"{one} {name}", "truth": known, "methods": cells})
    extra = [[p for p in f["points"] if p["status"] != "matched"] for f in maps.values()]
    for k in range(max(map(len, extra))):
        found = [rest[k] if k < len(rest) else None for rest in extra]
        cells = [_point_cells(row) for row in found]
        rows.append({"line": "extra", "truth": [DASH, DASH], "methods": cells})
    one, several = noun({p["kind"] for f in maps.values() for p in f["points"]})
    return {
        "one": one,
        "several": several,
        "methods": list(maps),
        "headings": ["x (m)", "y (m)", "Δx ± σ (mm)", "Δy ± σ (mm)", "seen"],
        "rows": rows,
        "caption": "Truth’s frame, moved so that the true path begins at the start, no further "
        "alignment. Δ: estimate minus truth, with the method’s own σ. Seen: sightings behind the "
        f"{one}. Extra: {several} that are duplicates or no true ones.",
    }


def nothing_judged(record: Record) -> str:
    """Returns why there is no table of landmarks."""
    if not any(len(estimate.map) for estimate in record.estimates.values()):
        return "No method has a landmark in its map."
    several = noun(landmark_kinds(record.measurements))[1]
    return (
        f"The {several} were known beforehand, or nothing tells where they truly are: the maps "
        "cannot be judged."
    )


def _point(figures: Any, kind: str, name: int) -> Mapping[str, Any] | None:
    """Returns the row of the point that stands for a true one, None where the map has none."""
    for row in figures["points"]:
        if row["status"] == "matched" and row["true_point"] == name and row["kind"] == kind:
            return dict(row)
    return None


def _point_cells(row: Mapping[str, Any] | None) -> list[str]:
    if row is None:
        return [DASH] * 5
    off = [
        f"{fixed(_scaled(row[f'd{axis}_m']), 1)} ± {fixed(_scaled(row[f'sigma_{axis}_m']), 1)}"
        for axis in "xy"
    ]
    return [fixed(row["x_m"], 3), fixed(row["y_m"], 3), *off, number(row["sightings"])]


def _cells(row: Mapping[str, Any] | None) -> list[str]:
    if row is None:
        return [DASH] * 5
    offset, sigma = (fixed(_scaled(row[key]), 2) for key in ("offset_m", "sigma_offset_m"))
    return [
        fixed(row["rho_m"], 4),
        fixed(_alpha_deg(row), 2),
        f"{offset} ± {sigma}",
        f"{fixed(row['d_alpha_deg'], 3)} ± {fixed(row['sigma_alpha_deg'], 3)}",
        number(row["sightings"]),
    ]


def _alpha_deg(row: Mapping[str, Any]) -> float:
    """Returns a line's angle without a jump of a whole turn against the true line's."""
    if row["d_alpha_deg"] is None:
        return float(row["alpha_deg"])
    return float(row["alpha_true_deg"] + row["d_alpha_deg"])


def _scaled(metres: float | None) -> float | None:
    return None if metres is None else 1e3 * metres


def _without_truth(record: Record) -> dict[str, Any] | None:
    """Returns the lines of the last method that has any, and how the one before it differs."""
    names = [n for n, e in record.estimates.items() if len(e.map.of_kind("line")[0])]
    if not names:
        return None
    name = names[-1]
    estimate = record.estimates[name]
    differences = _differences(record, names)
    rows = []
    numbers, lines = estimate.map.of_kind("line")
    for row, line in zip(numbers.tolist(), lines, strict=True):
        cov = estimate.landmark_cov(row)
        low, high = estimate.map.extent[row]
        cells = [
            fixed(line[0], 4),
            fixed(math.degrees(line[1]), 2),
            fixed(1e3 * math.sqrt(cov[0, 0]), 2),
            fixed(math.degrees(math.sqrt(cov[1, 1])), 3),
            fixed(high - low, 2),
            *[fixed(value, 2 + i) for i, value in enumerate(differences.get(row, (None, None)))],
            number(int(estimate.map.sightings[row])),
        ]
        rows.append({"line": int(estimate.map.id[row]), "truth": [], "methods": [cells]})
    other = f"{names[-2]} minus {name}" if len(names) > 1 else "no other map to compare with"
    return {
        "title": "Landmarks",
        "truth": False,
        "methods": [name],
        "headings": [
            "ρ (m)", "α (°)", "σ ρ (mm)", "σ α (°)", "length seen (m)", "differs (mm)", "by (°)",
            "sightings",
        ],
        "rows": rows,
        "caption": "Floor frame. σ of ρ at the origin grows with the distance of the stretch from "
        f"it. Differs: {other}, across the line at the middle of the common stretch.",
    }  # fmt: skip


def _differences(record: Record, names: Sequence[str]) -> dict[int, tuple[float, float]]:
    """Returns offset (mm) and angle (°) of the last but one map minus the last, by its rows."""
    found: dict[int, tuple[float, float]] = {}
    for entry in record.metrics["agreement"]:
        if entry["map"] and {entry["first"], entry["second"]} == set(names[-2:]):
            sign, key = (1.0, "row_first") if entry["first"] == names[-1] else (-1.0, "row_second")
            for row in entry["map"]["differences"]:
                found[row[key]] = (sign * 1e3 * row["offset_m"], sign * row["d_alpha_deg"])
    return found
