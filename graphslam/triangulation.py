"""Where a robot stands from the directions of known points alone, without any memory (Kato)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from graphslam.errors import UnderConstrained
from graphslam.geometry import Array, wrap
from graphslam.models.bearing import BEARING

ON_CIRCLE = 1e-6
"""Robot and beacons count as on one circle (or line) where the information on the pose, of unit
bearings and with lengths as shares of the beacons' spread, is this near to singular."""
NEAR_CIRCLE = 0.05
"""The same, where directions that fit no place may be those of a place next to the circle."""
SAME_DIRECTION = math.radians(30.0)
"""Headings by single beacons that agree less mean that the bearings are of other beacons."""
MOST_TRIPLES = 20
WORST_SIGMA = 0.25
"""A position is not determined where its standard deviation is beyond this share of the beacons'
spread: the linear covariance means nothing any more."""
REFINEMENTS = 20


@dataclass(frozen=True, slots=True)
class Fix:
    """A pose from bearings.

    Attributes:
        pose: (3,) floor frame, m and rad.
        cov: (3, 3) its covariance, floor frame.
        cost: half the sum of squared normalised residuals; 0 for three beacons.
    """

    pose: Array
    cov: Array
    cost: float


def three_cones(bearing: Array, width: float, height: float) -> Array:
    """Returns the pose (3,) from bearings (3,) to cones at (0, 0), (0, height) and (width, 0).

    Args:
        bearing: to the cones in that order, rad, robot frame.
        width: W, m.
        height: H, m.

    Raises:
        UnderConstrained: the robot stands on the circle through the cones.

    Source: Kato eqs. (1)-(3) with the erratum x - W in (2) and atan2 in (3); (3) is multiplied out
    so that no tangent is infinite.
    """
    a, b, c = np.asarray(bearing, float)
    cones = np.array([[0.0, 0.0], [0.0, height], [width, 0.0]])
    M1, M2 = math.sin(a - b), math.sin(a - c)  # times 1 / (cos a cos b), 1 / (cos a cos c)
    up = height * M2 * math.cos(b) + width * M1 * math.sin(c)
    across = height * M2 * math.sin(b) - width * M1 * math.cos(c)
    # tan(theta) = up / across: both ends of that direction are tried, the cones tell which
    if math.hypot(up, across) < ON_CIRCLE * max(width, height):
        raise UnderConstrained(singular_place(cones))
    for theta in (math.atan2(up, across), math.atan2(-up, -across)):
        (s0, c0), (s1, c1), (s2, c2) = (
            (math.sin(theta + v), math.cos(theta + v)) for v in (a, b, c)
        )
        by_height, by_width = s0 * c1 - s1 * c0, s2 * c0 - s0 * c2
        if abs(by_height) >= abs(by_width):  # the ray through the first cone, and the clearer other
            distance = height * c1 / by_height
        else:
            distance = width * s2 / by_width
        pose = np.array([distance * c0, distance * s0, theta])
        e = BEARING.residual(pose, cones, np.asarray(bearing, float)[:, None])[0]
        if np.abs(e).max() < 1e-6:
            pose[2] = wrap(theta)
            return pose
    raise UnderConstrained(singular_place(cones))


def three_beacons(beacons: Array, bearing: Array) -> Array:
    """Returns the pose (3,) from bearings (3,) to any three beacons (3, 2), in any order.

    The robot is where the circles meet again on which the middle beacon and each other one are seen
    under their angle. With the middle beacon as origin, a circle through it is |X|^2 = c X; both
    hold where X is the part of c across the difference of both c. Sines stay multiplied out, so
    that beacons in one direction, or in opposite ones, need no case of their own.

    Raises:
        UnderConstrained: beacons and robot lie on one circle or line; or no place at all sees the
            beacons in these directions.

    Source: V. Pierlot, M. Van Droogenbroeck, A New Three Object Triangulation Algorithm for Mobile
    Robot Positioning (2014), which adds the third circle to do without the square root.
    """
    beacons, bearing = np.asarray(beacons, float), np.asarray(bearing, float)
    spread = _spread(beacons)
    p, q = (beacons[0] - beacons[1]) / spread, (beacons[2] - beacons[1]) / spread
    s12, c12 = math.sin(bearing[1] - bearing[0]), math.cos(bearing[1] - bearing[0])
    s23, c23 = math.sin(bearing[2] - bearing[1]), math.cos(bearing[2] - bearing[1])
    first = s12 * p + c12 * np.array([p[1], -p[0]])
    second = s23 * q - c23 * np.array([q[1], -q[0]])
    between = s23 * first - s12 * second
    if np.hypot(*between) < ON_CIRCLE:
        raise UnderConstrained(singular_place(beacons))
    across = np.array([-between[1], between[0]]) / np.hypot(*between)
    along = across @ first / s12 if abs(s12) >= abs(s23) else across @ second / s23
    place = beacons[1] + spread * along * across
    offset = beacons - place
    heading = np.arctan2(offset[:, 1], offset[:, 0]) - bearing
    theta = float(np.angle(np.exp(1j * heading).sum()))
    if np.abs(wrap(heading - theta)).max() > SAME_DIRECTION:
        if np.hypot(*between) < NEAR_CIRCLE:
            raise UnderConstrained(singular_place(beacons))
        raise UnderConstrained("no place sees these beacons in these directions: check their names")
    return np.array([*place, theta])


