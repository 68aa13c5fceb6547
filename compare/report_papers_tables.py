"""The tables of the papers' report: what is printed, what we got, and why they differ."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from compare.metrics import rms
from compare.papers import MonteCarlo, Papers
from compare.papers_experiments import EXACT, VARIANTS, Experiment, seen_figures, shares
from compare.plots_papers import line_names
from compare.printed import PrintedPaper, printed_paper
from compare.record import Record
from compare.report_tables import DASH, fixed, number
from graphslam.geometry import Array, line_to_robot, nearest_twin
from graphslam.models.line import LINE

AGREES = 0.1
"""Share of the printed value within which ours agrees without a word."""


@dataclass(frozen=True, slots=True)
class Row:
    """One printed number beside ours.

    Attributes:
        label: what it is, with its unit.
        printed: key of the printed value; empty where the paper has none.
        ours: name of the figure of a run.
        decimals: of all numbers.
        scale: from the figure to the unit.
        why: why ours differs where it does.
    """

    label: str
    printed: str
    ours: str
    decimals: int = 0
    scale: float = 1.0
    why: str = ""


SIGHT = "The paper gives neither the pitch of the lines nor where the robot drives over them."
DRAWING = "Path and view are given in a drawing only."
ERRS = "Sightings, camera and map err otherwise: see “Why smaller?”."
MATCHES = "No sighting is far from its line: see “Why smaller?”."


def percent(label: str, printed: str, ours: str, why: str = "") -> Row:
    """Returns a row for a share, which the papers print in per cent."""
    return Row(label, printed, ours, 1, 100.0, why)


def metres(label: str, printed: str, ours: str, why: str = "") -> Row:
    """Returns a row for a length, m."""
    return Row(label, printed, ours, 3, 1.0, why)


def final_error(label: str, method: str, why: str = "") -> Row:
    """Returns a row for the final error of a method, m."""
    return metres(label, f"final_error_{method}", f"{method}.final_error_m", why)


def _localisation(views: str) -> tuple[Row, ...]:
    return (
        Row("images", "images", "images"),
        percent("sightings matched rightly, EKF (%)", "matched", "ekf.matched_share", MATCHES),
        percent("sightings matched wrongly, EKF (%)", "", "ekf.wrong_share"),
        Row("views of a line, each time over it", "views_per_line", "views_per_pass", 1),
        Row("views of a line in all", "views_per_line", "views_per_line", 1, 1.0, views),
        percent("steps with lines (%)", "steps_with_lines", "seen_share", SIGHT),
        percent("steps with one line (%)", "steps_one_line", "one_share", SIGHT),
        percent("steps with two lines (%)", "steps_two_lines", "two_share", SIGHT),
        final_error("final error, EKF (m)", "ekf", ERRS),
        final_error("final error, geometric correction (m)", "geometric", ERRS),
        final_error("final error, odometry (m)", "odometry", "It scatters widely over the seeds."),
        final_error("final error, smoother on the known map (m)", "smoother"),
        final_error("final error, particle filter (m)", "particle"),
        metres("path, EKF (RMS, m)", "", "ekf.rmse_m"),
        metres("path, geometric correction (RMS, m)", "", "geometric.rmse_m"),
        metres("path, smoother on the known map (RMS, m)", "", "smoother.rmse_m"),
        Row("NEES of the poses, EKF, per degree of freedom", "", "ekf.pose_nees", 2),
    )


MAP_WHY = "The wheels are ours; and no camera errs alike in all images."
ROWS: Mapping[str, tuple[Row, ...]] = {
    "experiment-1": _localisation("Most lines are driven over twice; the print counts one time."),
    "experiment-2": _localisation(""),
    "slam": (
        Row("steps", "steps", "images"),
        percent("steps with lines (%)", "steps_with_lines", "seen_share", DRAWING),
        percent("of these, with one line (%)", "seeing_steps_one_line", "one_of_seen", DRAWING),
        percent("of these, with two lines (%)", "seeing_steps_two_lines", "two_of_seen", DRAWING),
        percent("sightings matched rightly, EKF (%)", "matched", "ekf.matched_share", MATCHES),
        percent("sightings matched wrongly, EKF (%)", "", "ekf.wrong_share"),
        metres("map, ρ at the origin, EKF (RMS, m)", "map_rho", "ekf.rho_origin_rmse_m", MAP_WHY),
        Row("map, α, EKF (RMS, °)", "map_alpha", "ekf.alpha_rmse_deg", 2, 1.0, MAP_WHY),
        metres("map, ρ at the origin, smoother (RMS, m)", "", "smoother.rho_origin_rmse_m"),
        Row("map, α, smoother (RMS, °)", "", "smoother.alpha_rmse_deg", 2),
        Row("map lines that are one line twice, EKF", "", "ekf.duplicates"),
        final_error("final error, EKF (m)", "ekf"),
        final_error("final error, smoother (m)", "smoother"),
        final_error("final error, odometry (m)", "odometry"),
    ),
}
"""The rows of each experiment's table, by its key."""


