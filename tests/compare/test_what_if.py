"""What would help: bounds after changes, and the page that tells of them."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare.cli import main
from compare.situation import (
    situation_of,
    with_better_wheels,
    with_crossing_lines,
    with_sharper_sightings,
)
from compare.truth import truth_of
from compare.what_if import LENGTHS, QUANTITIES, what_if
from frontend.config import NoiseConfig
from frontend.extract import extract
from frontend.simulate import load_scenario, simulate_log
from graphslam.ekf import run_ekf
from graphslam.errors import BadConfig
from graphslam.smoother import smooth
from graphslam.smoother.bound import cramer_rao

LOG = simulate_log(load_scenario("one-direction"), 1)
MEASUREMENTS = extract(LOG)
SMOOTHED = smooth(MEASUREMENTS, run_ekf(MEASUREMENTS))
NOW = situation_of(MEASUREMENTS, truth_of(LOG, MEASUREMENTS), SMOOTHED)


def test_half_of_all_noise_is_half_the_bound() -> None:
    certain = replace(NOW.measurements, start_cov=1e-14 * np.eye(3))
    now = replace(NOW, measurements=certain)
    half = with_better_wheels(with_sharper_sightings(now, 0.5), 0.5)
    bounds = [cramer_rao(s.measurements, s.match, s.pose, s.landmarks.params) for s in (now, half)]
    np.testing.assert_allclose(
        bounds[1].cov_floor[1:], 0.25 * bounds[0].cov_floor[1:], rtol=1e-3, atol=1e-10
    )


def test_lines_across_are_foretold_to_fix_the_open_direction() -> None:
    found = what_if(LOG, MEASUREMENTS, SMOOTHED, NoiseConfig())
    (open_now,) = found.now.unobserved
    assert abs(open_now.direction[1]) > np.cos(np.radians(1.0))
    crossing, frames, sightings, wheels = found.predictions
    assert crossing.change == "lines every 1 m with normals along 90°"
    assert crossing.unobserved == ()
    assert found.gain(crossing, "last pose") > 0.5
    assert frames.sightings == pytest.approx(2 * found.now.sightings, abs=2)
    assert sightings.unobserved
    for prediction in found.predictions:
        assert all(0.0 < found.gain(prediction, q) < 1.0 for q in QUANTITIES)
    assert 0.0 < found.gain(wheels, "path") < 0.5 + 1e-9
    text = " ".join(found.sentences())
    assert "the position along 90° (floor frame) is not observed" in text
    assert "Do this first: lay lines (tape will do) that run along 0° of the floor frame" in text
    assert "Last pose: lines every 1 m with normals along 90° would help most" in text
    assert frames.how == "take 8 frames a second instead of 4"
    across = np.column_stack([np.cos(found.added[:, 1]), np.sin(found.added[:, 1])])
    assert len(across) >= 3
    np.testing.assert_allclose(np.abs(across @ open_now.direction), 1.0, atol=1e-3)


def test_where_nothing_matters_nothing_is_asked_for() -> None:
    sharp = with_better_wheels(with_sharper_sightings(NOW, 1e-3), 1e-3)
    found = what_if(LOG, sharp.measurements, SMOOTHED, NoiseConfig())
    assert not any(found.matters(p, q) for p in found.predictions for q in LENGTHS)
    text = " ".join(found.sentences())
    assert "Nothing needs to change" in text
    assert "Do this first" not in text


def test_a_log_without_truth_is_judged_at_its_estimate() -> None:
    blind = replace(LOG, truth=None, map=None)
    found = what_if(blind, MEASUREMENTS, SMOOTHED, NoiseConfig())
    told = what_if(LOG, MEASUREMENTS, SMOOTHED, NoiseConfig())
    assert (found.now.bound.at, told.now.bound.at) == ("estimate", "truth")
    for a, b in zip(found.predictions, told.predictions, strict=True):
        assert found.gain(a, "path") == pytest.approx(told.gain(b, "path"), abs=0.05)


def test_added_lines_need_a_view_to_be_seen_in() -> None:
    table = MEASUREMENTS.sightings["line"]
    narrow = replace(table, extent=np.full((len(table), 2), np.nan))
    unseen = replace(NOW, measurements=replace(MEASUREMENTS, sightings={"line": narrow}))
    with pytest.raises(BadConfig, match="too few to tell what is in view"):
        with_crossing_lines(unseen)


def test_the_command_writes_a_page_and_refuses_what_is_not_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "what-if"
    assert main(["study", "one-direction", "--what-if", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "would help most" in printed
    page = (out / "report.html").read_text()
    assert "What to change first" in page
    assert "half the noise of the wheels" in page
    assert "How to get there" in page
    assert "reached now by smoother" in page
    assert (out / "plots" / "plan.svg").is_file()
    with (out / "what-if.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert rows[0]["change"] == "as it is"
    assert len(rows) == 5
    assert json.loads((out / "what-if.json").read_text())["name"] == "one-direction"
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "note.txt").write_text("keep")
    assert main(["study", "one-direction", "--what-if", "--out", str(tmp_path / "mine")]) == 1
    assert "is not replaced" in capsys.readouterr().err
    assert main(["study", "nowhere", "--what-if", "--out", str(out)]) == 1
    assert "nowhere" in capsys.readouterr().err
