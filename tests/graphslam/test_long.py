"""Long logs: odometry's drift is found, maps are laid on each other, loops close or are told."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frontend.config import ExtractConfig
from frontend.extract import extract
from frontend.log import open_log
from graphslam.baseline import dead_reckoning
from graphslam.config import EkfConfig, SmootherConfig
from graphslam.ekf import Filter
from graphslam.estimate import LOOP_OPEN
from graphslam.geometry import Array, between, compose, interpolate_poses, inverse, wrap
from graphslam.long import close_all_loops, run_window
from graphslam.long.chain import CLOSED, drift_of
from graphslam.long.drift import Drift, corrected, fit_drift
from graphslam.long.laying import LAID_COLUMNS, lay
from graphslam.long.patches import in_frame
from graphslam.measurements import IntArray, Measurements, Odometry, Sightings
from graphslam.rematch.window import LOST, sliding_window, way_of

DRIFT = Drift(np.array([0.95, 0.98, 0.05, 0.08]), np.zeros(4), np.zeros((3, 2)))


def increments(seed: int, count: int = 400) -> Array:
    """Returns motions that drive, turn, and drive backwards."""
    rng = np.random.default_rng(seed)
    way, turn = rng.uniform(-0.1, 0.3, count), rng.uniform(-0.4, 0.4, count)
    return np.column_stack([way * np.cos(turn / 2), way * np.sin(turn / 2), turn])


def path_of(increment: Array) -> Array:
    path = [np.zeros(3)]
    for one in increment:
        path.append(compose(path[-1], one))
    return np.array(path)


def test_drift_is_found_from_a_path_without_noise():
    raw = increments(1)
    found = fit_drift(raw, path_of(corrected(raw, DRIFT)[0]))
    assert found.values == pytest.approx(DRIFT.values, abs=1e-6)
    assert found.rates.max() < 1e-3


def test_drift_and_its_noise_are_found_within_sigma_though_some_increments_slip():
    raw, rng = increments(2, 2000), np.random.default_rng(3)
    rates = np.array([[0.01, 0.005], [0.01, 0.005], [0.02, 0.03]])
    clean, cov = corrected(raw, replace(DRIFT, rates=rates))
    noisy = clean + rng.standard_normal(clean.shape) * np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    noisy[::100] += [0.1, 0.0, 0.3]
    found = fit_drift(raw, path_of(noisy))
    assert np.all(np.abs(found.values - DRIFT.values) < 4.0 * found.sigma)
    assert np.all(found.sigma < [0.002, 0.005, 0.005, 0.002])
    assert found.rates[2] == pytest.approx(rates[2], rel=0.4)


ROOM = np.array(
    [
        [3.0, 0.0, -4.0, 2.0],
        [2.0, np.pi / 2, -3.0, 3.0],
        [3.5, -np.pi / 2, -1.0, 3.0],
        [4.0, np.pi, -2.0, 3.5],
        [1.2, 0.7, 0.0, 1.5],
    ]
)


@pytest.mark.parametrize("motion", [(0.0, 0.0, 0.0), (0.8, -0.5, 0.2), (-1.1, 0.9, -0.3)])
def test_a_map_is_laid_on_itself_from_wherever_it_was_moved(motion: tuple[float, ...]):
    other = in_frame(ROOM, np.array(motion))
    sigma = np.array([0.6, 0.6, 0.15])
    ways = np.zeros((12, LAID_COLUMNS))
    count = lay(ROOM, other, sigma, np.diag(sigma**-2), 0.12, ways)
    best = ways[np.argmax(ways[:count, 3])]
    assert best[:3] == pytest.approx(motion, abs=0.01)  # the prior pulls a little
    assert best[4] == len(ROOM)
    assert best[5] > 2.0


def test_walls_are_not_laid_on_their_own_backs():
    turned = ROOM.copy()
    turned[:, :2] = np.column_stack([-ROOM[:, 0], ROOM[:, 1] + np.pi])
    turned[:, 2:] = -ROOM[:, :1:-1]
    ways, sigma = np.zeros((12, LAID_COLUMNS)), np.array([0.3, 0.3, 0.05])
    count = lay(ROOM, turned, sigma, np.diag(sigma**-2), 0.12, ways)
    assert count == 0 or ways[:count, 4].max() < 2


CORRIDORS = np.array([[0.0, 0.0], [16.0, 0.0], [16.0, 9.0], [0.0, 9.0]])


def loop_log(seed: int, laps: float) -> tuple[Measurements, Array]:
    """Returns a drive round a square of corridors with rooms off them, and the true path.

    Odometry drifts by 3 % and 2 degrees a metre.
    """
    rng = np.random.default_rng(seed)
    true = _drive(laps)
    walls = _walls()
    raw = corrected(
        between(true[:-1], true[1:]),
        Drift(np.array([1.03, 1.0, -np.radians(2.0), 0.0]), np.zeros(4), np.zeros((3, 2))),
    )[0]
    raw += rng.standard_normal(raw.shape) * [0.003, 0.003, 0.005]
    node, z, extent = [], [], []
    for n, pose in enumerate(true):
        for low, high in walls:
            ends = (np.array([low, high]) - pose[:2]) @ np.array(
                [[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]]
            )
            if np.hypot(*ends.mean(axis=0)) > 4.0:
                continue
            along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
            alpha = np.arctan2(along[0], -along[1])
            normal = np.array([np.cos(alpha), np.sin(alpha)])
            s = ends @ [-normal[1], normal[0]]
            node.append(n)
            z.append([ends[0] @ normal, alpha])
            extent.append([s.min(), s.max()])
    z = np.array(z) + rng.standard_normal((len(z), 2)) * [0.01, 0.005]
    count = len(z)
    lines = Sightings(
        "line", np.array(node), z, np.tile(np.diag([1e-4, 2.5e-5]), (count, 1, 1)),
        np.array(extent), np.array(node, float), np.full(count, np.nan),
        np.full(count, -1), np.full(count, -1),
    )  # fmt: skip
    cov = np.tile(np.diag([1e-5, 1e-5, 1e-4]), (len(raw), 1, 1))
    start = true[0]
    return Measurements(
        np.arange(len(true), dtype=float), start, 1e-12 * np.eye(3), Odometry(raw, cov),
        {"line": lines},
    ), true  # fmt: skip


def _drive(laps: float) -> Array:
    corners = [*CORRIDORS, *CORRIDORS, *CORRIDORS]
    path = [np.array([*corners[0], 0.0])]
    left = laps * 50.0
    for p, q in itertools.pairwise(corners):
        heading = np.arctan2(*(q - p)[::-1])
        while abs(wrap(heading - path[-1][2])) > 1e-6:
            step = float(np.clip(wrap(heading - path[-1][2]), -0.3, 0.3))
            path.append(path[-1] + [0.0, 0.0, step])
        for _ in range(round(np.hypot(*(q - p)) / 0.25)):
            if left <= 0:
                return np.array(path)
            path.append(path[-1] + [0.25 * np.cos(heading), 0.25 * np.sin(heading), 0.0])
            left -= 0.25
    return np.array(path)


def _walls() -> list[tuple[Array, Array]]:
    """Returns walls left and right of the corridors, in pieces of irregular depth."""
    rng = np.random.default_rng(5)
    walls = []
    for p, q in zip(CORRIDORS, np.roll(CORRIDORS, -1, axis=0), strict=True):
        along = (q - p) / np.hypot(*(q - p))
        across = np.array([-along[1], along[0]])
        for side in (-1.0, 1.0):
            at = 0.5
            while at < np.hypot(*(q - p)) - 1.0:
                length, depth = rng.uniform(1.0, 2.5), side * rng.uniform(0.8, 2.2)
                one, other = p + at * along, p + (at + length) * along
                walls.append((one + depth * across, other + depth * across))
                walls.append((other + depth * across, other + 1.6 * depth * across))
                at += length + rng.uniform(0.2, 0.8)
    return walls


@pytest.fixture(scope="module")
def twice_round():
    return loop_log(1, 1.6)


def test_a_loop_is_closed_and_odometry_calibrated_without_being_told(twice_round):
    measurements, true = twice_round
    window = run_window(measurements, EkfConfig())
    whole = close_all_loops(measurements, window, SmootherConfig())
    assert whole.counts[CLOSED] >= 1

    def apart(pose: Array) -> float:
        e = compose(inverse(true[0]), true)[:, :2] - compose(inverse(pose[0]), pose)[:, :2]
        return float(np.sqrt(np.mean(e**2)))

    assert apart(whole.pose) < 0.06
    assert apart(dead_reckoning(measurements).pose) > 1.0
    drift = drift_of(whole)
    assert drift is not None
    assert drift.values[0] == pytest.approx(1.0 / 1.03, abs=0.005)
    assert np.degrees(drift.values[2]) == pytest.approx(2.0, abs=0.5)
    assert 0.7 < np.nanmean(whole.nis) / 2 < 1.4


def test_one_way_without_a_loop_closes_none():
    measurements, _ = loop_log(2, 0.6)
    window = run_window(measurements, EkfConfig())
    whole = close_all_loops(measurements, window, SmootherConfig())
    assert CLOSED not in whole.counts
    assert not any(name.startswith(LOOP_OPEN) for name in whole.counts)


def test_a_filter_that_is_lost_begins_a_new_map_instead_of_finding_itself_turned(twice_round):
    measurements, true = twice_round
    increment = measurements.odometry.increment.copy()
    increment[len(increment) // 3, 2] += 0.7
    bumped = replace(measurements, odometry=replace(measurements.odometry, increment=increment))
    found = sliding_window(bumped, EkfConfig(), 6.0, anew=True)
    assert found.counts[LOST] >= 1
    turned = wrap(
        between(true[:-5], true[5:])[:, 2] - between(found.pose[:-5], found.pose[5:])[:, 2]
    )
    assert (
        np.degrees(np.abs(turned)).max() < 60.0
    )  # the bump itself; no wall matched across a corner
    whole = close_all_loops(bumped, run_window(bumped, EkfConfig()), SmootherConfig())
    assert whole.counts[CLOSED] >= 1
    after = slice(len(true) // 2, None)
    apart = compose(inverse(true[after][0]), true[after])[:, :2]
    apart = apart - compose(inverse(whole.pose[after][0]), whole.pose[after])[:, :2]
    assert np.sqrt(np.mean(apart**2)) < 0.15


class KeepingAll(Filter):
    """Matches with what was seen within a window, and keeps all the rest in its state."""

    def candidates(self, node: int, kind: str) -> IntArray:
        way = way_of(self.measurements.odometry.increment)
        found = super().candidates(node, kind)
        return found[way[self.roster.last[found]] >= way[node] - 3.0]


def test_what_a_window_leaves_behind_stays_in_the_map_and_changes_nothing_else(twice_round):
    measurements, _ = twice_round
    left = sliding_window(measurements, EkfConfig(), 3.0)
    kept = KeepingAll(measurements, EkfConfig(), None).run()
    np.testing.assert_array_equal(left.match, kept.match)
    np.testing.assert_allclose(left.pose, kept.pose, atol=1e-9)
    np.testing.assert_allclose(left.cov_joint[:3, :3], kept.cov_joint[:3, :3], rtol=1e-6)
    assert np.all(np.linalg.eigvalsh(left.cov_joint) > 0)
    assert not left.cov_joint[3, -1]
    assert kept.cov_joint[3, -1]


def test_the_first_loops_of_a_shared_log_close(shared_data: Path):
    folder = shared_data / "intel"
    log = open_log(folder / "intel.clf")
    assert log.scans is not None
    measurements = extract(log, ExtractConfig(to_s=float(log.scans.t[430])))
    whole = close_all_loops(measurements, run_window(measurements, EkfConfig()), SmootherConfig())
    relations = np.loadtxt(folder / "relations.csv", delimiter=",", skiprows=1)
    known = relations[np.max(relations[:, :2], axis=1) <= 430]
    row = np.arange(len(whole.pose), dtype=float)
    first, second = (interpolate_poses(known[:, k], row, whole.pose) for k in (0, 1))
    e = between(known[:, 2:5], between(first, second))
    assert np.hypot(e[:, 0], e[:, 1]).mean() < 0.06
    assert whole.counts[CLOSED] >= 1
