"""Monte Carlo localisation: many poses, weighed by how well the known map explains what is seen."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graphslam.association import gate_for, mahalanobis
from graphslam.baseline import propagate
from graphslam.cloud import Cloud, effective_number
from graphslam.config import MatchingConfig, ParticleConfig
from graphslam.elsewhere import Elsewhere, elsewhere
from graphslam.ending import end
from graphslam.errors import BadMeasurements
from graphslam.estimate import Estimate, Unobserved
from graphslam.geometry import Array, compose, wrap
from graphslam.measurements import LandmarkMap, Measurements
from graphslam.particle_looks import (
    Look,
    crossing_pair,
    explainable,
    looks_of,
    put,
    sharpness,
)
from graphslam.region import anywhere, around, region_of, within

BoolArray = NDArray[np.bool_]

MOST_PARTS = 20
"""Most parts that one node's likelihood is taken in."""
SMALLEST_SIGMA = 1e-6
"""Standard deviations below this are not told from none, m and rad."""
LOST_INFLATION = 4.0
"""Factor on a lost cloud's standard deviations where there is no region to start again in."""
MOVED_SHARE = 0.3
"""Share of searching particles that are put where an unexplained sighting says they could be."""
FIRST_LOOKS = 5
"""Nodes after the start of a search of which each gets its share of particles put by its lines."""
EXPLAINED = {True: 0.5, False: 0.8}
"""Particles that track, or search, explain a node where at least this share of its sightings lies
within their gate."""
FAR = 4.0
"""Landmarks beyond this many gates of a tracking cloud are none that its particles see."""


def localise_by_particles(
    measurements: Measurements,
    config: ParticleConfig | None = None,
    matching: MatchingConfig | None = None,
) -> Estimate:
    """Returns the path by Monte Carlo localisation on the known map.

    Particles move by odometry with noise drawn from its covariance and are weighed by their
    distance to the nearest landmark of each sighting, no sighting weighing more than one at the
    gate; they are resampled systematically where their effective number is small. Until nearly all
    agree on one place they *search*: there are more of them, and where they do not explain what is
    seen, some are put where it could be seen from. Then they *track*.

    The result has ``converged = False`` where they have not agreed in the end, or have agreed on
    one of several places that explain what was seen equally well; ``counts`` tells which others,
    for how many nodes they had not agreed, and how often they were lost. Pose and covariance are
    mean and covariance of all particles, of whatever shape their cloud is; other places, where
    there are any, add to the covariance what it is to be at one of them. The map counts as known
    exactly.

    Args:
        measurements: nodes, odometry, sightings, and a known map.
        config: where to start, how many particles, when they agree.
        matching: its ``gate`` counts; which landmark it is each particle decides for itself.

    Raises:
        BadMeasurements: there is no known map, or nothing bounds where the robot can be.

    Source: SantanaLoc section 6, future work: a filter of particles.
    """
    if measurements.known is None or not len(measurements.known):
        raise BadMeasurements(
            "particles need a known map, and the measurements have none; give them one"
        )
    gate = (matching or MatchingConfig()).gate
    return _Localisation(measurements, measurements.known, config or ParticleConfig(), gate).run()


