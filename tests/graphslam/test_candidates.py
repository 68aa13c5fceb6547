"""Which sightings and landmarks are compared at all: none that could be one may be missing."""

from __future__ import annotations

import numpy as np
import pytest

from graphslam.association import gate_for, mahalanobis
from graphslam.config import EkfConfig, MatchingConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.geometry import line_to_robot
from graphslam.measurements import Measurements, Odometry, Sightings
from graphslam.models.line import LINE
from graphslam.rematch.candidates import within_reach
from graphslam.rematch.fitted import Fitted, partition
from graphslam.rematch.moving import Move, matched, moved, near_lines
from graphslam.rematch.reach import gap_price
from graphslam.smoother import state_problem
from graphslam.smoother.batch import minimise
from tests.worlds import GRID, drive

KNOWN = EkfConfig(MatchingConfig(method="known"))
CHAIN = SmootherConfig(engine="chain")


def fitted_to(measurements: Measurements) -> Fitted:
    """Returns the minimum under the true matches, with one increment trusted less."""
    filtered = run_ekf(measurements, KNOWN)
    weight = np.ones(len(measurements.t) - 1)
    weight[len(weight) // 2] = 0.1
    problem = state_problem(measurements, filtered.match, filtered, odometry_weight=weight)
    return Fitted.of(problem, minimise(problem, CHAIN))


def corridor(lines: int) -> Measurements:
    """Returns a straight way with a new line across it every half metre."""
    rng = np.random.default_rng(4)
    nodes, sigma = 5 * lines, np.array([0.005, 0.009])
    alpha, x = rng.uniform(-0.4, 0.4, lines), 0.4 + 0.5 * np.arange(lines)
    increment = np.tile([0.1, 0.0, 0.0], (nodes - 1, 1))
    seen = [(i, k) for i in range(nodes) for k in range(lines) if 0.1 * i < x[k] < 0.1 * i + 1.0]
    node, line = np.array(seen).T
    pose = np.column_stack([0.1 * node, 0.0 * node, 0.0 * node])
    z = line_to_robot(np.column_stack([x * np.cos(alpha), alpha])[line], pose)
    z = z + rng.standard_normal(z.shape) * sigma
    table = Sightings(
        "line",
        node,
        z,
        np.tile(np.diag(sigma**2), (len(node), 1, 1)),
        np.tile([-0.5, 0.5], (len(node), 1)),
        0.1 * node,
        np.ones(len(node)),
        node,
        line,
    )
    noise = np.array([0.002, 0.002, 0.003])
    odometry = Odometry(
        increment + rng.standard_normal(increment.shape) * noise,
        np.tile(np.diag(noise**2), (nodes - 1, 1, 1)),
    )
    return Measurements(
        0.1 * np.arange(nodes), np.zeros(3), 1e-12 * np.eye(3), odometry, {"line": table}
    )


def exactly(fitted: Fitted) -> tuple[np.ndarray, np.ndarray]:
    """Returns squared distances (k, M) of all pairs by their joint covariances, and gap prices."""
    table, rules = fitted.problem.measurements.sightings["line"], CHAIN.rematching
    count = len(fitted.problem.kinds)
    row, landmark = np.repeat(np.arange(len(table)), count), np.tile(np.arange(count), len(table))
    pose, params = fitted.problem.pose[table.node[row]], fitted.problem.params[landmark]
    e, J_p, J_l = LINE.residual(pose, params, table.z[row])
    J = np.concatenate([J_p, J_l], axis=-1)
    P = fitted.minimum.pair_covariances(table.node[row], landmark)
    distance = mahalanobis(e, J @ P @ np.swapaxes(J, 1, 2) + table.cov[row])
    seen = LINE.extent_on_landmark(pose, params, table.z[row], table.extent[row])
    known = fitted.extent[landmark]
    gap = np.fmax(seen[:, 0], known[:, 0]) - np.fmin(seen[:, 1], known[:, 1])
    price = gap_price(np.maximum(gap, 0.0), rules)
    return distance.reshape(-1, count), price.reshape(-1, count)


@pytest.mark.parametrize("name", ["laps", "corridor"])
def test_no_pair_within_the_wide_gate_is_passed_over(name: str) -> None:
    fitted = fitted_to(drive(5, 150, GRID)[0] if name == "laps" else corridor(40))
    table, rules = fitted.problem.measurements.sightings["line"], CHAIN.rematching
    landmarks = fitted.of_kind("line")
    row, landmark = within_reach(fitted, LINE, table, landmarks, rules)
    looked_at = np.zeros((len(table), len(landmarks)), bool)
    looked_at[row, landmark] = True
    distance, price = exactly(fitted)
    could = (distance <= gate_for(rules.gate_new, 2)) & (price <= gate_for(rules.gate, 2))
    assert could.sum() >= len(table)
    assert not np.any(could & ~looked_at)


def test_a_sighting_is_compared_with_as_many_landmarks_however_long_the_way() -> None:
    share = []
    for lines in (60, 120):
        fitted = fitted_to(corridor(lines))
        table = fitted.problem.measurements.sightings["line"]
        row, _ = within_reach(fitted, LINE, table, fitted.of_kind("line"), CHAIN.rematching)
        share.append(len(row) / len(table))
    assert share[1] < 1.2 * share[0]


def test_matches_are_one_partition_whatever_landmarks_are_called() -> None:
    match = np.array([4, -1, 4, 2, 0, -1, 2])
    np.testing.assert_array_equal(partition(match), [0, -1, 0, 1, 2, -1, 1])
    names = np.array([7, 3, 1, 0, 5, -1])
    np.testing.assert_array_equal(partition(names[match]), partition(match))
    np.testing.assert_array_equal(partition(np.array([3, 3])), [0, 0])
    assert len(partition(np.zeros(0, np.int64))) == 0


def test_a_small_move_leaves_every_sighting_with_its_line_and_a_large_one_does_not() -> None:
    fitted, rules = fitted_to(corridor(30)), CHAIN.rematching
    before, last = partition(fitted.problem.match), len(fitted.problem.pose)
    for shift, same in ((0.02, True), (0.5, False)):
        move = Move(last // 2, last, np.array([shift, 0.0, 0.0]), 0.0)
        near = near_lines(fitted, shift, rules)
        after = matched(moved(fitted, move, near, rules), fitted, rules)
        assert np.array_equal(partition(after.match), before) == same


def test_what_shifts_may_lay_on_each_other_is_found_beforehand() -> None:
    fitted, rules = fitted_to(corridor(30)), CHAIN.rematching
    last = len(fitted.problem.pose)
    move = Move(last // 2, last, np.array([0.3, 0.1, 0.0]), 0.0)
    size = float(np.hypot(0.3, 0.1))
    few = moved(fitted, move, near_lines(fitted, size, rules), rules)
    many = moved(fitted, move, near_lines(fitted, 50.0, rules), rules)
    assert len(few.row) < len(many.row)
    a, b = (matched(after, fitted, rules).match for after in (few, many))
    np.testing.assert_array_equal(a, b)
