from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from graphslam.association import (
    DROPPED,
    NEW,
    Compatibility,
    assign,
    by_identity,
    compatibility,
    gate_for,
    jcbb,
    stretch_gap,
)
from graphslam.config import MatchingConfig
from graphslam.geometry import compose, line_to_robot, twin
from graphslam.models.line import LINE

ANGULAR = (False, True)


def shares(distance: list[list[float]], gate: float, gate_new: float) -> Compatibility:
    return Compatibility(np.array(distance) / gate, np.array(distance) / gate_new)


def test_the_nearest_pair_is_taken_first_and_each_landmark_once() -> None:
    found = assign(shares([[4.0, 9.0], [1.0, 8.0]], 10.0, 50.0))
    np.testing.assert_array_equal(found, [1, 0])


def test_between_the_two_gates_a_sighting_is_neither_match_nor_new() -> None:
    found = assign(shares([[20.0, 30.0], [70.0, 60.0]], 10.0, 50.0))
    np.testing.assert_array_equal(found, [DROPPED, NEW])


def test_a_second_sighting_of_a_taken_landmark_does_not_become_new() -> None:
    found = assign(shares([[1.0, 900.0], [2.0, 900.0]], 10.0, 50.0))
    np.testing.assert_array_equal(found, [0, DROPPED])


def test_a_landmark_that_has_its_sighting_already_takes_no_other() -> None:
    fit = shares([[1.0, 8.0], [2.0, 900.0]], 10.0, 50.0)
    np.testing.assert_array_equal(assign(fit, np.array([True, False])), [1, DROPPED])


def test_the_gate_keeps_its_probability_in_other_dimensions() -> None:
    probability = chi2.sf(14.0, 2)
    for dim in (1, 2, 3):
        assert chi2.sf(gate_for(14.0, dim), dim) == pytest.approx(probability)


def test_gated_matching_weighs_by_the_covariance() -> None:
    e = np.array([[[0.3, 0.0], [0.2, 0.0]]])
    S = np.array([[np.diag([0.04, 0.01]), np.diag([1e-4, 1e-4])]])
    np.testing.assert_array_equal(assign(compatibility(e, S, ANGULAR, MatchingConfig())), [0])


def test_nearest_matching_knows_lengths_from_angles_and_no_covariance() -> None:
    config = MatchingConfig(method="nearest", nearest_distance_m=0.15, nearest_angle_deg=10.0)
    e = np.array([[[0.3, 0.0], [0.1, 0.1]], [[0.1, 0.3], [0.4, 0.0]]])
    S = np.broadcast_to(np.eye(2), (2, 2, 2, 2))
    np.testing.assert_array_equal(assign(compatibility(e, S, ANGULAR, config)), [1, NEW])


def test_known_matching_uses_every_sighting_that_has_a_line() -> None:
    truth, identity = np.array([5, 5, 9, -1]), np.array([2, 5])
    np.testing.assert_array_equal(by_identity(truth, identity), [1, 1, NEW, DROPPED])
    np.testing.assert_array_equal(by_identity(truth, identity[:0]), [NEW, NEW, NEW, DROPPED])


# ---- stretches --------------------------------------------------------------------------------


def gaps(pose: np.ndarray, line: np.ndarray, known: list[float], z: np.ndarray, seen: list[float]):
    return stretch_gap(LINE, pose[None], line[None], np.array([known]), z[None], np.array([seen]))


def test_a_gap_is_what_lies_between_the_stretch_known_and_the_one_seen() -> None:
    line, pose = np.array([1.0, 0.5 * np.pi]), np.array([5.0, 0.0, 0.0])
    z = line_to_robot(line, pose)  # along this line, s is -x: 4.5 to 5.5 m of it are seen
    for known, expected in (([-3.0, 0.0], 1.5), ([-6.0, -5.0], 0.0), ([-9.0, -8.0], 2.5)):
        assert gaps(pose, line, known, z, [-0.5, 0.5]) == pytest.approx(expected)
    assert gaps(pose, line, [np.nan, np.nan], z, [-0.5, 0.5]) == 0.0
    assert gaps(pose, line, [-3.0, 0.0], z, [np.nan, np.nan]) == 0.0


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-4.0, 4.0),
    st.floats(-8.0, 8.0),
)  # fmt: skip
def test_a_gap_depends_neither_on_twins_nor_on_the_frame(
    x: float, y: float, theta: float, alpha: float, begin: float
) -> None:
    line, pose, known = np.array([0.7, alpha]), np.array([x, y, theta]), [begin, begin + 1.5]
    z = line_to_robot(line, pose)
    gap = gaps(pose, line, known, z, [-0.4, 0.6])
    flipped = gaps(pose, line, known, twin(z), [-0.6, 0.4])
    other = gaps(pose, twin(line), [-begin - 1.5, -begin], z, [-0.4, 0.6])
    np.testing.assert_allclose([flipped, other], [gap, gap], atol=1e-9)
    motion = np.array([0.0, 0.0, 1.0])  # about the origin: positions along the line stay
    turned = gaps(compose(motion, pose), line + np.array([0.0, 1.0]), known, z, [-0.4, 0.6])
    np.testing.assert_allclose(turned, gap, atol=1e-9)