class _Localisation:
    """One run: the cloud, whether it agrees, and what became of each sighting."""

    def __init__(
        self,
        measurements: Measurements,
        known: LandmarkMap,
        config: ParticleConfig,
        gate: float,
    ) -> None:
        self.measurements, self.known, self.config = measurements, known, config
        self.gate = gate
        self.rng = np.random.default_rng(config.seed)
        self.counts: Counter[str] = Counter()
        count = measurements.sighting_count
        self.match, self.used = np.full(count, -1), np.zeros(count, bool)
        self.nis = np.full(count, np.nan)
        self.unexplained = self.agreed_in_a_row = self.looked = 0
        self.node = self.agreed_from = 0
        self.counts["sighting of no known landmark"] = sum(
            len(t) for _, t in measurements.tables() if not explainable(t, known)
        )
        self.region = region_of(known, config.region)
        self.cloud = self.first_cloud()
        self.tracking = self.agrees()
        self.searched_from = None if self.tracking else 0
        if self.tracking:
            self.cloud.resample(config.particles)

    def first_cloud(self) -> Cloud:
        """Returns the particles before anything is seen."""
        config, m = self.config, self.measurements
        if config.start == "given":
            start = around(m.start_pose, m.start_cov, config.particles_searching, self.rng)
            return Cloud(start, self.rng)
        if self.region is None:
            raise BadMeasurements(
                "the known map bounds no floor to search: its lines neither cross nor have ends; "
                "say where the robot can be with particle.region"
            )
        return Cloud(anywhere(self.region, config.particles_searching, self.rng), self.rng)

    # ---- the run -----------------------------------------------------------------------------

    def run(self) -> Estimate:
        """Returns what all nodes lead to."""
        nodes = len(self.measurements.t)
        pose, cov = np.empty((nodes, 3)), np.empty((nodes, 3, 3))
        for node, looks in enumerate(looks_of(self.measurements, self.known)):
            self.node = node
            if node > 0:
                self.predict(node - 1)
            if looks:
                self.take(looks)
            if not self.tracking:
                self.counts["node before the particles agreed on one place"] += 1
            pose[node], cov[node] = self.cloud.moments()
        others = self.other_places(pose[-1], cov[-1])
        if others is not None:
            agreed = slice(self.agreed_from, None)
            cov[agreed] += others.spread(pose[agreed], self.region)
        return self.finish(pose, cov + SMALLEST_SIGMA**2 * np.eye(3), others)

    def predict(self, i: int) -> None:
        """Moves every particle from node i to i + 1, each with an error of its own."""
        odometry = self.measurements.odometry
        noise = self.rng.standard_normal((len(self.cloud), 3))
        moves = odometry.increment[i] + noise @ np.linalg.cholesky(odometry.cov[i]).T
        self.cloud.pose = compose(self.cloud.pose, moves)

    def take(self, looks: list[Look]) -> None:
        """Weighs the particles by one node's sightings and notices what that means."""
        if self.tracking:
            inside = self.weigh_in_parts([self.remember(look) for look in looks])
        else:
            self.counts["sighting before the particles agreed"] += len(looks)
            inside = self.search(looks)
        explained = np.mean(inside, axis=0) @ self.cloud.weight >= EXPLAINED[self.tracking]
        self.unexplained = 0 if explained else self.unexplained + 1
        if self.tracking:
            self.notice_being_lost()
        else:
            self.notice_agreement()
            self.thin(looks)

    def notice_being_lost(self) -> None:
        """Starts the search again after too many nodes that the particles do not explain."""
        if 0 < self.config.lost_after <= self.unexplained:
            self.counts["lost: no line was where its particles expected one"] += 1
            self.tracking = False
            self.searched_from = self.node
            self.unexplained = self.agreed_in_a_row = self.looked = 0
            if self.region is None:
                self.cloud.widen(LOST_INFLATION)
            else:
                start = anywhere(self.region, self.config.particles_searching, self.rng)
                self.cloud = Cloud(start, self.rng)

    def notice_agreement(self) -> None:
        """Ends the search where the particles have agreed for long enough."""
        agreed = self.unexplained == 0 and self.agrees()
        self.agreed_in_a_row = self.agreed_in_a_row + 1 if agreed else 0
        if self.agreed_in_a_row >= self.config.agree_nodes:
            self.tracking = True
            self.agreed_from = self.node

    def thin(self, looks: list[Look]) -> None:
        """Resamples a searching cloud where few particles carry its weight, or the search ended."""
        cloud = self.cloud
        if self.tracking:
            cloud.resample(self.config.particles)
        elif effective_number(cloud.log_weight) < self.config.resample_below * len(cloud):
            cloud.resample(len(cloud))
            cloud.spread(sharpness(looks))

    def agrees(self) -> bool:
        """Returns whether nearly all particles lie at one place."""
        config = self.config
        share = self.cloud.share_at_one_place(config.agree_m, math.radians(config.agree_deg))
        return share >= config.agree_share

    def limit(self, look: Look) -> float:
        """Returns the squared normalised residual beyond which a sighting is of something else."""
        return gate_for(self.gate, look.model.dim_z)

    def distances(self, looks: list[Look]) -> tuple[Array, BoolArray]:
        """Returns squared normalised residuals (k, n), at most at the limit, and who is inside."""
        distance = np.array([look.distance(self.cloud.pose) for look in looks])
        limit = np.array([self.limit(look) for look in looks])[:, None]
        return np.minimum(distance, limit), distance < limit

    # ---- tracking ----------------------------------------------------------------------------

    def weigh_in_parts(self, looks: list[Look]) -> BoolArray:
        """Weighs an agreed cloud, in parts between which it is redrawn where few would be left.

        Returns which sightings (k, n) each particle has inside its gate.
        """
        cloud, few = self.cloud, self.config.resample_below * len(self.cloud)
        left = 1.0
        for part in range(MOST_PARTS):
            distance, inside = self.distances(looks)
            log_p = -0.5 * distance.sum(axis=0)
            step = left if part == MOST_PARTS - 1 else cloud.largest_step(log_p, left, few)
            cloud.log_weight = cloud.log_weight + step * log_p
            left -= step
            if left <= 0.0:
                break
            cloud.resample(len(cloud))
            cloud.redraw()
        return inside

    def remember(self, look: Look) -> Look:
        """Notes which landmark a sighting is of, seen from where the particles expect to be.

        Returns the sighting with the landmarks only that any of the particles may take it for.
        """
        mean, P = self.cloud.moments()
        e, J, _ = look.model.residual(mean, look.params, look.z)
        distance = mahalanobis(e, J @ P @ np.swapaxes(J, 1, 2) + look.cov)
        nearest = int(np.argmin(distance))
        if distance[nearest] < self.limit(look):
            self.match[look.number] = look.rows[nearest]
            self.used[look.number] = True
            self.nis[look.number] = distance[nearest]
        else:
            self.counts["sighting of no known landmark"] += 1
        near = distance <= max(distance[nearest], FAR * self.limit(look))
        return replace(look, params=look.params[near], rows=look.rows[near])

    # ---- searching ---------------------------------------------------------------------------

    def search(self, looks: list[Look]) -> BoolArray:
        """Weighs a cloud of many places; where it explains too little, moves a share of it.

        Returns which sightings (k, n) each particle has inside its gate.
        """
        cloud = self.cloud
        counts = np.ones((len(looks), len(cloud)))
        ends = [i for i, look in enumerate(looks) if look.model.dim_landmark]
        self.looked += 1
        share = 1.0 / self.looked if self.looked <= FIRST_LOOKS else 0.0
        share = max(share, MOVED_SHARE if self.unexplained else 0.0)
        if share and ends:
            moved = self.rng.random(len(cloud)) < share
            chosen = crossing_pair(looks, int(self.rng.choice(ends)))
            sight = [looks[i] for i in chosen]
            cloud.pose = cloud.pose.copy()
            cloud.pose[moved] = put(cloud.pose[moved], sight, cloud.moments()[1], self.rng)
            # sightings that their places follow from must not weigh them once more
            counts[np.array(chosen)[:, None], moved] = 0.0
        distance, inside = self.distances(looks)
        cloud.log_weight = cloud.log_weight - 0.5 * np.sum(counts * distance, axis=0)
        return inside

    # ---- result ------------------------------------------------------------------------------

    def other_places(self, pose: Array, cov: Array) -> Elsewhere | None:
        """Returns where else the last pose may be; None where the place was never searched."""
        if self.searched_from is None or not self.tracking:
            return None
        last = pose, cov + SMALLEST_SIGMA**2 * np.eye(3)
        found = elsewhere(self.measurements, self.searched_from, last, self.may_be, self.gate)
        return found if found.reason else None

    def may_be(self, path: Array) -> bool:
        """Returns whether the robot can have driven a path (n, 3) since the search began."""
        m = self.measurements
        if self.searched_from == 0 and self.config.start == "given":
            off = path[0] - m.start_pose
            off[2] = wrap(off[2])
            return bool(mahalanobis(off, m.start_cov) <= gate_for(self.gate, 3))
        return self.region is None or bool(within(self.region, path).all())

    def finish(self, pose: Array, cov: Array, others: Elsewhere | None) -> Estimate:
        """Returns the run as an estimate."""
        known_place = self.tracking and others is None
        if others is not None:
            self.counts[others.reason] = max(1, len(others.motions))
        m, known = self.measurements, self.known
        joint = np.zeros((int(known.offsets()[-1]),) * 2)
        joint[:3, :3] = cov[-1]
        cov = 0.5 * (cov + np.swapaxes(cov, 1, 2))
        ending = end(m, pose, cov, known.kind, known.params, self.match, self.used, joint)
        unobserved = ending.unobserved
        if not known_place and not any(entry.stretch is None for entry in unobserved):
            unobserved = (_nowhere(cov[-1], propagate(m)[1][-1]), *unobserved)
        return Estimate(
            method="particle",
            causal=True,
            t=m.t,
            pose=pose,
            cov_floor=cov,
            map=ending.map,
            cov_joint=ending.cov_joint,
            match=self.match,
            used=self.used,
            nis=self.nis,
            weight=np.ones(len(self.match)),
            converged=known_place,
            unobserved=unobserved,
            counts={reason: n for reason, n in sorted(self.counts.items()) if n},
        )


def _nowhere(cov: Array, cov_odometry: Array) -> Unobserved:
    """Returns that the position is not observed, with the sigmas of its worst direction."""
    sigmas = [math.sqrt(np.linalg.eigvalsh(c[:2, :2])[1]) for c in (cov, cov_odometry)]
    return Unobserved("position", (0.0, 0.0), sigmas[0], sigmas[1])
