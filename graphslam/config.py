"""Configuration of the estimators. Field docstrings are the command line's help."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from graphslam.errors import BadConfig

Matching = Literal["gated", "nearest", "jcbb", "known"]
Engine = Literal["auto", "gtsam", "chain"]
Robust = Literal["none", "huber", "cauchy", "gnc"]
ParticleStart = Literal["given", "anywhere"]


@dataclass(frozen=True, slots=True)
class MatchingConfig:
    """Which landmark a sighting belongs to."""

    method: Matching = "gated"
    """gated: smallest Mahalanobis distance, nearest pair first, one sighting per landmark and
    node. nearest: the papers' nearest landmark within fixed thresholds. jcbb: the largest matching
    of all sightings of a node that fits jointly. known: the log's true identities, for judging
    only."""
    gate: float = 14.0
    """Squared Mahalanobis distance up to which a sighting of two dimensions matches (chi-square,
    99.9 %); other dimensions take the same probability."""
    gate_new: float = 80.0
    """Squared Mahalanobis distance from every landmark beyond which a sighting starts a new one;
    in between it is dropped and counted."""
    gap_m: float = 20.0
    """Distance along a landmark, from the stretch of it that was seen to what is seen now, at
    which nothing is left of both gates, m; half of it leaves half of them."""
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
        if not self.gap_m > 0:
            raise BadConfig(f"ekf.matching.gap_m = {self.gap_m}: must be positive")
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
    confirm_after: int = 3
    """Nodes that must have seen a landmark before it counts. One that is seen less often is
    removed, and its sightings are rejected; 1 switches this off."""
    lost_after: int = 3
    """Nodes in a row that rejected most of their sightings after which the filter says 'lost' and
    widens the covariance of its pose, ever more until it finds itself; 0 switches this off."""
    late_s: float = 5.0
    """How far the filter goes back for a sighting that arrives late (`t_received`), s. What is
    later still is left out and counted."""

    def __post_init__(self) -> None:
        if not self.late_s >= 0:
            raise BadConfig(f"ekf.late_s = {self.late_s}: must be 0 or more")
        if self.confirm_after < 1:
            raise BadConfig(f"ekf.confirm_after = {self.confirm_after}: must be 1 or more")
        if self.lost_after < 0:
            raise BadConfig(f"ekf.lost_after = {self.lost_after}: must be 0 or more")


@dataclass(frozen=True, slots=True)
class RematchConfig:
    """Deciding all matches again after smoothing, until nothing changes."""

    gate: float = 14.0
    """Squared Mahalanobis distance, by the smoothed covariances, up to which a sighting of two
    dimensions matches and two landmarks may be one; other dimensions take the same probability."""
    gate_new: float = 80.0
    """Squared Mahalanobis distance from every landmark beyond which sightings may start a new
    one."""
    gap_m: float = 2.0
    """Gap between two stretches of a line, m, at which it is a quarter as likely that they are of
    one line."""
    min_sightings: int = 3
    """Landmarks with fewer sightings are dropped."""
    window_m: float = 6.0
    """A landmark not seen for this long a way, m, counts as left behind: within it sightings are
    matched one by one, across it only whole groups of lines are."""
    submap_m: float = 12.0
    """Length of path, m, whose lines make a local map for closing loops."""
    rounds: int = 30
    """Largest number of rounds."""

    def __post_init__(self) -> None:
        if not 0 < self.gate <= self.gate_new < math.inf:
            raise BadConfig(
                f"smoother.rematching.gate = {self.gate}, gate_new = {self.gate_new}: must be "
                "positive and finite, gate_new not below gate"
            )
        for name in ("gap_m", "window_m", "submap_m"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise BadConfig(f"smoother.rematching.{name} = {value}: must be positive")
        for name in ("min_sightings", "rounds"):
            if getattr(self, name) < 1:
                raise BadConfig(
                    f"smoother.rematching.{name} = {getattr(self, name)}: must be 1 or more"
                )


@dataclass(frozen=True, slots=True)
class IncrementalConfig:
    """Smoothing as the robot drives, node by node (isam2, fixed-lag)."""

    lag_s: float = 5.0
    """How long fixed-lag keeps a pose open to what is seen later, s: each pose of its path comes
    this much later, and is the better for it."""
    relinearise: float = 0.01
    """Change of a variable, m or rad, from which it is linearised anew."""

    def __post_init__(self) -> None:
        if not 0 <= self.lag_s < math.inf:
            raise BadConfig(f"incremental.lag_s = {self.lag_s}: must be 0 or more")
        if not 0 < self.relinearise < math.inf:
            raise BadConfig(f"incremental.relinearise = {self.relinearise}: must be positive")


@dataclass(frozen=True, slots=True)
class SmootherConfig:
    """Full smoothing by a factor graph."""

    engine: Engine = "auto"
    """Who minimises. gtsam: custom factors in a GTSAM graph, the definition. chain: the same
    problem by our own elimination of the chain of poses, many times faster. auto: chain from 5,000
    nodes on, and where matches are decided again, which takes hundreds of minima; else gtsam is
    done before a first run has compiled the other."""
    check: bool = False
    """Minimise with the other engine, too, and say how far cost and covariances agree."""
    robust: Robust = "none"
    """Kernel on sightings. none: plain least squares. huber, cauchy: less weight to large
    residuals. gnc: truncated least squares by graduated non-convexity, which switches wrong
    matches off without a good start."""
    robust_gate: float = 14.0
    """Squared normalised residual of a sighting of two dimensions that still counts as right
    (chi-square, 99.9 %); other dimensions take the same probability."""
    robust_odometry: bool = False
    """Whether the kernel acts on odometry's increments, too: for wheels that slip or are lifted.
    Without it `smoother.rematch` alone switches increments off, where a slip is the more probable,
    and counts them."""
    rematch: bool = False
    """Whether all matches are decided again after smoothing: landmarks that are one are merged,
    those that are two split, rejected sightings revived, loops closed, until nothing changes."""
    rematching: RematchConfig = field(default_factory=RematchConfig)
    """How matches are decided again."""
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
        if self.robust_odometry and self.robust == "none":
            raise BadConfig(
                'smoother.robust_odometry = true: needs a kernel, such as smoother.robust = "gnc"'
            )
        if self.max_iterations < 1:
            raise BadConfig(f"smoother.max_iterations = {self.max_iterations}: must be 1 or more")
        if not 0 < self.tolerance < 1:
            raise BadConfig(f"smoother.tolerance = {self.tolerance}: must be between 0 and 1")


@dataclass(frozen=True, slots=True)
class LongConfig:
    """Long logs (ekf-window, loops)."""

    window_m: float = 6.0
    """A landmark not seen for this long a way, m, is left behind: the filter matches nothing with
    it; only whole groups of lines, by loop closing, are matched across."""
    calibrate: bool = True
    """Whether odometry calibrates itself: scale of distances and turns, curvature, where the sensor
    sits, and noise. Off where its noise and geometry are known better."""
    passes: int = 1
    """Passes of the filter to which drift and noise of odometry are fitted."""
    close: bool = True
    """Whether loops are closed."""
    rounds: int = 3
    """How often all matches are decided again at the end."""

    def __post_init__(self) -> None:
        if not 0 < self.window_m < math.inf:
            raise BadConfig(f"long.window_m = {self.window_m}: must be positive")
        if self.passes < 1 or self.rounds < 0:
            raise BadConfig(
                f"long.passes = {self.passes}, rounds = {self.rounds}: at least 1 and 0"
            )


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
    agree_nodes: int = 5
    """Nodes in a row, with sightings, that they must agree for before the search ends."""
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
        if min(self.seed, self.lost_after) < 0 or self.agree_nodes < 1:
            raise BadConfig(
                f"particle.seed = {self.seed}, lost_after = {self.lost_after}, agree_nodes = "
                f"{self.agree_nodes}: must be 0 or more, agree_nodes 1 or more"
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
