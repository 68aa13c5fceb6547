"""Second thoughts: matches decided again until nothing changes, loops closed, slips mended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from frontend.extract import extract
from frontend.log_parts import Wheels
from frontend.simulate import load_scenario, simulate_log
from graphslam.baseline import dead_reckoning, integrate
from graphslam.config import EkfConfig, MatchingConfig, SmootherConfig
from graphslam.ekf import run_ekf
from graphslam.estimate import Estimate
from graphslam.geometry import line_to_robot, position_along
from graphslam.measurements import Measurements, Odometry, Sightings
from graphslam.rematch import rematch
from graphslam.rematch.rematch import MENDED, MOVED, REVIVED
from graphslam.rematch.rounds import DROPPED, MERGED, STARTED, rounds
from graphslam.rematch.slipping import may_have_slipped
from graphslam.rematch.split import SPLIT, split_at_gaps
from graphslam.rematch.starts import parted
from graphslam.rematch.sure import Surety
from graphslam.rematch.window import sliding_window, way_of
from graphslam.smoother import smooth, state_problem
from graphslam.smoother.batch import SLIPPED, minimise
from tests.worlds import GRID, drive

KNOWN = EkfConfig(MatchingConfig(method="known"))
AGAIN = SmootherConfig(engine="chain", rematch=True)


def decided(measurements: Measurements, match: np.ndarray) -> tuple[np.ndarray, dict[str, int]]:
    """Returns what rematching makes of matches, and its counts."""
    problem, counts = rematch(state_problem(measurements, match), AGAIN, minimise)
    return problem.match, counts


def one_landmark_each(match: np.ndarray, truth: np.ndarray) -> bool:
    """Returns whether landmarks and true lines name the used sightings alike, one for one."""
    used = match >= 0
    pairs = np.unique(np.column_stack([match[used], truth[used]]), axis=0)
    return len(pairs) == len(np.unique(match[used])) == len(np.unique(truth))


@pytest.fixture(scope="module")
def world() -> tuple[Measurements, np.ndarray]:
    """Returns measurements of a drive, and which of its lines each sighting is of."""
    measurements, _ = drive(3, nodes=150)
    names = np.unique(measurements.sightings["line"].truth, return_inverse=True)[1]
    return measurements, names


def test_right_matches_stay_as_they_are(world: tuple[Measurements, np.ndarray]) -> None:
    measurements, truth = world
    match, counts = decided(measurements, truth)
    used = match >= 0
    assert np.array_equal(match[used], truth[used])
    assert np.mean(~used) < 0.01  # one right sighting in a thousand lies beyond the gate
    assert MERGED not in counts
    assert STARTED not in counts


def test_a_line_that_became_two_landmarks_is_one_again(
    world: tuple[Measurements, np.ndarray],
) -> None:
    measurements, truth = world
    own = np.flatnonzero(truth == 2)
    split = truth.copy()
    split[own[len(own) // 2 :]] = truth.max() + 1
    match, counts = decided(measurements, split)
    assert one_landmark_each(match, truth)
    assert counts[MERGED] >= 1


def test_two_lines_that_became_one_landmark_are_two_again(
    world: tuple[Measurements, np.ndarray],
) -> None:
    measurements, truth = world
    joined = np.where(truth == 1, 0, truth)
    joined = np.unique(joined, return_inverse=True)[1]
    match, counts = decided(measurements, joined)
    assert one_landmark_each(match, truth)
    assert counts[STARTED] >= 1


def test_wrong_matches_are_moved_and_rejected_sightings_revived(
    world: tuple[Measurements, np.ndarray],
) -> None:
    measurements, truth = world
    rng = np.random.default_rng(0)
    spoilt = truth.copy()
    rows = rng.choice(len(truth), 40, replace=False)
    spoilt[rows[:20]] = (truth[rows[:20]] + 1) % len(GRID)
    spoilt[rows[20:]] = -1
    match, counts = decided(measurements, spoilt)
    assert one_landmark_each(match, truth)
    assert counts[MOVED] >= 18
    assert counts[REVIVED] >= 18


def test_a_landmark_that_hardly_anything_supports_is_dropped(
    world: tuple[Measurements, np.ndarray],
) -> None:
    measurements, truth = world
    table = measurements.sightings["line"]
    z, rows = table.z.copy(), np.flatnonzero(table.node == 40)[:1]
    z[rows] += [0.5, 0.6]
    clutter = replace(measurements, sightings={"line": replace(table, z=z)})
    spoilt = truth.copy()
    spoilt[rows] = truth.max() + 1
    match, counts = decided(clutter, spoilt)
    assert counts[DROPPED] == 1
    assert np.all(match[rows] == -1)
    assert match.max() == truth.max()


def test_sightings_of_two_labels_are_never_of_one_landmark(
    world: tuple[Measurements, np.ndarray],
) -> None:
    measurements, truth = world
    table = measurements.sightings["line"]
    own = np.flatnonzero(truth == 2)
    label = np.where(truth == 2, 0, -1)
    label[own[::2]] = 1
    labelled = replace(measurements, sightings={"line": replace(table, label=label)})
    match, _ = decided(labelled, np.where(label == 1, -1, truth))
    first, second = (set(match[label == k].tolist()) - {-1} for k in (0, 1))
    assert first
    assert second
    assert not first & second
    assert np.mean(match < 0) < 0.02


def test_it_needs_no_match_to_start_from(world: tuple[Measurements, np.ndarray]) -> None:
    measurements, truth = world
    estimate = smooth(measurements, dead_reckoning(measurements), SmootherConfig(rematch=True))
    assert estimate.engine == "chain"  # unless another is asked for: gtsam takes far longer
    assert one_landmark_each(estimate.match, truth)


def test_hopeless_matches_do_no_harm(world: tuple[Measurements, np.ndarray]) -> None:
    measurements, truth = world
    match, _ = decided(measurements, np.random.default_rng(0).permutation(truth))
    assert one_landmark_each(match, truth)


def test_a_pass_of_its_own_matches_nothing_that_was_left_behind() -> None:
    measurements, _ = drive(3, nodes=320)
    truth, window_m = measurements.sightings["line"].truth, 2.0
    found = sliding_window(measurements, EkfConfig(), window_m)
    way = way_of(measurements.odometry.increment)[measurements.sightings["line"].node]
    for landmark in range(len(found.map)):
        own = np.flatnonzero(found.match == landmark)
        assert len(np.unique(truth[own])) == 1
        assert np.diff(way[own]).max() <= window_m + 1e-9
    assert len(found.map) > len(np.unique(truth))


def slipped() -> tuple[Measurements, np.ndarray]:
    """Returns measurements of 28 m in whose middle a wheel slipped by 0.1 m, and the true path."""
    log = simulate_log(replace(load_scenario("grid"), repeat=1), 0)
    assert log.wheels is not None
    assert log.robot is not None
    assert log.truth is not None
    t, angle = log.wheels.t, log.wheels.angle.copy()
    angle[:, 1] += 0.1 / log.robot.wheel_radius_right * np.clip(2.0 * (t - 0.5 * t[-1]), 0.0, 1.0)
    log = replace(log, wheels=Wheels(t, angle))
    measurements = extract(log)
    at = np.searchsorted(log.truth.t, measurements.t)
    return measurements, log.truth.pose[np.minimum(at, len(log.truth.t) - 1)]


def off(estimate: Estimate, truth: np.ndarray) -> float:
    return float(np.hypot(*(estimate.pose - truth)[:, :2].T).max())


def test_where_a_wheel_slipped_the_path_is_mended() -> None:
    measurements, truth = slipped()
    filtered = run_ekf(measurements, EkfConfig(lost_after=0))
    config = replace(AGAIN, robust="gnc", robust_odometry=True)
    smoothed = smooth(measurements, filtered, config)
    assert off(filtered, truth) > 0.5
    assert off(smoothed, truth) < 0.1
    names = measurements.sightings["line"].truth
    assert one_landmark_each(smoothed.match, names)
    assert smoothed.counts[MENDED] == 1


@pytest.mark.parametrize("lost_after", [0, EkfConfig().lost_after], ids=["torn", "bent"])
def test_a_slip_is_mended_without_robust_odometry_too_and_said(lost_after: int) -> None:
    measurements, truth = slipped()
    filtered = run_ekf(measurements, EkfConfig(lost_after=lost_after))
    smoothed = smooth(measurements, filtered, AGAIN)
    assert off(smoothed, truth) < 0.1
    assert one_landmark_each(smoothed.match, measurements.sightings["line"].truth)
    assert smoothed.counts[MENDED] == 1
    assert 1 <= smoothed.counts[SLIPPED] <= 6


def test_slips_are_looked_for_only_where_something_says_so(
    world: tuple[Measurements, np.ndarray],
) -> None:
    for measurements, match, suspected in (
        (*world, False),
        (slipped()[0], slipped()[0].sightings["line"].truth, True),
    ):
        problem = state_problem(measurements, np.unique(match, return_inverse=True)[1])
        minimum = minimise(problem, AGAIN)
        found = replace(problem, pose=minimum.pose, params=minimum.params)
        assert may_have_slipped(found, AGAIN.rematching) == suspected


@pytest.mark.parametrize(("sigma", "whole"), [(0.0005, True), (0.02, False)])
def test_a_line_is_parted_only_where_odometry_alone_does_not_lead_back_to_it(
    sigma: float, whole: bool
) -> None:
    measurements, _ = drive(3, nodes=320, odometry_sigma=(sigma, sigma, sigma))
    problem = state_problem(measurements, run_ekf(measurements, KNOWN).match)
    surely = parted(problem, 2.0, surety=Surety(problem, AGAIN.rematching))
    everything = parted(problem, 2.0)
    assert len(everything.kinds) > len(problem.kinds)
    assert len(surely.kinds) == len((problem if whole else everything).kinds)


def two_short_lines_in_a_row(aside: float) -> tuple[Measurements, np.ndarray]:
    """Returns a drive along two short lines, one after the other, and across long ones.

    The second short line lies ``aside`` beside where the first one points.
    """
    rng = np.random.default_rng(0)
    increments = np.tile([0.1, 0.0, 0.0], (60, 1))
    truth = integrate(np.zeros(3), increments)
    lines = np.array([[0.3, np.pi / 2], [0.3 + aside, np.pi / 2], *[[x, 0.0] for x in range(7)]])
    middle = np.array([[1.0, 0.3], [5.0, 0.3 + aside], *[[x, 0.0] for x in range(7)]])
    node, identity = np.nonzero(np.abs(truth[:, None, 0] - middle[None, :, 0]) < 0.55)
    sigma = np.array([0.004, 0.006])
    z = line_to_robot(lines[identity], truth[node]) + sigma * rng.standard_normal((len(node), 2))
    ahead = middle[identity] - truth[node, :2]
    here = position_along(z, ahead)
    table = Sightings(
        "line",
        node,
        z,
        np.broadcast_to(np.diag(sigma**2), (len(node), 2, 2)),
        here[:, None] + [-0.3, 0.3],
        0.1 * node,
        np.ones(len(node)),
        node,
        identity,
    )
    noise = 0.002 * rng.standard_normal(increments.shape)
    odometry = Odometry(increments + noise, np.broadcast_to(4e-6 * np.eye(3), (60, 3, 3)))
    start = np.zeros(3), 1e-12 * np.eye(3)
    return Measurements(0.1 * np.arange(61), *start, odometry, {"line": table}), identity


@pytest.mark.parametrize(("aside", "two"), [(0.08, True), (0.0, False)])
def test_short_lines_in_a_row_are_two_where_what_is_known_by_now_tells_them_apart(
    aside: float, two: bool
) -> None:
    measurements, truth = two_short_lines_in_a_row(aside)
    joined = np.maximum(truth - 1, 0)  # what one line would fit as well: no sighting is far from it
    problem = state_problem(measurements, joined)
    rough = rounds(problem, AGAIN, minimise)
    split = split_at_gaps(rough, AGAIN, minimise)
    assert len(rough.fitted.problem.kinds) == 8
    assert len(split.fitted.problem.kinds) == 8 + two
    assert split.counts.get(SPLIT, 0) == two
