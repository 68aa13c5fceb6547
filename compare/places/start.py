"""Where on the map a robot started, from the lamps that it saw on its way alone.

The lamps are mapped in the frame of the start first, by the filter. That little map may lie on the
building's in many ways: each of its lamps on each of the building's, either way round. What tells
them apart are the other lamps, lamps that should have been seen and were not, and walls: a robot
drives in places, not between them. Where more than one way remains, all are named.

Source: Bellini section 7, the future work.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from compare.places.building import Building, Tag
from compare.places.sight import LEAST_FRAMES, Sight
from compare.places.whereabouts import place_at
from frontend.camera import Camera
from graphslam.config import EkfConfig
from graphslam.ekf import run_ekf
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose, compose_jacobians, interpolate_poses, inverse, wrap
from graphslam.measurements import Measurements

MAP_SIGMA = (0.05, 0.05, math.radians(3.0))
"""How well the map says where lamps are: x and y in m, axis in rad."""
EXTRA = -15.0
"""Log-odds of a lamp that is not on the map, against one that is where the map says."""
DARK = math.log(0.05)
"""Log-probability of a lamp to be out of order, or in order where the map says it is not."""
OUTSIDE = -20.0
"""Log-probability of a path that leaves the places of the map."""
ROOM_M = 0.4
"""A path leaves the places where it is farther outside than this."""
OUTSIDE_SHARE = 0.05
COARSE = (0.3, 0.12, math.radians(15.0))
"""Lamps are compared within 0.3 m plus 0.12 m a metre from the one laid on top, and this angle."""
SURE = 0.999
"""Probability of one start above which it is decided."""
POSSIBLE = 1e-3
"""Starts below this probability are not possible any more."""
SAME_M, SAME_RAD = 0.3, math.radians(15.0)
ORIGIN_SIGMA = 1e-6
ITERATIONS, CONVERGED = 8, 1e-4
HOPELESS = 30.0
"""Ways to fit whose log-probability is this much below another's are not looked at further."""


@dataclass(frozen=True, slots=True)
class Start:
    """One way in which the lamps seen fit the map.

    Attributes:
        pose: (3,) where the robot started, floor frame of the map, m and rad.
        place: name of the place there.
        probability: of this start among all.
        lamps: the map's lamps that were seen, in the order of their first sighting.
        missing: lamps that should have been seen on the way and were not.
        extra: lamps seen that the map does not have.
    """

    pose: Array
    place: str
    probability: float
    lamps: tuple[int, ...]
    missing: tuple[int, ...]
    extra: int


@dataclass(frozen=True, slots=True)
class Answer:
    """Where a robot started.

    Attributes:
        starts: those that are possible, the most probable first; empty where no lamp was seen, or
            the lamps seen do not fit the map anywhere.
        lamps_seen: lamps that were seen and mapped.
    """

    starts: tuple[Start, ...]
    lamps_seen: int

    @property
    def decided(self) -> bool:
        """Whether one start only is left."""
        return len(self.starts) > 0 and self.starts[0].probability >= SURE

    @property
    def places(self) -> tuple[str, ...]:
        """Names of the places where the robot may have started."""
        return tuple(dict.fromkeys(start.place for start in self.starts))

    def __str__(self) -> str:
        seen = f"{self.lamps_seen} lamp{'' if self.lamps_seen == 1 else 's'} seen"
        if not self.starts:
            why = "no lamp was seen" if not self.lamps_seen else f"{seen} that fit nowhere"
            return f"the start is not known: {why}"
        if self.decided:
            first = self.starts[0]
            x, y, theta = first.pose
            return (
                f"the robot started in {first.place!r} at x = {x:.2f} m, y = {y:.2f} m, heading "
                f"{math.degrees(theta):.0f}° ({seen})"
            )
        named = ", ".join(repr(name) for name in self.places)
        return f"{len(self.starts)} starts are possible, in {named} ({seen}): drive on"


