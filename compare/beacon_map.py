"""Where bearings to given beacons fix the pose, how well, and where one more beacon helps most."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from compare.arrays import freeze_arrays
from compare.truth import BoolArray
from graphslam.errors import BadConfig
from graphslam.geometry import Array
from graphslam.triangulation import circle_through, pose_covariance

PROBABILITY = 0.95
SCALE = math.sqrt(-2.0 * math.log(1.0 - PROBABILITY))
"""Half axes of a plane Gaussian's ellipse of that probability, in standard deviations."""
CELLS = 60
"""Places along the longer side of the field at which the error is computed."""
TRIED = 24
"""Places along the longer side at which one more beacon is tried."""
AROUND = 0.25
"""How far the map goes on around the field, and how far from it one more beacon may stand, as a
share of its longer side."""
CLEAR = 0.02
"""No place nearer to a beacon than this share of the longer side counts: the robot is in it."""


@dataclass(frozen=True, slots=True)
class Field:
    """A rectangle of the floor: its corners, m."""

    low: tuple[float, float]
    high: tuple[float, float]

    def __post_init__(self) -> None:
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise BadConfig(f"the field from {self.low} to {self.high} is empty; exchange its ends")

    @property
    def size(self) -> float:
        """The longer side, m."""
        return max(b - a for a, b in zip(self.low, self.high, strict=True))

    def places(self, count: int, margin: float = 0.0) -> tuple[Array, Array]:
        """Returns x (n,) and y (m,) of the middles of square cells, ``count`` on the longer side.

        Args:
            count: cells along the longer side, of a field without margin.
            margin: how far the cells go on outside the field, m.
        """
        cell = self.size / count
        axes = []
        for low, high in zip(self.low, self.high, strict=True):
            number = max(1, round((high - low + 2.0 * margin) / cell))
            step = (high - low + 2.0 * margin) / number
            axes.append(low - margin + (np.arange(number) + 0.5) * step)
        return axes[0], axes[1]


@dataclass(frozen=True, slots=True)
class BeaconMap:
    """How well bearings to beacons fix the pose over a field, and some way around it.

    Attributes:
        field: the rectangle.
        beacons: (B, 2) m, floor frame.
        sigma: standard deviation of a bearing, rad.
        x: (n,) places, m.
        y: (m,) places, m.
        cov: (m, n, 3, 3) bound on the covariance of the pose, floor frame, m and rad; infinite
            where the pose is not determined.
    """

    field: Field
    beacons: Array
    sigma: float
    x: Array
    y: Array
    cov: Array

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def inside(self) -> BoolArray:
        """Returns which places (m, n) lie in the field."""
        (x0, y0), (x1, y1) = self.field.low, self.field.high
        across, up = (self.x >= x0) & (self.x <= x1), (self.y >= y0) & (self.y <= y1)
        return up[:, None] & across

    def half_axes(self) -> Array:
        """Returns the longer half axis (m, n) of the ellipse of `PROBABILITY`, m; inf likewise."""
        return SCALE * _largest_sigma(self.cov)

    def heading_sigma_deg(self) -> Array:
        """Returns the standard deviation (m, n) of the heading, degrees."""
        return np.degrees(np.sqrt(self.cov[..., 2, 2]))

    def circles(self) -> list[tuple[Array, float]]:
        """Returns centre and radius, m, of the circle on which three beacons fix nothing.

        Empty for more than three beacons, unless all lie on one circle; radius inf for a line.
        """
        found = [circle_through(self.beacons[list(t)]) for t in combinations(range(self.count), 3)]
        centre, radius = found[0]
        for other, size in found[1:]:
            both = math.isfinite(radius) and math.isfinite(size)
            same = both and np.hypot(*(other - centre)) + abs(size - radius) < 1e-6 * radius
            if not (same or (math.isinf(radius) and math.isinf(size))):
                return []
        return [found[0]]

    @property
    def count(self) -> int:
        """Number of beacons."""
        return len(self.beacons)


