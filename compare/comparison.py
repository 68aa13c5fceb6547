"""The comparison of several estimates of one run, with the truth where there is any."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from compare.agreement import Agreement, agreement
from compare.bound import Bound, bound_at_truth, bound_of
from compare.consistency import (
    SHARES,
    Consistency,
    Innovations,
    Overconfidence,
    Surprise,
    consistency,
    innovations,
    overconfidence,
    surprise,
)
from compare.maps import MapMetrics, common_direction, map_metrics
from compare.matching import MatchingTable, matching_table
from compare.metrics import TrajectoryMetrics, pose_nees, rms, trajectory
from compare.points import PointMetrics, point_metrics
from compare.truth import Truth, truth_of
from compare.words import landmark_kinds
from graphslam.config import Engine
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate, Unobserved
from graphslam.geometry import Array
from graphslam.measurements import Measurements
from graphslam.models import MODELS

if TYPE_CHECKING:
    from frontend.log import Log

SIGMA_ZERO = 1e-6
"""Standard deviations of the start pose that count as none, m and rad."""


@dataclass(frozen=True, slots=True)
class MethodMetrics:
    """One method, judged.

    Attributes:
        method: name of the method.
        causal: whether the pose at time t uses only data up to t.
        trajectory: errors of the path; None without a true path.
        pose_nees: NEES of the poses per degree of freedom; NaN where not defined.
        points: errors of the map's points; None without true points, or without points to judge.
        consistency: squared errors over covariances along the way; None where `pose_nees` is not
            defined.
        direction_sigma_deg: how surely the map's lines' mean direction is known in the floor frame,
            degrees; NaN without lines. Where all run one way it is the open direction's.
        innovations: squared innovations over covariances along the way; None for methods that
            predict no sightings.
        map: errors of the map; None without true lines, or without lines in the map.
        matching: which sightings were taken for what; None where no true landmark is known.
        landmarks: landmarks in the map.
        sightings: sightings there were.
        sightings_used: sightings that the estimate uses.
        nis_per_dof: mean normalised innovation (smoother: residual) squared per degree of freedom;
            NaN without any.
        position_sigma_m: RMS over the nodes of the standard deviation of position, m.
        last_position_sigma_m: standard deviation of the last position, m.
        heading_sigma_deg: RMS over the nodes of the standard deviation of heading, degrees.
        unobserved: directions of the last pose, and parts of the way, that the data does not fix.
        counts: what happened to sightings, by name.
        cost: half the sum of squared normalised residuals; NaN where there is none.
        iterations: of the optimiser.
        engine: who minimised; empty for methods that have no choice of it.
        converged: whether the optimiser met its tolerance.
    """

    method: str
    causal: bool
    trajectory: TrajectoryMetrics | None
    pose_nees: float
    map: MapMetrics | None
    matching: MatchingTable | None
    landmarks: int
    sightings: int
    sightings_used: int
    nis_per_dof: float
    position_sigma_m: float
    last_position_sigma_m: float
    heading_sigma_deg: float
    unobserved: tuple[Unobserved, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    cost: float = float("nan")
    iterations: int = 0
    engine: str = ""
    converged: bool = True
    consistency: Consistency | None = None
    innovations: Innovations | None = None
    points: PointMetrics | None = None
    direction_sigma_deg: float = float("nan")

    def __post_init__(self) -> None:
        object.__setattr__(self, "counts", MappingProxyType(dict(self.counts)))

    @property
    def overconfidence(self) -> Overconfidence | None:
        """In which coordinate it is overconfident, how much, and from where on; None if in none."""
        return None if self.consistency is None else overconfidence(self.consistency)

    @property
    def surprise(self) -> Surprise | None:
        """From where on innovations exceed what it expects, and by how much; None if nowhere."""
        return None if self.innovations is None else surprise(self.innovations)


@dataclass(frozen=True, slots=True)
class Comparison:
    """What several methods made of one run.

    Attributes:
        log: name of the recording; empty where only measurements were at hand.
        nodes: nodes of the run.
        truth: what is true about it.
        methods: one entry a method, in the order given.
        agreement: how any two of them differ.
        bound: how well path, last pose and map can be known at all; None where nothing tells.
        kinds: of the landmarks that were seen.
    """

    log: str
    nodes: int
    truth: Truth
    methods: tuple[MethodMetrics, ...]
    agreement: tuple[Agreement, ...]
    bound: Bound | None = None
    kinds: tuple[str, ...] = ()

    def __getitem__(self, method: str) -> MethodMetrics:
        """Returns the entry of a method; KeyError where it was not compared."""
        for entry in self.methods:
            if entry.method == method:
                return entry
        raise KeyError(method)

    @property
    def verdict(self) -> tuple[str, ...]:
        """What follows from the figures, in sentences; see `compare.verdict`."""
        from compare.verdict import verdict

        return verdict(self)

    def to_dict(self) -> dict[str, Any]:
        """Returns the content of metrics.json; see `compare.content`."""
        from compare.content import comparison_content

        return comparison_content(self)

    def _repr_html_(self) -> str:
        """Returns what a notebook shows; see `compare.show`."""
        from compare.show import comparison_html

        return comparison_html(self.to_dict())


def compare(
    log: Log | None,
    measurements: Measurements,
    estimates: Sequence[Estimate],
    engine: Engine = "auto",
) -> Comparison:
    """Returns errors, consistency and agreement of estimates made from the same measurements.

    Args:
        log: the recording, for its truth; None where only measurements are at hand.
        measurements: what the estimates were made from.
        estimates: one a method.
        engine: who computes the bound.

    Raises:
        BadMeasurements: an estimate belongs to other measurements, or two have one name.
    """
    names = [estimate.method for estimate in estimates]
    if len(set(names)) != len(names):
        raise BadMeasurements(f"two estimates have one name: {', '.join(names)}; rename one")
    for estimate in estimates:
        if len(estimate.match) != measurements.sighting_count:
            raise BadMeasurements(
                f"{estimate.method} speaks of {len(estimate.match)} sightings, the measurements "
                f"have {measurements.sighting_count}; compare estimates with their own measurements"
            )
    truth = truth_of(log, measurements)
    start = known_start(log)
    return Comparison(
        log="" if log is None else log.name,
        nodes=len(measurements.t),
        truth=truth,
        methods=tuple(_judge(estimate, measurements, truth, start) for estimate in estimates),
        agreement=tuple(agreement(a, b, measurements) for a, b in combinations(estimates, 2)),
        bound=_bound(measurements, truth, estimates, engine),
        kinds=landmark_kinds(measurements),
    )


def _bound(
    measurements: Measurements, truth: Truth, estimates: Sequence[Estimate], engine: Engine
) -> Bound | None:
    """Returns the bound at the truth, or else at the first smoothed estimate, which is its own."""
    at_truth = bound_at_truth(measurements, truth, engine)
    if at_truth is not None:
        return bound_of(at_truth, measurements, "truth", truth)
    for estimate in estimates:
        if not estimate.causal and estimate.used.any():
            return bound_of(estimate, measurements, "estimate", truth)
    return None


def known_start(log: Log | None) -> Array | None:
    """Returns the start pose (3,) where the log gives one without uncertainty, else None."""
    if log is None or not log.start_given or np.max(log.start_sigma) > SIGMA_ZERO:
        return None
    return log.start_pose


def _judge(
    estimate: Estimate, measurements: Measurements, truth: Truth, start: Array | None
) -> MethodMetrics:
    path = trajectory(estimate, truth)
    path_motion = truth.truth_T_start if path is None else path.truth_T_estimate
    position = np.sqrt(np.trace(estimate.cov_floor[:, :2, :2], axis1=1, axis2=2))
    honesty = pose_nees(estimate, truth, start)
    start_known = math.isfinite(honesty)
    return MethodMetrics(
        method=estimate.method,
        causal=estimate.causal,
        trajectory=path,
        pose_nees=honesty,
        consistency=consistency(estimate, truth) if start_known else None,
        map=map_metrics(estimate, measurements, truth, path_motion, start_known),
        matching=matching_table(estimate, measurements, truth),
        landmarks=len(estimate.map),
        sightings=len(estimate.match),
        sightings_used=int(estimate.used.sum()),
        nis_per_dof=_nis_per_dof(estimate, measurements),
        position_sigma_m=rms(position),
        last_position_sigma_m=float(position[-1]),
        heading_sigma_deg=math.degrees(rms(np.sqrt(estimate.cov_floor[:, 2, 2]))),
        unobserved=estimate.unobserved,
        counts=estimate.counts,
        cost=estimate.cost,
        iterations=estimate.iterations,
        engine=estimate.engine,
        converged=estimate.converged,
        direction_sigma_deg=common_direction(estimate)[1],
        innovations=innovations(estimate, measurements.driven(), SHARES),
        points=point_metrics(estimate, measurements, truth, start_known),
    )


def _nis_per_dof(estimate: Estimate, measurements: Measurements) -> float:
    total, freedom = 0.0, 0
    for first, table in measurements.tables():
        nis = estimate.nis[first : first + len(table)]
        total += float(np.nansum(nis))
        freedom += MODELS[table.kind].dim_z * int(np.isfinite(nis).sum())
    return total / freedom if freedom else float("nan")
