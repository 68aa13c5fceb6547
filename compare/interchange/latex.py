"""Tables for a paper, in LaTeX with the package booktabs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from compare.report_summary import summary
from compare.report_tables import DASH, fixed, number
from graphslam.estimate import Estimate
from graphslam.geometry import offset_error

SPECIAL = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "−": "$-$",
    "±": r"$\pm$",
    "ρ": r"$\rho$",
    "α": r"$\alpha$",
    "σ": r"$\sigma$",
    "χ": r"$\chi$",
    "Δ": r"$\Delta$",
    "²": r"$^2$",
    "°": r"$^\circ$",
    DASH: "--",
}


def escape(text: str) -> str:
    """Returns text that LaTeX prints as it stands."""
    return "".join(SPECIAL.get(character, character) for character in text)


def figures_latex(metrics: Mapping[str, Any]) -> str:
    """Returns the table of methods: a row a figure, a column a method, the best in bold.

    Args:
        metrics: content of ``metrics.json``.
    """
    methods = list(metrics["methods"])
    rows: list[str] = []
    for group in summary(metrics):
        note = f" ({group['note']})" if group["note"] else ""
        title = escape(group["title"] + note)
        rows += [r"\midrule", rf"\multicolumn{{{1 + len(methods)}}}{{l}}{{\emph{{{title}}}}} \\"]
        for row in group["rows"]:
            cells = [_cell(cell["text"], cell["best"]) for cell in row["cells"]]
            rows.append(_row([escape(row["label"]), *cells]))
    caption = f"Errors and claimed uncertainty by method on {metrics['log']}."
    head = _row(["", *(escape(name) for name in methods)])
    return _table("l" + "r" * len(methods), head, rows, escape(caption), "tab:methods")


def map_latex(estimate: Estimate, log: str) -> str:
    """Returns the table of one method's lines: where they are, and one sigma of it.

    The offset's sigma is across the line, at the middle of the stretch that was seen; at the foot
    of the normal from the origin where that is not known.
    """
    rows = [r"\midrule"]
    places, lines = estimate.map.of_kind("line")
    for place, (rho, alpha) in zip(places.tolist(), lines.tolist(), strict=True):
        extent = estimate.map.extent[place]
        middle = extent.mean() if np.isfinite(extent).all() else 0.0
        across = offset_error(np.eye(2), np.array(middle))
        cov = estimate.landmark_cov(place)
        texts = [
            str(estimate.map.id[place]),
            fixed(rho, 3),
            fixed(float(np.degrees(alpha)), 2),
            number(1e3 * float(np.sqrt(across @ cov @ across))),
            number(float(np.degrees(np.sqrt(cov[1, 1])))),
            fixed(extent[0], 2),
            fixed(extent[1], 2),
            str(estimate.map.sightings[place]),
        ]
        rows.append(_row([escape(text) for text in texts]))
    head = _row(
        [
            "line",
            r"$\rho$ (m)",
            r"$\alpha$ ($^\circ$)",
            r"$\sigma$ across (mm)",
            r"$\sigma_\alpha$ ($^\circ$)",
            "from (m)",
            "to (m)",
            "sightings",
        ]
    )
    caption = f"Lines of the map by {estimate.method} on {log}, floor frame."
    return _table("r" * 8, head, rows, escape(caption), "tab:map")


def texts_latex(
    headings: Sequence[str], rows: Sequence[Sequence[str]], caption: str, label: str
) -> str:
    """Returns a table of texts, the numbers in it to the right."""
    body = [r"\midrule", *(_row([escape(text) for text in row]) for row in rows)]
    head = _row([escape(text) for text in headings])
    return _table("r" * len(headings), head, body, escape(caption), label)


def _cell(text: str, best: bool) -> str:
    return rf"\textbf{{{escape(text)}}}" if best else escape(text)


def _row(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def _table(columns: str, head: str, rows: Sequence[str], caption: str, label: str) -> str:
    return "\n".join(
        [
            r"% needs \usepackage{booktabs}",
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{caption}}}",
            rf"\label{{{label}}}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            head,
            *rows,
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    )
