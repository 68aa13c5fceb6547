"""The noise that a log suggests: what was drawn is found again, and makes the filter consistent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from compare.cli import main
from compare.comparison import Comparison, compare
from compare.config import RunConfig, load_config
from compare.noise import GROUPS, NoiseSuggestion, noise_sentence, suggest_noise
from compare.truth import truth_of
from compare.verdict import verdict
from frontend.config import ExtractConfig, NoiseConfig
from frontend.extract import extract
from frontend.log import Log, open_log
from frontend.log_parts import PoseTrack
from frontend.simulate import load_scenario, simulate_log
from graphslam.config import EkfConfig, MatchingConfig
from graphslam.ekf import innovation_log_likelihood, run_ekf
from graphslam.errors import BadConfig
from graphslam.kalman import JointState
from graphslam.measurements import Measurements
from tests.compare.tiny_log import write_tiny_log
from tests.worlds import drive

SOURCES = ("ground truth", "innovations")
SAMPLE = Path(__file__).parents[2] / "data" / "sample"


def suggested(log: Log, source: str, config: RunConfig | None = None) -> NoiseSuggestion:
    """Returns what a log suggests, and checks where it says that it took it from."""
    config = config or RunConfig()
    measurements = extract(log, config.extract)
    truth = truth_of(log, measurements) if source == "ground truth" else None
    found = suggest_noise(log, measurements, run_ekf(measurements, config.ekf), truth, config)
    assert found.source == source
    return found


def with_noise(**noise: object) -> RunConfig:
    return RunConfig(extract=ExtractConfig(noise=NoiseConfig(**noise)))


@pytest.mark.parametrize(
    ("name", "source"),
    [("square", "ground truth"), ("free", "innovations"), ("square", "innovations")],
)
def test_on_real_wheels_a_run_with_the_suggested_noise_is_consistent_and_maps_every_line_once(
    shared_data: Path, name: str, source: str
) -> None:
    log = open_log(shared_data / "logs" / name)
    found = suggested(log, source)
    measurements = extract(log, found.settings.extract)
    judged = compare(log, measurements, [run_ekf(measurements, found.settings.ekf)])["ekf"]
    assert found.nis_before < 0.5
    assert 0.8 <= judged.nis_per_dof <= 1.25
    assert judged.nis_per_dof == pytest.approx(found.nis_after, abs=0.02)
    assert judged.map is not None
    assert (judged.map.true_lines_seen, judged.map.matched) == (12, 12)
    assert judged.map.missed == judged.map.spurious == judged.map.duplicates == 0


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("scenario", ["santana-slam", "sample"])
def test_noise_that_was_drawn_is_found_again(scenario: str, source: str) -> None:
    """Both wheel laws; assumed are twice the wheel noise and three times the sightings'."""
    log = simulate_log(load_scenario(scenario), seed=2)
    drive = log.robot
    assert drive is not None
    wrong = with_noise(
        noise_left=2.0 * drive.noise_left,
        noise_right=2.0 * drive.noise_right,
        rho_factor=3.0,
        alpha_factor=3.0,
    )
    found = suggested(log, source, wrong)
    noise = found.settings.extract.noise
    assert (noise.rho_factor, noise.alpha_factor) == pytest.approx((1.0, 1.0), rel=0.1)
    wheels = {"ground truth": 0.1, "innovations": 0.2}[source]
    assert noise.noise_left == noise.noise_right == pytest.approx(drive.noise_left, rel=wheels)
    if source == "ground truth":
        assert noise.slip == pytest.approx(drive.slip, rel=0.2)
    assert found.fits
    assert found.landmarks_after == found.landmarks_before


