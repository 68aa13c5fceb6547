"""What the report says about the data: worst residuals, lines per frame, shares within limits."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import chi2

from compare.plots_uncertainty import NEES_PROBABILITY, nees_band
from compare.record import Record
from compare.replay import worst_sightings
from compare.report_replay import jpeg_text, taken_for
from compare.report_tables import DASH, fixed, number
from graphslam.geometry import Array

MOST_LINES = 5
"""Lines per node that are counted one by one; more are counted together."""
NIS_LIMIT = 0.95


def worst_residuals(record: Record) -> dict[str, Any] | None:
    """Returns the sightings with the largest NIS of each method, with their frames."""
    rows = [
        _worst_row(record, name, row)
        for name, estimate in record.estimates.items()
        for row in worst_sightings(record.measurements, estimate).tolist()
    ]
    if not rows:
        return None
    return {
        "rows": rows,
        "pictures": any(row["picture"] for row in rows),
        "caption": "The sightings with the largest normalised innovation squared (the smoother: "
        f"residual over the sighting’s own noise), no unit. Limit: {NIS_LIMIT:.0%} of sightings "
        "whose noise is as stated lie below it. In the picture the sighting is drawn thick. Frame: "
        "file in the log’s folder.",
    }


def _worst_row(record: Record, method: str, row: int) -> dict[str, Any]:
    measurements, estimate = record.measurements, record.estimates[method]
    first, table = next((f, t) for f, t in measurements.tables() if f <= row < f + len(t))
    node = int(table.node[row - first])
    landmark = int(taken_for(estimate)[row])
    picture = _picture(record, row)
    return {
        "method": method,
        "nis": number(float(estimate.nis[row])),
        "limit": number(float(chi2.ppf(NIS_LIMIT, table.z.shape[1]))),
        "kind": table.kind.replace("_", " "),
        "sighting": row - first,
        "landmark": DASH if landmark < 0 else str(landmark),
        "t": fixed(float(measurements.t[node] - measurements.t[0]), 2),
        "node": node,
        "frame": DASH if picture is None else picture["name"],
        "picture": picture,
    }


def _picture(record: Record, row: int) -> dict[str, Any] | None:
    """Returns the thumbnail that shows a sighting, with the ends of all its lines."""
    frames = record.frames
    if frames is None or not len(at := np.flatnonzero(frames.sighting == row)):
        return None
    i = int(frames.frame[at[0]])
    lines = [
        {"ends": np.round(frames.ends[k].ravel(), 1).tolist(), "this": frames.sighting[k] == row}
        for k in np.flatnonzero(frames.frame == i)
    ]
    width, height = frames.size[i].tolist()
    size = {"width": width, "height": height}
    return {"name": frames.name[i], "jpeg": jpeg_text(frames, i), "lines": lines, **size}


def lines_per_node(record: Record) -> dict[str, Any]:
    """Returns at which share of the nodes how many sightings were seen, and used by each method.

    Source: SantanaSLAM Fig. 10 and the text above it.
    """
    measurements = record.measurements
    count = len(measurements.t)
    nodes = np.concatenate([np.zeros(0, int), *(t.node for _, t in measurements.tables())])
    columns = {"seen": nodes}
    for name, estimate in record.estimates.items():
        if estimate.used.any():
            columns[f"used by {name}"] = nodes[estimate.used]
    shares = [_shares(np.bincount(node, minlength=count)) for node in columns.values()]
    labels = ["none", *map(str, range(1, MOST_LINES + 1)), f"more than {MOST_LINES}"]
    rows = [
        {"label": label, "cells": [f"{share[i]:.1%}" for share in shares]}
        for i, label in enumerate(labels)
    ]
    mean = [fixed(len(node) / count, 2) for node in columns.values()]
    return {"columns": list(columns), "rows": rows, "mean": mean, "nodes": f"{count:,}"}


def _shares(per_node: Array) -> Array:
    capped = np.minimum(per_node, MOST_LINES + 1)
    return np.bincount(capped, minlength=MOST_LINES + 2) / len(per_node)


def within_limits(record: Record) -> dict[str, Any] | None:
    """Returns how many poses lie within their own limits, by method; None where not defined."""
    judged = record.metrics["methods"]
    names = [name for name in record.estimates if judged[name]["pose_nees"] is not None]
    if not names:
        return None
    low, high = nees_band()
    rows = []
    for name in names:
        error = record.pose_error(name)[1:]
        variance = np.diagonal(record.estimates[name].cov_floor, axis1=1, axis2=2)[1:]
        known = np.isfinite(error).all(axis=1)
        inside = np.mean(error[known] ** 2 <= 9.0 * variance[known], axis=0)
        nees = record.pose_nees(name)[1:][known]
        cells = [
            number(float(nees.mean())),
            *(
                f"{np.mean(part):.1%}"
                for part in (nees < low, (nees >= low) & (nees <= high), nees > high)
            ),
        ]
        rows.append({"method": name, "cells": [*cells, *(f"{share:.1%}" for share in inside)]})
    return {
        "headings": [
            "mean NEES / 3", "below the band", "in it", "above it",
            "x within 3σ", "y within 3σ", "heading within 3σ",
        ],
        "rows": rows,
        "caption": f"Shares of the nodes. An honest method has {NEES_PROBABILITY:.0%} in the band "
        f"({low:.3f} to {high:.2f}), half of the rest on either side, and 99.7 % of each "
        "coordinate within three sigma; the nodes of one run share their errors, so that a single "
        "run scatters widely around that.",
    }  # fmt: skip


def most_seen_line(record: Record) -> dict[str, Any] | None:
    """Returns what each method claims, at the end, of the line that it saw most; None without."""
    rows = []
    for name, estimate in record.estimates.items():
        row = estimate.map.most_seen("line")
        if row is None:
            continue
        cov = estimate.landmark_cov(row)
        rows.append(
            {
                "method": name,
                "cells": [
                    str(int(estimate.map.id[row])),
                    number(int(estimate.map.sightings[row])),
                    number(1e6 * float(cov[0, 0])),
                    number(float(np.degrees(np.degrees(cov[1, 1])))),
                ],
            }
        )
    headings = ["line", "sightings", "variance of ρ (mm²)", "variance of α (°²)"]
    return {"headings": headings, "rows": rows} if rows else None
