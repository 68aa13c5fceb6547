"""Two maps held against each other: which lines are the same, how far off, and is that expected."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from compare.agreement import agreement
from compare.align import rigid_from_points
from compare.arrays import freeze_arrays
from compare.metrics import rms
from compare.two_maps_sources import (
    MEASUREMENTS_FILE,
    Relation,
    Source,
    open_sources,
    relation,
)
from graphslam.errors import BadConfig
from graphslam.geometry import Array, compose, interpolate_poses, wrap
from graphslam.line_maps.alignment import (
    Alignment,
    align_matches,
    find_alignments,
    refine_alignment,
)
from graphslam.line_maps.ambiguity import Ambiguity, ambiguity
from graphslam.line_maps.chi2 import MapTest, same_map
from graphslam.line_maps.config import AlignmentConfig
from graphslam.measurements import IntArray, Measurements
from graphslam.models.line import LINE

FEWEST_POSES = 3
"""Common times below which paths are not compared."""
Tie = Literal["searched", "asked", "start", "path"]
"""How the frames of two maps were brought together."""


@dataclass(frozen=True, slots=True)
class PathDifference:
    """How two paths differ at common times, second minus first.

    Attributes:
        t: (n,) common times: those of the first that the second covers, s.
        difference: (n, 3) in the first's frame, m and rad, heading wrapped; frames tied as the
            maps' are.
        sigma: (n, 3) standard deviations of the first's poses, NaN where unknown.
        sigma_second: (n, 3) of the second's.
        aligned_rms_m: RMS distance after the rigid motion that lays the paths best on each other.
    """

    t: Array
    difference: Array
    sigma: Array
    sigma_second: Array
    aligned_rms_m: float

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def distance(self) -> Array:
        """(n,) distance of the two positions, m."""
        return np.hypot(self.difference[:, 0], self.difference[:, 1])


@dataclass(frozen=True, slots=True)
class MapPair:
    """Two sources, the second brought into the first's frame.

    Attributes:
        a: the first, whose frame is kept.
        b: the second.
        relation: what they have in common.
        tied: how the frames were brought together: "searched" among all motions, "asked" near a
            motion that was given, "start" as both began at the same pose, "path" by the two paths'
            common clock.
        alignment: of b's lines on a's; None where none agree, or either has no lines.
        ambiguity: whether another alignment fits as well; None unless it was searched.
        alternatives: (E, 3) motions of all alignments that fit equally well, the one taken first.
        test: the differences of the lines; None without an alignment.
        motion: (3,) ``a_T_b`` that everything is drawn with.
        path: how the paths differ; None where they cannot be compared.
        no_path: why not, "" where they are compared.
    """

    a: Source
    b: Source
    relation: Relation
    tied: Tie
    alignment: Alignment | None
    ambiguity: Ambiguity | None
    alternatives: Array
    test: MapTest | None
    motion: Array
    path: PathDifference | None
    no_path: str

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def only_a(self) -> IntArray:
        """Rows of the first map's lines that the second has not."""
        return _unmatched(len(self.a.map), self.alignment, 0)

    @property
    def only_b(self) -> IntArray:
        """Rows of the second map's lines that the first has not."""
        return _unmatched(len(self.b.map), self.alignment, 1)


def compare_sources(
    sources: Sequence[Source],
    near: Array | None = None,
    config: AlignmentConfig | None = None,
) -> tuple[MapPair, ...]:
    """Returns each source but the first held against the first.

    Args:
        sources: at least two.
        near: (3,) motion ``first_T_other``, m and rad, to look near; None looks everywhere.
        config: tolerances; None for the defaults.

    Raises:
        BadConfig: nothing agrees near the motion that was asked for.
    """
    config = config or AlignmentConfig()
    return tuple(_pair(sources[0], other, near, config) for other in sources[1:])


def compare_maps(
    paths: Sequence[Path | str],
    out: Path | str | None = None,
    near: Sequence[float] | None = None,
    config: AlignmentConfig | None = None,
) -> tuple[MapPair, ...]:
    """Returns results, map files or truth held against the first of them; the command `compare`.

    Args:
        paths: at least two; see `compare.two_maps_sources.open_source`.
        out: folder to write report.html, comparison.json, lines.csv and plots to; None writes
            nothing.
        near: x (m), y (m) and turn (degrees) of the others' frame in the first's, to look near.
        config: tolerances; None for the defaults.

    Raises:
        BadConfig: fewer than two, one that cannot be compared, or ``out`` is somebody else's.
        BadLog: a table cannot be used.
        BadMeasurements: an estimate cannot be used.
        OSError: the folder cannot be written.
    """
    if len(paths) < 2:
        raise BadConfig("compare needs at least two maps; name a second one")
    if out is not None:
        from compare.two_maps_report import check_comparison, write_comparison

        check_comparison(Path(out))
    sources = open_sources(tuple(Path(path) for path in paths))
    start = None if near is None else np.array([near[0], near[1], math.radians(near[2])])
    pairs = compare_sources(sources, start, config)
    if out is not None:
        write_comparison(pairs, Path(out))
    return pairs


