"""The verdict says what the figures say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compare.comparison import Comparison, MethodMetrics, compare
from compare.consistency import Consistency, Innovations
from compare.maps import common_direction
from compare.verdict import verdict
from frontend.extract import extract
from frontend.simulate import Scenario, load_scenario, simulate_log
from graphslam.baseline import dead_reckoning
from graphslam.ekf import run_ekf
from graphslam.elsewhere import OTHER_PLACES
from graphslam.estimate import Unobserved
from graphslam.smoother import smooth
from tests.compare.made import estimate_of, log_with, relabelled
from tests.worlds import GRID, drive

DRIVEN, TRUE_POSE = drive(seed=5, nodes=200)
MEASUREMENTS = replace(DRIVEN, start_pose=TRUE_POSE[0])
LABELS = MEASUREMENTS.sightings["line"].truth
LOG = log_with(MEASUREMENTS.t, TRUE_POSE, GRID)
UNLABELLED = relabelled(MEASUREMENTS, np.full(len(LABELS), -1))


def made_comparison(truth: bool = True) -> Comparison:
    measurements = MEASUREMENTS if truth else UNLABELLED
    estimates = [dead_reckoning(measurements)]
    estimates += [
        estimate_of(measurements, TRUE_POSE, GRID, LABELS, method=method, causal=method == "ekf")
        for method in ("ekf", "smoother")
    ]
    return compare(LOG if truth else None, measurements, estimates)


JUDGED = made_comparison()
UNJUDGED = made_comparison(truth=False)


def with_method(comparison: Comparison, entry: MethodMetrics) -> Comparison:
    others = tuple(entry if m.method == entry.method else m for m in comparison.methods)
    return replace(comparison, methods=others)


def with_errors(method: str, comparison: Comparison, **errors: float) -> Comparison:
    """Returns the comparison with other errors of one method's path or map."""
    entry = comparison[method]
    assert entry.trajectory is not None
    assert entry.map is not None
    path = {k: v for k, v in errors.items() if hasattr(entry.trajectory, k)}
    figures = {k: v for k, v in errors.items() if hasattr(entry.map, k)}
    assert {*path, *figures} == {*errors}
    return with_method(
        comparison,
        replace(
            entry,
            trajectory=replace(entry.trajectory, **path),
            map=replace(entry.map, **figures),
        ),
    )


def path_errors(ekf: float, smoother: float) -> Comparison:
    comparison = with_errors("ekf", JUDGED, aligned_rmse_m=ekf)
    return with_errors("smoother", comparison, aligned_rmse_m=smoother)


def sentence(comparison: Comparison, *words: str) -> str:
    """Returns the one sentence that holds all words."""
    found = [s for s in verdict(comparison) if all(word in s for word in words)]
    assert len(found) == 1, verdict(comparison)
    return found[0]


def test_a_path_that_smoothing_makes_much_better_is_worth_it() -> None:
    comparison = path_errors(0.0200, 0.0130)
    assert verdict(comparison)[0].startswith(
        "By ground truth, smooth this run: it gives the better path; for the last pose and map "
        "the filter does as well."
    )
    text = sentence(comparison, "Path (aligned RMS error of 200 nodes)")
    assert "ekf 20 mm, smoother 13 mm; smoothing cuts the filter's by 35%, which matters." in text


@pytest.mark.parametrize(
    ("ekf", "smoother"),
    [(0.0100, 0.0085), (0.0015, 0.0006), (0.01, 0.01), (0.0, 0.0)],
    ids=["below 20 percent", "below 1 mm", "equal", "both without error"],
)
def test_a_small_difference_does_not_matter(ekf: float, smoother: float) -> None:
    comparison = path_errors(ekf, smoother)
    assert verdict(comparison)[0].startswith(
        "By ground truth, filtering is enough: smoothing changes the path, last pose and map by "
        "nothing that matters. (A difference matters above 20% and 1 mm.)"
    )
    assert "does not matter" in sentence(comparison, "Path (aligned")


def test_a_path_that_smoothing_makes_worse_speaks_for_the_filter() -> None:
    comparison = path_errors(0.010, 0.020)
    assert "filter this run: smoothing makes the path worse." in verdict(comparison)[0]
    assert "raises the filter's by 100%" in sentence(comparison, "Path (aligned")


