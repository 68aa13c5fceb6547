"""Walls in scans: found where they are, with honest covariances; what is no wall is counted."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from frontend.recorded import Scan
from frontend.wall_config import WallConfig
from frontend.wall_pieces import REASONS
from frontend.walls import detect_walls
from graphslam.geometry import Array, inverse, line_to_floor, transform_points, wrap

STEP = np.radians(1.0)
ROOM = np.array([[-2.0, -3.0], [4.0, -3.0], [4.0, 2.0], [-2.0, 2.0], [-2.0, -3.0]])


def scan_of(corners: Array, pose: Array, sigma: float, seed: int, motion: Array | None = None):
    """Returns what a laser at ``pose`` sees of a polygon (K, 2), noise and motion included."""
    rng = np.random.default_rng(seed)
    angles = -np.pi / 2 + STEP * np.arange(181)
    ranges = np.full(181, np.inf)
    for n, angle in enumerate(angles):
        here = pose if motion is None else _moved(pose, motion * n / 180)
        direction = np.array([np.cos(here[2] + angle), np.sin(here[2] + angle)])
        for p, q in itertools.pairwise(corners):
            edge = q - p
            det = direction[0] * -edge[1] + direction[1] * edge[0]
            if abs(det) > 1e-12:
                away = p - here[:2]
                r = (away[0] * -edge[1] + away[1] * edge[0]) / det
                s = (direction[0] * away[1] - direction[1] * away[0]) / det
                if r > 0 and 0 <= s <= 1:
                    ranges[n] = min(ranges[n], r)
    return Scan(ranges + sigma * rng.standard_normal(181), -np.pi / 2, STEP)


def _moved(pose: Array, motion: Array) -> Array:
    return np.array([*transform_points(pose, motion[:2]), pose[2] + motion[2]])


def true_line(p: Array, q: Array, pose: Array) -> Array:
    """Returns the line through two points in the robot frame."""
    direction = q - p
    alpha = np.arctan2(direction[0], -direction[1])
    rho = p[0] * np.cos(alpha) + p[1] * np.sin(alpha)
    return np.asarray(line_to_floor(np.array([rho, alpha]), inverse(pose)))


def errors(walls, corners: Array, pose: Array) -> tuple[Array, Array]:
    """Returns errors (K, 2) against the nearest true wall, modulo the twin, and covariances."""
    out = []
    for z in walls.z:
        best = None
        for p, q in itertools.pairwise(corners):
            line = true_line(p, q, pose)
            for sign, turn in ((1.0, 0.0), (-1.0, np.pi)):
                e = np.array([z[0] - sign * line[0], wrap(z[1] - line[1] - turn)])
                if best is None or np.abs(e).sum() < np.abs(best).sum():
                    best = e
        out.append(best)
    return np.array(out), walls.cov


def test_a_room_gives_its_walls():
    pose = np.array([0.3, -0.4, 0.2])
    walls = detect_walls(scan_of(ROOM, pose, 0.005, 1), np.zeros(3), WallConfig())
    e, _ = errors(walls, ROOM, pose)
    assert len(walls) == 3  # the fourth is behind the laser
    assert np.abs(e).max() < 0.02
    assert np.all(walls.z[:, 0] >= 0)
    assert np.all(walls.extent[:, 1] - walls.extent[:, 0] > 1.0)


def test_covariance_is_that_of_range_noise():
    config = WallConfig(
        range_sigma_m=0.02, beam_sigma_deg=0, range_bias_m=0, direction_floor_deg=0,
        straightness_m=0, split_m=0.2,
    )  # fmt: skip
    pose = np.array([0.3, -0.4, 0.2])
    nees = []
    for seed in range(60):
        walls = detect_walls(scan_of(ROOM, pose, 0.02, seed), np.zeros(3), config)
        e, cov = errors(walls, ROOM, pose)
        long = walls.extent[:, 1] - walls.extent[:, 0] > 1.0
        nees += [v @ np.linalg.solve(P, v) for v, P in zip(e[long], cov[long], strict=True)]
    # mean of n chi-square variables of 2 dimensions: 2 +- 4 * 2 / sqrt(n); end points that two
    # walls share cost a little
    assert 1.6 < np.mean(nees) < 2.6


def test_the_laser_may_sit_anywhere_on_the_robot():
    pose, sensor = np.array([0.5, 0.2, -0.3]), np.array([0.2, -0.1, 0.15])
    seen = scan_of(ROOM, _moved(pose, sensor), 0.0, 0)
    e, _ = errors(detect_walls(seen, sensor, WallConfig()), ROOM, pose)
    assert np.abs(e).max() < 2e-3


def test_motion_during_a_scan_is_taken_out():
    pose, motion = np.array([0.0, 0.0, 0.0]), np.array([0.05, 0.0, 0.2])
    seen = scan_of(ROOM, pose, 0.0, 0, motion)
    with_it = detect_walls(seen, np.zeros(3), WallConfig(), motion)
    without = detect_walls(seen, np.zeros(3), WallConfig())
    assert np.abs(errors(with_it, ROOM, pose)[0]).max() < 2e-3
    assert np.abs(errors(without, ROOM, pose)[0]).max() > 0.05


def test_pieces_on_both_sides_of_a_door_are_one_wall():
    angles = -np.pi / 2 + STEP * np.arange(181)
    ranges = 2.0 / np.maximum(np.cos(angles), 1e-9)
    ranges[np.abs(ranges * np.sin(angles)) < 0.5] = 6.0
    ranges[ranges > 10.0] = np.inf
    config = WallConfig(min_length_m=0.9)
    apart = detect_walls(Scan(ranges, -np.pi / 2, STEP), np.zeros(3), WallConfig(max_break_m=0.5))
    whole = detect_walls(Scan(ranges, -np.pi / 2, STEP), np.zeros(3), config)
    at_two = np.abs(whole.z[:, 0] - 2.0) < 0.05
    assert np.sum(at_two) == 1
    assert np.sum(np.abs(apart.z[:, 0] - 2.0) < 0.05) == 2


@pytest.mark.parametrize("reason", REASONS[:4])
def test_what_is_no_wall_is_counted(reason: str):
    angles = -np.pi / 2 + STEP * np.arange(181)
    round_ = np.where(np.abs(angles) < 0.6, 1.0 / np.cos(0.9 * angles), np.nan)
    short = np.where(np.abs(angles) < 0.06, 1.0 / np.cos(angles), np.nan)
    grazed = np.where(angles > 1.1, 0.3 / np.maximum(np.cos(angles), 0.01), np.nan)
    few = np.where(np.abs(angles) < 0.03, 10.0, np.nan)
    case = dict(zip(REASONS[:4], (few, short, grazed, round_), strict=True))[reason]
    config = WallConfig(curved=0.5 if reason == REASONS[3] else 2.0, grazing_deg=30.0)
    if reason == REASONS[3]:
        config = WallConfig(curved=0.5, split_m=1.0, straightness_m=0.0, range_sigma_m=0.002)
    walls = detect_walls(Scan(case, -np.pi / 2, STEP), np.zeros(3), config)
    assert walls.rejected[reason] >= 1, dict(walls.rejected)
    assert not len(walls)


def test_an_empty_scan_has_no_walls():
    walls = detect_walls(Scan(np.full(5, np.nan), 0.0, 0.1), np.zeros(3), WallConfig())
    assert len(walls) == 0
