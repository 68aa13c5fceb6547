"""What can be compared: results, map files and truth, brought to one form."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from compare.map_files import ESTIMATE_FILE, MAP_FILE, read_map_file
from compare.results import RUN_FORMAT
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.geometry import Array
from graphslam.line_maps.line_map import LineMap
from graphslam.measurements import IntArray
from graphslam.models.line import LINE

Certainty = Literal["joint", "blocks", "exact", "unknown"]
PREFERRED = "smoother"
"""The method of a run that its folder stands for, if it is there."""
MERGED_FORMAT = "graphslam-merged-map/1"
"""Format of the file beside a merged map that tells what it is made of."""
LOG_FILE, RUN_FILE, MEASUREMENTS_FILE = "log.toml", "run.json", "measurements.npz"
METRICS_FILE = "metrics.json"


@dataclass(frozen=True, slots=True)
class Source:
    """A map, a path or both, whatever they were read from.

    Attributes:
        label: short name, unique in one comparison.
        what: what it is, for people.
        path: where it was read from.
        map: its lines in their own frame; may hold none.
        line_id: (M,) names of the lines.
        sightings: (M,) how many sightings support each line; 0 where nothing tells.
        certainty: what is known of the lines' uncertainty: their joint covariance, the covariance
            of each alone, that they are exact, or nothing (then they stand as exact).
        t: (N,) times of the path, s; may be none.
        pose: (N, 3) path, same frame as the lines.
        cov_floor: (N, 3, 3) its covariances, or None where unknown.
        logs: hashes of the logs it comes from, none where unknown.
        measurements: hash of the measurements it was estimated from, "" where unknown.
        estimate: all of the estimate, or None for what is none.
        run: folder of the run that it is from, or None.
        truth_errors: what ground truth says of it: RMS errors of path and map, m, each after one
            rigid motion of its own; None where not known.
    """

    label: str
    what: str
    path: Path
    map: LineMap
    line_id: IntArray
    sightings: IntArray
    certainty: Certainty
    t: Array
    pose: Array
    cov_floor: Array | None = None
    logs: tuple[str, ...] = ()
    measurements: str = ""
    estimate: Estimate | None = None
    run: Path | None = None
    truth_errors: tuple[float | None, float | None] = (None, None)

    @property
    def is_estimate(self) -> bool:
        """Whether its frame is the one in which a run began."""
        return self.run is not None


def open_source(path: Path | str) -> Source:
    """Returns what a path names.

    Args:
        path: a run's folder (its smoother, or else its last method with a map); one method's folder
            in it, or the estimate.npz or map.csv there; a log folder (its truth); a map file; or a
            path, ``*.tum``.

    Raises:
        BadConfig: it is nothing of these.
        BadLog: a table in it cannot be used.
        BadMeasurements: an estimate in it cannot be used.
    """
    path = Path(path)
    if (path / RUN_FILE).is_file():
        return _of_run(path)
    if (path / LOG_FILE).is_file():
        return _of_log(path)
    if path.suffix == ".tum":
        return _of_tum(path)
    if path.name == MAP_FILE and (path.parent / LOG_FILE).is_file():
        return _of_log(path.parent)
    return _of_map(path)


def open_sources(paths: tuple[Path, ...]) -> tuple[Source, ...]:
    """Returns what paths name, with labels that tell them apart: the paths themselves, if need be.

    Raises:
        BadConfig: one is named twice, or as for `open_source`.
    """
    sources = [open_source(path) for path in paths]
    for k, source in enumerate(sources):
        if any(source.path.resolve() == other.path.resolve() for other in sources[:k]):
            raise BadConfig(f"{source.path}: is given twice; leave one out")
    labels = [source.label for source in sources]
    return tuple(
        replace(source, label=str(source.path)) if labels.count(source.label) > 1 else source
        for source in sources
    )


def _of_run(folder: Path) -> Source:
    info = _run_info(folder)
    names = [name for name in info.get("methods", ()) if (folder / name / ESTIMATE_FILE).is_file()]
    if not names:
        raise BadConfig(f"{folder}: holds no estimate; use `graphslam run`")
    method = PREFERRED if PREFERRED in names else names[-1]
    return _of_map(folder / method)


def _of_map(path: Path) -> Source:
    """Returns a map file, or one method's folder."""
    file = read_map_file(path)
    rows, lines = file.landmarks.of_kind(LINE.kind)
    place = (file.landmarks.offsets()[rows][:, None] - 3 + np.arange(LINE.dim_landmark)).ravel()
    cov = file.cov[np.ix_(place, place)]
    certainty: Certainty = "joint" if file.joint else "blocks"
    if np.isnan(cov).any():
        certainty, cov = "unknown", np.zeros_like(cov)
    elif not cov.any():
        certainty = "exact"
    info = _run_info(file.path.parent.parent)
    source = Source(
        label=_label(file.path, info),
        what="map file",
        path=path,
        map=LineMap(lines.reshape(-1, 2), 0.5 * (cov + cov.T), file.landmarks.extent[rows]),
        line_id=file.landmarks.id[rows],
        sightings=file.landmarks.sightings[rows],
        certainty=certainty,
        t=np.zeros(0),
        pose=np.zeros((0, 3)),
        logs=_logs(info) or _merged_logs(file.path),
        measurements=info.get("fingerprints", {}).get("measurements", ""),
        run=file.path.parent.parent if info else None,
    )
    if file.path.name != ESTIMATE_FILE and file.path.suffix != ".npz":
        return source
    return _with_estimate(source, Estimate.load(file.path))


