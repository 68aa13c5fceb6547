"""Which map line is which true line, how far off it lies, and which lines were to be seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compare.maps import MapMetrics, map_metrics
from compare.matching import assign, matching_table
from compare.truth import SEEN_FRAMES, Truth, truth_of
from frontend.camera import Camera
from frontend.log import Log
from frontend.log_parts import LineSightings
from graphslam.estimate import Estimate
from graphslam.geometry import (
    inverse,
    line_to_robot,
    points_on_line,
    position_along,
    twin,
)
from graphslam.measurements import Measurements, Odometry, Sightings
from tests.compare.made import estimate_of, log_with, moved, relabelled
from tests.worlds import GRID, drive

DRIVEN, TRUE_POSE = drive(seed=5, nodes=200, sighting_sigma=(0.002, 0.002))
MEASUREMENTS = replace(DRIVEN, start_pose=TRUE_POSE[0])
LABELS = MEASUREMENTS.sightings["line"].truth
UNLABELLED = relabelled(MEASUREMENTS, np.full(len(LABELS), -1))
LOG = log_with(MEASUREMENTS.t, TRUE_POSE, GRID)
STAYS = np.zeros(3)
NOISY = GRID + np.random.default_rng(4).normal(0.0, [0.01, 0.005], GRID.shape)


def estimated(
    lines: np.ndarray,
    match: np.ndarray = LABELS,
    measurements: Measurements = MEASUREMENTS,
    pose: np.ndarray = TRUE_POSE,
) -> Estimate:
    return estimate_of(measurements, pose, lines, match)


def judged(
    estimate: Estimate,
    measurements: Measurements = MEASUREMENTS,
    log: Log = LOG,
    path_motion: np.ndarray = STAYS,
) -> MapMetrics:
    figures = map_metrics(estimate, measurements, truth_of(log, measurements), path_motion)
    assert figures is not None
    return figures


def counts(figures: MapMetrics) -> dict[str, int | None]:
    names = ("true_lines_seen", "matched", "missed", "spurious", "duplicates", "unseen")
    return {name: getattr(figures, name) for name in names}


def labelled(truth: np.ndarray) -> Log:
    """Returns the log with sightings of its own that name these true lines."""
    table = MEASUREMENTS.sightings["line"]
    t = MEASUREMENTS.t[table.node]
    return replace(LOG, sightings=LineSightings(t, table.z, table.cov, table.extent, truth, t))


def unmatched() -> np.ndarray:
    """No sighting says which line is which: only geometry can."""
    return np.full(len(LABELS), -1)


# ---- errors ------------------------------------------------------------------------------------


def test_the_true_map_has_no_error() -> None:
    figures = judged(estimated(GRID))
    assert counts(figures) == {
        "true_lines_seen": 8,
        "matched": 8,
        "missed": 0,
        "spurious": 0,
        "duplicates": 0,
        "unseen": 0,
    }
    assert figures.rho_rmse_m < 1e-9
    assert figures.rho_origin_rmse_m < 1e-9
    assert figures.alpha_rmse_deg < 1e-9
    assert figures.unaligned_rho_rmse_m < 1e-9
    assert figures.nees < 1e-9


@settings(max_examples=25, deadline=None)
@given(st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-1.5, 1.5)).map(np.array))
def test_moving_an_estimate_changes_no_aligned_error_of_its_map(motion: np.ndarray) -> None:
    estimate = estimated(NOISY)
    before = judged(estimate)
    after = judged(moved(estimate, motion), path_motion=inverse(motion))
    for name in ("rho_rmse_m", "rho_origin_rmse_m", "alpha_rmse_deg"):
        assert getattr(after, name) == pytest.approx(getattr(before, name), rel=1e-6)
    assert after.lines.status == before.lines.status


@settings(max_examples=25, deadline=None)
@given(st.lists(st.booleans(), min_size=8, max_size=8), st.booleans())
def test_naming_true_lines_by_their_twins_changes_nothing(flips: list[bool], voted: bool) -> None:
    estimate = estimated(NOISY, LABELS if voted else unmatched())
    renamed = np.where(np.array(flips)[:, None], twin(GRID), GRID)
    before, after = judged(estimate), judged(estimate, log=log_with(DRIVEN.t, TRUE_POSE, renamed))
    assert counts(after) == counts(before)
    for name in ("rho_rmse_m", "rho_origin_rmse_m", "alpha_rmse_deg", "nees"):
        assert getattr(after, name) == pytest.approx(getattr(before, name), rel=1e-9)


def test_an_offset_counts_where_the_line_was_seen_and_not_at_the_origin() -> None:
    """Four lines around a far place, one of them turned about the middle of its seen stretch."""
    true = np.array([[20.0, 0.0], [21.0, 0.0], [20.0, np.pi / 2], [21.0, np.pi / 2]])
    measurements, pose = one_node_looking_at(true, np.array([20.5, 20.5, 0.0]))
    turn, lines = 1e-3, true.copy()
    middle = points_on_line(true[0], np.array(20.5))
    lines[0] = [middle @ [np.cos(turn), np.sin(turn)], turn]
    figures = judged(
        estimate_of(measurements, pose, lines, np.tile(np.arange(4), SEEN_FRAMES)),
        measurements,
        log_with(measurements.t, pose, true),
    )
    assert figures.matched == 4
    assert figures.rho_rmse_m < 2e-4
    assert figures.rho_origin_rmse_m > 5e-3
    row = figures.lines
    np.testing.assert_allclose(row.sigma_offset[0], 1e-2 * np.hypot(1.0, 20.5), rtol=1e-2)
    np.testing.assert_allclose(row.sigma_alpha[0], 1e-2)


def one_node_looking_at(lines: np.ndarray, pose: np.ndarray) -> tuple[Measurements, np.ndarray]:
    """Returns `SEEN_FRAMES` nodes at one place that see all lines without error, one metre each."""
    nodes, count = SEEN_FRAMES, len(lines)
    total = nodes * count
    table = Sightings(
        "line",
        np.repeat(np.arange(nodes), count),
        np.tile(line_to_robot(lines, pose), (nodes, 1)),
        np.broadcast_to(1e-6 * np.eye(2), (total, 2, 2)),
        np.tile([-0.5, 0.5], (total, 1)),
        np.zeros(total),
        np.ones(total),
        np.zeros(total, int),
        np.full(total, -1),
    )
    still = np.broadcast_to(1e-6 * np.eye(3), (nodes - 1, 3, 3))
    odometry = Odometry(np.zeros((nodes - 1, 3)), still)
    measurements = Measurements(
        np.arange(float(nodes)), pose, 1e-12 * np.eye(3), odometry, {"line": table}
    )
    return measurements, np.tile(pose, (nodes, 1))


def test_errors_from_the_common_start_are_given_beside_the_aligned_ones() -> None:
    figures = judged(moved(estimated(GRID), np.array([0.03, 0.04, 0.0])))
    assert figures.rho_rmse_m < 1e-9
    assert figures.unaligned_rho_rmse_m == pytest.approx(np.sqrt((0.03**2 + 0.04**2) / 2))


def test_maps_of_parallel_lines_are_moved_along_them_by_the_path() -> None:
    parallel = GRID[:4]
    seen = np.isin(LABELS, np.arange(4))
    table = MEASUREMENTS.sightings["line"].select(seen)
    measurements = replace(MEASUREMENTS, sightings={"line": table})
    log = log_with(MEASUREMENTS.t, TRUE_POSE, parallel)
    along = np.array([0.0, 0.7, 0.0])
    figures = judged(
        estimate_of(measurements, TRUE_POSE, parallel, table.truth), measurements, log, along
    )
    np.testing.assert_allclose(figures.truth_T_estimate, along, atol=1e-9)
    assert figures.rho_rmse_m < 1e-9
    assert figures.nees_freedom == 2 * 4 - 2


def test_map_nees_of_a_run_counts_the_joint_covariance() -> None:
    estimate = estimated(NOISY)
    tighter = replace(estimate, cov_joint=estimate.cov_joint / 4.0)
    assert judged(tighter).nees == pytest.approx(4.0 * judged(estimate).nees)


def test_a_method_without_lines_has_no_map_figures() -> None:
    truth = truth_of(LOG, MEASUREMENTS)
    assert map_metrics(estimated(np.zeros((0, 2)), unmatched()), MEASUREMENTS, truth, STAYS) is None
    bare = truth_of(log_with(MEASUREMENTS.t, TRUE_POSE, None), MEASUREMENTS)
    assert map_metrics(estimated(GRID), MEASUREMENTS, bare, STAYS) is None


def test_lines_whose_stretch_is_unknown_are_compared_near_where_the_robot_saw_them() -> None:
    table = MEASUREMENTS.sightings["line"]
    blind = replace(MEASUREMENTS, sightings={"line": replace(table, extent=table.extent * np.nan)})
    estimate = estimate_of(blind, TRUE_POSE, NOISY, LABELS)
    assert np.isnan(estimate.map.extent).all()
    figures, reference = judged(estimate, blind), judged(estimated(NOISY))
    assert figures.matched == 8
    assert figures.rho_rmse_m == pytest.approx(reference.rho_rmse_m, rel=0.5)
    where = TRUE_POSE[table.node[LABELS == 4], :2].mean(axis=0)
    s = position_along(estimate.map.params[4], where)
    expected = 1e-2 * np.hypot(1.0, s)
    assert figures.lines.sigma_offset[4] == pytest.approx(expected)


# ---- which line is which -----------------------------------------------------------------------


@pytest.mark.parametrize("voted", [True, False])
def test_a_second_line_on_a_true_line_is_a_duplicate(voted: bool) -> None:
    lines = np.vstack([GRID, GRID[2] + [0.02, 0.0]])
    match = LABELS.copy()
    match[np.flatnonzero(LABELS == 2)[:3]] = 8
    figures = judged(estimated(lines, match if voted else unmatched()))
    assert (figures.matched, figures.duplicates, figures.spurious) == (8, 1, 0)
    assert figures.lines.status[8] == "duplicate"
    assert figures.lines.true_id[8] == 2


@pytest.mark.parametrize("voted", [True, False])
def test_a_line_near_no_true_line_is_spurious(voted: bool) -> None:
    lines = np.vstack([GRID, [1.0, 0.0]])
    figures = judged(estimated(lines, LABELS if voted else unmatched()))
    assert (figures.matched, figures.duplicates, figures.spurious) == (8, 0, 1)
    assert np.isnan(figures.lines.offset[8])
    assert figures.lines.true_id[8] == -1


@pytest.mark.parametrize("voted", [True, False])
def test_a_seen_line_that_the_map_lacks_is_missed(voted: bool) -> None:
    match = np.where(LABELS == 7, -1, LABELS)
    figures = judged(estimated(GRID[:7], match if voted else unmatched()))
    assert (figures.true_lines_seen, figures.matched, figures.missed) == (8, 7, 1)
    assert figures.missed_id == (7,)


def test_a_line_that_hardly_came_into_view_is_neither_matched_nor_missed_nor_spurious() -> None:
    """Without labels and beyond reach: the true line 8 has no sighting near it."""
    true = np.vstack([GRID, [9.0, 0.0]])
    log = log_with(MEASUREMENTS.t, TRUE_POSE, true)
    figures = judged(estimated(true, unmatched()), log=log)
    assert counts(figures) == {
        "true_lines_seen": 8,
        "matched": 8,
        "missed": 0,
        "spurious": 0,
        "duplicates": 0,
        "unseen": 1,
    }


def test_a_line_that_hardly_came_into_view_does_not_pull_the_map() -> None:
    true = np.vstack([GRID, [9.0, 0.0]])
    lines = true + np.vstack([np.zeros((8, 2)), [0.08, 0.05]])
    log = log_with(MEASUREMENTS.t, TRUE_POSE, true)
    figures = judged(estimated(lines, unmatched()), log=log)
    assert figures.unseen == 1
    assert figures.rho_rmse_m < 1e-9
    assert figures.alpha_rmse_deg < 1e-9


def test_a_line_without_sightings_does_not_take_a_true_line_that_has_its_own() -> None:
    lines = np.vstack([GRID, GRID[2]])
    lines[2] += [0.03, 0.0]
    figures = judged(estimated(lines))
    assert figures.lines.status[2] == "matched"
    assert figures.lines.status[8] == "duplicate"


def test_sightings_tell_what_a_line_is_even_where_another_true_line_is_nearer() -> None:
    lines = GRID.copy()
    lines[1, 0] = GRID[2, 0] - 0.05
    figures = judged(estimated(lines))
    assert figures.lines.true_id[1] == 1
    assert figures.rho_rmse_m > 0.2


def test_derived_identities_vote_as_the_logs_own_do() -> None:
    lines = GRID.copy()
    lines[1, 0] = GRID[2, 0] - 0.05
    given_by_log = judged(estimated(lines))
    derived = judged(estimated(lines, LABELS, UNLABELLED), UNLABELLED)
    np.testing.assert_array_equal(derived.lines.true_id, given_by_log.lines.true_id)
    assert derived.rho_rmse_m == given_by_log.rho_rmse_m


def test_a_line_of_sightings_that_the_log_calls_clutter_is_spurious_beside_a_true_line() -> None:
    clutter = np.flatnonzero(LABELS == 3)[:6]
    match, labels = LABELS.copy(), LABELS.copy()
    match[clutter], labels[clutter] = 8, -1
    measurements = relabelled(MEASUREMENTS, labels)
    lines = np.vstack([GRID, GRID[3] + [0.05, 0.0]])
    figures = judged(estimated(lines, match, measurements), measurements, labelled(labels))
    assert figures.lines.status[8] == "spurious"
    assert figures.matched == 8


def test_the_line_with_most_sightings_counts_where_two_claim_one_true_line() -> None:
    lines = np.vstack([GRID, GRID[2]])
    lines[2] += [0.03, 0.0]
    match = LABELS.copy()
    match[np.flatnonzero(LABELS == 2)[:3]] = 8
    figures = judged(estimated(lines, match))
    assert figures.lines.status[2] == "matched"
    assert figures.lines.status[8] == "duplicate"


def test_geometry_gives_two_close_true_lines_one_map_line_each() -> None:
    """Both map lines lie nearest to the first true line; together they fit one to one."""
    true = np.vstack([GRID, [GRID[0, 0] + 0.06, 0.0]])
    lines = np.vstack([GRID, [GRID[0, 0] + 0.025, 0.0]])
    figures = judged(
        estimated(lines, unmatched(), UNLABELLED),
        UNLABELLED,
        log_with(MEASUREMENTS.t, TRUE_POSE, true),
    )
    np.testing.assert_array_equal(figures.lines.true_id, np.arange(9))


def test_geometry_tells_collinear_lines_apart_by_their_stretches() -> None:
    true = np.array([[1.0, 0.0], [1.0, 0.0], [2.0, np.pi / 2]])
    extent = np.array([[-4.0, -2.0], [2.0, 4.0], [-9.0, 9.0]])
    measurements, pose = one_node_looking_at(true[[0, 2]], np.array([0.0, 3.0, 0.0]))
    match = np.full(measurements.sighting_count, -1)
    estimate = estimate_of(measurements, pose, true[[1, 2]], match)
    stretch = np.array([[2.5, 3.5], [-0.5, 0.5]])
    estimate = replace(estimate, map=replace(estimate.map, extent=stretch))
    figures = judged(estimate, measurements, log_with(measurements.t, pose, true, extent=extent))
    np.testing.assert_array_equal(figures.lines.true_id, [1, 2])


def test_geometry_finds_the_lines_of_a_map_that_is_off_by_more_than_its_threshold() -> None:
    """The path's own motion brings the map near enough to begin."""
    motion = np.array([1.0, -0.5, 0.6])
    estimate = moved(estimated(NOISY, unmatched(), UNLABELLED), motion)
    figures = judged(estimate, UNLABELLED, path_motion=inverse(motion))
    np.testing.assert_array_equal(figures.lines.true_id, np.arange(8))


