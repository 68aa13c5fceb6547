"""The Santana papers' misprints: each switch does what is printed, and that is not what is right.

Who 'corrects' a right equation back to the print, or a switch forward to the right form, is told
here.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from graphslam.config import EkfConfig, MatchingConfig
from graphslam.ekf import Filter, run_ekf
from graphslam.errors import BadConfig, BadMeasurements, UnderConstrained
from graphslam.geometry import compose, line_to_robot, twin, wrap
from graphslam.measurements import Measurements, Odometry
from graphslam.models.line import LINE
from graphslam.models.odometry import transition
from graphslam.models.wheels import DifferentialDrive, increments_from_wheels, wheel_increment
from graphslam.printed import ERRATA, filters, noise, run_printed
from tests.graphslam.test_localisation import on_known_map, path_rmse
from tests.worlds import drive

ROBOT = DifferentialDrive(0.042, 0.042, 0.2, 0.03, 0.03, "paper", (0.0, 0.0, 0.0))
HERE = np.array([0.4, -0.7, 0.9])
COV = np.diag([1e-4, 1e-4, 1e-4])
NEAREST = EkfConfig(matching=MatchingConfig(method="nearest"), confirm_after=1, lost_after=0)
KNOWN = EkfConfig(matching=MatchingConfig(method="known"))
SWITCHES = [name for name, erratum in ERRATA.items() if erratum.switchable]


def a_filter(kind: type[Filter]) -> Filter:
    return kind(on_known_map(0, nodes=3)[0], EkfConfig(), None)


def predicted(kind: type[Filter], increment: np.ndarray, here: np.ndarray = HERE) -> np.ndarray:
    """Returns the mean that a filter predicts from ``here``."""
    there = compose(here, increment)
    _, _, offset = a_filter(kind).motion(here, there, increment, COV)
    return there + offset


def wheels(rotations: np.ndarray, drive: DifferentialDrive) -> Measurements:
    """Returns measurements of wheels that turn by rotations (n, 2), rad, between the nodes."""
    angle = np.concatenate([np.zeros((1, 2)), np.cumsum(rotations, axis=0)])
    t = np.arange(float(len(angle)))
    odometry = Odometry(*increments_from_wheels(t, angle, t, drive), t, angle)
    return Measurements(t, HERE, 1e-12 * np.eye(3), odometry)


def pose_nees(estimate, truth: np.ndarray) -> float:
    error = estimate.pose - truth
    error[:, 2] = wrap(error[:, 2])
    solved = np.linalg.solve(estimate.cov_floor[1:], error[1:, :, None])[..., 0]
    return float(np.mean(np.sum(error[1:] * solved, axis=1)) / 3)


# ---- motion ------------------------------------------------------------------------------------


def test_loc_9_moves_y_the_wrong_way_in_a_curve_and_only_there() -> None:
    x, y, theta = HERE
    length, turn = 0.3, 0.4
    increment = np.array([length * np.sin(turn) / turn, length * (1 - np.cos(turn)) / turn, turn])
    printed = [
        x + length / turn * (np.sin(theta + turn) - np.sin(theta)),
        y + length / turn * (np.cos(theta + turn) - np.cos(theta)),
        theta + turn,
    ]
    np.testing.assert_allclose(predicted(filters.PlusInY, increment), printed, atol=1e-12)
    right = predicted(Filter, increment)
    assert right[1] - y == pytest.approx(-(printed[1] - y))
    straight = np.array([0.3, 0.0, 0.0])
    np.testing.assert_array_equal(predicted(filters.PlusInY, straight), predicted(Filter, straight))


def test_loc_14_drives_straight_without_moving() -> None:
    straight = np.array([0.3, 0.0, 0.0])
    np.testing.assert_allclose(predicted(filters.TurnForLength, straight), HERE, atol=1e-12)
    right = HERE + 0.3 * np.array([np.cos(HERE[2]), np.sin(HERE[2]), 0.0])
    np.testing.assert_allclose(predicted(Filter, straight), right, atol=1e-12)
    curve = np.array([0.3, 0.01, 0.1])
    np.testing.assert_array_equal(predicted(filters.TurnForLength, curve), predicted(Filter, curve))


def test_loc_16_adds_the_last_mean_to_the_prediction() -> None:
    increment = np.array([0.3, 0.01, 0.1])
    right = predicted(Filter, increment)
    np.testing.assert_allclose(right, compose(HERE, increment), atol=1e-12)
    np.testing.assert_allclose(predicted(filters.PoseTwice, increment), right + HERE, atol=1e-12)


# ---- wheel noise -------------------------------------------------------------------------------


def test_loc_19_is_off_by_2_over_b_and_b2_over_2r2_and_has_one_k3_for_both_wheels() -> None:
    left, right = 1.0, 1.6
    r, b = 0.042, 0.2
    K1 = 2 / b * r * (right + left) / (2 * (right - left))
    K3 = b**2 / (2 * r**2) * b * left / (right - left) ** 2
    K2 = HERE[2] + r * (right - left) / b
    column = [
        K1 * np.cos(K2) - K3 * (np.sin(K2) - np.sin(HERE[2])),
        K1 * np.sin(K2) - K3 * (-np.cos(K2) + np.cos(HERE[2])),
        r / b,
    ]
    printed = noise.printed_v_loc(np.array([left, right]), ROBOT, HERE[2])
    np.testing.assert_allclose(printed[:, 1], column, rtol=1e-12)
    np.testing.assert_allclose(printed[:, 0], -np.array(column), rtol=1e-12)
    assert np.abs(printed - right_v(np.array([left, right])))[:2].max() > 0.1


def test_loc_20_has_a_variance_that_follows_the_rotation_not_its_square() -> None:
    """Cut in ten, a step keeps its printed variance; the right one shrinks tenfold."""
    whole, cut = np.array([[2.0, 2.0]]), np.full((10, 2), 0.2)
    variance = {}
    for name, steps in {"whole": whole, "cut": cut}.items():
        robot = replace(ROBOT, floor=(1e-9, 1e-9))
        measurements = wheels(steps, robot)
        printed = noise.with_variance_law(measurements, robot)
        variance[name] = measurements.odometry.cov[:, 2, 2].sum()
        variance["printed", name] = printed.odometry.cov[:, 2, 2].sum()
    assert variance["whole"] / variance["cut"] == pytest.approx(10.0, rel=1e-6)
    assert variance["printed", "whole"] == pytest.approx(variance["printed", "cut"], rel=1e-6)


def test_slam_16_is_right_away_from_equal_wheels() -> None:
    for left, right in ((1.0, 1.6), (-0.5, 0.5), (-1.0, -1.3)):
        rotation = np.array([left, right])
        printed = noise.printed_v_slam(rotation, ROBOT, HERE[2])
        V = right_v(rotation)
        np.testing.assert_allclose(printed, V, atol=1e-12)


def right_v(rotation: np.ndarray) -> np.ndarray:
    """Returns the right V in the floor frame at the heading of `HERE`."""
    c, s = math.cos(HERE[2]), math.sin(HERE[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turn @ wheel_increment(rotation, ROBOT)[1]


def test_slam_16_magnifies_rounding_where_the_wheels_turn_nearly_alike() -> None:
    for difference, off in ((1e-8, 0.1), (1e-12, 1e6)):
        rotation = np.array([0.85, 0.85 + difference])
        worst = max(
            np.abs(noise.printed_v_slam(rotation, ROBOT, theta)[:2]).max()
            for theta in np.linspace(0.1, 3.0, 30)
        )
        assert worst > off
        assert np.abs(wheel_increment(rotation, ROBOT)[1][:2]).max() < 0.03
    same = np.array([0.85, 0.85])
    np.testing.assert_allclose(
        noise.printed_v_slam(same, ROBOT, HERE[2]), right_v(same), atol=1e-15
    )


def test_slam_16_says_so_where_nothing_is_left_of_the_covariance() -> None:
    rotation = np.array([[0.85, 0.85 + 1e-14]] * 3)
    with pytest.raises(UnderConstrained, match="wheels that turn nearly alike"):
        noise.with_v(noise.printed_v_slam, wheels(rotation, ROBOT), ROBOT)


def test_the_rebuilt_wheel_noise_is_the_right_one_where_v_is_right() -> None:
    """Slip, floor, law and frames survive the way through a printed V."""
    rng = np.random.default_rng(3)
    for law in ("paper", "distance"):
        robot = replace(ROBOT, law=law, slip=(0.002, 0.001, 0.004))
        measurements = wheels(rng.uniform(0.5, 1.5, (6, 2)), robot)
        rebuilt = noise.with_v(noise.printed_v_slam, measurements, robot)
        np.testing.assert_allclose(rebuilt.odometry.cov, measurements.odometry.cov, atol=1e-12)
        np.testing.assert_array_equal(rebuilt.odometry.increment, measurements.odometry.increment)


# ---- sightings ---------------------------------------------------------------------------------


def test_loc_22_has_a_sigma_that_passes_through_zero() -> None:
    measurements, _ = drive(0, nodes=3)
    table = measurements.sightings["line"]
    z = np.array([[0.1, np.pi], [0.6, np.pi], [0.9, np.pi], [0.9, 0.0]])
    rows = replace(
        table.select(np.zeros(4, int)), z=z, cov=np.broadcast_to(1e-4 * np.eye(2), (4, 2, 2))
    )
    seen = replace(measurements, sightings={"line": rows})
    sigma = np.sqrt(noise.with_signed_sigma(seen, ROBOT).sightings["line"].cov[:, 0, 0])
    # alpha_M is -90 degrees for the first three, 90 for the last
    printed = np.abs(0.004 + 0.3 * np.array([-1, -1, -1, 1]) * np.expm1(z[:, 0] / 45))
    np.testing.assert_allclose(sigma, np.maximum(printed, 1e-4), rtol=1e-12)
    assert sigma[1] < 1e-4 + 1e-12
    assert sigma[2] < 0.3 * sigma[3]


@pytest.mark.parametrize("name", [lambda z: z, twin], ids=["model (27)", "model (28)"])
def test_loc_29_has_a_heading_entry_in_the_row_of_rho(name) -> None:
    pose, line = np.array([1.5, -0.8, 0.4]), np.array([[2.0, 0.9]])
    z = name(line_to_robot(line, pose))
    sign = 1.0 if name(np.array([1.0, 0.0]))[0] > 0 else -1.0
    _, J, _ = a_filter(filters.HeadingInRho).residual(LINE, pose, line, z)
    printed = -sign * (pose[0] * np.sin(0.9) - pose[1] * np.cos(0.9))
    assert J[0, 0, 2] == pytest.approx(printed)
    assert a_filter(Filter).residual(LINE, pose, line, z)[1][0, 0, 2] == 0.0


def test_slam_27_has_the_printed_landmark_block() -> None:
    pose, line = np.array([1.5, -0.8, 0.4]), np.array([[2.0, 0.9]])
    z = line_to_robot(line, pose)
    _, J_pose, J = a_filter(filters.LandmarkBlock).residual(LINE, pose, line, z)
    np.testing.assert_array_equal(J[0], [[1.0, 0.0], [0.0, -1.0]])
    _, right_pose, right = a_filter(Filter).residual(LINE, pose, line, z)
    np.testing.assert_array_equal(J_pose, right_pose)
    lever = pose[0] * np.sin(0.9) - pose[1] * np.cos(0.9)
    np.testing.assert_allclose(right[0], [[1.0, lever], [0.0, 1.0]], atol=1e-12)


def test_slam_6_linearises_at_the_mean_before_the_motion() -> None:
    before, now = np.array([1.5, -0.8, 0.4]), np.array([1.7, -0.7, 0.45])
    line = np.array([[2.0, 0.9]])
    z = line_to_robot(line, now)
    printed = a_filter(filters.LastMean)
    printed.before = before
    e, _, J = printed.residual(LINE, now, line, z)
    np.testing.assert_allclose(e, 0.0, atol=1e-12)
    lever = before[0] * np.sin(0.9) - before[1] * np.cos(0.9)
    assert J[0, 0, 1] == pytest.approx(lever)
    right = a_filter(Filter).residual(LINE, now, line, z)[2]
    assert right[0, 0, 1] == pytest.approx(now[0] * np.sin(0.9) - now[1] * np.cos(0.9))


def test_slam_6_remembers_where_it_was() -> None:
    printed = a_filter(filters.LastMean)
    start = printed.state.mean[:3].copy()
    printed.predict(0)
    np.testing.assert_array_equal(printed.before, start)


# ---- matching ----------------------------------------------------------------------------------


def test_slam_33_gives_a_line_another_name_from_its_other_side() -> None:
    line = np.array([2.0, 0.3])
    names = []
    for heading in (0.3, 0.3 + np.pi):
        pose = np.array([1.5, 0.2, heading])
        for z in (line_to_robot(line, pose), twin(line_to_robot(line, pose))):
            if z[0] >= 0:  # as a detector names it
                names.append(filters.printed_name(pose, z))
    np.testing.assert_allclose(names[0], line, atol=1e-12)
    np.testing.assert_allclose(names[1], twin(line), atol=1e-12)


def test_slam_33_maps_nearly_every_line_twice_and_the_right_rule_none() -> None:
    lines = {}
    for name in ((), ("slam-3.3-names",)):
        lines[name] = [
            len(run_printed(drive(seed, nodes=170)[0], name, NEAREST).map) for seed in range(3)
        ]
    assert lines[()] == [8, 8, 8]
    # the lap turns round once: half of all views are from the other side
    assert min(lines["slam-3.3-names",]) >= 14


# ---- what they cost ----------------------------------------------------------------------------


def test_right_filters_are_consistent() -> None:
    """Mean pose NEES per dimension over 50 seeds, mapping and on a known map."""
    mapping, localising = [], []
    for seed in range(50):
        measurements, truth = drive(seed, nodes=60)
        mapping.append(pose_nees(run_ekf(measurements, KNOWN), truth))
        measurements, truth = on_known_map(seed, nodes=60)
        localising.append(pose_nees(run_ekf(measurements), truth))
    assert 0.8 < np.mean(mapping) < 1.2
    assert 0.8 < np.mean(localising) < 1.2


def test_the_printed_h_costs_at_least_half_of_the_path_and_all_honesty() -> None:
    """SantanaSLAM (27): twice the path error in every run, pose NEES in the hundreds."""
    nees, factor = [], []
    for seed in range(8):
        measurements, truth = drive(seed, nodes=120)
        right = run_ekf(measurements, NEAREST)
        printed = run_printed(measurements, ["slam-27-landmark"], NEAREST)
        nees.append(pose_nees(printed, truth))
        factor.append(path_rmse(printed, truth) / path_rmse(right, truth))
    assert min(factor) > 2.0
    assert np.median(nees) > 100.0


# ---- the registry ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SWITCHES)
def test_every_switch_changes_the_filters_result(name: str) -> None:
    rng = np.random.default_rng(1)
    rotations = np.repeat(rng.uniform(0.4, 1.6, (5, 2)), 8, axis=0)
    rotations[::3] = rotations[::3, :1]
    rotations = np.round(rotations * 2.0**27) / 2.0**27  # so that their sums are exact
    rotations[::6, 1] += 2.0**-27
    known = on_known_map(0, nodes=41)[0] if ERRATA[name].paper == "SantanaLoc" else None
    plain, _ = drive(0, nodes=41)
    odometry = wheels(rotations, ROBOT).odometry
    measurements = replace(plain, t=np.arange(41.0), odometry=odometry, known=known and known.known)
    config = NEAREST if name == "slam-3.3-names" else KNOWN
    right = run_printed(measurements, [], config, ROBOT)
    printed = run_printed(measurements, [name], config, ROBOT)
    assert not np.array_equal(printed.pose, right.pose)
    assert printed.method == "ekf, as printed"


def test_without_a_switch_it_is_the_filter() -> None:
    measurements, _ = drive(0, nodes=40)
    np.testing.assert_array_equal(run_printed(measurements, []).pose, run_ekf(measurements).pose)


def test_switches_can_be_combined() -> None:
    measurements, _ = drive(1, nodes=40)
    names = ["slam-27-landmark", "loc-9-sign"]
    both = run_printed(measurements, names, KNOWN)
    for name in names:
        assert not np.array_equal(both.pose, run_printed(measurements, [name], KNOWN).pose)


def test_every_erratum_has_a_switch_or_says_why_not() -> None:
    for name, erratum in ERRATA.items():
        assert erratum.name == name
        assert erratum.switchable != bool(erratum.no_switch)


def test_wrong_requests_are_refused_in_words() -> None:
    measurements, _ = drive(0, nodes=3)
    with pytest.raises(BadConfig, match="unknown erratum 'loc-1'"):
        run_printed(measurements, ["loc-1"])
    with pytest.raises(BadConfig, match="has no switch"):
        run_printed(measurements, ["slam-feature-map"])
    with pytest.raises(BadConfig, match="drive"):
        run_printed(measurements, ["loc-20-variance"])
    with pytest.raises(BadMeasurements, match="raw wheel readings"):
        run_printed(measurements, ["loc-20-variance"], drive=ROBOT)


def test_the_right_transition_is_the_printed_g_of_both_papers() -> None:
    """SantanaLoc (18), SantanaSLAM (15): G is right in both, though (9) is not."""
    length, turn, theta = 0.3, 0.4, HERE[2]
    increment = np.array([length * np.sin(turn) / turn, length * (1 - np.cos(turn)) / turn, turn])
    F, _, _ = transition(HERE, compose(HERE, increment), increment, COV)
    printed = np.eye(3)
    printed[0, 2] = length / turn * (np.cos(theta + turn) - np.cos(theta))
    printed[1, 2] = length / turn * (np.sin(theta + turn) - np.sin(theta))
    np.testing.assert_allclose(F, printed, atol=1e-12)
