"""The comparison as a whole: what is in it, what is written, and how far methods agree."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest

import compare as package
from compare.agreement import agreement
from compare.comparison import Comparison, compare
from compare.content import plain
from graphslam.baseline import dead_reckoning
from graphslam.ekf import run_ekf
from graphslam.errors import BadMeasurements
from graphslam.geometry import line_to_floor, wrap
from tests.compare.made import estimate_of, log_with, moved, relabelled
from tests.worlds import GRID, drive

DRIVEN, TRUE_POSE = drive(seed=5, nodes=200)
MEASUREMENTS = replace(DRIVEN, start_pose=TRUE_POSE[0])
LABELS = MEASUREMENTS.sightings["line"].truth
LOG = log_with(MEASUREMENTS.t, TRUE_POSE, GRID)


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return compare(LOG, MEASUREMENTS, [dead_reckoning(MEASUREMENTS), run_ekf(MEASUREMENTS)])


def floats(content: Any) -> Iterator[float]:
    if isinstance(content, dict):
        content = list(content.values())
    if isinstance(content, list):
        for entry in content:
            yield from floats(entry)
    elif isinstance(content, float):
        yield content


# ---- content -----------------------------------------------------------------------------------


def test_the_public_names_are_those_of_the_package() -> None:
    assert package.compare is compare
    assert package.Comparison is Comparison
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        package.nonsense  # noqa: B018


def test_every_method_has_the_figures_of_the_contract(comparison: Comparison) -> None:
    content = comparison.to_dict()["methods"]["ekf"]
    for name in ("rmse_m", "final_error_m", "heading_rmse_deg"):
        assert content["trajectory"][name] > 0.0
        assert content["trajectory"]["aligned_" + name] > 0.0
    for name in ("rho_rmse_m", "rho_origin_rmse_m", "alpha_rmse_deg"):
        assert content["map"][name] > 0.0
    assert [content["map"][name] for name in ("true_lines_seen", "matched", "missed")] == [8, 8, 0]
    assert [content["map"][name] for name in ("spurious", "duplicates", "unseen")] == [0, 0, 0]
    assert 0.0 < content["pose_nees"] < 10.0
    assert 0.0 < content["map_nees"] < 10.0
    assert content["matching"]["right_share"] == 1.0


def test_an_exactly_known_start_gives_a_nees_that_matches_a_filters_covariance() -> None:
    """The mean over runs of a filter whose noise is its model's own."""
    values = []
    for seed in range(8):
        measurements, true_pose = drive(seed=seed, nodes=60)
        log = log_with(measurements.t, true_pose, GRID)
        values.append(compare(log, measurements, [run_ekf(measurements)])["ekf"])
    assert 0.6 < np.mean([entry.pose_nees for entry in values]) < 1.6
    assert 0.7 < np.mean([entry.map.nees for entry in values if entry.map]) < 1.4


def test_odometry_has_a_path_and_no_map(comparison: Comparison) -> None:
    content = comparison.to_dict()["methods"]["odometry"]
    assert content["trajectory"]["rmse_m"] > 0.0
    assert content["map"] is None
    assert content["map_nees"] is None
    assert content["matching"] is None


def test_content_is_plain_json_with_none_for_what_is_not_defined(comparison: Comparison) -> None:
    content = comparison.to_dict()
    assert json.loads(json.dumps(content, allow_nan=False)) == content
    assert content["methods"]["ekf"]["cost"] is None


def test_numbers_have_twelve_significant_digits(comparison: Comparison) -> None:
    values = list(floats(comparison.to_dict()))
    assert len(values) > 100
    assert all(value == float(f"{value:.12g}") for value in values)


def test_rounding_noise_does_not_change_what_is_written() -> None:
    assert plain({"a": np.array([0.1 + 0.2, -0.0, np.nan, np.inf])}) == {
        "a": [0.3, 0.0, None, None]
    }
    assert str(plain(-0.0)) == "0.0"
    assert plain((np.int64(3), True, None, "x")) == [3, True, None, "x"]