def test_noise_assumed_too_small_is_raised_and_double_lines_vanish() -> None:
    log = simulate_log(load_scenario("sample"), seed=1)
    wrong = with_noise(noise_left=0.005, noise_right=0.005, rho_factor=0.2, alpha_factor=0.2)
    found = suggested(log, "innovations", wrong)
    noise = found.settings.extract.noise
    assert found.nis_before > 1.25
    assert found.fits
    assert (noise.rho_factor, noise.alpha_factor) == pytest.approx((1.0, 1.0), rel=0.15)
    assert noise.noise_left == pytest.approx(0.02, rel=0.2)
    assert found.landmarks_after == 22 < found.landmarks_before


def test_wheel_noise_of_the_rendered_sample_is_found_from_images() -> None:
    found = suggested(open_log(SAMPLE), "ground truth", with_noise(noise_left=0.06))
    noise = found.settings.extract.noise
    # the sample was drawn with k = 0.02 on both wheels; one factor scales what is assumed
    assert noise.noise_left == pytest.approx(3.0 * noise.noise_right, rel=0.01)
    right = suggested(open_log(SAMPLE), "ground truth").settings.extract.noise
    assert right.noise_left == right.noise_right == pytest.approx(0.02, rel=0.1)
    assert right.slip == pytest.approx((0.002, 0.002, 0.005), rel=0.1)


def test_truth_that_is_coarser_than_the_sightings_is_not_trusted() -> None:
    log = simulate_log(load_scenario("sample"), seed=1)
    assert log.truth is not None
    rng = np.random.default_rng(0)
    coarse = log.truth.pose + rng.normal(0.0, [0.01, 0.01, 0.01], log.truth.pose.shape)
    log = replace(log, truth=PoseTrack(log.truth.t, coarse))
    measurements = extract(log)
    truth = truth_of(log, measurements)
    found = suggest_noise(log, measurements, run_ekf(measurements), truth)
    assert found.source == "innovations"
    assert "ground truth" in found.notes[0]
    assert found.factors[:3] == pytest.approx((1.0, 1.0, 1.0), rel=0.1)


def test_what_a_log_does_not_determine_stays_near_what_was_assumed_and_is_named() -> None:
    log = simulate_log(load_scenario("santana-slam"), seed=1)
    blind = replace(extract(log), sightings={})
    found = suggest_noise(log, blind, run_ekf(blind))
    assert found.undetermined == GROUPS
    assert found.factors == pytest.approx([1.0] * 4)
    assert found.settings.ekf == EkfConfig()


def test_the_gates_stay_where_they_would_cut_off_no_match() -> None:
    found = suggested(simulate_log(load_scenario("sample"), seed=1), "ground truth")
    assert found.settings.ekf.matching == MatchingConfig(gate_new=80.0)


def test_the_likelihood_is_largest_at_the_noise_that_was_drawn() -> None:
    measurements, _ = drive(seed=3, nodes=400)
    at = run_ekf(measurements)

    def likelihood(sightings: float, odometry: float) -> float:
        table = measurements.sightings["line"]
        scaled: Measurements = replace(
            measurements,
            odometry=replace(measurements.odometry, cov=odometry**2 * measurements.odometry.cov),
            sightings={"line": replace(table, cov=sightings**2 * table.cov)},
        )
        return innovation_log_likelihood(scaled, at)

    best = likelihood(1.0, 1.0)
    assert best > max(likelihood(0.8, 1.0), likelihood(1.25, 1.0)) + 5.0
    assert best > max(likelihood(1.0, 0.7), likelihood(1.0, 1.4)) + 5.0


def test_the_log_likelihood_of_an_update_is_that_of_its_joint_normal_distribution() -> None:
    rng = np.random.default_rng(0)
    root, noise = rng.normal(size=(3, 3)), rng.normal(size=(2, 2, 2))
    cov = noise @ np.swapaxes(noise, 1, 2)
    J = rng.normal(size=(2, 2, 3))
    state = JointState(np.zeros(3), root @ root.T)
    innovation = rng.normal(size=(2, 2))
    state.correct(innovation, J, np.zeros((2, 2, 0)), np.zeros((2, 0), np.int64), cov)
    H = J.reshape(4, 3)
    S = H @ root @ root.T @ H.T + block_diag(*cov)
    expected = multivariate_normal(np.zeros(4), S).logpdf(innovation.ravel())
    assert state.log_likelihood == pytest.approx(expected, rel=1e-12)