def test_a_better_path_and_a_worse_map_are_both_said() -> None:
    comparison = with_errors("smoother", path_errors(0.02, 0.01), rho_rmse_m=0.02)
    assert "smoothing gives the better path, filtering the better map" in verdict(comparison)[0]


def test_a_map_with_fewer_wrong_lines_is_the_better_one() -> None:
    comparison = with_errors("ekf", JUDGED, duplicates=2)
    assert "it gives the better map" in verdict(comparison)[0]
    assert sentence(comparison, "ekf:", "seen lines mapped") == (
        "ekf: 8 of 8 seen lines mapped, 2 twice, none spurious."
    )


def test_one_wrong_line_more_among_many_does_not_make_a_map_worse() -> None:
    comparison = with_errors("ekf", with_errors("smoother", JUDGED, spurious=90), spurious=91)
    assert "it gives the better map" not in verdict(comparison)[0]


def test_an_error_where_the_filter_had_none_is_given_in_metres() -> None:
    text = sentence(path_errors(0.0, 0.005), "Path (aligned")
    assert "smoothing raises the filter's by 5 mm, which matters." in text


def test_methods_with_the_same_line_count_share_a_sentence() -> None:
    assert "ekf and smoother: 8 of 8 seen lines mapped, none twice, none spurious." in verdict(
        JUDGED
    )


def test_causal_and_not_causal_paths_are_told_apart() -> None:
    assert sentence(JUDGED, "The path of ekf is causal", "smoother uses the whole run")


def test_the_share_of_right_matches_is_said() -> None:
    assert sentence(JUDGED, f"smoother: 100.0% of {len(LABELS)} matches are right.")


@pytest.mark.parametrize(
    ("nees", "word"), [(4.0, "overconfident"), (1.0, "consistent"), (0.05, "conservative")]
)
def test_a_known_nees_is_judged(nees: float, word: str) -> None:
    comparison = with_method(JUDGED, replace(JUDGED["ekf"], pose_nees=nees))
    assert sentence(comparison, "ekf, poses: " + word, f"NEES {nees:.2g}")


def test_a_nees_that_is_not_defined_is_not_mentioned() -> None:
    comparison = with_method(JUDGED, replace(JUDGED["ekf"], pose_nees=float("nan")))
    assert not any("ekf, poses" in s for s in verdict(comparison))


def test_what_is_not_observed_is_said_of_methods_that_observe() -> None:
    blind = Unobserved("position", (0.0, 1.0), 0.2, 0.21)
    comparison = with_method(JUDGED, replace(JUDGED["smoother"], unobserved=(blind,)))
    assert "position along 90°" in sentence(comparison, "not observed")


def test_lost_episodes_and_missing_convergence_are_said() -> None:
    lost = replace(JUDGED["ekf"], counts={"lost: every sighting rejected": 3, "other": 5})
    late = replace(JUDGED["smoother"], converged=False, iterations=50)
    comparison = with_method(with_method(JUDGED, lost), late)
    assert sentence(comparison, "ekf was lost 3 times: every sighting rejected.")
    assert sentence(comparison, "smoother did not converge in 50 iterations")
    once = replace(lost, counts={"lost: every sighting rejected": 1})
    assert sentence(with_method(JUDGED, once), "ekf was lost once: every sighting rejected.")


def test_a_place_that_is_not_known_is_said_with_what_else_it_may_be() -> None:
    words = "they repeat every 0.600 m along 0°"
    unsure = replace(JUDGED["ekf"], converged=False, iterations=0)
    several = replace(unsure, counts={f"{OTHER_PLACES}: {words}": 7})
    told = sentence(with_method(JUDGED, several), "ekf does not know its place: 7 other places")
    assert words in told
    assert not any("did not converge" in s for s in verdict(with_method(JUDGED, several)))
    assert sentence(with_method(JUDGED, unsure), "ekf has not found its place on the known map")


def test_a_method_that_odometry_alone_beats_is_warned_of() -> None:
    worse = with_errors("ekf", JUDGED, aligned_rmse_m=10.0)
    assert sentence(worse, "The path of ekf is worse than odometry alone")
    assert not any("worse than odometry" in s for s in verdict(JUDGED))