def test_assignment_prefers_more_pairs_to_nearer_ones() -> None:
    distance = np.array([[0.1, 0.9], [0.2, np.inf], [0.3, np.inf], [np.inf, np.inf]])
    target, own = assign(distance, np.array([True, True]))
    np.testing.assert_array_equal(target, [1, 0, 0, -1])
    np.testing.assert_array_equal(own, [True, True, False, False])


# ---- which lines were to be seen ---------------------------------------------------------------

LOOKING_DOWN = Camera(
    name="floor",
    looks_at="floor",
    image_size=(201, 201),
    homography=np.array([[0.0, -100.0, 100.0], [-100.0, 0.0, 200.0], [0.0, 0.0, 1.0]]),
)
"""Shows the floor from 0 to 2 m ahead and 1 m to either side."""


def seen_by_camera(
    true: np.ndarray,
    frames: int,
    extent: np.ndarray | None = None,
    nodes: int = 8,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> list[bool]:
    """Which lines count as seen by a camera that stands still and leaves after some frames."""
    t = np.arange(float(nodes))
    pose = np.tile(at, (nodes, 1))
    pose[frames:, 0] = 100.0
    still = np.broadcast_to(1e-6 * np.eye(3), (nodes - 1, 3, 3))
    measurements = Measurements(
        t, pose[0], 1e-12 * np.eye(3), Odometry(np.diff(pose, axis=0), still)
    )
    truth = truth_of(log_with(t, pose, true, LOOKING_DOWN, t, extent), measurements)
    assert truth.seen is not None
    return truth.seen.tolist()


@pytest.mark.parametrize(("frames", "seen"), [(4, False), (5, True)])
def test_a_line_is_seen_when_five_frames_show_it(frames: int, seen: bool) -> None:
    assert seen_by_camera(np.array([[1.0, 0.0], [3.0, 0.0]]), frames) == [seen, False]


@pytest.mark.parametrize(("length", "seen"), [(0.24, False), (0.26, True)])
def test_a_line_is_seen_when_a_quarter_of_a_metre_is_in_view(length: float, seen: bool) -> None:
    """Once cut by the edge of the view, once by its own end."""
    corner = 2.005 + 1.005
    across_corner = np.array([[(corner - length / np.sqrt(2)) / np.sqrt(2), np.pi / 4]])
    assert seen_by_camera(across_corner, 8) == [seen]
    short = np.array([[-length / 2, length / 2]])
    assert seen_by_camera(np.array([[1.0, 0.0]]), 8, short) == [seen]


def test_a_line_that_ends_before_the_view_begins_is_not_seen() -> None:
    lines = np.array([[1.0, 0.0], [-1.0, np.pi]])
    extent = np.array([[1.5, 4.0], [-0.9, 4.0]])
    assert seen_by_camera(lines, 8, extent) == [False, True]


def test_a_stretch_in_view_is_found_on_the_floor_wherever_the_robot_stands() -> None:
    lines = np.tile([3.0, 0.0], (2, 1))
    extent = np.array([[9.5, 10.5], [-10.5, -9.5]])
    assert seen_by_camera(lines, 8, extent, at=(2.0, 10.0, 0.3)) == [True, False]


def test_frames_that_were_left_out_of_the_run_do_not_count() -> None:
    t = np.arange(8.0)
    pose = np.zeros((8, 3))
    still = np.broadcast_to(1e-6 * np.eye(3), (3, 3, 3))
    every_second = Measurements(
        t[::2], np.zeros(3), 1e-12 * np.eye(3), Odometry(np.zeros((3, 3)), still)
    )
    log = log_with(t, pose, np.array([[1.0, 0.0]]), LOOKING_DOWN, t)
    assert truth_of(log, every_second).seen == [False]


@pytest.mark.parametrize(("sightings", "seen"), [(4, False), (5, True)])
def test_without_a_camera_five_sightings_make_a_line_seen(sightings: int, seen: bool) -> None:
    truth = truth_near(0.0, 0.0, sightings)
    assert truth.seen is not None
    assert truth.seen.tolist() == [seen]


@pytest.mark.parametrize(
    ("offset", "angle_deg", "near"),
    [(0.019, 0.0, True), (0.021, 0.0, False), (0.0, 1.4, True), (0.0, 1.6, False)],
)
def test_sightings_within_20_mm_and_1_5_degrees_of_a_true_line_are_of_it(
    offset: float, angle_deg: float, near: bool
) -> None:
    truth = truth_near(offset, np.radians(angle_deg), 5)
    assert truth.landmark.tolist() == [0 if near else -1] * 5
    assert truth.seen == [near]
    assert not truth.labelled


def truth_near(offset: float, angle: float, sightings: int) -> Truth:
    """The truth about sightings that are off by this at the middle of the stretch that they saw."""
    true = np.array([[1.0, 0.0]])
    measurements, pose = one_node_looking_at(true, np.zeros(3))
    table = measurements.sightings["line"].select(np.arange(SEEN_FRAMES) < sightings)
    middle = np.array([1.0 + offset, 2.0])
    z = np.array([middle @ [np.cos(angle), np.sin(angle)], angle])
    s = position_along(z, middle)
    count = len(table)
    table = replace(table, z=np.tile(z, (count, 1)), extent=np.tile([s - 0.5, s + 0.5], (count, 1)))
    measurements = replace(measurements, sightings={"line": table})
    return truth_of(log_with(measurements.t, pose, true), measurements)


def test_the_logs_own_identities_are_kept_as_they_are() -> None:
    wrong = np.roll(LABELS, 1)
    truth = truth_of(labelled(wrong), relabelled(MEASUREMENTS, wrong))
    np.testing.assert_array_equal(truth.landmark, wrong)
    assert truth.labelled


def test_derived_identities_are_those_that_the_simulation_knows() -> None:
    truth = truth_of(LOG, UNLABELLED)
    known = truth.landmark >= 0
    assert known.mean() > 0.99
    np.testing.assert_array_equal(truth.landmark[known], LABELS[known])


def test_without_a_true_path_identities_tell_what_was_seen_or_nothing_does() -> None:
    log = log_with(MEASUREMENTS.t, None, np.vstack([GRID, [9.0, 0.0]]))
    seen = truth_of(log, MEASUREMENTS).seen
    assert seen is not None
    assert seen.tolist() == [True] * 8 + [False]
    assert truth_of(log, UNLABELLED).seen is None
    figures = judged(estimated(GRID[:6], unmatched(), UNLABELLED), UNLABELLED, log)
    assert figures.true_lines_seen is None
    assert figures.missed is None
    assert figures.matched == 6


# ---- SantanaSLAM Table 2 -----------------------------------------------------------------------


def test_the_matching_table_counts_as_santana_slam_table_2() -> None:
    """Map line 0 takes two sightings of line 1, line 2 is clutter for a tenth of its sightings."""
    match, labels = LABELS.copy(), LABELS.copy()
    match[np.flatnonzero(LABELS == 1)[:2]] = 0
    clutter = np.flatnonzero(LABELS == 2)[:4]
    labels[clutter] = -1
    measurements = relabelled(MEASUREMENTS, labels)
    table = matching_table(
        estimated(GRID, match, measurements), measurements, truth_of(LOG, measurements)
    )
    assert table is not None
    number = np.bincount(LABELS)
    np.testing.assert_array_equal(table.true_id, np.arange(8))
    np.testing.assert_array_equal(table.correct, number - [0, 2, 4, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(table.incorrect, [2, 0, 0, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(table.unknown, [0, 0, 4, 0, 0, 0, 0, 0])
    assert table.unknown_total == 4
    assert table.hit_rate[0] == pytest.approx(number[0] / (number[0] + 2))
    known = len(LABELS) - 4
    assert table.right_share == pytest.approx((known - 2) / known)


def test_sightings_that_an_estimate_rejected_are_missed_not_identified() -> None:
    match = np.where(LABELS == 0, -1, LABELS)
    match[np.flatnonzero(LABELS == 3)[:2]] = -1
    table = matching_table(estimated(GRID, match), MEASUREMENTS, truth_of(LOG, MEASUREMENTS))
    assert table is not None
    number = np.bincount(LABELS)
    assert (table.identifications[0], table.missed[0]) == (0, number[0])
    assert (table.identifications[3], table.missed[3]) == (number[3] - 2, 2)
    assert np.isnan(table.hit_rate[0])
    assert table.right_share == 1.0


def test_landmarks_beyond_one_for_each_line_and_of_no_line_are_needless() -> None:
    """Map line 8 takes half of line 5's sightings, map line 9 two that are of no line."""
    match, labels = LABELS.copy(), LABELS.copy()
    match[np.flatnonzero(LABELS == 5)[::2]] = 8
    clutter = np.flatnonzero(LABELS == 6)[:2]
    match[clutter], labels[clutter] = 9, -1
    lines = np.vstack([GRID, GRID[5], GRID[6] + [0.5, 0.0]])
    measurements = relabelled(MEASUREMENTS, labels)
    truth = truth_of(labelled(labels), measurements)
    table = matching_table(estimated(lines, match, measurements), measurements, truth)
    assert table is not None
    np.testing.assert_array_equal(table.needless, [0, 0, 0, 0, 0, 1, 0, 0])
    assert table.needless_total == 2
    np.testing.assert_array_equal(table.incorrect, np.zeros(8))


def test_without_known_identities_there_is_no_matching_table() -> None:
    estimate = estimated(GRID, LABELS, UNLABELLED)
    assert matching_table(estimate, UNLABELLED, truth_of(None, UNLABELLED)) is None


def test_lines_that_the_maps_own_motion_always_fits_are_not_called_exact() -> None:
    def only(*rows: int) -> MapMetrics:
        number = {row: n for n, row in enumerate(rows)}
        return judged(estimated(GRID[list(rows)], np.array([number.get(k, -1) for k in LABELS])))

    one, crossing, parallel = only(0), only(0, 4), only(0, 1)
    assert np.isnan(one.rho_rmse_m)
    assert np.isnan(one.alpha_rmse_deg)
    assert np.isnan(crossing.rho_rmse_m)
    assert crossing.alpha_rmse_deg < 1e-9
    assert parallel.rho_rmse_m < 1e-9