def find_start(
    building: Building, measurements: Measurements, camera: Camera | None = None
) -> Answer:
    """Returns where a robot may have started.

    Args:
        building: the map.
        measurements: with sightings of lamps; what they say of the start is not used.
        camera: that looks at the ceiling, where one is known: it tells what should be in view.

    Raises:
        BadConfig: there are no sightings of lamps, or the map has none.
    """
    if "lamp" not in measurements.sightings:
        raise BadConfig(
            "the log has no lamps to find the start by: it needs a camera with "
            'looks_at = "ceiling", or lamps.csv'
        )
    tags = building.lamps()
    if not tags:
        raise BadConfig(f"the map {building.name!r} has no lamps to find the start by; add them")
    local = _local_map(measurements)
    if not len(local.map):
        return Answer((), 0)
    table = measurements.sightings["lamp"]
    scene = _Scene(building, tags, local, Sight.of(table, measurements.t, camera))
    return Answer(_normalised(scene, _candidates(scene)), len(local.map))


def _local_map(measurements: Measurements) -> Estimate:
    """Returns path and lamps in the frame of the start."""
    own = replace(
        measurements,
        start_pose=np.zeros(3),
        start_cov=ORIGIN_SIGMA**2 * np.eye(3),
        sightings={"lamp": measurements.sightings["lamp"]},
        known=None,
    )
    return run_ekf(own, EkfConfig())


@dataclass(frozen=True, slots=True)
class _Fit:
    """A way to lay the local map on the building's: a motion, its lamps, and how well it fits."""

    motion: Array
    lamps: tuple[int, ...]  # rows of the building's lamps, -1 for none, by row of the local map
    score: float
    missing: tuple[int, ...]