def test_without_truth_it_says_so_and_argues_from_covariances_and_agreement() -> None:
    smoother = replace(UNJUDGED["smoother"], position_sigma_m=0.010)
    ekf = replace(UNJUDGED["ekf"], position_sigma_m=0.020)
    comparison = with_method(with_method(UNJUDGED, smoother), ekf)
    texts = verdict(comparison)
    assert texts[0].startswith("By the methods' own covariances, smooth this run")
    assert texts[1].startswith("There is no ground truth for this run")
    assert "The filter's variance is 4 times the smoother's." in sentence(comparison, "Path (own")
    assert sentence(comparison, "ekf and smoother differ by 0 mm RMS along the path")
    assert not any("error of" in text for text in texts)


def test_without_truth_covariances_of_a_lost_filter_decide_nothing() -> None:
    sure = replace(UNJUDGED["ekf"], position_sigma_m=0.001, last_position_sigma_m=0.001)
    assert "filter this run" in verdict(with_method(UNJUDGED, sure))[0]
    lost = with_method(UNJUDGED, replace(sure, counts={"lost: every sighting rejected": 1}))
    texts = verdict(lost)
    assert texts[0].startswith("Smooth this run: ekf was lost, and its own covariances are not")
    assert not any("filter this run" in text for text in texts)
    late = replace(UNJUDGED["smoother"], converged=False, iterations=50)
    assert verdict(with_method(UNJUDGED, late))[0].startswith(
        "Filter this run: smoother has not converged"
    )
    both = verdict(with_method(lost, late))
    assert both[0].startswith("Nothing tells whether to filter or to smooth this run: ekf was lost")
    judged = with_method(
        JUDGED, replace(JUDGED["ekf"], counts={"lost: every sighting rejected": 1})
    )
    assert verdict(judged)[0].startswith("By ground truth")


def test_maps_that_contradict_each_other_are_pointed_out() -> None:
    entry = next(e for e in UNJUDGED.agreement if e.first == "ekf")
    assert entry.map is not None
    many = np.full(len(entry.map.row_a), 10.0)
    apart = replace(entry, map=replace(entry.map, offset_sigmas=many))
    others = tuple(apart if e is entry else e for e in UNJUDGED.agreement)
    comparison = replace(UNJUDGED, agreement=others)
    assert sentence(comparison, "common lines", "at least one of them is wrong about itself")
    assert not any("wrong about itself" in s for s in verdict(UNJUDGED))


def test_a_map_in_a_frame_of_its_own_gets_a_hint_at_the_start_pose() -> None:
    log = log_with(MEASUREMENTS.t, None, GRID + np.array([50.0, 0.0]))
    match = np.full(len(LABELS), -1)
    estimate = estimate_of(UNLABELLED, TRUE_POSE, GRID, match)
    comparison = compare(log, UNLABELLED, [estimate])
    assert sentence(comparison, "[start] must be in the frame of the true map")
    assert not any("[start]" in s for s in verdict(JUDGED))


def test_one_method_alone_gets_its_figures_and_no_recommendation() -> None:
    alone = compare(LOG, MEASUREMENTS, [dead_reckoning(MEASUREMENTS)])
    texts = verdict(alone)
    assert texts[0].startswith("Path (aligned RMS error of 200 nodes): odometry ")
    assert not any("smoothing" in text for text in texts)


def test_a_run_with_no_method_has_no_verdict_to_give() -> None:
    assert verdict(replace(JUDGED, methods=(), agreement=()))[0].startswith("There is no ground")


def test_without_any_sighting_the_verdict_says_that_there_is_nothing_to_choose() -> None:
    measurements = drive(1, 40)[0].without_sightings()
    judged = compare(None, measurements, [dead_reckoning(measurements), run_ekf(measurements)])
    assert judged.verdict[0].startswith("No sighting was used")


def judged_scenario(scenario: Scenario, seed: int = 0) -> Comparison:
    log = simulate_log(scenario, seed)
    measurements = extract(log)
    filtered = run_ekf(measurements)
    odometry = dead_reckoning(measurements)
    return compare(log, measurements, [odometry, filtered, smooth(measurements, filtered)])


def test_lines_of_one_direction_are_to_be_crossed_before_any_method_is_chosen() -> None:
    judged = judged_scenario(load_scenario("one-direction"))
    texts = verdict(judged)
    assert texts[0].startswith("Do neither before adding a second line direction: along 9")
    assert f"± {judged['smoother'].direction_sigma_deg:.2g}° for one sigma" in texts[0]
    assert "no line fixes the position" in texts[0]
    assert "(It counts from a ratio of 3 on.)" in texts[0]
    lamps = verdict(replace(judged, kinds=("lamp",)))[0]
    assert lamps.startswith("Do neither before more lamps are seen: along 9")
    assert "no lamp fixes the position" in lamps
    both = verdict(replace(judged, kinds=("line", "lamp")))[0]
    assert "no landmark fixes the position" in both


