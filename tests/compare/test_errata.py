"""What the misprints cost: the study's floor, its figures, its table."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare.errata import Cost, ErrataStudy, ErratumCost, study_errata
from compare.errata_world import draw_run, errata_scenario
from compare.metrics import mean_nees
from graphslam.baseline import dead_reckoning
from graphslam.geometry import wrap
from graphslam.models.wheels import wheel_increment
from graphslam.printed import ERRATA

NAMES = ("loc-29-heading", "slam-27-landmark", "slam-3.3-names")


@pytest.fixture(scope="module")
def result() -> ErrataStudy:
    return study_errata(2, names=NAMES, jobs=1)


def test_the_printed_h_of_slam_doubles_the_path_error_and_leaves_no_honesty(
    result: ErrataStudy,
) -> None:
    cost = result["slam-27-landmark"]
    assert cost.path_factor > 2.0
    assert cost.printed.pose_nees > 100.0
    assert cost.right.pose_nees < 1.5


def test_the_printed_rule_maps_every_line_twice(result: ErrataStudy) -> None:
    cost = result["slam-3.3-names"]
    assert cost.right.duplicates == 0.0
    assert cost.printed.duplicates >= 7.0


def test_the_printed_h_of_localisation_is_overconfident(result: ErrataStudy) -> None:
    cost = result["loc-29-heading"]
    assert cost.printed.pose_nees > 5.0
    assert cost.path_factor > 1.2


def test_the_table_has_a_cell_for_every_heading_and_an_erratum_a_row(result: ErrataStudy) -> None:
    rows = result.rows()
    assert [row[0] for row in rows] == list(NAMES)
    assert all(len(row) == len(result.headings) for row in rows)
    assert rows[1][1] == "SantanaSLAM (27)"
    assert rows[0][-1] == "0 of 2"


def test_a_filter_that_never_ended_shows_dashes_and_a_senseless_figure_is_told_as_such() -> None:
    right = Cost(3, 0.01, 1.0, 0.0)
    none = Cost(0, math.nan, math.nan, math.nan)
    rows = ErrataStudy(
        3,
        (
            ErratumCost(ERRATA["loc-19-jacobian"], right, none),
            ErratumCost(ERRATA["loc-16-prediction"], right, Cost(3, 1e6, 1e30, 0.0)),
        ),
    ).rows()
    assert rows[0][3:5] == ("–", "–")
    assert rows[0][-1] == "3 of 3"
    assert rows[1][3] == "> 100,000"


def test_finished_runs_are_kept_and_give_the_same_figures(
    result: ErrataStudy, tmp_path: Path
) -> None:
    first = study_errata(1, tmp_path / "runs", names=NAMES, jobs=1)
    both = study_errata(2, tmp_path / "runs", names=NAMES, jobs=1)
    assert both == result
    assert first != result


def test_an_unknown_erratum_is_an_error() -> None:
    with pytest.raises(KeyError):
        study_errata(1, names=["loc-1"])


# ---- the floor and the drive -------------------------------------------------------------------


def test_the_wheels_read_what_was_commanded_and_turn_by_that_plus_noise() -> None:
    """SantanaSLAM (11), SantanaLoc (11): truth is reading plus noise, not the other way round."""
    scenario = errata_scenario()
    measurements, truth = draw_run(scenario, 0, known=False)
    steps = np.diff(measurements.odometry.wheel_angle, axis=0)
    alike = np.abs(steps[:, 1] - steps[:, 0])
    assert np.mean(alike == 0.0) > 0.3
    assert ((alike > 0.0) & (alike < 1e-7)).any()
    moved = wheel_increment(steps, scenario.robot)[0]
    path = np.hypot(*np.diff(truth[:, :2], axis=0).T)
    straight = alike < 1e-7
    relative = path[straight] / np.hypot(*moved[straight, :2].T) - 1.0
    # the mean of two wheels of 3 % each
    assert np.std(relative) == pytest.approx(0.03 / np.sqrt(2), rel=0.1)


def test_every_line_is_seen_from_both_sides() -> None:
    measurements, truth = draw_run(errata_scenario(), 1, known=True)
    table = measurements.sightings["line"]
    alpha = measurements.known.params[table.truth, 1]
    ahead = np.cos(alpha - truth[table.node, 2]) > 0
    for line in range(len(measurements.known)):
        assert set(ahead[table.truth == line]) == {True, False}


def test_odometry_is_honest_on_it() -> None:
    nees = []
    for seed in range(20):
        measurements, truth = draw_run(replace(errata_scenario()), seed, known=True)
        error = dead_reckoning(measurements).pose[[150]] - truth[[150]]
        error[:, 2] = wrap(error[:, 2])
        nees.append(mean_nees(error, dead_reckoning(measurements).cov_floor[[150]]))
    assert 0.5 < np.mean(nees) < 1.6
