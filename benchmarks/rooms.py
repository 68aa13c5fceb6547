"""A benchmark problem of any size: a robot wanders through rooms with four floor lines each."""

from __future__ import annotations

import numpy as np

from graphslam.baseline import integrate
from graphslam.geometry import compose, line_to_robot
from graphslam.measurements import Measurements, Odometry, Sightings
from graphslam.smoother.problem import Problem

SIDE = 5.0
"""Side of a room, m."""
OFFSETS = (-1.3, 1.7)
"""Where a room's lines lie, across both axes, from its middle, m."""
ODOMETRY_SIGMA = np.array([0.002, 0.002, 0.003])
SIGHTING_SIGMA = np.array([0.005, 0.009])
START_SIGMA = 1e-6


def rooms_problem(nodes: int, lines: int, seed: int = 1) -> Problem:
    """Returns a problem with two sightings a pose, of known lines, and a start a little off.

    From each pose two lines of its room are seen, drawn by chance.

    Args:
        nodes: number of poses.
        lines: lines in the world, four a room; those never seen are left out.
        seed: of the way taken, the noise and the start.
    """
    rng = np.random.default_rng(seed)
    increments, room = _wander(nodes, lines // 4, rng)
    start = np.array([0.0, 0.0, 0.0])
    truth = integrate(start, increments)
    world = _world(lines // 4)
    per_room = world.reshape(-1, 4, 2)
    seen = line_to_robot(per_room[room], truth[:, None, :])
    chosen = np.sort(rng.permuted(np.tile(np.arange(4), (nodes, 1)), axis=1)[:, :2], axis=1)
    z = np.take_along_axis(seen, chosen[..., None], axis=1).reshape(-1, 2)
    z = z + rng.standard_normal(z.shape) * SIGHTING_SIGMA
    identity = (4 * room[:, None] + chosen).ravel()
    known, match = np.unique(identity, return_inverse=True)
    node, count = np.repeat(np.arange(nodes), 2), 2 * nodes
    table = Sightings(
        "line",
        node,
        z,
        np.broadcast_to(np.diag(SIGHTING_SIGMA**2), (count, 2, 2)),
        np.full((count, 2), np.nan),
        0.1 * node,
        np.ones(count),
        node,
        identity,
    )
    measured = increments + rng.standard_normal((nodes - 1, 3)) * ODOMETRY_SIGMA
    cov = np.broadcast_to(np.diag(ODOMETRY_SIGMA**2), (nodes - 1, 3, 3))
    measurements = Measurements(
        0.1 * np.arange(nodes),
        start,
        START_SIGMA**2 * np.eye(3),
        Odometry(measured, cov),
        {"line": table},
    )
    pose = compose(truth, _slow_error(nodes, rng) * np.array([0.05, 0.05, 0.01]))
    pose[0] = start
    params = world[known] + rng.standard_normal((len(known), 2)) * np.array([0.03, 0.01])
    return Problem(
        measurements,
        match,
        ("line",) * len(known),
        np.zeros(len(known), bool),
        pose,
        params,
        np.ones(count),
        np.ones(nodes - 1),
    )


def _wide(rooms: int) -> int:
    return max(int(np.sqrt(rooms)), 1)


def _world(rooms: int) -> np.ndarray:
    """Returns the lines (4 * rooms, 2): two across each axis of every room."""
    row, column = np.divmod(np.arange(rooms), _wide(rooms))
    lines = np.zeros((rooms, 4, 2))
    for n, offset in enumerate(OFFSETS):
        lines[:, n, 0] = SIDE * column + offset
        lines[:, 2 + n] = np.column_stack([SIDE * row + offset, np.full(rooms, np.pi / 2)])
    return lines.reshape(-1, 2)


def _wander(nodes: int, rooms: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Returns exact increments (nodes - 1, 3), and the room of each node: middle to middle."""
    wide = _wide(rooms)
    moves = ((0, 1), (1, 0), (0, -1), (-1, 0))
    straight, turn = int(SIDE / 0.1), np.pi / 20
    steps: list[list[float]] = []
    where: list[int] = [0]
    row, column, heading = 0, 0, 0
    while len(where) < nodes:
        options = [
            h
            for h, (dr, dc) in enumerate(moves)
            if 0 <= column + dc < wide and row + dr >= 0 and (row + dr) * wide + column + dc < rooms
        ]
        ahead = [h for h in options if h != (heading + 2) % 4] or options
        way = int(rng.choice(ahead))
        quarter = (way - heading + 1) % 4 - 1  # of a turn, 2 is about-face
        steps += [[0.0, 0.0, np.sign(quarter) * turn]] * (10 * abs(quarter))
        where += [row * wide + column] * (10 * abs(quarter))
        steps += [[SIDE / straight, 0.0, 0.0]] * straight
        here, row, column = row * wide + column, row + moves[way][0], column + moves[way][1]
        where += [here] * (straight // 2) + [row * wide + column] * (straight - straight // 2)
        heading = way
    return np.array(steps[: nodes - 1]), np.array(where[:nodes])


def _slow_error(nodes: int, rng: np.random.Generator, length: int = 200) -> np.ndarray:
    """Returns unit noise (nodes, 3) that changes over ``length`` nodes."""
    knots = rng.standard_normal((nodes // length + 2, 3))
    at = np.arange(nodes) / length
    return np.column_stack([np.interp(at, np.arange(len(knots)), column) for column in knots.T])
