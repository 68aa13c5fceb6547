"""Loops closed by local line maps: rightly, never by guessing, and in linear time."""

from __future__ import annotations

import numpy as np
import pytest

from graphslam.config import EkfConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.estimate import LOOP_DOUBTED, Estimate
from graphslam.line_maps.alignment import Alignment
from graphslam.line_maps.line_map import LineMap
from graphslam.measurements import Measurements, Odometry
from graphslam.rematch import closing
from graphslam.rematch.accord import Closing, Compared
from graphslam.rematch.closing import MOST, candidates, closures, shifts_in_words
from graphslam.rematch.fitted import Fitted
from graphslam.rematch.rematch import CLOSED
from graphslam.rematch.spread import Spread
from graphslam.rematch.submaps import Submap
from graphslam.smoother import smooth, state_problem
from graphslam.smoother.batch import minimise
from tests.graphslam.loops import loop_drive

AGAIN = SmootherConfig(engine="chain", rematch=True)


def rematched(measurements: Measurements) -> Estimate:
    return smooth(measurements, run_ekf(measurements, EkfConfig()), AGAIN)


def one_landmark_each(match: np.ndarray, truth: np.ndarray) -> bool:
    """Returns whether landmarks and true lines name the used sightings alike, one for one."""
    pairs = np.unique(np.column_stack([match, truth])[match >= 0], axis=0)
    return len(pairs) == len(np.unique(pairs[:, 0])) == len(np.unique(truth))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_loop_is_closed_and_every_line_is_one_landmark(seed: int) -> None:
    measurements = loop_drive(seed)
    truth = measurements.sightings["line"].truth
    filtered = run_ekf(measurements, EkfConfig())
    smoothed = smooth(measurements, filtered, AGAIN)
    assert smoothed.counts[CLOSED] == 1
    assert one_landmark_each(smoothed.match, truth)
    assert not one_landmark_each(filtered.match, truth)


def test_on_a_periodic_floor_the_shifts_that_also_fit_are_named() -> None:
    counts = rematched(loop_drive(0, period_m=1.5)).counts
    (named,) = [name for name in counts if name.startswith(LOOP_DOUBTED)]
    assert "in x by -1.5" in named
    assert named.endswith("m it also fits")


def test_shifts_along_one_axis_are_told_by_it() -> None:
    shifts = np.array([[1.2, 0.01], [0.6, -0.02]])
    assert shifts_in_words(shifts) == "shifted in x by 0.60 m or 1.20 m it also fits"
    assert shifts_in_words(shifts[:, ::-1]) == "shifted in y by 0.60 m or 1.20 m it also fits"
    both = shifts_in_words(np.array([[0.6, 0.6], [0.0, 0.6]]))
    assert both == "shifted in x and y by (0.60, 0.60) m, in y by 0.60 m it also fits"
    assert shifts_in_words(np.zeros((0, 2))) == ""


def pairs_to_compare(stretches: int) -> int:
    """Returns how many pairs of local maps are compared on a long walk in a small place."""
    rng = np.random.default_rng(0)
    each, nodes = 10, 10 * stretches
    increment = np.column_stack(
        [np.full(nodes - 1, 0.5), np.zeros(nodes - 1), rng.normal(0, 0.6, nodes - 1)]
    )
    cov = np.broadcast_to(0.01 * np.eye(3), (nodes - 1, 3, 3))
    pose = np.column_stack([rng.uniform(0, 20, (nodes, 2)), rng.uniform(-3, 3, nodes)])
    empty = LineMap.exact(np.zeros((0, 2)), np.zeros((0, 2)))
    maps = tuple(
        Submap(k * each, (k + 1) * each, np.arange(3 * k, 3 * k + 3), empty)
        for k in range(stretches)
    )
    return len(candidates(maps, Spread(pose, Odometry(increment, cov)), 12.0, np.inf))


def test_the_number_of_comparisons_grows_with_the_way_not_with_its_square() -> None:
    few, many = pairs_to_compare(200), pairs_to_compare(800)
    assert few > 10 * 200
    assert many <= MOST * 800
    assert many < 1.2 * 4 * few