def printed_value(experiment: Experiment, key: str) -> float:
    """Returns a printed number, or NaN where the paper has none."""
    paper = experiment.printed
    if key in ("map_rho", "map_alpha"):
        return printed_map_errors(paper)[key == "map_alpha"]
    found = paper.values.get(experiment.prefix + key)
    return math.nan if not key or found is None else found.value


def printed_map_errors(paper: PrintedPaper) -> tuple[float, float]:
    """Returns the RMS errors of rho (m) and alpha (degrees) of the printed feature map."""
    table = paper.tables["feature_map"]
    errors = [
        np.subtract(table.column(f"corrected_{name}"), table.column(f"actual_{name}"))
        for name in ("rho_m", "alpha_deg")
    ]
    return rms(errors[0]), rms(errors[1])


def image_figures(record: Record) -> dict[str, float]:
    """Returns the figures of a run through images under the names of those without."""
    figures: dict[str, Any] = dict(seen_figures(record.measurements, len(record.measurements.t)))
    for name, method in record.metrics["methods"].items():
        table = method["matching"] or {"correct": 0, "identifications": 0}
        right, taken = table["correct"], table["identifications"]
        figures |= shares(name, right, taken - right, method["sightings"])
        for part in ("trajectory", "map"):
            known = {k: v for k, v in (method[part] or {}).items() if isinstance(v, int | float)}
            figures |= {f"{name}.{key}": value for key, value in known.items()}
        figures[f"{name}.pose_nees"] = method["pose_nees"]
    return {k: math.nan if v is None else float(v) for k, v in figures.items()}


def comparison_rows(study: MonteCarlo, record: Record) -> list[dict[str, Any]]:
    """Returns the table of one experiment: printed, median and range of ours, images, and why."""
    found, rows = image_figures(record), []
    for row in ROWS[study.experiment.key]:
        printed = printed_value(study.experiment, row.printed)
        values, image = row.scale * study.values(row.ours), row.scale * found.get(row.ours, np.nan)
        middle = row.scale * study.median(row.ours)
        apart = abs(middle - printed) > AGREES * abs(printed)
        cells = [fixed(value, row.decimals) for value in (printed, middle)]
        cells += [_range(values, row.decimals), fixed(image, row.decimals)]
        rows.append({"label": row.label, "cells": cells, "why": row.why if apart else ""})
    return rows


def _range(values: Array, decimals: int) -> str:
    if not len(values):
        return DASH
    ends = [fixed(float(value), decimals) for value in (values.min(), values.max())]
    return ends[0] if ends[0] == ends[1] else " to ".join(ends)


