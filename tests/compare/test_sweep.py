"""Sweeps: which setting is meant, which values, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

from compare.config import RunConfig
from compare.sweep import setting_name, sweep_points
from graphslam.config import EkfConfig
from graphslam.errors import BadConfig

BASE = replace(RunConfig(), ekf=EkfConfig(confirm_after=7))


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("ekf.matching.gate", "ekf.matching.gate"),
        ("ekf.gate", "ekf.matching.gate"),
        ("confirm_after", "ekf.confirm_after"),
        ("detector.polarity", "extract.detector.polarity"),
        ("methods", "methods"),
    ],
)
def test_part_of_a_name_means_the_only_setting_that_it_fits(text: str, name: str) -> None:
    assert setting_name(text) == name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ekf.gaet", "is not a known setting; did you mean ekf.matching.gate"),
        ("confirm_afer", "did you mean ekf.confirm_after"),
        ("zzz", "is not a known setting; `graphslam config` prints them all"),
        ("ekf.matching", "is a table of settings; name one, such as ekf.matching.method"),
        ("smoother.confirm_after", "is not a known setting"),
        ("gate", "may mean ekf.matching.gate or .*; write one of them out"),
        ("matching.ekf.gate", "is not a known setting"),
    ],
)
def test_name_that_fits_no_setting_or_several_tells_what_is_near(text: str, message: str) -> None:
    with pytest.raises(BadConfig, match=f"--sweep {text}.*{message}"):
        setting_name(text)


def test_values_are_set_in_turn_and_all_else_is_kept() -> None:
    points = sweep_points(["ekf.gate=5,9.5,14"], BASE)
    assert [point.config.ekf.matching.gate for point in points] == [5.0, 9.5, 14.0]
    assert {point.config.ekf.confirm_after for point in points} == {7}
    assert [point.values for point in points] == [
        (("ekf.matching.gate", text),) for text in ("5", "9.5", "14")
    ]
    assert points[1].label == "ekf.matching.gate = 9.5"
    assert points[1].folder == "ekf.matching.gate=9.5"


def test_several_settings_give_every_combination_the_last_changing_fastest() -> None:
    points = sweep_points(["ekf.gate=5,9", "confirm_after=1,3"], BASE)
    found = [(point.config.ekf.matching.gate, point.config.ekf.confirm_after) for point in points]
    assert found == [(5.0, 1), (5.0, 3), (9.0, 1), (9.0, 3)]
    assert len({point.folder for point in points}) == 4


def test_no_sweep_is_one_point_without_a_folder_of_its_own() -> None:
    (point,) = sweep_points([], BASE)
    assert (point.config, point.values, point.folder, point.label) == (BASE, (), "", "")


def test_texts_need_no_quotes_and_lists_keep_their_commas() -> None:
    points = sweep_points(["matching.method=gated,nearest"], BASE)
    assert [point.config.ekf.matching.method for point in points] == ["gated", "nearest"]
    points = sweep_points(["line_width_m=[0.001, 0.02],[0.002, 0.03]"], BASE)
    widths = [point.config.extract.detector.line_width_m for point in points]
    assert widths == [(0.001, 0.02), (0.002, 0.03)]
    assert all("/" not in point.folder and " " not in point.folder for point in points)


def test_one_value_written_twice_is_one_point() -> None:
    assert len(sweep_points(["ekf.gate=5,5.0"], BASE)) == 1


@pytest.mark.parametrize(
    ("sweeps", "message"),
    [
        (["ekf.gate"], "write it like ekf.matching.gate=5,9,14"),
        (["ekf.gate="], "write it like ekf.matching.gate=5,9,14"),
        (["ekf.gate=5,nine"], "ekf.matching.gate = 'nine' must be a number"),
        (["ekf.gate=5,-1"], "must be positive"),
        (["confirm_after=2.5"], "must be a whole number"),
        (["ekf.gate=5", "matching.gate=9"], "is given twice"),
        (["known_map=a/b,a-b"], "would share the folder known_map=a-b"),
    ],
)
def test_values_that_cannot_be_used_are_refused(sweeps: list[str], message: str) -> None:
    with pytest.raises(BadConfig, match=message):
        sweep_points(sweeps, BASE)
