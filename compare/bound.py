"""The Cramer-Rao bound of a run, and what it says of path, last pose and map."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from compare.maps import line_sigmas, seen_middles
from compare.metrics import rms
from compare.truth import Truth
from graphslam.config import Engine
from graphslam.errors import UnderConstrained
from graphslam.estimate import Estimate
from graphslam.geometry import compose, inverse, line_to_robot
from graphslam.measurements import IntArray, Measurements
from graphslam.models import MODELS
from graphslam.models.line import LINE


@dataclass(frozen=True, slots=True)
class Bound:
    """Standard deviations that no estimator undercuts on average, from the common start.

    Attributes:
        at: where it was linearised: at the truth, or at an estimate where there is no truth.
        path_m: RMS over the nodes of the position's, m.
        final_m: of the last position, m.
        heading_deg: RMS over the nodes of the heading's, degrees.
        map_m: RMS over the lines of the offset's at the middle of the seen stretch, m; NaN where
            no line is estimated.
    """

    at: Literal["truth", "estimate"]
    path_m: float
    final_m: float
    heading_deg: float
    map_m: float


def bound_of(
    estimate: Estimate,
    measurements: Measurements,
    at: str,
    truth: Truth,
    counted: IntArray | None = None,
) -> Bound:
    """Returns the figures of a bound: an estimate as by `graphslam.smoother.bound.cramer_rao`.

    Args:
        estimate: the bound.
        measurements: it is of.
        at: where it was linearised, "truth" or "estimate".
        truth: which lines were to be seen.
        counted: rows of the lines that count for the map; those that were to be seen where None.
    """
    position = np.sqrt(np.trace(estimate.cov_floor[:, :2, :2], axis1=1, axis2=2))
    lines, _ = estimate.map.of_kind(LINE.kind)
    if counted is not None:
        lines = lines[np.isin(lines, counted)]
    elif at == "truth" and truth.seen is not None:
        lines = lines[np.isin(estimate.map.id[lines], truth.line_id[truth.seen])]
    offset, _ = line_sigmas(estimate, lines, seen_middles(estimate, measurements, lines))
    return Bound(
        at="truth" if at == "truth" else "estimate",
        path_m=rms(position),
        final_m=float(position[-1]),
        heading_deg=math.degrees(rms(np.sqrt(estimate.cov_floor[:, 2, 2]))),
        map_m=rms(offset[offset > 0]),
    )


def bound_at_truth(
    measurements: Measurements, truth: Truth, engine: Engine = "auto"
) -> Estimate | None:
    """Returns the bound at the true path and lines, in the start's frame.

    None where the truth does not say enough: a node without a true pose, lines without a true one,
    landmarks of other kinds, or an installation without GTSAM.
    """
    pose, covered = truth.at(measurements.t)
    others = [k for k in measurements.sightings if MODELS[k].dim_landmark and k != LINE.kind]
    given = set() if measurements.known is None else {*measurements.known.kind} - {LINE.kind}
    if not covered.all() or others or given or not len(truth.lines):
        return None
    matches, names = true_matches(measurements, truth)
    if not (matches >= 0).any():
        return None
    try:
        from graphslam.smoother.bound import cramer_rao
    except ModuleNotFoundError as missing:
        if missing.name != "gtsam":
            raise
        return None
    pose = compose(inverse(truth.truth_T_start), pose)
    if measurements.known is not None:
        lines = measurements.known.params
    else:
        rows = [int(np.flatnonzero(truth.line_id == name)[0]) for name in names]
        lines = line_to_robot(truth.lines[rows], truth.truth_T_start)
    try:
        found = cramer_rao(measurements, matches, pose, lines, engine)
    except UnderConstrained:
        return None
    return replace(found, map=replace(found.map, id=names))


def true_matches(measurements: Measurements, truth: Truth) -> tuple[IntArray, IntArray]:
    """Returns the landmark (K,) of each sighting by its true line, and the landmarks' names (M,).

    With a known map the landmarks are its own, in its order; else the true lines that were seen.
    """
    if measurements.known is not None:
        names = measurements.known.id
    else:
        names = np.unique(truth.landmark[np.isin(truth.landmark, truth.line_id)])
    order = {int(name): row for row, name in enumerate(names)}
    matches = np.array([order.get(int(name), -1) for name in truth.landmark], np.int64)
    return matches, names