def _with_estimate(source: Source, estimate: Estimate) -> Source:
    errors = (None, None) if source.run is None else _truth_errors(source.run, estimate.method)
    return replace(
        source,
        what=f"{estimate.method} estimate",
        t=estimate.t,
        pose=estimate.pose,
        cov_floor=estimate.cov_floor,
        estimate=estimate,
        truth_errors=errors,
    )


def _truth_errors(run: Path, method: str) -> tuple[float | None, float | None]:
    """Returns what a run's metrics.json says of the path and the map of one of its methods."""
    figures = _content(run / METRICS_FILE).get("methods", {}).get(method, {})
    path, map_ = figures.get("trajectory") or {}, figures.get("map") or {}
    return path.get("aligned_rmse_m"), map_.get("rho_rmse_m")


def _label(file: Path, info: dict[str, Any]) -> str:
    folder = file.resolve().parent
    if info:
        return f"{info['log']['name']} ({folder.name})"
    return folder.name if file.name in (MAP_FILE, ESTIMATE_FILE) else file.stem


def _of_log(folder: Path) -> Source:
    from frontend.log import open_log

    log = open_log(folder)
    if log.map is None and log.truth is None:
        raise BadConfig(
            f"{folder}: is a log without truth (no map.csv, no groundtruth.tum): there is nothing "
            "to compare; give the folder that `graphslam run` made of it"
        )
    rows, lines = (np.zeros(0, np.int64), np.zeros((0, 2)))
    extent, line_id = np.zeros((0, 2)), rows
    if log.map is not None:
        rows, lines = log.map.of_kind(LINE.kind)
        extent, line_id = log.map.extent[rows], log.map.id[rows]
    return Source(
        label=f"{log.name} (truth)",
        what="truth of a log",
        path=folder,
        map=LineMap.exact(lines.reshape(-1, 2), extent),
        line_id=line_id,
        sightings=np.zeros(len(lines), np.int64),
        certainty="exact",
        t=np.zeros(0) if log.truth is None else log.truth.t,
        pose=np.zeros((0, 3)) if log.truth is None else log.truth.pose,
        logs=(log.digest,),
    )


def _of_tum(path: Path) -> Source:
    from compare.interchange.tum import read_tum

    track, info = read_tum(path), _run_info(path.resolve().parent.parent)
    nothing = np.zeros(0, np.int64)
    return Source(
        label=path.stem if not info else f"{info['log']['name']} ({path.resolve().parent.name})",
        what="path file",
        path=path,
        map=LineMap.exact(np.zeros((0, 2)), np.zeros((0, 2))),
        line_id=nothing,
        sightings=nothing,
        certainty="unknown",
        t=track.t,
        pose=track.pose,
        logs=_logs(info),
        measurements=info.get("fingerprints", {}).get("measurements", ""),
        run=path.resolve().parent.parent if info else None,
    )


def _logs(info: dict[str, Any]) -> tuple[str, ...]:
    digest = info.get("log", {}).get("digest", "")
    return (digest,) if digest else ()


def _merged_logs(file: Path) -> tuple[str, ...]:
    """Returns the logs behind a merged map; none where the file is none of ours."""
    content = _content(file.with_suffix(".json"))
    return tuple(content.get("logs", ())) if content.get("format") == MERGED_FORMAT else ()


def _run_info(folder: Path) -> dict[str, Any]:
    """Returns the content of a run's run.json; empty where the folder is none of a run."""
    content = _content(folder / RUN_FILE)
    return content if content.get("format") == RUN_FORMAT else {}


def _content(path: Path) -> dict[str, Any]:
    """Returns what a JSON file holds; empty where it holds no object, or cannot be read."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}