# ---- one pair ---------------------------------------------------------------------------------


def _pair(a: Source, b: Source, near: Array | None, config: AlignmentConfig) -> MapPair:
    common = relation(a, b)
    tied, start = _tie(a, b, common, near)
    alignment, unsure = None, None
    alternatives = np.zeros((0, 3))
    if len(a.map) and len(b.map):
        if tied == "searched":
            found = find_alignments(a.map, b.map, config)
            unsure = ambiguity(found, b.map, config)
            if unsure is not None:
                alignment = found[0]
                alternatives = np.array([found[k].motion for k in unsure.equal])
        else:
            alignment = _aligned_near(a, b, common, start, config)
    if alignment is None and near is not None:
        raise BadConfig(
            f"{b.path}: none of its lines lies on one of {a.path} near that motion; give another "
            "--near, or leave it out to search everywhere"
        )
    test = None if alignment is None else same_map(a.map, b.map, alignment, common.independent)
    motion = start if tied == "start" or test is None else test.motion
    path, no_path = _paths(a, b, common, motion)
    return MapPair(a, b, common, tied, alignment, unsure, alternatives, test, motion, path, no_path)


def _tie(a: Source, b: Source, common: Relation, near: Array | None) -> tuple[Tie, Array]:
    """Returns how the frames are brought together, and the motion ``a_T_b`` to start from."""
    if near is not None:
        return "asked", near
    if common.same_log and a.is_estimate and b.is_estimate:
        return "start", np.zeros(3)
    t = _common_times(a, b)
    if common.same_log and len(t) >= FEWEST_POSES:
        first, second = (interpolate_poses(t, s.t, s.pose)[:, :2] for s in (a, b))
        return "path", rigid_from_points(second, first)
    return "searched", np.zeros(3)


def _aligned_near(
    a: Source, b: Source, common: Relation, start: Array, config: AlignmentConfig
) -> Alignment | None:
    """Returns the alignment near a motion; by common sightings where both have them."""
    shared = _same_sightings(a, b) if common.same_measurements else None
    if shared is not None and len(shared):
        return align_matches(a.map, b.map, shared, start, config)
    return refine_alignment(a.map, b.map, start, config)


def _same_sightings(a: Source, b: Source) -> IntArray | None:
    """Returns rows (K, 2) of the lines that two estimates made of the same sightings.

    None where one of them is no whole estimate.
    """
    if a.estimate is None or b.estimate is None or a.run is None:
        return None
    found = agreement(a.estimate, b.estimate, Measurements.load(a.run / MEASUREMENTS_FILE)).map
    if found is None:
        return None
    sides = ((a.estimate, found.row_a), (b.estimate, found.row_b))
    columns = [np.searchsorted(e.map.of_kind(LINE.kind)[0], rows) for e, rows in sides]
    return np.column_stack(columns)


def _common_times(a: Source, b: Source) -> Array:
    if not len(a.t) or not len(b.t):
        return np.zeros(0)
    return a.t[(a.t >= b.t[0]) & (a.t <= b.t[-1])]


def _paths(
    a: Source, b: Source, common: Relation, motion: Array
) -> tuple[PathDifference | None, str]:
    """Returns how the paths differ, or None and the reason."""
    without = [source.label for source in (a, b) if not len(source.t)]
    if without:
        return None, f"{' and '.join(without)} has no path" if len(without) == 1 else "no paths"
    files = "path file" in (a.what, b.what)
    if not common.same_log and not files:
        return None, "the logs differ, so that their clocks have nothing in common"
    t = _common_times(a, b)
    if len(t) < FEWEST_POSES:
        return None, f"{len(t)} common times are too few"
    first = interpolate_poses(t, a.t, a.pose)
    second = compose(motion, interpolate_poses(t, b.t, b.pose))
    if files and not common.same_log:
        second = compose(rigid_from_points(second[:, :2], first[:, :2]), second)
    difference = second - first
    difference[:, 2] = wrap(difference[:, 2])
    best = rigid_from_points(second[:, :2], first[:, :2])
    left = (compose(best, second) - first)[:, :2]
    return (
        PathDifference(
            t, difference, _sigma_at(t, a), _sigma_at(t, b), rms(np.hypot(left[:, 0], left[:, 1]))
        ),
        "",
    )


def _sigma_at(t: Array, source: Source) -> Array:
    """Returns (n, 3) standard deviations of a source's poses at times; NaN where unknown."""
    if source.cov_floor is None:
        return np.full((len(t), 3), np.nan)
    sigma = np.sqrt(np.diagonal(source.cov_floor, axis1=1, axis2=2))
    return np.column_stack([np.interp(t, source.t, column) for column in sigma.T])


def _unmatched(count: int, alignment: Alignment | None, column: int) -> IntArray:
    rows = np.arange(count)
    if alignment is None:
        return rows
    used = np.concatenate([alignment.matches[:, column], alignment.parts[:, column]])
    return rows[~np.isin(rows, used)]