CLOSE, BESIDE, ELSEWHERE = np.zeros(3), np.array([0.08, 0.0, 0.0]), np.array([0.5, 0.0, 0.0])


def laid(
    a: int, b: int, pairs: set[tuple[int, int]], motion: np.ndarray, score_m: float = 3.0
) -> Closing:
    """Returns a closing of two submaps, sure to a centimetre."""
    common = np.zeros((1, 2))
    cov, matches = 1e-4 * np.eye(3), common.astype(int)
    alignment = Alignment(
        motion, cov, np.linalg.inv(cov), None, matches, matches, common, score_m, 0.0, score_m
    )
    return Closing(a, b, frozenset(pairs), score_m, alignment)


def straight_on() -> tuple[Fitted, tuple[Submap, ...]]:
    """Returns a straight path by good odometry, and four submaps of it."""
    step = np.tile([0.1, 0.0, 0.0], (99, 1))
    odometry = Odometry(step, np.broadcast_to(1e-6 * np.eye(3), (99, 3, 3)))
    start = np.zeros(3), 1e-12 * np.eye(3)
    measurements = Measurements(0.1 * np.arange(100), *start, odometry, {})
    problem = state_problem(measurements, np.zeros(0, int))
    lines = LineMap.exact(np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]))
    maps = tuple(Submap(n, n + 10, np.arange(1), lines) for n in (0, 10, 80, 90))
    return Fitted.of(problem, minimise(problem, AGAIN)), maps


@pytest.mark.parametrize(
    ("pairs", "motion", "agree", "contradict"),
    [
        ({(1, 21), (2, 22), (3, 23)}, CLOSE, True, False),
        ({(1, 21), (2, 22), (3, 24)}, CLOSE, True, False),  # one wrong pair is a mishap
        ({(1, 21), (2, 22), (3, 23)}, BESIDE, False, False),  # laid badly, and no other place
        ({(1, 22), (2, 23), (4, 24)}, CLOSE, False, True),
        ({(1, 21), (2, 22), (3, 23)}, ELSEWHERE, False, True),  # walls fit wherever they are laid
        ({(7, 27), (8, 28), (9, 29)}, ELSEWHERE, False, False),
    ],
)
def test_closings_agree_by_the_lines_they_match_and_by_where_they_lay_the_path(
    pairs: set[tuple[int, int]], motion: np.ndarray, agree: bool, contradict: bool
) -> None:
    fitted, maps = straight_on()
    spread = Spread(fitted.problem.pose, fitted.problem.measurements.odometry)
    compared = Compared(maps, spread, 17.0, 87.0)
    one = [laid(0, 2, {(1, 21), (2, 22), (3, 23)}, CLOSE)]
    other = [laid(1, 3, pairs, motion)]
    assert compared.agree(one, other) == agree
    assert compared.contradict(one, other) == contradict


def test_what_one_closure_rules_out_is_no_rival_of_the_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fitted, maps = straight_on()
    right = {(1, 21), (2, 22), (3, 23)}
    further = {(4, 24), (5, 25), (6, 26)}
    wrong = {(1, 24), (2, 25), (4, 27), (5, 28)}
    found = [
        *(laid(0, 2, right, CLOSE, score_m) for score_m in (8.0, 7.0)),
        *(laid(1, 3, further, CLOSE, score_m) for score_m in (3.0, 2.0)),
        *(laid(1, 2, wrong, ELSEWHERE, score_m) for score_m in (2.0, 1.0)),
    ]
    monkeypatch.setattr(closing, "_closings", lambda *_: iter(found))
    first = closures(fitted, maps, AGAIN.rematching, slips=False)
    assert first.groups == (tuple(sorted(right)), tuple(sorted(further)))
    assert not first.refused
    del found[:2]  # nothing says any more that the wrong one is
    alone = closures(fitted, maps, AGAIN.rematching, slips=False)
    assert not alone.groups
    assert sum(alone.refused.values()) == 1
