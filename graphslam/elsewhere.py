"""Where else on a known map the robot may be: places that explain as well what it has seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from graphslam.arrays import frozen
from graphslam.association import gate_for, mahalanobis
from graphslam.config import EkfConfig, MatchingConfig
from graphslam.ekf import run_ekf
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose, inverse, wrap
from graphslam.landmarks import stretches_seen
from graphslam.line_maps.alignment import Alignment, find_alignments
from graphslam.line_maps.ambiguity import ambiguity
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.line_map import LineMap
from graphslam.measurements import IntArray, Measurements, Odometry, Sightings
from graphslam.models.line import LINE
from graphslam.particle_looks import looks_of

OTHER_PLACES = "other places explain what was seen as well"
"""Begins the reason under which an estimate counts other places; the rest says where they are."""
BLUR = np.diag(np.square([0.02, 0.02, math.radians(1.0)]))
"""Covariance of a path at another place, m and rad: floors repeat to some millimetres only, and
what they differ by below this tells no places apart."""
FEWEST_LOST = 5
"""A place that leaves this many more sightings without a landmark is ruled out, ..."""
LOST_SHARE = 0.03
"""... or this share of all where that is more."""
HERE = (0.15, math.radians(10.0))
"""An alignment that moves the last pose by less, m and rad, is no other place."""
SLID_M = 0.5
"""A place may slide where the path can be this far off along the one direction of all lines, m."""
ALL = AlignmentConfig(hypotheses=40, most=40, equal_consistency=1e-9, equal_score=1e-9)
"""Alignments are listed however well they fit: the sightings decide. Those that explain nearly all
of them are among the first."""


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """Other places where a robot may be.

    Attributes:
        motions: (A, 3) rigid motions of the floor frame that take the path that was found to the
            others; none where nothing else explains what was seen.
        slide: (2,) direction along which nothing that was seen fixes the place, or None.
        reason: what the places differ by, after `OTHER_PLACES`.
    """

    motions: Array
    slide: Array | None
    reason: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "motions", frozen("motions", self.motions, (None, 3)))

    def spread(self, pose: Array, region: tuple[Array, Array] | None) -> Array:
        """Returns what the other places, each as likely, add to the covariances of poses.

        Args:
            pose: (n, 3) floor frame.
            region: corners of the floor, m: as far as a place that may slide may be off.

        Returns:
            (n, 3, 3) mean products of the differences from the poses, floor frame.
        """
        off = compose(self.motions[:, None], pose) - pose
        off[..., 2] = wrap(off[..., 2])
        out = np.einsum("kni,knj->nij", off, off) / (1 + len(self.motions))
        if self.slide is not None and region is not None:
            width = np.abs(self.slide) @ (region[1] - region[0])
            out[:, :2, :2] += width**2 / 12.0 * np.outer(self.slide, self.slide)
        return np.asarray(out)


def elsewhere(
    measurements: Measurements,
    first: int,
    last: tuple[Array, Array],
    may_be: Callable[[Array], bool],
    gate: float,
) -> Elsewhere:
    """Returns where else a robot may be that has found its place on a known map.

    The lines that it saw are laid on the known map in every way. A way remains where the whole
    path, moved along, may be, and leaves hardly more sightings without a landmark. The path is the
    filter's, run backwards from the last pose to where the search began.

    Args:
        measurements: nodes, odometry, sightings, and a known map.
        first: the node where the search began.
        last: pose (3,) and covariance (3, 3) of the last node, floor frame.
        may_be: whether the robot can have driven a path (n, 3), from ``first`` to the last node.
        gate: largest squared normalised residual of a sighting of two dimensions.
    """
    part = backwards(measurements, first, last)
    known = part.known
    assert known is not None, "a place is searched on a known map"
    path = run_ekf(part, EkfConfig(matching=MatchingConfig(gate=gate, gate_new=gate)))
    rows, lines = known.of_kind(LINE.kind)
    seen = _seen(part, path)
    found = find_alignments(LineMap.exact(lines, known.extent[rows]), seen, ALL)
    if found and found[0].slide is not None:
        slid = np.outer([SLID_M, -SLID_M], [*found[0].slide, 0.0])
        free = any(may_be(compose(motion, path.pose[::-1])) for motion in slid)
        return _result(found[:1], (), seen, found[0].slide if free else None)
    ways = [a for a in found if a.slide is None and may_be(compose(a.motion, path.pose[::-1]))]
    here = [_is_here(compose(a.motion, last[0]), last[0]) for a in ways]
    others = [a for a, same in zip(ways, here, strict=True) if not same]
    lost = _lost(part, path.pose, np.array([np.zeros(3), *(a.motion for a in others)]), gate)
    most = max(FEWEST_LOST, LOST_SHARE * part.sighting_count)
    kept = [a for a, more in zip(others, lost[1:] - lost[0], strict=True) if more < most]
    return _result([a for a, same in zip(ways, here, strict=True) if same][:1], kept, seen, None)


def backwards(measurements: Measurements, first: int, last: tuple[Array, Array]) -> Measurements:
    """Returns the same drive from the last node back to another one, as if driven in reverse.

    Every sighting counts as received at once.

    Args:
        measurements: nodes, odometry, sightings; raw wheel readings are left out.
        first: the node that becomes the last one.
        last: pose (3,) and covariance (3, 3) of the last node, floor frame: where it starts.
    """
    nodes, t = len(measurements.t), -measurements.t[first:][::-1]
    increment = measurements.odometry.increment[first:][::-1]
    back = inverse(increment)
    J = np.zeros((len(back), 3, 3))  # of the inverse
    J[:, 0, 0] = J[:, 1, 1] = -np.cos(increment[:, 2])
    J[:, 1, 0] = np.sin(increment[:, 2])
    J[:, 0, 1] = -J[:, 1, 0]
    J[:, 0, 2], J[:, 1, 2], J[:, 2, 2] = back[:, 1], -back[:, 0], -1.0
    cov = J @ measurements.odometry.cov[first:][::-1] @ np.swapaxes(J, 1, 2)
    tables = {}
    for kind, table in measurements.sightings.items():
        rows = np.flatnonzero(table.node >= first)
        rows = rows[np.argsort(-table.node[rows], kind="stable")]
        columns = {f.name: getattr(table, f.name)[rows] for f in fields(table) if f.name != "kind"}
        node = nodes - 1 - table.node[rows]
        tables[kind] = Sightings(kind, **{**columns, "node": node, "t_received": t[node]})
    return replace(
        measurements,
        t=t,
        start_pose=last[0],
        start_cov=last[1],
        odometry=Odometry(back, 0.5 * (cov + np.swapaxes(cov, 1, 2))),
        sightings=tables,
    )


def _seen(part: Measurements, path: Estimate) -> LineMap:
    """Returns the known lines that were seen, as long as they were seen."""
    alone = replace(part, known=None)
    extent = stretches_seen(alone, path.pose, path.map.params, path.match)
    rows, lines = path.map.of_kind(LINE.kind)
    was = path.map.sightings[rows] > 0
    return LineMap.exact(lines[was], extent[rows[was]])


def _is_here(pose: Array, last: Array) -> bool:
    off = pose - last
    return bool(math.hypot(*off[:2]) < HERE[0] and abs(wrap(off[2])) < HERE[1])


def _lost(part: Measurements, pose: Array, motions: Array, gate: float) -> IntArray:
    """Returns how many sightings have no landmark where the path is moved by each motion (A,)."""
    assert part.known is not None
    count = np.zeros(len(motions), np.int64)
    for node, looks in enumerate(looks_of(part, part.known)):
        moved = compose(motions, pose[node])
        for look in looks:
            e, J, _ = look.model.residual(moved[:, None], look.params, look.z)
            cov = J @ BLUR @ np.swapaxes(J, -1, -2) + look.cov
            nearest = mahalanobis(e, cov).min(axis=1)
            count += nearest > gate_for(gate, look.model.dim_z)
    return count


def _result(
    here: Sequence[Alignment], others: Sequence[Alignment], seen: LineMap, slide: Array | None
) -> Elsewhere:
    motions = np.array([a.motion for a in others]).reshape(-1, 3)
    found = ambiguity([*here, *others], seen, ALL)
    if found is None or (slide is None and not others):
        return Elsewhere(motions, slide, "")
    more = " (and perhaps there are more)" if len(others) > ALL.most // 2 else ""
    words = str(found) if slide is not None else f"they {found.differences()}"
    return Elsewhere(motions, slide, f"{OTHER_PLACES}{more}: {words}")