def test_a_gap_uses_up_both_gates_alike() -> None:
    config = MatchingConfig(gap_m=10.0)
    e, S = np.array([[[0.1, 0.0]]]), np.array([[0.01 * np.eye(2)]])
    near = compatibility(e, S, ANGULAR, config)
    far = compatibility(e, S, ANGULAR, config, np.array([[9.5]]))
    beyond = compatibility(e, S, ANGULAR, config, np.array([[10.5]]))
    assert [assign(fit)[0] for fit in (near, far, beyond)] == [0, DROPPED, NEW]


# ---- joint compatibility ----------------------------------------------------------------------


def joint_problem(seed: int, rows: int = 3, landmarks: int = 4):
    """Returns candidate pairs of random residuals that a common pose error correlates."""
    rng = np.random.default_rng(seed)
    row, landmark = (a.ravel() for a in np.mgrid[0:rows, 0:landmarks])
    J = rng.standard_normal((len(row) * 2, 3))
    S = J @ J.T + 0.3 * np.eye(len(row) * 2)
    return row, landmark, rng.standard_normal((len(row), 2)) * 3.0, S


def joint_distance(pairs: list[int], e: np.ndarray, S: np.ndarray) -> float:
    place = (np.array(pairs)[:, None] * 2 + np.arange(2)).ravel()
    return float(e[pairs].ravel() @ np.linalg.solve(S[np.ix_(place, place)], e[pairs].ravel()))


def exhaustive(row, landmark, e, S, gate: float, extra) -> tuple[int, float, list[list[int]]]:
    """Returns pairs and distance of the best matching, and all matchings with as many pairs."""
    names = np.unique(row)
    choices = [[-1, *np.flatnonzero(row == name)] for name in names]
    found = []
    for choice in product(*choices):
        pairs = [int(q) for q in choice if q >= 0]
        if len(set(landmark[pairs])) < len(pairs):
            continue
        steps = [pairs[: n + 1] for n in range(len(pairs))]
        sums = [joint_distance(s, e, S) + extra[s].sum() for s in steps]
        if all(d <= gate_for(gate, 2 * (n + 1)) for n, d in enumerate(sums)):
            found.append((-len(pairs), sums[-1] if sums else 0.0, pairs))
    most, distance, _ = min(found)
    return -most, distance, [entry for entry in found if entry[0] == most]


@pytest.mark.parametrize("seed", range(25))
def test_jcbb_finds_what_trying_all_matchings_finds(seed: int) -> None:
    row, landmark, e, S = joint_problem(seed)
    extra = np.random.default_rng(seed).uniform(0.0, 3.0, len(row))
    chosen = np.flatnonzero(jcbb(row, landmark, e, S, 6.0, extra)).tolist()
    pairs, distance, _ = exhaustive(row, landmark, e, S, 6.0, extra)
    assert len(chosen) == pairs
    got = joint_distance(chosen, e, S) + extra[chosen].sum() if chosen else 0.0
    assert got == pytest.approx(distance)


@pytest.mark.parametrize("seed", range(25))
def test_pairs_on_which_matchings_nearly_as_good_differ_are_left_out(seed: int) -> None:
    row, landmark, e, S = joint_problem(seed)
    none = np.zeros(len(row))
    chosen = set(np.flatnonzero(jcbb(row, landmark, e, S, 6.0, ambiguity=4.0)).tolist())
    _, distance, found = exhaustive(row, landmark, e, S, 6.0, none)
    close = [set(pairs) for _, d, pairs in found if d <= distance + 4.0]
    assert chosen == set.intersection(*close)


def test_two_parallel_lines_are_matched_in_order_though_each_alone_is_nearer_to_the_other() -> None:
    """The robot stands 0.2 m off: alone, the second sighting fits the first landmark best."""
    spacing, off = 0.33, 0.2
    row, landmark = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    e = np.array([[off, 0.0], [off + spacing, 0.0], [off - spacing, 0.0], [off, 0.0]])
    pose, own = np.kron(np.ones((4, 4)), np.diag([0.15**2, 0.0])), np.diag([1e-4, 1e-4])
    S = pose + np.kron(np.eye(4), own)
    assert abs(e[2, 0]) < abs(e[3, 0])
    np.testing.assert_array_equal(jcbb(row, landmark, e, S, 14.0), [True, False, False, True])
    alone = assign(compatibility(e.reshape(2, 2, 2), S[:2, :2] * np.ones((2, 2, 1, 1)), ANGULAR,
                                 MatchingConfig()))  # fmt: skip
    assert alone[1] == 0


def test_jcbb_without_candidates_chooses_none() -> None:
    none = np.zeros(0, np.int64)
    assert len(jcbb(none, none, np.zeros((0, 2)), np.zeros((0, 0)), 14.0)) == 0
    e = np.array([[100.0, 0.0]])
    assert not jcbb(np.array([0]), np.array([0]), e, np.eye(2), 14.0).any()