# ---- settings ----------------------------------------------------------------------------------


def test_noise_settings_stand_in_place_of_the_logs_and_the_detectors() -> None:
    log = simulate_log(load_scenario("sample"), seed=1)
    plain = extract(log)
    noise = NoiseConfig(0.04, 0.04, (0.004, 0.004, 0.01), rho_factor=2.0, alpha_factor=3.0)
    other = extract(log, ExtractConfig(noise=noise))
    by = np.outer([2.0, 3.0], [2.0, 3.0])
    cov = plain.sightings["line"].cov
    np.testing.assert_allclose(other.sightings["line"].cov, cov * by, rtol=1e-12)
    floor = np.diag([1e-8, 1e-8, 1e-8])
    grown = 4.0 * (plain.odometry.cov - floor) + floor
    np.testing.assert_allclose(other.odometry.cov, grown, rtol=1e-9, atol=1e-18)
    np.testing.assert_array_equal(other.odometry.increment, plain.odometry.increment)


@pytest.mark.parametrize(
    "noise", [{"rho_factor": 0.0}, {"alpha_factor": np.nan}, {"noise_left": -1.0}]
)
def test_noise_settings_that_cannot_be_are_refused(noise: dict) -> None:
    with pytest.raises(BadConfig, match=r"must be"):
        NoiseConfig(**noise)


# ---- what the run says -------------------------------------------------------------------------


def with_nis(nis: float) -> Comparison:
    measurements, _ = drive(seed=3, nodes=60)
    comparison = compare(None, measurements, [run_ekf(measurements)])
    return replace(comparison, methods=(replace(comparison.methods[0], nis_per_dof=nis),))


@pytest.mark.parametrize(
    ("nis", "words"), [(0.1, ("cleaner", "0.1,", "0.32 times")), (4.0, ("noisier", "2 times"))]
)
def test_a_filter_whose_noise_does_not_fit_is_told_how_to_find_it(
    nis: float, words: tuple[str, ...]
) -> None:
    sentence = noise_sentence(with_nis(nis))
    assert sentence is not None
    assert all(word in sentence for word in (*words, "graphslam calibrate LOG --noise"))
    assert verdict(with_nis(nis))[-1] == sentence


@pytest.mark.parametrize("nis", [0.81, 1.0, 1.24, np.nan])
def test_a_filter_whose_noise_fits_is_told_nothing(nis: float) -> None:
    assert noise_sentence(with_nis(nis)) is None


# ---- the command -------------------------------------------------------------------------------


def test_calibrate_writes_settings_that_run_takes_and_keeps_the_users_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_tiny_log(tmp_path / "tiny", nodes=120)
    mine = tmp_path / "mine.toml"
    mine.write_text("[ekf]\nlost_after = 7\n")
    out = tmp_path / "noise.toml"
    arguments = ["calibrate", str(log), "--noise", "--out", str(out), "--config", str(mine)]
    assert main(arguments) == 0
    shown = capsys.readouterr().out
    settings = load_config(out)
    noise = settings.extract.noise
    assert settings.ekf.lost_after == 7
    assert f"noise_left = {noise.noise_left:g}" in shown
    assert "ground truth" in shown
    assert shown.rstrip().endswith(str(out))
    run = ["run", str(log), "--config", str(out), "--methods", "ekf", "--out", str(tmp_path / "r")]
    assert main(run) == 0


def test_calibrate_without_anything_to_find_is_wrong_usage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["calibrate", str(tmp_path)]) == 2
    assert "--noise" in capsys.readouterr().err
