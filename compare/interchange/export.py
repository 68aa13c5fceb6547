"""Results as files for other programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from compare.folders import whole_file, writing
from compare.interchange.dxf import dxf_text
from compare.interchange.formats import TABLES, Format, Table
from compare.interchange.g2o_write import g2o_text
from compare.interchange.latex import figures_latex, map_latex
from compare.interchange.tables import table_csv, table_json
from compare.record import Record
from compare.results import tum_text
from compare.walls import plan_layers
from graphslam.errors import BadConfig
from graphslam.plan import plan_svg

TRUTH, RERUN = "truth", "rerun"
PREFERRED = "smoother"
"""Whose path and map are exported where none is named, if the run has it."""
PLAN_SIZE = 960
"""Of the longer side of an SVG plan on the screen, pixels."""

Exporter = Callable[[Record, str, Table], str]
"""Makes the content of a file from a run, a method's name and the table asked for."""


def export(
    result: Path | str,
    to: Format,
    out: Path | str,
    method: str | None = None,
    table: Table = "figures",
) -> Path:
    """Writes a result as a file for other programs, and returns the file's path.

    Args:
        result: a folder that `run` wrote, or one method's folder in it.
        to: the format.
        out: the file; one that is there is replaced.
        method: whose path or map; "truth" for the true poses at the nodes (TUM only). None: the
            method whose folder ``result`` is, else the smoother, else the run's last.
        table: what CSV, JSON and LaTeX show: all methods' figures, or one method's map or path.

    Raises:
        BadConfig: the folder is not one of a run, or has not what was asked for.
        BadMeasurements: its files contradict each other.
        OSError: the file cannot be written.
    """
    if to not in (*EXPORTERS, RERUN):
        raise BadConfig(f"cannot export to {to!r}; known: {', '.join((*EXPORTERS, RERUN))}")
    if table not in TABLES:
        raise BadConfig(f"there is no table {table!r}; known: {', '.join(TABLES)}")
    out = Path(out)
    if out.is_dir():
        raise BadConfig(f"{out}: is a folder; give the file to write")
    record, folder_method = _open(Path(result))
    if to == RERUN:
        return _rerun(record, out)
    text = EXPORTERS[to](record, _method(record, method or folder_method, to), table)
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(out) as beside:
            beside.write_text(text, encoding="utf-8", newline="\n")
    return out


def _rerun(record: Record, out: Path) -> Path:
    from compare.interchange.rerun_view import write_rerun

    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(out) as beside:
            write_rerun(record, beside)
    return out


def _open(result: Path) -> tuple[Record, str | None]:
    """Returns the run that a folder is, or is a method's part of; and that method's name."""
    if (result / "estimate.npz").is_file():
        return Record.load(result.resolve().parent), result.resolve().name
    return Record.load(result), None


def _method(record: Record, asked: str | None, to: Format) -> str:
    known = list(record.estimates)
    if asked is None:
        return PREFERRED if PREFERRED in known else known[-1]
    if asked == TRUTH and to == "tum":
        return TRUTH
    if asked not in known:
        raise BadConfig(f"the run has no method {asked!r}; it has {', '.join(known)}")
    return asked


def _tum(record: Record, method: str, table: Table) -> str:
    if method != TRUTH:
        estimate = record.estimates[method]
        return tum_text(estimate.t, estimate.pose)
    if not record.has_true_pose:
        raise BadConfig("the run has no true path: its log has no groundtruth.tum at the nodes")
    return tum_text(record.truth.t, record.truth.pose)


def _g2o(record: Record, method: str, table: Table) -> str:
    return g2o_text(record.measurements, record.estimates[method])


def _dxf(record: Record, method: str, table: Table) -> str:
    return dxf_text(plan_layers(record, method))


def _svg(record: Record, method: str, table: Table) -> str:
    plan = plan_svg(plan_layers(record, method, numbered=False), PLAN_SIZE)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{plan}\n'


def _latex(record: Record, method: str, table: Table) -> str:
    if table == "path":
        raise BadConfig(
            "a path has a row for every node, which no printed table holds; take csv, json or tum"
        )
    if table == "map":
        return map_latex(record.estimates[method], record.metrics["log"])
    return figures_latex(record.metrics)


def _csv(record: Record, method: str, table: Table) -> str:
    return table_csv(record, table, method)


def _json(record: Record, method: str, table: Table) -> str:
    return table_json(record, table, method)


EXPORTERS: Mapping[Format, Exporter] = MappingProxyType(
    {
        "tum": _tum,
        "g2o": _g2o,
        "dxf": _dxf,
        "svg": _svg,
        "csv": _csv,
        "json": _json,
        "latex": _latex,
    }
)
