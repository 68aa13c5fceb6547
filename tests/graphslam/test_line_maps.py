"""Two line maps laid on each other, tested for being the same, and merged."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from graphslam.errors import BadConfig, BadMeasurements
from graphslam.geometry import (
    between,
    compose,
    inverse,
    line_to_floor,
    line_to_robot,
    nearest_twin,
    points_on_line,
    position_along,
    transform_points,
    twin,
    wrap,
)
from graphslam.line_maps.alignment import (
    Alignment,
    align_matches,
    find_alignments,
    refine_alignment,
)
from graphslam.line_maps.ambiguity import ambiguity
from graphslam.line_maps.chi2 import MapTest, same_map
from graphslam.line_maps.choice import choose
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.line_map import LineMap
from graphslam.line_maps.merge import merge_line_maps

MOTION = np.array([3.0, -2.0, np.radians(130.0)])
FLOOR = np.array(
    [
        (0.3, 0.0),
        (1.7, 0.1),
        (3.9, -0.05),
        (0.9, 1.5),
        (2.2, 1.62),
        (4.1, 1.57),
        (2.5, 0.8),
        (1.1, 2.4),
    ]
)
STRETCH = np.array(
    [
        (0.0, 4.0),
        (0.5, 3.0),
        (-1.0, 2.5),
        (-4.0, 0.0),
        (-3.0, 1.0),
        (-4.5, -1.0),
        (-1.5, 2.0),
        (-2.0, 1.5),
    ]
)
SIGMA = np.array([0.004, 0.005])


def blocks(stretch: np.ndarray, sigma: np.ndarray = SIGMA) -> np.ndarray:
    """Returns covariances of (rho, alpha) whose offset at the middle and angle are independent."""
    J = np.zeros((len(stretch), 2, 2))
    J[:, 0, 0] = J[:, 1, 1] = 1.0
    J[:, 0, 1] = stretch.mean(axis=1)
    return J @ np.diag(sigma**2) @ np.swapaxes(J, 1, 2)


def seen(
    rng: np.random.Generator | None,
    lines: np.ndarray = FLOOR,
    stretch: np.ndarray = STRETCH,
    sigma: np.ndarray = SIGMA,
) -> LineMap:
    """Returns a map of true lines, with errors of its own covariance; without any where None."""
    cov = blocks(stretch, sigma)
    error = np.zeros_like(lines)
    if rng is not None:
        root = np.linalg.cholesky(cov)
        error = (root @ rng.standard_normal((len(lines), 2, 1)))[..., 0]
    return LineMap(lines + error, cov, stretch)


def moved(line_map: LineMap, motion: np.ndarray) -> LineMap:
    """Returns a map as it looks from a frame at ``motion``."""
    lines = line_to_robot(line_map.lines, motion)
    ends = points_on_line(line_map.lines[:, None], line_map.extent)
    extent = np.sort(
        position_along(lines[:, None], transform_points(inverse(motion), ends)), axis=1
    )
    return LineMap(lines, blocks(extent), extent)


def far_off(motion: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    error = between(truth, motion)
    return float(np.hypot(*error[:2])), float(abs(error[2]))


# ---- finding ----------------------------------------------------------------------------------


def test_a_turned_map_with_a_third_of_its_lines_missing_is_found() -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        a, b = seen(rng), moved(seen(rng), MOTION)
        keep = np.sort(rng.permutation(len(FLOOR))[:6])
        best = find_alignments(a, b.select(keep))[0]
        assert best.matches.tolist() == [[int(k), n] for n, k in enumerate(keep)]
        distance, turn = far_off(best.motion, MOTION)
        assert distance < 0.03
        assert turn < 0.01
        assert best.fixed


def test_without_noise_the_motion_is_exact_and_everything_expected_agrees() -> None:
    a = seen(None)
    best = find_alignments(a, moved(a, MOTION))[0]
    assert far_off(best.motion, MOTION) == pytest.approx((0.0, 0.0), abs=1e-8)
    assert best.agree_m == pytest.approx(np.ptp(STRETCH, axis=1).sum())
    assert best.consistency == pytest.approx(1.0)
    assert best.conflict_m == 0.0


def test_twins_are_the_same_lines() -> None:
    rng = np.random.default_rng(1)
    a, b = seen(rng), moved(seen(rng), MOTION)
    flip = np.arange(len(b)) % 2 == 0
    sign = np.where(flip[:, None, None], np.diag([-1.0, 1.0]), np.eye(2))
    twins = LineMap(
        np.where(flip[:, None], twin(b.lines), b.lines),
        sign @ b.blocks() @ sign,
        np.where(flip[:, None], -b.extent[:, ::-1], b.extent),
    )
    one, other = find_alignments(a, b)[0], find_alignments(a, twins)[0]
    np.testing.assert_array_equal(one.matches, other.matches)
    np.testing.assert_allclose(one.motion, other.motion, atol=1e-9)
    np.testing.assert_allclose(one.cov, other.cov, atol=1e-12)
    plain, turned = same_map(a, b, one), same_map(a, twins, other)
    assert turned.chi2 == pytest.approx(plain.chi2)
    np.testing.assert_allclose(np.abs(turned.offset), np.abs(plain.offset), atol=1e-9)


def test_the_search_is_deterministic_and_does_not_depend_on_the_frames() -> None:
    rng = np.random.default_rng(2)
    a, b = seen(rng), seen(rng)
    first, again = (find_alignments(a, moved(b, MOTION)) for _ in range(2))
    assert [f.motion.tolist() for f in first] == [f.motion.tolist() for f in again]
    elsewhere = np.array([-40.0, 25.0, 2.0])
    best = find_alignments(a, moved(b, compose(MOTION, elsewhere)))[0]
    np.testing.assert_array_equal(best.matches, first[0].matches)
    assert best.score_m == pytest.approx(first[0].score_m, rel=1e-3)


def test_one_line_seen_in_two_pieces_is_one_match_and_a_part() -> None:
    a = seen(None)
    pieces = np.array([*range(8), 0])
    stretch = STRETCH[pieces].copy()
    stretch[0], stretch[8] = (0.0, 2.5), (2.8, 4.0)
    b = moved(seen(None, FLOOR[pieces], stretch), MOTION)
    best = find_alignments(a, b)[0]
    assert [0, 0] in best.matches.tolist()
    assert best.parts.tolist() == [[0, 8]]
    assert len(best.matches) == 8
    back = find_alignments(b, a)[0]
    assert back.parts.tolist() == [[8, 0]]


def test_lines_are_not_matched_where_they_were_not_both_seen() -> None:
    a = seen(None)
    stretch = STRETCH.copy()
    stretch[0] = (6.0, 9.0)
    best = find_alignments(a, moved(seen(None, FLOOR, stretch), MOTION))[0]
    assert 0 not in best.matches[:, 0]
    assert len(best.matches) == 7


def test_a_line_just_beside_another_counts_against_an_alignment() -> None:
    lines = FLOOR.copy()
    lines[0, 0] += 0.08
    b = moved(seen(None, lines), MOTION)
    best = find_alignments(seen(None), b)[0]
    assert 0 not in best.matches[:, 0]
    assert best.conflict_m == pytest.approx(4.0, abs=0.01)
    assert best.score_m == pytest.approx(best.agree_m - best.conflict_m)


def test_unknown_stretches_reach_as_far_as_the_map() -> None:
    a = seen(None)
    unknown = LineMap.exact(FLOOR, np.full((8, 2), np.nan))
    best = find_alignments(unknown, moved(a, MOTION))[0]
    assert len(best.matches) == 8
    assert far_off(best.motion, MOTION) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert np.isfinite(unknown.stretches()).all()


def test_a_single_line_of_unknown_length_still_has_a_stretch() -> None:
    alone = LineMap.exact(np.array([[1.0, 0.3]]), np.full((1, 2), np.nan))
    assert np.ptp(alone.stretches()) == pytest.approx(2.0)


def test_maps_without_lines_or_without_agreement_have_no_alignment() -> None:
    empty = LineMap.exact(np.zeros((0, 2)), np.zeros((0, 2)))
    assert find_alignments(seen(None), empty) == ()
    assert find_alignments(empty, seen(None)) == ()
    assert refine_alignment(empty, seen(None), np.zeros(3)) is None
    assert ambiguity((), empty) is None
    assert refine_alignment(seen(None), seen(None), np.array([50.0, 0.0, 0.0])) is None


def test_an_alignment_near_a_motion_is_refined_to_it() -> None:
    rng = np.random.default_rng(3)
    a, b = seen(rng), moved(seen(rng), MOTION)
    near = refine_alignment(a, b, MOTION + np.array([0.08, -0.06, 0.03]))
    assert near is not None
    np.testing.assert_allclose(near.motion, find_alignments(a, b)[0].motion, atol=1e-9)


# ---- what is not fixed ------------------------------------------------------------------------


def lattice(count: int, pitch: float, offset: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    rho = offset + pitch * np.arange(count)
    lines = [(r, alpha) for alpha in (0.0, np.pi / 2) for r in rho]
    reach = (offset - 0.3, offset + pitch * (count - 1) + 0.3)
    stretch = [reach if alpha == 0.0 else (-reach[1], -reach[0]) for _, alpha in lines]
    return np.array(lines), np.array(stretch)


def test_a_periodic_floor_names_its_period_and_its_turns() -> None:
    rng = np.random.default_rng(4)
    lines, stretch = lattice(5, 0.6, 0.2)
    a, b = seen(rng, lines, stretch), moved(seen(rng, lines, stretch), np.array([0.4, 0.1, 0.2]))
    found = find_alignments(a, b)
    unsure = ambiguity(found, b)
    assert unsure is not None
    assert not unsure.unique
    np.testing.assert_allclose(unsure.periods, [[0.6, 0.0], [0.0, 0.6]], atol=0.01)
    np.testing.assert_allclose(np.degrees(unsure.turns), [-90.0, 90.0, 180.0])
    assert "0.60" in str(unsure)
    right = [
        k for k in unsure.equal if far_off(found[k].motion, np.array([0.4, 0.1, 0.2]))[0] < 0.02
    ]
    assert len(right) == 1


def test_a_floor_that_repeats_to_rounding_leaves_all_alignments_in_question() -> None:
    rng = np.random.default_rng(4)
    lines, stretch = lattice(4, 0.6, 0.2)
    a, b = seen(rng, lines, stretch), moved(seen(rng, lines, stretch), MOTION)
    found = find_alignments(a, b)
    unsure = ambiguity(found, b)
    assert unsure is not None
    choice = choose(found, unsure, a, b)
    assert choice.rows == unsure.equal
    assert choice.in_question == len(unsure.equal) > 1
    assert "none of them apart" in str(choice)


@pytest.mark.parametrize("seed", range(3))
def test_joints_that_are_a_little_off_the_period_tell_the_right_alignment(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lines, stretch = lattice(5, 0.6, 0.2)
    lines[:, 0] += rng.uniform(-0.008, 0.008, len(lines))
    sigma = 0.1 * SIGMA
    a = seen(rng, lines, stretch, sigma)
    b = moved(seen(rng, lines, stretch, sigma), MOTION)
    b = LineMap(b.lines, blocks(b.extent, sigma), b.extent)
    b = b.select(np.flatnonzero(np.arange(len(b)) != 2))  # so that length speaks for no one
    found = find_alignments(a, b)
    unsure = ambiguity(found, b)
    assert unsure is not None
    assert len(unsure.equal) > 3
    choice = choose(found, unsure, a, b)
    assert choice.in_question <= 5  # some of few common lines fit closely by chance
    shift, turn = far_off(found[choice.rows[0]].motion, MOTION)
    assert shift < 0.003
    assert turn < 0.003
    assert "for the others" in str(choice)


def test_a_floor_without_period_has_one_alignment_and_says_how_far_the_next_is() -> None:
    rng = np.random.default_rng(5)
    a, b = seen(rng), moved(seen(rng), MOTION)
    unsure = ambiguity(find_alignments(a, b), b)
    assert unsure is not None
    assert unsure.unique
    assert unsure.equal == (0,)
    assert 0.0 <= unsure.ratio < 0.6
    assert "one alignment fits" in str(unsure)


def test_parallel_lines_leave_the_shift_along_them_open() -> None:
    rng = np.random.default_rng(6)
    lines = np.column_stack([[0.0, 0.7, 1.9, 3.1], np.full(4, 0.4)])
    stretch = np.tile([-2.0, 3.0], (4, 1))
    a, b = seen(rng, lines, stretch), moved(seen(rng, lines, stretch), np.array([0.2, 0.3, 1.0]))
    best = find_alignments(a, b)[0]
    assert not best.fixed
    assert best.slide is not None
    np.testing.assert_allclose(np.abs(best.slide @ [np.cos(0.4), np.sin(0.4)]), 0.0, atol=0.02)
    along = np.array([*best.slide, 0.0])
    assert along @ best.information @ along < 1e-3 * np.trace(best.information)
    assert np.sqrt(along @ best.cov @ along) > 100.0
    assert far_off(best.motion, np.array([0.2, 0.3, 1.0]))[1] < 0.02
    unsure = ambiguity((best,), b)
    assert unsure is not None
    assert not unsure.unique
    assert "any shift along" in str(unsure)


def test_one_common_line_leaves_nothing_to_test() -> None:
    one = LineMap(FLOOR[:1], blocks(STRETCH[:1]), STRETCH[:1])
    best = find_alignments(one, one)[0]
    test = same_map(one, one, best)
    assert test.freedom == 0
    assert np.isnan(test.probability)
    assert np.isnan(test.per_freedom)


# ---- are they the same ------------------------------------------------------------------------


def correlated(rng: np.random.Generator, floor: LineMap) -> LineMap:
    """Returns a map whose lines share an error of their frame beside errors of their own."""
    frame = rng.standard_normal(3) * [0.05, 0.05, 0.03]
    J = np.zeros((len(floor), 2, 3))
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        high, low = (
            nearest_twin(line_to_floor(floor.lines, s), floor.lines) for s in (step, -step)
        )
        J[:, :, k] = (high - low) / 2e-6
    J = J.reshape(-1, 3)
    shared = J @ np.diag(np.square([0.05, 0.05, 0.03])) @ J.T
    own = floor.cov
    error = J @ frame + np.linalg.cholesky(own) @ rng.standard_normal(len(own))
    return LineMap(floor.lines + error.reshape(-1, 2), own + shared, floor.extent)


@pytest.fixture(scope="module")
def equal_maps() -> list[tuple[Alignment, MapTest]]:
    """Many pairs of maps of one floor, each with an error of its own frame."""
    floor = seen(None)
    matches = np.column_stack([np.arange(8)] * 2)
    found = []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        a, b = correlated(rng, floor), correlated(rng, floor)
        alignment = align_matches(a, b, matches, np.zeros(3))
        found.append((alignment, same_map(a, b, alignment)))
    return found


def test_chi_square_of_equal_maps_is_chi_square_whatever_their_frames_do(
    equal_maps: list[tuple[Alignment, MapTest]],
) -> None:
    values = [test.chi2 for _, test in equal_maps]
    assert {test.freedom for _, test in equal_maps} == {13}
    assert scipy.stats.kstest(values, scipy.stats.chi2(13).cdf).pvalue > 0.01
    motions = [a.motion @ np.linalg.solve(a.cov, a.motion) for a, _ in equal_maps]
    assert scipy.stats.kstest(motions, scipy.stats.chi2(3).cdf).pvalue > 0.01


def test_sigmas_of_the_differences_are_their_scatter(
    equal_maps: list[tuple[Alignment, MapTest]],
) -> None:
    scaled = [np.column_stack([t.offset, t.d_line[:, 1]]) / t.sigma for _, t in equal_maps]
    np.testing.assert_allclose(np.std(scaled, axis=0), 1.0, atol=0.2)


def test_a_line_that_moved_is_a_difference() -> None:
    rng = np.random.default_rng(7)
    lines = FLOOR.copy()
    lines[3, 0] += 0.04
    a, b = seen(rng), moved(seen(rng, lines), MOTION)
    test = same_map(a, b, find_alignments(a, b)[0])
    assert test.probability < 1e-3
    assert int(np.argmax(np.abs(test.offset))) == test.matches[:, 0].tolist().index(3)


def test_the_error_that_would_explain_a_difference_is_the_one_that_was_made() -> None:
    made = 0.02
    half = 0.5 * (STRETCH[:, 1] - STRETCH[:, 0])
    found = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        ends = made * rng.standard_normal((len(FLOOR), 2))
        turned = (ends[:, 1] - ends[:, 0]) / (2.0 * half)
        offset = ends.mean(axis=1) + turned * STRETCH.mean(axis=1)
        bent = FLOOR + np.column_stack([offset, turned])
        a, b = seen(rng), seen(rng, bent)
        test = same_map(a, b, align_matches(a, b, np.column_stack([np.arange(8)] * 2), np.zeros(3)))
        found.append(test.excess)
    assert np.median(found) == pytest.approx(made, rel=0.2)


def test_no_further_error_is_asked_for_where_the_covariances_suffice(
    equal_maps: list[tuple[Alignment, MapTest]],
) -> None:
    for _, test in equal_maps:
        assert (test.excess == 0.0) == (test.chi2 <= test.freedom)


def test_differences_are_second_minus_first() -> None:
    lines = FLOOR.copy()
    lines[0, 0] += 0.03
    a, b = seen(None), seen(None, lines)
    matches = np.column_stack([np.arange(8)] * 2)
    test = same_map(a, b, align_matches(a, b, matches, np.zeros(3)))
    assert test.offset[0] > 0.015
    back = same_map(b, a, align_matches(b, a, matches, np.zeros(3)))
    np.testing.assert_allclose(back.offset, -test.offset, atol=1e-4)
    assert back.chi2 == pytest.approx(test.chi2, rel=1e-3)


def test_dependent_maps_are_tested_against_a_bound_and_own_sigmas() -> None:
    rng = np.random.default_rng(8)
    a = seen(rng)
    b = LineMap(a.lines + 0.003 * rng.standard_normal((8, 2)), a.cov, a.extent)
    alignment = align_matches(a, b, np.column_stack([np.arange(8)] * 2), np.zeros(3))
    free, bound = same_map(a, b, alignment), same_map(a, b, alignment, independent=False)
    assert bound.chi2 == pytest.approx(0.5 * free.chi2)
    assert bound.scale == 2.0
    assert bound.probability > free.probability
    np.testing.assert_allclose(bound.own**2, 2.0 * free.chi2, rtol=0.02)


def test_an_exact_map_leaves_the_other_ones_covariance() -> None:
    rng = np.random.default_rng(9)
    plan = LineMap.exact(FLOOR, STRETCH)
    b = moved(seen(rng), MOTION)
    best = find_alignments(plan, b)[0]
    test = same_map(plan, b, best)
    np.testing.assert_array_equal(test.sigma_a, 0.0)
    np.testing.assert_allclose(test.sigma, test.sigma_b)
    assert np.isnan(test.own[0])
    assert 0.001 < test.probability < 0.999
    both = same_map(plan, plan, find_alignments(plan, plan)[0])
    assert both.freedom == 0
    np.testing.assert_allclose(both.offset, 0.0, atol=1e-9)


# ---- merging ----------------------------------------------------------------------------------


def test_merged_maps_are_honest_and_better_than_either() -> None:
    nees, better = [], 0
    matches = np.column_stack([np.arange(8)] * 2)
    for seed in range(100):
        rng = np.random.default_rng(seed)
        a, b = seen(rng), moved(seen(rng), MOTION)
        merged = merge_line_maps(a, b, align_matches(a, b, matches, MOTION))
        error = merged.map.lines - nearest_twin(FLOOR, merged.map.lines)
        error[:, 1] = wrap(error[:, 1])
        nees.append(error.ravel() @ np.linalg.solve(merged.map.cov, error.ravel()))
        assert np.all(np.diagonal(merged.map.cov) < np.diagonal(a.cov))
        worse = a.lines - FLOOR
        better += np.sum(error**2 / np.diagonal(a.cov).reshape(-1, 2)) < np.sum(
            worse**2 / np.diagonal(a.cov).reshape(-1, 2)
        )
    assert scipy.stats.kstest(nees, scipy.stats.chi2(16).cdf).pvalue > 0.01
    assert better > 80


def test_lines_of_one_map_alone_carry_the_uncertainty_of_the_frames() -> None:
    a = seen(None).select(np.arange(6))
    b = moved(seen(None), MOTION)
    merged = merge_line_maps(a, b, find_alignments(a, b)[0])
    assert merged.rows_a[-2:] == ((), ())
    assert merged.rows_b[-2:] == ((6,), (7,))
    np.testing.assert_allclose(nearest_twin(merged.map.lines, FLOOR), FLOOR, atol=1e-7)
    np.testing.assert_allclose(merged.map.extent[:6], STRETCH[:6], atol=1e-7)
    alone = np.diagonal(merged.map.cov).reshape(-1, 2)[6:, 1]
    assert np.all(alone > SIGMA[1] ** 2)
    turn = merged.cov_motion[2, 2]
    assert np.all(alone < SIGMA[1] ** 2 + turn + 1e-9)


def test_a_line_known_exactly_stays_where_it_is() -> None:
    rng = np.random.default_rng(10)
    plan = LineMap.exact(FLOOR, STRETCH)
    b = moved(seen(rng), MOTION)
    merged = merge_line_maps(plan, b, find_alignments(plan, b)[0])
    np.testing.assert_allclose(merged.map.lines, FLOOR, atol=1e-5)
    assert not merged.map.cov.any()


def test_pieces_of_one_line_become_one() -> None:
    a = seen(None)
    pieces = np.array([*range(8), 0])
    stretch = STRETCH[pieces].copy()
    stretch[0], stretch[8] = (0.0, 2.5), (2.8, 4.0)
    b = moved(seen(None, FLOOR[pieces], stretch), MOTION)
    merged = merge_line_maps(a, b, find_alignments(a, b)[0])
    assert len(merged.map) == 8
    assert merged.rows_b[0] == (0, 8)
    other_way = merge_line_maps(b, a, find_alignments(b, a)[0])
    assert len(other_way.map) == 8
    assert other_way.rows_a[0] == (0, 8)
    assert np.ptp(other_way.map.extent[0]) == pytest.approx(4.0, abs=1e-6)


# ---- input ------------------------------------------------------------------------------------


def test_maps_that_contradict_themselves_are_refused() -> None:
    with pytest.raises(BadMeasurements, match="shape"):
        LineMap(FLOOR, np.zeros((3, 3)), STRETCH)
    with pytest.raises(BadMeasurements, match="symmetric"):
        LineMap(FLOOR[:1], np.array([[1.0, 0.5], [0.0, 1.0]]), STRETCH[:1])
    with pytest.raises(BadMeasurements, match="ends before"):
        LineMap(FLOOR[:1], np.eye(2), STRETCH[:1, ::-1])
    with pytest.raises(BadMeasurements, match="line 0 is not positive definite"):
        LineMap(FLOOR[:1], np.array([[1.0, 2.0], [2.0, 1.0]]), STRETCH[:1])
    together = np.kron(np.array([[1.0, 2.0], [2.0, 1.0]]), np.eye(2))
    bad = LineMap(FLOOR[:2], together, STRETCH[:2])
    with pytest.raises(BadMeasurements, match="make the map again"):
        align_matches(bad, bad, np.column_stack([np.arange(2)] * 2), np.zeros(3))


@pytest.mark.parametrize(
    ("name", "value"),
    [("offset_m", 0.0), ("far_m", 0.01), ("angle_deg", 40.0), ("most", 0), ("equal_score", 1.5)],
)
def test_settings_without_meaning_are_refused(name: str, value: float) -> None:
    with pytest.raises(BadConfig, match=f"alignment.{name}"):
        AlignmentConfig(**{name: value})
