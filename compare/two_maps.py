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
from compare.two_maps_relation import Relation, relation
from compare.two_maps_sources import MEASUREMENTS_FILE, Source, open_sources
from compare.two_paths import FEWEST_POSES, PathDifference, common_times, path_difference
from graphslam.errors import BadConfig
from graphslam.geometry import Array, interpolate_poses
from graphslam.line_maps.alignment import (
    Alignment,
    align_matches,
    find_alignments,
    refine_alignment,
)
from graphslam.line_maps.ambiguity import Ambiguity, ambiguity
from graphslam.line_maps.chi2 import MapTest, same_map
from graphslam.line_maps.choice import RULED_OUT, Choice, choose
from graphslam.line_maps.config import AlignmentConfig
from graphslam.measurements import IntArray, Measurements
from graphslam.models.line import LINE

Tie = Literal["searched", "asked", "start", "path"]
"""How the frames of two maps were brought together."""


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
        alternatives: all alignments that fit equally well, the one taken first; none unless it was
            searched.
        choice: what the lines' differences say about those, in their order; None likewise.
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
    alternatives: tuple[Alignment, ...]
    choice: Choice | None
    test: MapTest | None
    motion: Array
    path: PathDifference | None
    no_path: str

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def _repr_html_(self) -> str:
        """Returns what a notebook shows; see `compare.show_many`."""
        from compare.show_many import pair_html

        return pair_html(self)

    @property
    def sure(self) -> bool:
        """Whether the alignment is the only one that can be right, as far as the maps tell.

        Where there may be more than were looked at, its differences have to be small, too.
        """
        if self.ambiguity is None or self.choice is None:
            return self.alignment is not None
        if self.choice.in_question > 1:
            return False
        return not self.ambiguity.more or self.choice.tests[0].probability >= RULED_OUT

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
    alignment, unsure, choice = None, None, None
    alternatives: tuple[Alignment, ...] = ()
    if len(a.map) and len(b.map):
        if tied == "searched":
            found = find_alignments(a.map, b.map, config)
            unsure = ambiguity(found, b.map, config)
            if unsure is not None:
                choice = choose(found, unsure, a.map, b.map, common.independent, config)
                alternatives = tuple(found[k] for k in choice.rows)
                alignment = alternatives[0]
        else:
            alignment = _aligned_near(a, b, common, start, config)
    if alignment is None and near is not None:
        raise BadConfig(
            f"{b.path}: none of its lines lies on one of {a.path} near that motion; give another "
            "--near, or leave it out to search everywhere"
        )
    test = None if alignment is None else same_map(a.map, b.map, alignment, common.independent)
    motion = start if tied == "start" or test is None else test.motion
    path, no_path = path_difference(a, b, common, motion)
    return MapPair(
        a=a,
        b=b,
        relation=common,
        tied=tied,
        alignment=alignment,
        ambiguity=unsure,
        alternatives=alternatives,
        choice=choice,
        test=test,
        motion=motion,
        path=path,
        no_path=no_path,
    )


def _tie(a: Source, b: Source, common: Relation, near: Array | None) -> tuple[Tie, Array]:
    """Returns how the frames are brought together, and the motion ``a_T_b`` to start from."""
    if near is not None:
        return "asked", near
    if common.same_log and a.is_estimate and b.is_estimate:
        return "start", np.zeros(3)
    t = common_times(a, b)
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


def _unmatched(count: int, alignment: Alignment | None, column: int) -> IntArray:
    rows = np.arange(count)
    if alignment is None:
        return rows
    used = np.concatenate([alignment.matches[:, column], alignment.parts[:, column]])
    return rows[~np.isin(rows, used)]
