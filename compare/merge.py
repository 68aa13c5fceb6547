"""Two maps of one floor from files into one map file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from compare.content import plain
from compare.folders import whole_file, writing
from compare.results import map_columns, write_csv, write_json
from compare.two_maps import MapPair, compare_sources
from compare.two_maps_overview import motion_content
from compare.two_maps_sources import MERGED_FORMAT, Source, open_sources
from compare.two_maps_words import ambiguity_text, probability
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.merge import Merged, merge_line_maps
from graphslam.measurements import LandmarkMap
from graphslam.models.line import LINE

DOUBTFUL = 1e-3
"""Probability of the maps' differences below which merging them is doubtful."""


@dataclass(frozen=True, slots=True)
class MergedMap:
    """A merged map with where it came from.

    Attributes:
        pair: the two maps, aligned and tested.
        merged: the lines, in the first map's frame.
        estimate: the same as an estimate without a path: what `MAP.npz` holds.
        warnings: what makes the result doubtful.
    """

    pair: MapPair
    merged: Merged
    estimate: Estimate
    warnings: tuple[str, ...]


def merge_maps(
    a: Path | str,
    b: Path | str,
    out: Path | str | None = None,
    near: Sequence[float] | None = None,
    config: AlignmentConfig | None = None,
) -> MergedMap:
    """Returns two maps fused into one in the first's frame; the command `merge`.

    Args:
        a: a result, or a map file; see `compare.two_maps_sources.open_source`.
        b: the same.
        out: ``MAP.csv`` to write; the joint covariance goes beside it to ``MAP.npz``, and where
            each line came from to ``MAP.json``. None writes nothing.
        near: x (m), y (m) and turn (degrees) of b's frame in a's, to look near.
        config: tolerances; None for the defaults.

    Raises:
        BadConfig: the maps cannot be merged, or ``out`` is somebody else's; the message says why.
        BadLog: a table cannot be used.
        BadMeasurements: an estimate cannot be used.
        OSError: a file cannot be written.
    """
    if out is not None:
        _check_out(Path(out))
    sources = open_sources((Path(a), Path(b)))
    for source in sources:
        _check_source(source)
    start = None if near is None else np.array([near[0], near[1], np.radians(near[2])])
    [pair] = compare_sources(sources, start, config)
    _check_pair(pair)
    assert pair.alignment is not None
    merged = merge_line_maps(pair.a.map, pair.b.map, pair.alignment)
    result = MergedMap(pair, merged, _estimate(pair, merged), tuple(_warnings(pair)))
    if out is not None:
        _write(result, Path(out))
    return result


# ---- what can be merged -----------------------------------------------------------------------


def _check_source(source: Source) -> None:
    if not len(source.map):
        raise BadConfig(f"{source.path}: has no lines to merge; give a map with lines")
    if source.certainty == "unknown":
        raise BadConfig(
            f"{source.path}: does not say how uncertain its lines are, so it cannot be weighed; "
            "give the folder of one method, or a map.csv with cov_rr, cov_ra and cov_aa (all 0: "
            "known exactly)"
        )


def _check_pair(pair: MapPair) -> None:
    a, b = pair.a.path, pair.b.path
    if not pair.relation.independent:
        raise BadConfig(
            f"{b}: holds measurements of a log that {a} holds too, and merging would count them "
            "twice; give maps of different logs"
        )
    if pair.alignment is None:
        raise BadConfig(f"{b}: none of its lines agrees with {a}; is it the same floor?")
    if not pair.alignment.fixed:
        raise BadConfig(
            f"{b}: the common lines with {a} all run one way, so that nothing fixes the shift "
            "along them; merge maps that share lines of two directions"
        )
    if not pair.sure:
        best = motion_content(pair.alternatives[0].motion)
        raise BadConfig(
            f"{b}: {ambiguity_text(pair)}, so that nothing tells where it lies in {a}; say where "
            "its frame is, about, with --near X Y DEG (metres, metres, degrees), such as --near "
            f"{round(best['x_m'], 2) + 0.0} {round(best['y_m'], 2) + 0.0} {best['turn_deg']:.0f}"
        )


