"""Configuration of the estimators. Field docstrings are the command line's help."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from graphslam.errors import BadConfig

Matching = Literal["gated", "nearest", "known"]
Engine = Literal["gtsam", "chain"]


@dataclass(frozen=True, slots=True)
class MatchingConfig:
    """Which landmark a sighting belongs to."""

    method: Matching = "gated"
    """gated: smallest Mahalanobis distance, nearest pair first, one sighting per landmark and
    node. nearest: the papers' nearest landmark within fixed thresholds. known: the log's true
    identities, for judging only."""
    gate: float = 14.0
    """Squared Mahalanobis distance up to which a sighting of two dimensions matches (chi-square,
    99.9 %); other dimensions take the same probability."""
    gate_new: float = 80.0
    """Squared Mahalanobis distance from every landmark beyond which a sighting starts a new one;
    in between it is dropped and counted."""
    nearest_distance_m: float = 0.15
    """Largest difference in length for `nearest`, in the frame of the sighting, m."""
    nearest_angle_deg: float = 10.0
    """Largest difference in angle for `nearest`, degrees."""

    def __post_init__(self) -> None:
        if self.method not in get_args(Matching):
            known = ", ".join(get_args(Matching))
            raise BadConfig(f"ekf.matching.method = {self.method!r}: must be one of {known}")
        if not 0 < self.gate <= self.gate_new < math.inf:
            raise BadConfig(
                f"ekf.matching.gate = {self.gate}, gate_new = {self.gate_new}: must be positive "
                "and finite, gate_new not below gate"
            )
        if not 0 < self.nearest_distance_m < math.inf:
            raise BadConfig(
                f"ekf.matching.nearest_distance_m = {self.nearest_distance_m}: must be positive"
            )
        if not 0 < self.nearest_angle_deg <= 90:
            raise BadConfig(
                f"ekf.matching.nearest_angle_deg = {self.nearest_angle_deg}: must be above 0, at "
                "most 90"
            )


@dataclass(frozen=True, slots=True)
class EkfConfig:
    """EKF-SLAM."""

    matching: MatchingConfig = field(default_factory=MatchingConfig)
    extend_map: bool = False
    """With a known map: whether sightings of none of its landmarks start new ones."""
    lost_after: int = 5
    """Nodes in a row whose sightings were all rejected after which the filter says 'lost' and
    doubles the standard deviations of its pose; 0 switches this off."""

    def __post_init__(self) -> None:
        if self.lost_after < 0:
            raise BadConfig(f"ekf.lost_after = {self.lost_after}: must be 0 or more")


@dataclass(frozen=True, slots=True)
class SmootherConfig:
    """Full smoothing by a factor graph."""

    engine: Engine = "gtsam"
    """Who minimises. gtsam: custom factors in a GTSAM graph, the definition. chain: the same
    problem by our own elimination of the chain of poses, many times faster."""
    max_iterations: int = 50
    """Largest number of linear solves."""
    tolerance: float = 1e-10
    """Converged when the predicted relative decrease of the cost falls below this."""

    def __post_init__(self) -> None:
        if self.engine not in get_args(Engine):
            known = ", ".join(get_args(Engine))
            raise BadConfig(f"smoother.engine = {self.engine!r}: must be one of {known}")
        if self.max_iterations < 1:
            raise BadConfig(f"smoother.max_iterations = {self.max_iterations}: must be 1 or more")
        if not 0 < self.tolerance < 1:
            raise BadConfig(f"smoother.tolerance = {self.tolerance}: must be between 0 and 1")