def test_crossing_lines_leave_the_choice_to_the_figures() -> None:
    judged = judged_scenario(replace(load_scenario("grid"), repeat=1))
    texts = verdict(judged)
    assert texts[0].startswith("By ground truth, ")
    assert judged.bound is not None
    assert judged.bound.at == "truth"
    assert sentence(judged, "The best there is", "Cramér–Rao")
    assert judged["smoother"].unobserved == ()
    assert judged["smoother"].innovations is None
    assert sentence(judged, "ekf, innovations: on no part of the way too large")


def test_a_long_way_without_a_line_is_told_with_its_place() -> None:
    measurements, truth = drive(seed=5, nodes=400)
    table = measurements.sightings["line"]
    kept = (table.node < 100) | (table.node > 300)
    measurements = replace(
        measurements, start_pose=truth[0], sightings={"line": table.select(kept)}
    )
    filtered = run_ekf(measurements)
    smoothed = smooth(measurements, filtered)
    judged = compare(log_with(measurements.t, truth, GRID), measurements, [filtered, smoothed])
    (way,) = judged["ekf"].unobserved
    assert way.stretch is not None
    assert way.stretch.length_m > 5.0
    assert (way.stretch.from_s, way.stretch.to_s) == (pytest.approx(9.9), pytest.approx(30.1))
    assert way.sigma >= way.sigma_odometry  # a filter's, that begins the way unsure
    assert judged["smoother"].unobserved[0].sigma < way.sigma
    text = sentence(judged, "No line or other landmark counted for", "from 9.9 s to 30.1 s")
    assert "odometry drifts by" in text
    assert "by ekf and" in text
    assert Unobserved.from_list(way.to_list()) == way


def test_where_a_method_is_overconfident_is_told() -> None:
    bold = replace(JUDGED["ekf"], consistency=Consistency(
        np.arange(1.0, 5.0), np.array([[1.0, 1.0, 1.0, 1.0]] * 2 + [[1.0, 1.0, 16.0, 6.0]] * 2), 1
    ))  # fmt: skip
    text = sentence(with_method(JUDGED, bold), "ekf is overconfident")
    assert text == "ekf is overconfident by a factor 4 in heading after 3 m."


def test_causal_paths_are_compared_with_each_other() -> None:
    other = replace(JUDGED["ekf"], method="isam2")
    both = replace(JUDGED, methods=(*JUDGED.methods, other))
    assert sentence(both, "With the data up to each time the path of isam2", "that of ekf by")


def test_innovations_that_grow_too_large_are_told_with_their_place_and_without_truth() -> None:
    shares = np.arange(1.0, 17.0)
    calm = Innovations(shares, np.ones(16), np.full(16, 40.0))
    wild = replace(calm, nis=np.where(shares > 12.0, 4.0, 1.0))
    comparison = with_method(UNJUDGED, replace(UNJUDGED["ekf"], innovations=wild))
    text = sentence(comparison, "ekf is overconfident by a factor 2 in what it expects to see")
    assert "after 12 m (NIS 4 per degree of freedom from there on; up to 1." in text
    quiet = with_method(UNJUDGED, replace(UNJUDGED["ekf"], innovations=calm))
    assert sentence(quiet, "ekf, innovations: on no part of the way", "NIS 1 per degree")


def test_the_open_direction_is_the_lines_own_and_as_sure_in_the_floor_frame_as_said() -> None:
    """In the start's frame the bound allows 0.85 degrees; beside the lines it is far better."""
    scenario, errors = load_scenario("one-direction"), []
    for seed in range(4):
        measurements = extract(simulate_log(scenario, seed))
        estimate = smooth(measurements, run_ekf(measurements))
        (open_direction,) = estimate.unobserved
        normal, sigma = common_direction(estimate)
        off = (open_direction.angle_deg - normal) % 180.0 - 90.0
        assert abs(off) < 0.2
        errors.append(((open_direction.angle_deg - 90.0 + 90.0) % 180.0 - 90.0) / sigma)
    assert 0.2 < np.sqrt(np.mean(np.square(errors))) < 2.0