class _Scene:
    """What all candidates are held against."""

    def __init__(
        self, building: Building, tags: tuple[Tag, ...], local: Estimate, sight: Sight | None
    ) -> None:
        self.building, self.tags, self.local = building, tags, local
        self.lamps = building.landmarks().params
        self.seen = local.map.params[:, :3]
        self.cov = local.cov_joint[3:, 3:]
        self.sight = sight
        self.frames = local.pose
        if sight is not None:
            times = sight.frames(local.t)
            self.frames = interpolate_poses(times, local.t, local.pose)
        self.dark = np.array([tag.dark for tag in tags])
        self.best = -np.inf

    def fit(self, motion: Array) -> _Fit | None:
        """Returns the best fit near a motion; None where nothing fits, or others fit far better."""
        rows = self._assigned(motion)
        while EXTRA * np.count_nonzero(rows < 0) > self.best - HOPELESS and (rows >= 0).any():
            motion, off, cost = self._solve(motion, rows)
            freedom = 3 * np.count_nonzero(rows >= 0) - 3
            if not freedom or cost <= chi2.ppf(0.999, freedom):
                fit = self._scored(motion, rows, cost)
                self.best = max(self.best, fit.score)
                return fit
            rows = rows.copy()
            rows[np.argmax(np.where(rows >= 0, off, -1.0))] = -1
        return None

    def _assigned(self, motion: Array) -> Array:
        """Returns for each local lamp the row of the building's lamp near it, -1 where none is."""
        at = compose(motion, self.seen)
        away = at[:, None] - self.lamps
        distance = np.hypot(away[..., 0], away[..., 1])
        turned = np.abs(0.5 * wrap(2.0 * away[..., 2]))
        own = int(np.argmin(distance.min(axis=1)))
        reach = COARSE[0] + COARSE[1] * np.hypot(*(at[:, :2] - at[own, :2]).T)
        distance = np.where((distance <= reach[:, None]) & (turned <= COARSE[2]), distance, np.inf)
        rows = np.full(len(at), -1)
        while np.isfinite(distance).any():
            i, j = np.unravel_index(np.argmin(distance), distance.shape)
            rows[i] = j
            distance[i], distance[:, j] = np.inf, np.inf
        return rows

    def _solve(self, motion: Array, rows: Array) -> tuple[Array, Array, float]:
        """Returns the best motion for an assignment, each lamp's own misfit, and the cost."""
        used = np.flatnonzero(rows >= 0)
        entries = (3 * used[:, None] + np.arange(3)).ravel()
        cov = self.cov[np.ix_(entries, entries)]
        for _ in range(ITERATIONS):
            at, J_motion, J_seen = compose_jacobians(
                np.tile(motion, (len(used), 1)), self.seen[used]
            )
            e = at - self.lamps[rows[used]]
            e[:, 2] = 0.5 * wrap(2.0 * e[:, 2])
            A = np.zeros((len(entries), len(entries)))
            for k, block in enumerate(J_seen):
                A[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = block
            S = A @ cov @ A.T + np.diag(np.tile(np.square(MAP_SIGMA), len(used)))
            J = J_motion.reshape(-1, 3)
            weighted = np.linalg.solve(S, np.column_stack([J, e.ravel()]))
            step = np.linalg.solve(J.T @ weighted[:, :3], J.T @ weighted[:, 3])
            motion = motion - step
            if np.abs(step).max() < CONVERGED:
                break
        residual = e.ravel() - J @ step
        cost = float(residual @ np.linalg.solve(S, residual))
        off = np.full(len(rows), -1.0)
        variance = np.diag(S)
        off[used] = np.sum((residual**2 / variance).reshape(-1, 3), axis=1)
        return np.array([*motion[:2], wrap(motion[2])]), off, cost

    def _scored(self, motion: Array, rows: Array, cost: float) -> _Fit:
        path = compose(motion, self.frames)
        matched = rows[rows >= 0]
        score = -0.5 * cost + EXTRA * np.count_nonzero(rows < 0) + DARK * self.dark[matched].sum()
        missing: list[int] = []
        if self.sight is not None:
            expected = self.sight.expects(path, self.lamps).sum(axis=0) >= LEAST_FRAMES
            expected[matched] = False
            missing = np.flatnonzero(expected & ~self.dark).tolist()
        inside = np.max([place.holds(path[:, :2]) for place in self.building.places], axis=0)
        outside = float(np.mean(inside < -ROOM_M)) > OUTSIDE_SHARE
        score += DARK * len(missing) + (OUTSIDE if outside else 0.0)
        return _Fit(motion, tuple(rows.tolist()), float(score), tuple(missing))


def _candidates(scene: _Scene) -> list[_Fit]:
    """Returns all ways in which the local map fits the building's, each once, the best first."""
    fits: list[_Fit] = []
    tried: set[tuple[int, ...]] = set()
    for seen in scene.seen:
        for lamp in scene.lamps:
            for turn in (0.0, math.pi):
                on_lamp = np.array([lamp[0], lamp[1], lamp[2] + turn])
                fit = scene.fit(compose(on_lamp, inverse(seen)))
                if fit is None:
                    continue
                key = (*fit.lamps, round(fit.motion[2] / SAME_RAD))
                if key not in tried and not any(_same(fit.motion, f.motion) for f in fits):
                    tried.add(key)
                    fits.append(fit)
    return sorted(fits, key=lambda fit: -fit.score)


def _same(a: Array, b: Array) -> bool:
    return bool(np.hypot(*(a[:2] - b[:2])) < SAME_M and abs(wrap(a[2] - b[2])) < SAME_RAD)


def _normalised(scene: _Scene, fits: list[_Fit]) -> tuple[Start, ...]:
    """Returns the possible starts; that the robot is on another map altogether is one of them."""
    nowhere = EXTRA * len(scene.seen) + OUTSIDE
    score = np.array([*(fit.score for fit in fits), nowhere])
    weight = np.exp(score - score.max())
    share = weight / weight.sum()
    starts = []
    for fit, probability in zip(fits, share, strict=False):
        if probability < POSSIBLE:
            continue
        pose = compose(fit.motion, scene.local.pose[0])
        matched = tuple(scene.tags[row].id for row in fit.lamps if row >= 0)
        starts.append(
            Start(
                pose,
                str(place_at(scene.building, pose[:2])),
                float(probability),
                matched,
                tuple(scene.tags[row].id for row in fit.missing),
                sum(row < 0 for row in fit.lamps),
            )
        )
    return tuple(starts)