def test_equal_runs_give_equal_bytes(comparison: Comparison) -> None:
    again = compare(LOG, MEASUREMENTS, [dead_reckoning(MEASUREMENTS), run_ekf(MEASUREMENTS)])
    assert json.dumps(again.to_dict()) == json.dumps(comparison.to_dict())


def test_a_comparison_cannot_be_changed(comparison: Comparison) -> None:
    with pytest.raises(FrozenInstanceError):
        comparison.log = "other"  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        comparison.truth.lines[0, 0] = 1.0
    figures = comparison["ekf"].map
    assert figures is not None
    with pytest.raises(ValueError, match="read-only"):
        figures.lines.offset[0] = 1.0


def test_without_a_log_only_agreement_and_the_methods_own_figures_are_left() -> None:
    bare = relabelled(MEASUREMENTS, np.full(len(LABELS), -1))
    comparison = compare(None, bare, [dead_reckoning(bare), run_ekf(bare)])
    content = comparison.to_dict()
    assert content["truth"] == {
        "path": False,
        "lines": 0,
        "points": 0,
        "lines_seen": None,
        "sightings_labelled": False,
    }
    for entry in content["methods"].values():
        assert entry["trajectory"] is None
        assert entry["map"] is None
        assert entry["pose_nees"] is None
        assert entry["position_sigma_m"] > 0.0
    assert len(content["agreement"]) == 1


@pytest.mark.parametrize(
    ("change", "defined"),
    [
        ({}, True),
        ({"start_given": False}, False),
        ({"start_sigma": np.array([0.0, 0.0, 0.01])}, False),
        ({"start_sigma": np.full(3, 1e-6)}, True),
        ({"start_pose": TRUE_POSE[0] + 0.01}, False),
    ],
)
def test_pose_nees_is_given_only_for_an_exactly_known_start(
    change: dict[str, Any], defined: bool
) -> None:
    comparison = compare(replace(LOG, **change), MEASUREMENTS, [dead_reckoning(MEASUREMENTS)])
    assert np.isfinite(comparison["odometry"].pose_nees) == defined


def test_the_true_line_of_every_sighting_is_at_hand(comparison: Comparison) -> None:
    np.testing.assert_array_equal(comparison.truth.landmark, LABELS)


def test_a_method_that_was_not_compared_is_a_key_error(comparison: Comparison) -> None:
    with pytest.raises(KeyError, match="smoother"):
        comparison["smoother"]


def test_estimates_of_other_measurements_are_refused() -> None:
    other = dead_reckoning(drive(seed=6, nodes=50)[0])
    with pytest.raises(BadMeasurements, match="compare estimates with their own measurements"):
        compare(LOG, MEASUREMENTS, [other])


def test_two_estimates_of_one_name_are_refused() -> None:
    estimate = dead_reckoning(MEASUREMENTS)
    with pytest.raises(BadMeasurements, match="two estimates have one name"):
        compare(LOG, MEASUREMENTS, [estimate, estimate])


# ---- agreement ---------------------------------------------------------------------------------


def test_an_estimate_agrees_with_itself() -> None:
    estimate = run_ekf(MEASUREMENTS)
    same = agreement(estimate, estimate, MEASUREMENTS)
    assert same.position_rms_m == 0.0
    assert same.map is not None
    assert len(same.map.row_a) == 8
    assert same.map.offset_rms_m < 1e-12
    assert same.map.sigmas_rms < 1e-9


