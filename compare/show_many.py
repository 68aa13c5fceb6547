"""How a batch, and two maps held against each other, show themselves in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

from compare.plots_style import style
from compare.report_tables import number

if TYPE_CHECKING:
    from compare.batch import Batch
    from compare.two_maps import MapPair

SHOWN = ("aligned_rmse_m", "map_rmse_m", "pose_nees", "position_sigma_m", "landmarks")
"""Figures of a batch in its table."""


def pair_html(pair: MapPair) -> str:
    """Returns two maps held against each other: verdict, reasons, both drawn, line by line."""
    from compare.plots_two_maps import plan
    from compare.two_maps_tables import line_headings, line_rows
    from compare.two_maps_words import path_sentence, reasons, verdict

    path = [] if pair.path is None else [path_sentence(pair.path)]
    with style():
        picture = plan(pair, "plan").svg
    lines = ""
    if pair.test is not None:
        rows = [[row["label"], *row["cells"]] for row in line_rows(pair)]
        lines = _table(["line of the first", *line_headings(pair)], rows)
    title = f"<b>{escape(pair.a.label)} against {escape(pair.b.label)}</b>"
    points = "".join(f"<li>{escape(text)}</li>" for text in [*reasons(pair), *path])
    return f"<div>{title}<p>{escape(verdict(pair))}</p><ul>{points}</ul>{picture}{lines}</div>"


def batch_html(batch: Batch) -> str:
    """Returns a batch: its verdict, what failed, medians by method, and how they spread."""
    from compare.plots_batch import box_plots
    from compare.report_batch import verdict

    swept = bool(batch.points[0].values)
    rows = []
    for entry in batch.summary:
        summary, figure = entry.summary, entry.summary.figure
        if figure.name in SHOWN and summary.runs:
            values = (summary.median, summary.mean, summary.worst)
            cells = [
                summary.method,
                f"{figure.label} ({figure.unit})" if figure.unit else figure.label,
                *(number(figure.scale * value) for value in values),
                number(summary.runs),
            ]
            rows.append([*([batch.points[entry.point].label] if swept else []), *cells])
    plot = box_plots(batch)
    failed = [
        f"{' '.join(filter(None, (f.log, batch.points[f.point].label, f.method)))}: {f.reason}"
        for f in batch.failures
    ]
    told = "".join(f"<p>{escape(text)}</p>" for text in [*verdict(batch), *failed])
    headings = ["method", "figure", "median", "mean", "worst", "logs"]
    table = _table([*(["setting"] if swept else []), *headings], rows)
    return f"<div><b>{len(batch.logs)} logs</b>{told}{table}{plot.svg if plot else ''}</div>"


def _table(headings: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in headings)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