@dataclass(frozen=True, slots=True)
class Advice:
    """Where one more beacon helps most.

    Attributes:
        place: (2,) m.
        x: (n,) places tried, m.
        y: (m,) places tried, m.
        worst: (m, n) half axis that 95 % of the field stays below with a beacon there, m.
        worst_now: the same without it, m; inf where more than 5 % of the field is not determined.
        median_now: half axis that half of the field stays below, m.
        median_then: the same with the beacon, m.
        worst_then: that of `worst` at the best place, m.
    """

    place: Array
    x: Array
    y: Array
    worst: Array
    worst_now: float
    median_now: float
    median_then: float
    worst_then: float

    def __post_init__(self) -> None:
        freeze_arrays(self)


def beacon_map(beacons: Array, field: Field, sigma: float, cells: int = CELLS) -> BeaconMap:
    """Returns the bound on the pose's covariance over a field.

    It does not depend on the heading. Every beacon is seen from everywhere, each bearing with the
    same standard deviation.

    Args:
        beacons: (B, 2) m, floor frame; three or more.
        field: where the robot drives.
        sigma: standard deviation of a bearing, rad.
        cells: places along the longer side.

    Raises:
        BadConfig: fewer than three beacons.
    """
    beacons = np.asarray(beacons, float)
    if len(beacons) < 3:
        raise BadConfig(
            f"{len(beacons)} beacons fix no pose anywhere; give three, or add odometry and map "
            "them: graphslam run"
        )
    x, y = field.places(cells, AROUND * field.size)
    cov = pose_covariance(_poses(x, y), beacons, np.full(len(beacons), sigma**2))
    return BeaconMap(field, beacons, sigma, x, y, cov)


def one_more(drawn: BeaconMap, cells: int = 20, tried: int = TRIED) -> Advice:
    """Returns where one more beacon makes the error smallest that 95 % of the field stays below.

    Args:
        drawn: the map without it.
        cells: places along the longer side at which the error is judged.
        tried: places along the longer side where the beacon may stand, in the field and around it.
    """
    field = drawn.field
    x, y = field.places(tried, AROUND * field.size)
    judged = _poses(*field.places(cells)).reshape(-1, 3)
    now = SCALE * _largest_sigma(_cov(judged, drawn.beacons, drawn.sigma))
    worst = np.empty((len(y), len(x)))
    for row, column in np.ndindex(worst.shape):
        more = np.vstack([drawn.beacons, [x[column], y[row]]])
        clear = np.hypot(*(judged[:, :2] - more[-1]).T) > CLEAR * field.size
        half = SCALE * _largest_sigma(_cov(judged[clear], more, drawn.sigma))
        worst[row, column] = np.quantile(half, PROBABILITY, method="higher")
    row, column = np.unravel_index(int(np.argmin(worst)), worst.shape)
    place = np.array([x[column], y[row]])
    then = SCALE * _largest_sigma(_cov(judged, np.vstack([drawn.beacons, place]), drawn.sigma))
    return Advice(
        place=place,
        x=x,
        y=y,
        worst=worst,
        worst_now=float(np.quantile(now, PROBABILITY, method="higher")),
        median_now=float(np.quantile(now, 0.5, method="higher")),
        median_then=float(np.quantile(then, 0.5, method="higher")),
        worst_then=float(worst.min()),
    )


def _poses(x: Array, y: Array) -> Array:
    """Returns poses (m, n, 3) at all places, heading along x."""
    across, up = np.meshgrid(x, y)
    return np.stack([across, up, np.zeros_like(across)], axis=-1)


def _cov(pose: Array, beacons: Array, sigma: float) -> Array:
    return pose_covariance(pose, beacons, np.full(len(beacons), sigma**2))


def _largest_sigma(cov: Array) -> Array:
    """Returns the largest standard deviation (...) of position, m; inf where it is not fixed."""
    fixed = np.isfinite(cov[..., 0, 0])
    safe = np.where(fixed[..., None, None], cov[..., :2, :2], np.eye(2))
    return np.where(fixed, np.sqrt(np.linalg.eigvalsh(safe)[..., 1]), np.inf)
