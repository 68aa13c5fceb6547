"""Which lamps a robot should have seen on its way, told by where in its frame it sees lamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from compare.places.building import Building
from frontend.camera import Camera
from graphslam.estimate import Estimate
from graphslam.geometry import Array, compose, interpolate_poses, inverse, rotate_covariance
from graphslam.measurements import IntArray, LandmarkMap, Measurements, Sightings
from graphslam.models.lamp import LAMP

MARGIN = 0.15
"""Share of the sight, at each of its borders, where a lamp may be in view or not."""
SIGMAS = 2.0
"""A lamp that may lie outside the sight by this many standard deviations is not expected."""
LEAST_FRAMES = 5
"""A lamp that should have been seen in fewer frames is not missed."""
UNLIKELY = 1e-4
"""Probability of being missed by chance below which a lamp is out of order."""
SUREST = 0.95
SAME_M = 0.5
"""Lamps of map and log that are closer than this are the same; lamps are farther apart."""


@dataclass(frozen=True, slots=True)
class Sight:
    """Where in the robot frame lamps are seen, as their sightings tell.

    Attributes:
        low: (2,) smallest x and y, m.
        high: (2,) largest.
        step_s: time between frames, s.
    """

    low: Array
    high: Array
    step_s: float

    @staticmethod
    def of(table: Sightings, t: Array, camera: Camera | None = None) -> Sight | None:
        """Returns the sight behind sightings; None with too few.

        That of the camera where one is known. Else the box around the sightings; in a corridor they
        lie in a row, and a camera is taken to see half as far to one side as to the other, at
        least.

        Args:
            table: sightings of lamps.
            t: (N,) times of the nodes, s.
            camera: that looks at the ceiling, or None.
        """
        times = np.unique(t[table.node])
        if len(times) < LEAST_FRAMES:
            return None
        corners = table.z[:, :2] if camera is None else camera.view()
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        half = 0.5 * np.ptp(corners, axis=0)
        half = (1.0 - 2.0 * MARGIN) * np.maximum(half, 0.5 * half.max())
        return Sight(middle - half, middle + half, float(np.median(np.diff(times))))

    def frames(self, t: Array) -> Array:
        """Returns the times of frames (F,) from the first to the last of t (N,), s.

        Where a log holds sightings only, there is no node in the dark: the sensor looked all the
        same.
        """
        count = round((t[-1] - t[0]) / self.step_s)
        return np.linspace(t[0], t[-1], count + 1) if count else t[:1]

    def expects(self, pose: Array, lamps: Array, spread: Array | float = 0.0) -> Array:
        """Returns (F, L) whether lamps (L, 2) at least should be seen from poses (F, 3).

        Args:
            pose: floor frame.
            lamps: ``(x, y, ...)``, floor frame, m.
            spread: (F, 2) or one: how far off the poses may be along x and y of the robot, m.
        """
        places = np.column_stack([lamps[:, :2], np.zeros(len(lamps))])
        at = compose(inverse(pose)[:, None], places)[..., :2]
        room = np.asarray(spread, float)[..., None, :] if np.ndim(spread) else spread
        low, high = self.low + room, self.high - room
        return np.asarray(((at >= low) & (at <= high)).all(axis=-1))


@dataclass(frozen=True, slots=True)
class LampRecord:
    """What became of one lamp of the map.

    Attributes:
        id: its number.
        place: name of its place.
        seen: frames that saw it.
        expected: frames that should have, at the least.
        out_of_order: whether it must be: never seen, and expected too often for chance.
        dark: whether the map says so.
    """

    id: int
    place: str
    seen: int
    expected: int
    out_of_order: bool
    dark: bool


def _same_lamps(building: Building, known: LandmarkMap) -> IntArray:
    """Returns the number of the building's lamp that each known landmark (M,) is; -1 for none."""
    lamps, same = building.landmarks(), np.full(len(known), -1)
    rows, places = known.of_kind(LAMP.kind)
    away = np.hypot(*(places[:, None, :2] - lamps.params[:, :2]).transpose(2, 0, 1))
    near = away.argmin(axis=1)
    found = away[np.arange(len(rows)), near] <= SAME_M
    same[rows[found]] = lamps.id[near[found]]
    return same


def lamp_records(
    building: Building,
    measurements: Measurements,
    estimate: Estimate,
    camera: Camera | None = None,
) -> tuple[LampRecord, ...]:
    """Returns what became of each lamp of the map that was seen or should have been.

    Nothing where lamps are mapped, not known: then the path does not tell which lamp is which.

    Args:
        building: its lamps; those that lie where lamps known to the measurements do are the same.
        measurements: with sightings of lamps.
        estimate: made from them.
        camera: that looks at the ceiling, where one is known.
    """
    table = measurements.sightings.get("lamp")
    sight = None if table is None else Sight.of(table, measurements.t, camera)
    known = measurements.known
    if table is None or sight is None or known is None or LAMP.kind not in known.kind:
        return ()
    first = next(first for first, own in measurements.tables() if own is table)
    match = estimate.match[first : first + len(table)]
    same = _same_lamps(building, known)
    ids = same[match[(match >= 0) & (match < len(known))]]
    frames = sight.frames(measurements.t)
    pose = interpolate_poses(frames, estimate.t, estimate.pose)
    robot = rotate_covariance(estimate.cov_floor, -estimate.pose[:, 2])
    variance = np.diagonal(robot, axis1=1, axis2=2)[:, :2].T
    spread = SIGMAS * np.sqrt([np.interp(frames, estimate.t, each) for each in variance]).T
    landmarks = building.landmarks()
    expected = sight.expects(pose, landmarks.params, spread).sum(axis=0)
    counts = np.array([np.count_nonzero(ids == number) for number in landmarks.id.tolist()])
    hit = counts > 0
    share = counts[hit].sum() / max(1, np.maximum(expected, counts)[hit].sum())
    chance = (1.0 - min(SUREST, float(share))) ** expected
    gone = (counts == 0) & (expected >= LEAST_FRAMES) & (chance < UNLIKELY)
    return tuple(
        LampRecord(
            lamp.id, building.place_of(lamp.id), int(seen), int(should), bool(out), lamp.dark
        )
        for lamp, seen, should, out in zip(building.lamps(), counts, expected, gone, strict=True)
        if seen or should
    )