def variant_rows(papers: Papers, key: str) -> list[dict[str, Any]]:
    """Returns what each variant does to an experiment, medians over the same seeds."""
    rows = []
    for variant in VARIANTS:
        study = papers.variant(key, variant)
        figures = [f"{method}.final_error_m" for method in SHOWN]
        figures += ["geometric.rmse_m", "ekf.rmse_m"]
        cells = [fixed(study.median(figure), 3) for figure in figures]
        cells.append(fixed(100.0 * study.median("ekf.matched_share"), 1))
        cells.append(number(study.median("ekf.pose_nees")))
        rows.append({"label": WHAT[variant], "cells": cells})
    experiment = papers.study(key).experiment
    said = [fixed(printed_value(experiment, f"final_error_{method}"), 2) for method in SHOWN]
    matched = fixed(printed_value(experiment, "matched"), 0)
    rows.append({"label": "as printed", "cells": [*said, DASH, DASH, matched, DASH]})
    return rows


SHOWN = ("odometry", "geometric", "ekf")
WHAT = {
    EXACT: "nothing: noise anew in each frame",
    "camera": "calibration off by 1.5 cm",
    "map": "map lines off by 1 cm, 0.5°",
    "noise held": "noise held each time over a line",
    "noise held, threefold": "the same, threefold",
}
"""The variants in words."""


def matching_rows(record: Record) -> list[dict[str, Any]]:
    """Returns SantanaSLAM's matching table, printed and ours, line by line, and its sums."""
    table = printed_paper("SantanaSLAM").tables["matching"]
    names = line_names(record)
    ours = {
        names.get(row["true_landmark"]): row
        for row in record.metrics["methods"]["ekf"]["matching"]["landmarks"]
    }
    columns = ("identifications", "correct", "incorrect")
    rows = []
    for line, *printed in zip(*map(table.column, ("line", *columns)), strict=True):
        found = ours.get(int(line), {"identifications": 0, "correct": 0, "incorrect": 0})
        rows.append((f"Line {int(line)}", printed, [found[c] for c in columns]))
    sums = [np.sum([row[i] for row in rows], axis=0).tolist() for i in (1, 2)]
    rows.append(("all", *sums))
    return [
        {"label": label, "cells": [*_matching_cells(printed), *_matching_cells(found)]}
        for label, printed, found in rows
    ]


def _matching_cells(counts: list[float]) -> list[str]:
    share = 100.0 * counts[1] / counts[0] if counts[0] else math.nan
    return [*(str(int(count)) for count in counts), fixed(share, 1)]


def feature_map_rows(record: Record) -> dict[str, Any]:
    """Returns SantanaSLAM's feature map, printed and ours, and the RMS errors of both.

    'Calculated' is in the frame in which the robot starts at (0, 0, 0), 'corrected' in the floor's.
    """
    table = printed_paper("SantanaSLAM").tables["feature_map"]
    estimate, start = record.estimates["ekf"], record.measurements.start_pose
    known = {
        row["true_line"]: estimate.map.params[row["row"], :2]
        for row in record.metrics["methods"]["ekf"]["map"]["lines"]
        if row["status"] == "matched"
    }
    rows, errors = [], []
    for name, actual in zip(record.truth.line_id.tolist(), record.truth.lines, strict=True):
        printed = [
            fixed(table.column(f"{stage}_{part}")[name], decimals)
            for stage in ("actual", "calculated", "corrected")
            for part, decimals in (("rho_m", 2), ("alpha_deg", 1))
        ]
        if name in known:
            corrected = nearest_twin(known[name], actual)
            calculated = LINE.canonical(
                line_to_robot(known[name], start)[None], np.full((1, 2), np.nan)
            )[0][0]
            errors.append(corrected - actual)
            ours = [*_line(calculated), *_line(corrected)]
        else:
            ours = [DASH] * 4
        rows.append({"label": printed[:2], "cells": [*printed[2:], *ours]})
    rho, alpha = printed_map_errors(printed_paper("SantanaSLAM"))
    e = np.array(errors).reshape(-1, 2)
    return {
        "rows": rows,
        "printed": [fixed(rho, 3), fixed(alpha, 1)],
        "ours": [fixed(rms(e[:, 0]), 3), fixed(math.degrees(rms(e[:, 1])), 1)],
    }


def _line(line: Array) -> list[str]:
    return [fixed(float(line[0]), 2), fixed(math.degrees(float(line[1])), 1)]
