"""Small measurement-level worlds for tests: lines, a drive, and noise drawn from its own law."""

from __future__ import annotations

import numpy as np

from graphslam.baseline import integrate
from graphslam.geometry import line_to_robot, wrap
from graphslam.measurements import LandmarkMap, Measurements, Odometry, Sightings

GRID = np.array(
    [(rho, 0.0) for rho in (0.4, 1.5, 2.7, 4.1)]
    + [(rho, np.pi / 2) for rho in (0.3, 1.2, 2.6, 3.9)]
)
START = np.array([0.5, 0.5, 0.1])


def square_drive(nodes: int, side: float = 3.0) -> np.ndarray:
    """Returns exact increments (nodes - 1, 3) of laps around a square with rounded corners."""
    step, turn = 0.1, np.pi / 20
    straight, corner = int(side / step), 10
    lap = ([[step, 0.0, 0.0]] * straight + [[0.03, 0.0, turn]] * corner) * 4
    return np.resize(np.array(lap), (nodes - 1, 3))


def drive(
    seed: int,
    nodes: int = 200,
    lines: np.ndarray = GRID,
    odometry_sigma: tuple[float, float, float] = (0.004, 0.004, 0.006),
    sighting_sigma: tuple[float, float] = (0.01, 0.01),
    start_sigma: float = 1e-6,
    noise: float = 1.0,
    reach: float = 1.0,
) -> tuple[Measurements, np.ndarray]:
    """Returns measurements of a drive over ``lines`` and its true poses (nodes, 3).

    ``noise`` scales the errors drawn, not the covariances stated: 0 gives the truth itself. Lines
    within ``reach`` metres of the robot are seen; half of them under their twin's name.
    """
    rng = np.random.default_rng(seed)
    increments = square_drive(nodes)
    cov = np.diag(np.square(odometry_sigma))
    # the residual is between(true poses) - increment, so the error is added to the true motion
    start = START + noise * start_sigma * rng.standard_normal(3)
    truth = integrate(start, increments)
    measured = increments + noise * rng.standard_normal((nodes - 1, 3)) * odometry_sigma
    node, z, identity = [], [], []
    for i, pose in enumerate(truth):
        seen = line_to_robot(lines, pose)
        for line in np.flatnonzero(np.abs(seen[:, 0]) < reach):
            value = seen[line] + noise * rng.standard_normal(2) * sighting_sigma
            if rng.random() < 0.5:
                value = np.array([-value[0], value[1] + np.pi])
            node.append(i)
            z.append(value)
            identity.append(line)
    count = len(node)
    table = Sightings(
        "line",
        np.array(node),
        np.array(z).reshape(-1, 2),
        np.broadcast_to(np.diag(np.square(sighting_sigma)), (count, 2, 2)),
        np.tile([-0.5, 0.5], (count, 1)),
        np.array(node) * 0.1,
        np.ones(count),
        np.array(node),
        np.array(identity, dtype=int),
    )
    odometry = Odometry(measured, np.broadcast_to(cov, (nodes - 1, 3, 3)))
    measurements = Measurements(
        0.1 * np.arange(nodes), START, start_sigma**2 * np.eye(3), odometry, {"line": table}
    )
    return measurements, truth


CONES = np.array([[-1.0, -1.2], [4.5, -1.0], [5.0, 4.4], [-0.9, 4.6], [1.8, 1.9], [9.0, 2.0]])


def bearing_drive(
    seed: int,
    nodes: int = 200,
    points: np.ndarray = CONES,
    labels: np.ndarray | None = None,
    known: bool = False,
    odometry_sigma: tuple[float, float, float] = (0.004, 0.004, 0.006),
    bearing_sigma: float = 0.01,
    start_sigma: float = 1e-6,
    noise: float = 1.0,
) -> tuple[Measurements, np.ndarray]:
    """Returns measurements of a drive that sees the directions of all ``points`` at every node.

    With it the true poses (nodes, 3); ``noise`` as in `drive`, ``known`` gives the points away.
    """
    rng = np.random.default_rng(seed)
    increments = square_drive(nodes)
    start = START + noise * start_sigma * rng.standard_normal(3)
    truth = integrate(start, increments)
    measured = increments + noise * rng.standard_normal((nodes - 1, 3)) * odometry_sigma
    node = np.repeat(np.arange(nodes), len(points))
    which = np.tile(np.arange(len(points)), nodes)
    offset = points[which] - truth[node, :2]
    z = np.arctan2(offset[:, 1], offset[:, 0]) - truth[node, 2]
    z = z + noise * bearing_sigma * rng.standard_normal(len(node))
    count, labels = len(node), np.full(len(points), -1) if labels is None else labels
    table = Sightings(
        "bearing",
        node,
        wrap(z)[:, None],
        np.broadcast_to(bearing_sigma**2 * np.eye(1), (count, 1, 1)),
        np.full((count, 2), np.nan),
        0.1 * node,
        np.full(count, np.nan),
        np.full(count, -1),
        which,
        labels[which],
    )
    given = None
    if known:
        none = np.full((len(points), 2), np.nan)
        zeros = np.zeros(len(points), int)
        given = LandmarkMap(
            np.arange(len(points)), ("bearing",) * len(points), points, none, zeros, labels
        )
    odometry = Odometry(
        measured, np.broadcast_to(np.diag(np.square(odometry_sigma)), (nodes - 1, 3, 3))
    )
    measurements = Measurements(
        0.1 * np.arange(nodes),
        START,
        start_sigma**2 * np.eye(3),
        odometry,
        {"bearing": table},
        given,
    )
    return measurements, truth
