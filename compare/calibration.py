"""From a log to noise that fits it: as a value, as a file of settings, and in words."""

from __future__ import annotations

import math

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from compare.config import RunConfig, to_toml
from compare.console import Progress
from compare.noise import UNSUSPICIOUS, NoiseSuggestion, suggest_noise
from frontend.log import Log
from graphslam.errors import BadLog


def calibrate_noise(
    log: Log, config: RunConfig | None = None, progress: Progress | None = None
) -> NoiseSuggestion:
    """Returns the noise that fits a log, from ground truth where it has some.

    Args:
        log: the recording.
        config: what is assumed to begin with; None for the defaults.
        progress: told about each stage.

    Raises:
        BadLog: the log cannot be used.
        BadConfig: the configuration cannot be used.
    """
    from compare.truth import truth_of
    from frontend.extract import extract
    from graphslam.ekf import run_ekf

    config, tell = config or RunConfig(), progress or Progress()
    measurements = extract(
        log, config.extract, lambda done, total: tell(f"{log.name}: extract", done, total)
    )
    tell(f"{log.name}: fit noise", 0, 1)
    estimate = run_ekf(measurements, config.ekf)
    if not np.isfinite(estimate.nis).any():
        raise BadLog(
            f"{log.folder}: nothing is seen twice, so there is nothing to fit noise to; see "
            "`graphslam inspect`"
        )
    return suggest_noise(log, measurements, estimate, truth_of(log, measurements), config)


def noise_toml(found: NoiseSuggestion, name: str) -> str:
    """Returns the settings of a suggestion as TOML that `graphslam run --config` takes.

    Args:
        found: the suggestion.
        name: of the log that it fits.
    """
    return (
        f"# Noise that fits the log {name}, from {found.source}: [extract.noise] and the gates in\n"
        f"# [ekf.matching]. NIS per dimension {found.nis_before:.2g} before, "
        f"{found.nis_after:.2g} with these settings.\n\n{to_toml(found.settings)}"
    )


def robot_lines(found: NoiseSuggestion) -> str:
    """Returns the lines of ``[robot]`` in log.toml that say the same about the wheels."""
    noise = found.settings.extract.noise
    assert noise.slip is not None
    slip = ", ".join(f"{value:g}" for value in noise.slip)
    return (
        f"noise_left = {noise.noise_left:g}\nnoise_right = {noise.noise_right:g}\nslip = [{slip}]"
    )


def print_noise(found: NoiseSuggestion, log: Log) -> None:
    """Prints what fits, how sure that is, and what the filter makes of it, to standard output."""
    noise = found.settings.extract.noise
    assert noise.slip is not None
    x, y, heading = noise.slip
    values = (
        _sigma(found.sigma_rho_a_m, 1e3, "mm and more with distance"),
        _sigma(found.sigma_alpha_deg, 1.0, "°"),
        f"k = {noise.noise_left:g} left, {noise.noise_right:g} right",
        f"{1e3 * x:.3g} mm, {1e3 * y:.3g} mm, {1e3 * heading:.3g} mrad per √m",
    )
    table = Table(title=Text(f"{log.name}: noise from {found.source}"), title_justify="left")
    for heading_text in ("sigma of", "times assumed", "sure to", "that is"):
        table.add_column(heading_text)
    names = ("rho", "alpha", "wheel noise", "slip")
    rows = zip(names, found.factors, found.log_sigma, values, strict=True)
    for name, factor, sigma, value in rows:
        table.add_row(name, f"{factor:.3g}", f"{math.expm1(sigma):.0%}", value)
    console = Console(highlight=False, soft_wrap=False)
    console.print(table)
    for sentence in (*found.notes, *_outcome(found)):
        console.print(Text(sentence))
    console.print(Text(f"\nFor [robot] in log.toml:\n{robot_lines(found)}\n"), soft_wrap=True)


def _sigma(value: float | None, scale: float, unit: str) -> str:
    return "as sightings.csv says, times that" if value is None else f"{scale * value:.3g} {unit}"


def _outcome(found: NoiseSuggestion) -> list[str]:
    told = []
    if found.undetermined:
        told.append(
            f"Not determined by this log, and left near what was assumed: "
            f"{', '.join(found.undetermined)}."
        )
    told.append(
        f"NIS per dimension: {found.nis_before:.2g} before, {found.nis_after:.2g} with this noise; "
        f"{UNSUSPICIOUS[0]} to {UNSUSPICIOUS[1]} is unsuspicious. Landmarks: "
        f"{found.landmarks_before} before, {found.landmarks_after} with it."
    )
    matching = found.settings.ekf.matching
    told.append(f"Gates that it needs: {matching.gate:g} to match, {matching.gate_new:g} for new.")
    return told