def test_paths_are_compared_where_they_stand() -> None:
    a = estimate_of(MEASUREMENTS, TRUE_POSE, GRID, LABELS)
    shifted = TRUE_POSE + np.array([0.03, 0.04, 0.0])
    b = replace(a, pose=np.column_stack([shifted[:, :2], wrap(shifted[:, 2] + 0.1)]))
    found = agreement(a, b, MEASUREMENTS)
    assert found.position_rms_m == pytest.approx(0.05)
    assert found.position_max_m == pytest.approx(0.05)
    assert found.last_position_m == pytest.approx(0.05)
    assert found.heading_rms_deg == pytest.approx(np.degrees(0.1))


def test_lines_are_paired_by_the_sightings_they_share() -> None:
    """Not by place: the second map lies more than a line's distance beside the first."""
    a = estimate_of(MEASUREMENTS, TRUE_POSE, GRID, LABELS)
    b = moved(a, np.array([0.7, 0.7, 0.0]))
    found = agreement(a, b, MEASUREMENTS).map
    assert found is not None
    np.testing.assert_array_equal(found.row_a, found.row_b)
    np.testing.assert_allclose(found.offset, 0.7, atol=1e-9)
    np.testing.assert_allclose(found.d_alpha, 0.0, atol=1e-12)


def test_lines_without_common_sightings_are_paired_by_place() -> None:
    nothing = np.full(len(LABELS), -1)
    a = estimate_of(MEASUREMENTS, TRUE_POSE, GRID, nothing)
    order = np.array([3, 1, 0, 2, 7, 4, 5])
    b = estimate_of(MEASUREMENTS, TRUE_POSE, GRID[order] + [0.01, 0.0], nothing)
    found = agreement(a, b, MEASUREMENTS).map
    assert found is not None
    np.testing.assert_array_equal(order[found.row_b], found.row_a)
    assert (found.only_a, found.only_b) == (1, 0)
    np.testing.assert_allclose(found.offset, 0.01, atol=1e-12)


def test_differences_are_counted_in_the_smaller_of_both_sigmas() -> None:
    a = estimate_of(MEASUREMENTS, TRUE_POSE, GRID, LABELS)
    joint = np.array(a.cov_joint)
    b = replace(moved(a, np.array([0.01, 0.01, 0.0])), cov_joint=joint / 4.0)
    found = agreement(a, b, MEASUREMENTS).map
    assert found is not None
    stretch = a.map.extent.mean(axis=1)
    sigma = 0.5 * 1e-2 * np.hypot(1.0, stretch)
    np.testing.assert_allclose(found.offset_sigmas, 0.01 / sigma, rtol=0.02)


def test_offsets_are_taken_where_both_maps_saw_the_line() -> None:
    turn = np.array([0.0, 0.0, 0.01])
    a = estimate_of(MEASUREMENTS, TRUE_POSE, GRID, LABELS)
    b = moved(a, turn)
    there = np.tile([9.0, 11.0], (len(GRID), 1))
    a = replace(a, map=replace(a.map, extent=np.tile([0.0, 11.0], (len(GRID), 1))))
    b = replace(b, map=replace(b.map, extent=there))
    found = agreement(a, b, MEASUREMENTS).map
    assert found is not None
    moved_lines = line_to_floor(GRID, turn)
    np.testing.assert_allclose(moved_lines[:, 0], GRID[:, 0])
    np.testing.assert_allclose(np.abs(found.offset), 10.0 * 0.01, rtol=0.06)


def test_a_map_without_lines_has_no_map_agreement(comparison: Comparison) -> None:
    entry = comparison.agreement[0]
    assert (entry.first, entry.second) == ("odometry", "ekf")
    assert entry.position_rms_m > 0.0
    assert entry.map is None


def test_paths_with_other_nodes_are_compared_where_times_overlap() -> None:
    a = estimate_of(MEASUREMENTS, TRUE_POSE, GRID, LABELS)
    half = replace(
        a, t=a.t[50:150:2], pose=a.pose[50:150:2], cov_floor=a.cov_floor[50:150:2], method="half"
    )
    found = agreement(a, half, MEASUREMENTS)
    assert found.nodes == 99
    assert found.position_rms_m < 5e-3
