"""Configuration of the estimators. Field docstrings are the command line's help."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from graphslam.errors import BadConfig

Matching = Literal["gated", "nearest", "known"]
Engine = Literal["gtsam", "chain"]
Robust = Literal["none", "huber", "cauchy", "gnc"]
ParticleStart = Literal["given", "anywhere"]


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
    robust: Robust = "none"
    """Kernel on sightings. none: plain least squares. huber, cauchy: less weight to large
    residuals. gnc: truncated least squares by graduated non-convexity, which switches wrong
    matches off without a good start."""
    robust_gate: float = 14.0
    """Squared normalised residual of a sighting of two dimensions that still counts as right
    (chi-square, 99.9 %); other dimensions take the same probability."""
    robust_odometry: bool = False
    """Whether the kernel acts on odometry's increments, too: for wheels that slip or are lifted."""
    max_iterations: int = 50
    """Largest number of linear solves."""
    tolerance: float = 1e-10
    """Converged when the predicted relative decrease of the cost falls below this."""

    def __post_init__(self) -> None:
        if self.engine not in get_args(Engine):
            known = ", ".join(get_args(Engine))
            raise BadConfig(f"smoother.engine = {self.engine!r}: must be one of {known}")
        if self.robust not in get_args(Robust):
            known = ", ".join(get_args(Robust))
            raise BadConfig(f"smoother.robust = {self.robust!r}: must be one of {known}")
        if not 0 < self.robust_gate < math.inf:
            raise BadConfig(f"smoother.robust_gate = {self.robust_gate}: must be positive")
        if self.max_iterations < 1:
            raise BadConfig(f"smoother.max_iterations = {self.max_iterations}: must be 1 or more")
        if not 0 < self.tolerance < 1:
            raise BadConfig(f"smoother.tolerance = {self.tolerance}: must be between 0 and 1")


@dataclass(frozen=True, slots=True)
class ParticleConfig:
    """Monte Carlo localisation on a known map."""

    start: ParticleStart = "given"
    """Where the robot may stand at first. given: as [start] says, with its sigma. anywhere: every
    place of the region, in every direction."""
    region: tuple[float, float, float, float] | None = None
    """Floor that the robot can be on: smallest x, largest x, smallest y, largest y, floor frame, m;
    absent: a box around the known map."""
    particles: int = 1000
    """Particles while they agree on one place."""
    particles_searching: int = 20000
    """Particles while they do not."""
    seed: int = 0
    """Decides all that is random."""
    resample_below: float = 0.5
    """Particles are drawn anew (systematic resampling) where their effective number falls below
    this share of them."""
    agree_m: float = 0.25
    """Particles agree where nearly all lie this close to their densest place, m, ..."""
    agree_deg: float = 10.0
    """... and this close to its heading, degrees."""
    agree_share: float = 0.98
    """How much of the particles' weight 'nearly all' is."""
    lost_after: int = 10
    """Nodes in a row that show hardly a line where the particles expect one after which the search
    starts again over the whole region; 0 switches this off."""

    def __post_init__(self) -> None:
        if self.start not in get_args(ParticleStart):
            known = ", ".join(get_args(ParticleStart))
            raise BadConfig(f"particle.start = {self.start!r}: must be one of {known}")
        if self.region is not None:
            x_min, x_max, y_min, y_max = self.region
            if not (-math.inf < x_min < x_max < math.inf and -math.inf < y_min < y_max < math.inf):
                raise BadConfig(
                    f"particle.region = {self.region}: needs smallest x, largest x, smallest y, "
                    "largest y, all finite"
                )
        if not 10 <= self.particles <= self.particles_searching:
            raise BadConfig(
                f"particle.particles = {self.particles}, particles_searching = "
                f"{self.particles_searching}: at least 10, and not fewer while searching"
            )
        if self.seed < 0 or self.lost_after < 0:
            raise BadConfig(
                f"particle.seed = {self.seed}, lost_after = {self.lost_after}: must be 0 or more"
            )
        if not (0 < self.resample_below <= 1 and 0.5 < self.agree_share < 1):
            raise BadConfig(
                f"particle.resample_below = {self.resample_below}, agree_share = "
                f"{self.agree_share}: shares, above 0 and at most 1, above 0.5 and below 1"
            )
        if not (0 < self.agree_m < math.inf and 0 < self.agree_deg <= 90):
            raise BadConfig(
                f"particle.agree_m = {self.agree_m}, agree_deg = {self.agree_deg}: must be "
                "positive, the angle at most 90"
            )