def fix(beacons: Array, bearing: Array, variance: Array) -> Fix:
    """Returns the most likely pose from bearings to three or more known beacons.

    Three beacons have a closed form; with more it starts Gauss-Newton from the triple that explains
    all bearings best.

    Args:
        beacons: (n, 2) floor frame, m.
        bearing: (n,) rad, robot frame.
        variance: (n,) rad².

    Raises:
        UnderConstrained: fewer than three, or the pose is not determined: robot and beacons lie on
            one circle or line, or so near that the covariance is beyond `WORST_SIGMA`.
    """
    count = len(beacons)
    if count < 3:
        raise UnderConstrained(f"{count} bearings fix no pose; it takes three")
    found: list[tuple[float, Array]] = []
    refused = ""
    for triple in _triples(count):
        try:
            pose = three_beacons(beacons[triple], bearing[triple])
        except UnderConstrained as error:
            refused = str(error)
            continue
        found.append((_cost(pose, beacons, bearing, variance), pose))
    if not found:
        raise UnderConstrained(refused)
    pose = min(found, key=lambda entry: entry[0])[1]
    for _ in range(REFINEMENTS if count > 3 else 0):
        e, J, _ = BEARING.residual(pose, beacons, bearing[:, None])
        weighted = J[:, 0] / variance[:, None]
        information = weighted.T @ J[:, 0]
        if not np.linalg.cond(information) < 1e14:
            raise UnderConstrained(singular_place(beacons))
        step = np.linalg.solve(information, weighted.T @ e[:, 0])
        pose = pose - step
        if np.abs(step).max() < 1e-12 * max(1.0, np.abs(pose).max()):
            break
    pose[2] = wrap(pose[2])
    cov = pose_covariance(pose, beacons, variance)
    if not np.sqrt(np.linalg.eigvalsh(cov[:2, :2])[1]) < WORST_SIGMA * _spread(beacons):
        raise UnderConstrained(singular_place(beacons))
    return Fix(pose, cov, _cost(pose, beacons, bearing, variance))


def pose_covariance(pose: Array, beacons: Array, variance: Array) -> Array:
    """Returns the bound on the covariance (..., 3, 3) of poses (..., 3) from bearings, floor frame.

    Infinite where beacons (n, 2) and robot lie on one circle or line.

    Args:
        pose: (..., 3) floor frame.
        beacons: (n, 2) floor frame, m.
        variance: (n,) of the bearings, rad².
    """
    pose = np.asarray(pose, float)
    _, J, _ = BEARING.residual(pose[..., None, :], beacons, np.zeros((len(beacons), 1)))
    J = J[..., 0, :]
    information = np.swapaxes(J, -1, -2) @ (J / np.asarray(variance)[:, None])
    scale = np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), 1e-300))
    scaled = information / scale[..., :, None] / scale[..., None, :]
    singular = np.linalg.eigvalsh(scaled)[..., 0] < ON_CIRCLE**2
    scaled = np.where(singular[..., None, None], np.eye(3), scaled)
    cov = np.linalg.inv(scaled) / scale[..., :, None] / scale[..., None, :]
    return np.where(singular[..., None, None], np.inf, cov)


def circle_through(points: Array) -> tuple[Array, float]:
    """Returns centre (2,) and radius, m, of the circle through three points; inf for a line."""
    (a, b, c) = np.asarray(points, float)
    u, v = b - a, c - a
    twice = 2.0 * (u[0] * v[1] - u[1] * v[0])
    if abs(twice) < ON_CIRCLE * _spread(points) ** 2:
        return np.full(2, np.inf), math.inf
    centre = np.array([v[1] * (u @ u) - u[1] * (v @ v), u[0] * (v @ v) - v[0] * (u @ u)]) / twice
    return a + centre, float(np.hypot(*centre))


def singular_place(beacons: Array) -> str:
    """Returns in words where bearings to these beacons fix no pose, and what helps."""
    if len(beacons) > 3:
        return (
            "the pose is not determined: robot and beacons lie on, or near, one circle or line, or "
            "far outside the beacons; add a beacon elsewhere"
        )
    centre, radius = circle_through(beacons)
    where = "line through the three beacons"
    if math.isfinite(radius):
        x, y = centre
        where = (
            f"circle through the three beacons (centre {x:.3g}, {y:.3g} m, radius {radius:.3g} m)"
        )
    return (
        f"the pose is not determined: the robot is on, or near, the {where}, where their bearings "
        "fix nothing; add a beacon off it, or move"
    )


def _spread(beacons: Array) -> float:
    """Returns the largest distance between beacons, m."""
    beacons = np.asarray(beacons, float)
    return float(np.linalg.norm(beacons[:, None] - beacons[None], axis=2).max())


def _cost(pose: Array, beacons: Array, bearing: Array, variance: Array) -> float:
    e = BEARING.residual(pose, beacons, bearing[:, None])[0][:, 0]
    return float(0.5 * np.sum(e**2 / variance))


def _triples(count: int) -> list[list[int]]:
    """Returns rows of triples, each beacon in the middle too; not more than `MOST_TRIPLES`."""
    every = [list(t) for t in combinations(range(count), 3)]
    return every[:: max(1, len(every) // MOST_TRIPLES)]
