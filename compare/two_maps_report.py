"""The folder that `graphslam compare` writes: one page, its plots and numbers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from compare.interchange.latex import texts_latex
from compare.pages import template
from compare.plots_style import Plot, style, themed
from compare.plots_two_maps import colours, differences, path_differences, plan
from compare.results import whole_folder, write_csv, write_json
from compare.two_maps import MapPair
from compare.two_maps_overview import (
    ALTERNATIVE_HEADINGS,
    OVERVIEW_HEADINGS,
    alternative_rows,
    overview_rows,
)
from compare.two_maps_tables import (
    FORMAT,
    content,
    facts,
    line_columns,
    line_headings,
    line_rows,
    table_caption,
)
from compare.two_maps_words import path_sentence, reasons, verdict
from graphslam.errors import BadConfig

FILE = "comparison.json"


def write_comparison(pairs: Sequence[MapPair], folder: Path) -> Path:
    """Writes the page, comparison.json, lines.csv, lines.tex and plots/*; equal input, equal bytes.

    Args:
        pairs: at least one.
        folder: that of an earlier comparison is replaced, any other is refused.

    Returns:
        The report.

    Raises:
        BadConfig: the folder is somebody else's.
        OSError: it cannot be written.
    """
    with style():
        drawn = [_plots(pair, k, len(pairs)) for k, pair in enumerate(pairs, start=1)]
    with whole_folder(folder, check_comparison) as fresh:
        (fresh / "plots").mkdir()
        for plot in (plot for plots in drawn for plot in plots.values()):
            write_csv(fresh / "plots" / f"{plot.name}.csv", plot.data)
            _write(fresh / "plots" / f"{plot.name}.svg", plot.standalone())
        write_json(fresh / FILE, content(pairs))
        write_csv(fresh / "lines.csv", _all_lines(pairs))
        _write(fresh / "lines.tex", _latex(pairs))
        _write(fresh / "report.html", _page(pairs, drawn))
    return folder / "report.html"


def check_comparison(folder: Path) -> None:
    """Raises BadConfig where ``folder`` exists and holds no earlier comparison."""
    if not (folder.exists() or folder.is_symlink()):
        return
    try:
        found = json.loads((folder / FILE).read_text(encoding="utf-8"))
        ours = isinstance(found, dict) and found.get("format") == FORMAT
    except (OSError, ValueError, RecursionError):
        ours = False
    if not ours:
        raise BadConfig(
            f"{folder}: exists and is no earlier comparison (no {FILE} of ours), so it is not "
            "replaced; give another --out, or move it away"
        )


def _plots(pair: MapPair, number: int, count: int) -> dict[str, Plot]:
    suffix = "" if count == 1 else f"-{number}"
    made = {
        "plan": plan(pair, f"plan{suffix}"),
        "differences": differences(pair, f"differences{suffix}"),
        "paths": path_differences(pair, f"paths{suffix}"),
    }
    return {name: plot for name, plot in made.items() if plot is not None}


def _all_lines(pairs: Sequence[MapPair]) -> dict[str, Any]:
    """Returns the differences of all pairs' lines below each other."""
    tables = [line_columns(pair) for pair in pairs if pair.test is not None]
    if not tables:
        return {"first": [], "second": []}
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def _latex(pairs: Sequence[MapPair]) -> str:
    """Returns the tables of the common lines for a paper, one a pair."""
    return "\n".join(
        texts_latex(
            ["line of the first", *line_headings(pair)],
            [[row["label"], *row["cells"]] for row in line_rows(pair)],
            f"Lines of {pair.b.label} against those of {pair.a.label}. {table_caption(pair)}",
            f"tab:lines-{number}",
        )
        for number, pair in enumerate(pairs, start=1)
        if pair.test is not None
    )


def _page(pairs: Sequence[MapPair], drawn: Sequence[dict[str, Plot]]) -> str:
    sources = [pairs[0].a, *(pair.b for pair in pairs)]
    names = [source.label for source in sources]
    html: str = template("two_maps.html").render(
        title=_title(names),
        version=version("floorline-slam"),
        overview=overview_rows(pairs) if len(pairs) > 1 else [],
        overview_headings=OVERVIEW_HEADINGS,
        alternative_headings=ALTERNATIVE_HEADINGS,
        sources=[facts(source) for source in sources],
        pairs=[_section(*both) for both in zip(pairs, drawn, strict=True)],
    )
    return html


def _title(names: Sequence[str]) -> str:
    """Returns what the page is called; two methods of one run are named by the run once."""
    if len(names) > 2:
        return f"{names[0]} against {len(names) - 1} others"
    parts = [name.removesuffix(")").rpartition(" (") for name in names]
    if parts[0][0] and parts[0][0] == parts[1][0]:
        return f"{parts[0][0]}: {parts[0][2]} against {parts[1][2]}"
    return " against ".join(names)


def _section(pair: MapPair, plots: dict[str, Plot]) -> dict[str, Any]:
    rows = alternative_rows(pair)
    kept = pair.choice.in_question if pair.choice is not None else 0
    first, second = (themed(colour) for colour in colours(pair))
    return {
        "first": {"name": pair.a.label, "colour": first},
        "second": {"name": pair.b.label, "colour": second},
        "verdict": verdict(pair),
        "because": reasons(pair),
        "path": "" if pair.path is None else path_sentence(pair.path),
        "plots": plots,
        "headings": line_headings(pair) if pair.test is not None else [],
        "rows": line_rows(pair) if pair.test is not None else [],
        "caption": table_caption(pair),
        "in_question": rows[:kept],
        "ruled_out": rows[kept:],
        "independent": pair.relation.independent,
    }


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
