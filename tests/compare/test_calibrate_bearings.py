"""Calibration of directions: what was put wrong is found, on images and on bearings.csv."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compare.cli import main
from frontend.calibrate_bearings import calibrate_bearings, fit_correction, known_directions
from frontend.config import ExtractConfig
from frontend.extract import extract
from frontend.log import Log, open_log
from frontend.omni import BearingCorrection
from frontend.simulate import load_scenario, simulate, simulate_log
from frontend.simulate.scenario import Motion
from graphslam.errors import BadConfig, BadLog
from graphslam.geometry import wrap

WRONG = BearingCorrection(3.0, ((1.5, -0.5), (0.0, 0.8)))
LAP = (Motion(arc_deg=360.0, radius=0.2),)


@pytest.fixture(scope="module")
def spoilt() -> Log:
    """A log whose directions lack the correction `WRONG`."""
    log = simulate_log(replace(load_scenario("cones-outdoors"), repeat=1), seed=4)
    assert log.bearings is not None
    right, raw = log.bearings.z, log.bearings.z
    for _ in range(30):  # the raw direction whose corrected one is right
        raw = raw - wrap(WRONG.of(raw) - right)
    return replace(log, bearings=replace(log.bearings, z=raw))


def test_offset_and_waves_of_bearings_are_found_within_their_sigmas(spoilt: Log) -> None:
    found = calibrate_bearings(spoilt)
    off = np.array(found.correction.numbers()) - WRONG.numbers()
    assert np.abs(off / found.sigma_deg).max() < 4.0
    assert np.abs(off).max() < 0.1
    assert found.before_deg > 2.0
    assert found.after_deg == pytest.approx(0.3, rel=0.1)
    assert found.bias_before_deg == pytest.approx(-3.0, abs=0.3)
    assert found.stated_deg == pytest.approx(0.3)
    mended = replace(spoilt, bearing_correction=found.correction)
    assert calibrate_bearings(mended).before_deg == pytest.approx(found.after_deg, rel=0.05)
    # wrong names of landmarks do not pull it
    assert spoilt.bearings is not None
    unnamed = replace(
        spoilt, bearings=replace(spoilt.bearings, truth=-1 + 0 * spoilt.bearings.truth)
    )
    again = calibrate_bearings(unnamed)
    np.testing.assert_allclose(again.correction.numbers(), found.correction.numbers(), atol=0.1)


def test_centre_turn_and_oval_of_a_mirror_are_found_from_images(tmp_path: Path) -> None:
    whole = load_scenario("three-cones")
    omni = replace(
        whole.omni, rate=1.2, image_size=(400, 300), centre_off_px=(2.5, -1.5), turned_deg=2.0,
        oval=0.03,
    )  # fmt: skip
    start = replace(whole.start, x=0.45, y=0.15)
    spoilt = replace(whole, omni=omni, path=LAP, repeat=1, start=start)
    folder = simulate(spoilt, tmp_path / "log", seed=2)
    out = tmp_path / "omni.toml"
    assert main(["calibrate", str(folder), "--bearings", "--out", str(out)]) == 0
    table = tomllib.loads(out.read_text())["cameras"]["omni"]
    np.testing.assert_allclose(table["centre"], [199.5 + 2.5, 149.5 - 1.5], atol=0.35)
    assert table["offset_deg"] == pytest.approx(2.0, abs=0.15)
    # an oval by e moves directions by e/2 sin 2b
    assert np.hypot(*table["harmonics_deg"][1]) == pytest.approx(np.degrees(0.03) / 2, abs=0.25)
    text = (folder / "log.toml").read_text()
    before = errors(open_log(folder))
    head, rest = text.split("[cameras.", 1)
    tail = rest[rest.index("[start]") :]
    (folder / "log.toml").write_text(head + out.read_text().split("\n", 2)[2] + "\n" + tail)
    after = errors(open_log(folder))
    assert after < 0.25 < 1.0 < before


def errors(log: Log) -> float:
    """Returns the RMS error of a log's directions as they are used, degrees."""
    known, camera = known_directions(log, ExtractConfig())
    assert camera is not None
    off = wrap(camera.correction.of(known.measured) - known.true)
    return float(np.degrees(np.sqrt(np.mean(off**2))))


def test_the_command_writes_what_log_toml_takes(tmp_path: Path, capsys) -> None:
    scenario = replace(load_scenario("cones-outdoors"), repeat=1)
    folder = simulate(scenario, tmp_path / "log", images=False)
    settings = folder / "log.toml"
    settings.write_text(settings.read_text() + "\n[bearings]\noffset_deg = 5.0\n")
    assert extract(open_log(folder)).sightings["bearing"].truth.min() >= 0
    out = tmp_path / "b.toml"
    command = ["calibrate", str(folder), "--bearings", "--harmonics", "1", "--out", str(out)]
    assert main(command) == 0
    shown = capsys.readouterr().out
    assert "Offset: +0.0" in shown or "Offset: -0.0" in shown
    assert "it fits" in shown
    table = tomllib.loads(out.read_text())["bearings"]
    assert abs(table["offset_deg"]) < 0.05
    assert len(table["harmonics_deg"]) == 1


def test_what_is_missing_for_it_is_named(spoilt: Log, tmp_path: Path) -> None:
    for change, message in (
        ({"truth": None}, "groundtruth.tum is missing"),
        ({"landmarks": None}, "landmarks.csv is missing"),
        ({"bearings": None, "cameras": {}}, "no bearings to calibrate"),
    ):
        with pytest.raises(BadLog, match=message):
            calibrate_bearings(replace(spoilt, **change))
    with pytest.raises(BadConfig, match="harmonics = 7"):
        calibrate_bearings(spoilt, harmonics=7)
    known, _ = known_directions(spoilt, ExtractConfig())
    with pytest.raises(BadConfig, match="too few to find 5 numbers"):
        fit_correction(known.select(np.arange(10)), 2)
    assert main(["calibrate", "--bearings"]) == 2
