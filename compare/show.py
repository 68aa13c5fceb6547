"""How results show themselves in a notebook: the verdict, a table of methods, and a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from compare.console import CLAIMED, JUDGED, first_of, millimetres
from compare.plots_style import method_colour
from compare.report_summary import summary
from graphslam.estimate import Estimate
from graphslam.plan import Layer, estimate_layers, plan_svg
from graphslam.show import MOST_POINTS, PLAN_SIZE

BAR_WIDTH, ROW_HEIGHT, LABEL_WIDTH = 260, 18, 150
"""Of the bars of the picture, pixels."""


def comparison_html(metrics: Mapping[str, Any]) -> str:
    """Returns a comparison as HTML: verdict, figures of all methods, and bars of their errors.

    Args:
        metrics: content of ``metrics.json``.
    """
    return f"<div>{_verdict(metrics)}{_table(metrics)}{_bars(metrics)}</div>"


def result_html(metrics: Mapping[str, Any], estimates: Mapping[str, Estimate]) -> str:
    """Returns a run as HTML: verdict, figures of all methods, and the plan of the floor.

    Args:
        metrics: content of ``metrics.json``.
        estimates: by method.
    """
    if not estimates:
        return "<div>measurements only: no method was run</div>"
    layers = [layer for name, made in estimates.items() for layer in _layers(name, made)]
    names = ", ".join(
        f'<span style="color:{method_colour(name)}">{escape(name)}</span>' for name in estimates
    )
    return (
        f"<div>{_verdict(metrics)}{_table(metrics)}"
        f'<figure style="margin:0">{plan_svg(layers, PLAN_SIZE, MOST_POINTS)}<figcaption>Floor '
        f"frame, metres: {names}. Lines with their numbers, paths, and the last positions' "
        "ellipses of 95 % probability.</figcaption></figure></div>"
    )


def _layers(name: str, estimate: Estimate) -> Sequence[Layer]:
    colour = method_colour(name)
    return [
        Layer(layer.name, layer.polylines, layer.labels, colour)
        for layer in estimate_layers(estimate, name)
    ]


def _verdict(metrics: Mapping[str, Any]) -> str:
    title = f"<b>{escape(metrics['log'])}</b>" if metrics["log"] else ""
    return title + "".join(f"<p>{escape(sentence)}</p>" for sentence in metrics["verdict"][:1])


def _table(metrics: Mapping[str, Any]) -> str:
    heads = "".join(
        f'<th style="text-align:right">{escape(name)}</th>' for name in metrics["methods"]
    )
    rows = []
    for group in summary(metrics):
        note = f" ({group['note']})" if group["note"] else ""
        span = 1 + len(metrics["methods"])
        title = escape(group["title"] + note)
        rows.append(f'<tr><th colspan="{span}" style="text-align:left">{title}</th></tr>')
        for row in group["rows"]:
            cells = "".join(
                f'<td style="text-align:right">{_emphasis(**cell)}</td>' for cell in row["cells"]
            )
            label = escape(row["label"])
            rows.append(f'<tr><td style="text-align:left">{label}</td>{cells}</tr>')
    return f"<table><thead><tr><th></th>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _emphasis(text: str, best: bool) -> str:
    return f"<b>{escape(text)}</b>" if best else escape(text)


def _bars(metrics: Mapping[str, Any]) -> str:
    """Returns a picture of what the command line's table says: one bar a figure and method."""
    methods = metrics["methods"]
    judged = any(entry["trajectory"] or entry["map"] for entry in methods.values())
    parts, y = [], 0
    for heading, paths in (JUDGED if judged else CLAIMED).items():
        values = {name: first_of(entry, paths) for name, entry in methods.items()}
        known = {name: value for name, value in values.items() if value is not None}
        if not known:
            continue
        parts.append(f'<text x="0" y="{y + 13}" font-weight="bold">{escape(heading)}</text>')
        y += ROW_HEIGHT
        for name, value in known.items():
            parts.append(_bar(name, value, max(known.values()), y))
            y += ROW_HEIGHT
    width = LABEL_WIDTH + BAR_WIDTH + 90
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{y}" role="img" '
        f'aria-label="Errors by method" font-family="sans-serif" font-size="12" '
        f'fill="currentColor">{"".join(parts)}</svg>'
    )


def _bar(name: str, value: float, largest: float, y: int) -> str:
    length = BAR_WIDTH * value / largest if largest > 0 else 0.0
    return (
        f'<text x="12" y="{y + 13}">{escape(name)}</text>'
        f'<rect x="{LABEL_WIDTH}" y="{y + 3}" width="{length:.1f}" height="{ROW_HEIGHT - 6}" '
        f'fill="{method_colour(name)}"/>'
        f'<text x="{LABEL_WIDTH + length + 6:.1f}" y="{y + 13}">{millimetres(value)}</text>'
    )
