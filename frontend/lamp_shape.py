"""Place and axis of a lamp from its outline in the plane of the lamps: whole, or cut and completed.

The plane's coordinates are those of the robot frame, in metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from graphslam.geometry import Array, wrap

ITERATIONS = 20
FITTED_STARTS = 3
"""How many of the best places where a cut lamp may lie are fitted."""
LEAST_EDGE = 0.3
"""Share of an edge's length that must be in view to count as seen."""
STRAY = 3.0
"""Points farther than this many times the typical residual from the fitted edges do not count."""


@dataclass(frozen=True, slots=True)
class Moments:
    """A lamp's area, where it lies and how it lies.

    Attributes:
        area: m².
        place: ``(x, y, phi)`` of its centre of gravity and its long axis, phi modulo pi.
        length: of the rectangle that has the same second moments, m.
        width: the same.
        fill: area over that of the box around the outline along the axes.
    """

    area: float
    place: Array
    length: float
    width: float
    fill: float


def moments(outline: Array) -> Moments:
    """Returns the moments of the area inside an outline (V, 2), m, by Green's theorem.

    Source: Bellini section 3.2 (centre of gravity and orientation), in the plane of the lamps
    instead of the image, where perspective and lens would shift both.
    """
    middle = outline.mean(axis=0)
    x, y = (outline - middle).T
    x_next, y_next = np.roll(x, -1), np.roll(y, -1)
    cross = x * y_next - x_next * y
    twice = float(cross.sum())
    sign, area = (-1.0 if twice < 0 else 1.0), 0.5 * abs(twice)
    scale = sign / max(area, 1e-300)
    c_x = scale * float(np.sum((x + x_next) * cross)) / 6.0
    c_y = scale * float(np.sum((y + y_next) * cross)) / 6.0
    xx = scale * float(np.sum((x * x + x * x_next + x_next**2) * cross)) / 12.0 - c_x**2
    yy = scale * float(np.sum((y * y + y * y_next + y_next**2) * cross)) / 12.0 - c_y**2
    xy = np.sum((x * y_next + 2.0 * x * y + 2.0 * x_next * y_next + x_next * y) * cross)
    xy = scale * float(xy) / 24.0 - c_x * c_y
    phi = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    half, spread = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    length, width = np.sqrt(12.0 * max(half + spread, 0.0)), np.sqrt(12.0 * max(half - spread, 0.0))
    place = np.array([middle[0] + c_x, middle[1] + c_y, phi])
    box = np.ptp(in_lamp(outline, place), axis=0)
    return Moments(area, place, float(length), float(width), area / max(float(box.prod()), 1e-300))


def in_lamp(points: Array, place: Array) -> Array:
    """Returns points (V, 2) along and across the axis of a lamp ``(x, y, phi)``, from it."""
    c, s = np.cos(place[2]), np.sin(place[2])
    x, y = points[:, 0] - place[0], points[:, 1] - place[1]
    return np.column_stack([c * x + s * y, -s * x + c * y])


@dataclass(frozen=True, slots=True)
class Completed:
    """A cut lamp, completed.

    Attributes:
        place: ``(x, y, phi)`` of the whole lamp.
        information: (3, 3) inverse covariance of the place for points with independent errors of
            1 m across their edge.
        rms: of the points' distances from the edges, m.
    """

    place: Array
    information: Array
    rms: float


def complete(outline: Array, cut: NDArray[np.bool_], size: tuple[float, float]) -> Completed | None:
    """Returns the rectangle of a lamp's size that fits the visible edges of a cut lamp, or None.

    Least squares on the distances of the outline's points from the nearest edge; points where the
    image ends are no edge, but lie inside the lamp. None where the points do not fix the place,
    because both ends are out of view.

    Args:
        outline: (V, 2) in the plane of the lamps, m.
        cut: (V,) which of its points are where the image ends.
        size: length and width of a lamp, m.

    Source: Bellini section 3.2 and Fig. 4.
    """
    edge, beyond = outline[~cut], outline[cut]
    if len(edge) < 4:
        return None
    half = 0.5 * np.array(size)
    starts = sorted(_starts(outline, cut, half), key=lambda q: _misfit(q, edge, beyond, half))
    fits = [fit for q in starts[:FITTED_STARTS] if (fit := _fit(q, edge, half)) is not None]
    return min(fits, key=lambda f: _misfit(f.place, edge, beyond, half), default=None)


def _starts(outline: Array, cut: NDArray[np.bool_], half: Array) -> list[Array]:
    """Returns places where the lamp may lie: each of its four corners on one of the outline's."""
    step = np.roll(outline, -4, axis=0) - outline  # over several points: they lie on a grid
    free = ~(cut | np.roll(cut, -4))
    # a rectangle's edges have two directions, a right angle apart
    quarter = np.sum(
        np.hypot(*step[free].T) * np.exp(4j * np.arctan2(step[free, 1], step[free, 0]))
    )
    starts = []
    for phi in 0.25 * np.angle(quarter) + np.array([0.0, 0.5 * np.pi]):
        at = in_lamp(outline[~cut], np.array([0.0, 0.0, phi]))
        low, high = at.min(axis=0) + half, at.max(axis=0) - half
        for a, b in product((low[0], high[0]), (low[1], high[1])):
            c, s = np.cos(phi), np.sin(phi)
            starts.append(np.array([c * a - s * b, s * a + c * b, phi]))
    return starts


def _misfit(place: Array, edge: Array, beyond: Array, half: Array) -> float:
    """Returns the mean distance of points from where they should be, m."""
    away = np.abs(_distances(in_lamp(edge, place), half)[0])
    out = np.maximum(np.abs(in_lamp(beyond, place)) - half, 0.0).sum(axis=1)
    return float((away.sum() + out.sum()) / (len(away) + len(out)))


def _distances(at: Array, half: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Returns the signed distances (V,) of points from the nearest edge, outside positive, and
    whether that edge is an end of the lamp."""
    gap = np.abs(at) - half
    end = np.abs(gap[:, 0]) < np.abs(gap[:, 1])
    return np.where(end, gap[:, 0], gap[:, 1]), end


def _shows(along: Array, half: float) -> bool:
    """Returns whether points along edges of one direction show enough of them to tell."""
    return len(along) > 1 and float(np.ptp(along)) >= LEAST_EDGE * 2.0 * half


def _fit(place: Array, edge: Array, half: Array) -> Completed | None:
    """Returns the place that Gauss-Newton finds from a start, or None where nothing fixes it."""
    q = place
    for _ in range(ITERATIONS):
        at = in_lamp(edge, q)
        d, end = _distances(at, half)
        typical = max(1.4826 * float(np.median(np.abs(d))), 1e-6 * float(half[0]))
        near = np.abs(d) <= STRAY * typical
        side = np.sign(np.where(end, at[:, 0], at[:, 1]))
        c, s = np.cos(q[2]), np.sin(q[2])
        J = np.column_stack(
            [
                side * np.where(end, -c, s),
                side * np.where(end, -s, -c),
                side * np.where(end, at[:, 1], -at[:, 0]),
            ]
        )[near]
        information = J.T @ J
        if not (_shows(at[near & end, 1], half[1]) and _shows(at[near & ~end, 0], half[0])):
            return None
        step = np.linalg.solve(information, -J.T @ d[near])
        q = q + step
        if np.hypot(*step[:2]) < 1e-7 * half[0] and abs(step[2]) < 1e-7:
            break
    d = _distances(in_lamp(edge, q), half)[0]
    q = np.array([q[0], q[1], 0.5 * wrap(2.0 * q[2])])
    return Completed(q, information, float(np.sqrt(np.mean(d**2))))