def _warnings(pair: MapPair) -> list[str]:
    found = []
    test = pair.test
    assert test is not None
    if test.freedom and test.probability < DOUBTFUL:
        found.append(
            "the maps differ by more than their covariances allow "
            f"({probability(test.probability)}): standard deviations of the merged map are too "
            f"small by a factor of about {test.per_freedom**0.5:.1f}"
        )
    for source in (pair.a, pair.b):
        if source.certainty == "blocks":
            found.append(
                f"{source.label}: a map.csv has no correlations between lines, so they count as "
                "independent; the method's folder or its estimate.npz has them"
            )
    return found


# ---- the result -------------------------------------------------------------------------------


def _estimate(pair: MapPair, merged: Merged) -> Estimate:
    """Returns the merged map in the form in which joint covariances are kept everywhere."""
    count = len(merged.map)
    ids = [int(pair.a.line_id[rows[0]]) for rows in merged.rows_a if rows]
    following = 1 + max(int(i) for i in pair.a.line_id)
    ids += range(following, following + count - len(ids))
    sightings = [
        int(pair.a.sightings[list(i)].sum() + pair.b.sightings[list(j)].sum())
        for i, j in zip(merged.rows_a, merged.rows_b, strict=True)
    ]
    landmarks = LandmarkMap(
        id=np.array(ids),
        kind=(LINE.kind,) * count,
        params=merged.map.lines,
        extent=merged.map.extent,
        sightings=np.array(sightings),
    )
    cov = np.zeros((3 + 2 * count, 3 + 2 * count))
    cov[3:, 3:] = merged.map.cov
    none = np.zeros(0)
    return Estimate(
        method="merged",
        causal=False,
        t=none,
        pose=np.zeros((0, 3)),
        cov_floor=np.zeros((0, 3, 3)),
        map=landmarks,
        cov_joint=cov,
        match=np.zeros(0, np.int64),
        used=np.zeros(0, bool),
        nis=none,
        weight=none,
    )


def _check_out(out: Path) -> None:
    if out.suffix != ".csv":
        raise BadConfig(f"{out}: is not the name of a map file; give one that ends in .csv")
    beside = out.with_suffix(".json")
    if not out.exists() and not beside.exists() and not out.with_suffix(".npz").exists():
        return
    try:
        found = json.loads(beside.read_text(encoding="utf-8"))
        ours = isinstance(found, dict) and found.get("format") == MERGED_FORMAT
    except (OSError, ValueError, RecursionError):
        ours = False
    if not ours:
        raise BadConfig(
            f"{out}: this file, or the .npz or .json beside it, exists and is no merged map of "
            f"ours ({beside.name} tells), so nothing is replaced; give another --out, or move it "
            "away"
        )


def _write(result: MergedMap, out: Path) -> None:
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(out.with_suffix(".json")) as path:
            write_json(path, _content(result))
        with whole_file(out.with_suffix(".npz")) as path:
            result.estimate.save(path)
        with whole_file(out) as path:
            write_csv(path, map_columns(result.estimate))


def _content(result: MergedMap) -> dict[str, object]:
    pair, merged, test = result.pair, result.merged, result.pair.test
    assert test is not None
    ids = zip(result.estimate.map.id.tolist(), merged.rows_a, merged.rows_b, strict=True)
    found = {
        "format": MERGED_FORMAT,
        "frame": pair.a.label,
        "first": str(pair.a.path),
        "second": str(pair.b.path),
        "logs": sorted({*pair.a.logs, *pair.b.logs}),
        "motion": motion_content(merged.motion),
        "cov_motion": merged.cov_motion,
        "chi2": test.chi2,
        "freedom": test.freedom,
        "probability": test.probability,
        "warnings": result.warnings,
        "lines": [
            {"line": i, "first": pair.a.line_id[list(rows)], "second": pair.b.line_id[list(others)]}
            for i, rows, others in ids
        ],
    }
    return dict(plain(found))
