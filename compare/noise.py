"""Which noise fits a log, and what the filter makes of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from compare.config import RunConfig
from compare.noise_fit import GROUPS, NoiseParts, fit_factors, noise_parts, truth_criterion
from frontend.config import NoiseConfig
from graphslam.config import EkfConfig
from graphslam.geometry import Array
from graphslam.measurements import Measurements

if TYPE_CHECKING:
    from compare.comparison import Comparison
    from compare.truth import Truth
    from frontend.log import Log
    from graphslam.estimate import Estimate

UNSUSPICIOUS = (0.8, 1.25)
"""NIS per dimension of a filter whose noise is about right."""
UNDETERMINED = 0.5
"""A factor is not determined where the standard deviation of its logarithm is above this."""
ROUNDS = 4
"""At most so often are factors fitted, to sightings matched anew under noise that grew."""
GREW = 1.5
"""Noise grew, so that other sightings may match, where a factor rose by more than this."""
GATE_MARGIN = 1.5
"""Where the gate would cut off a match, it becomes this multiple of the largest NIS of one."""
NEW_OVER_GATE = 80.0 / 14.0
"""The gate for new landmarks over the gate for matches, as in the defaults."""
WIDER = 4.0
"""The gate for new landmarks is widened by this while there are more landmarks than before, ..."""
WIDENED = 3
"""... at most so often."""


@dataclass(frozen=True, slots=True)
class NoiseSuggestion:
    """Noise that fits a log, tried on it.

    Attributes:
        source: "ground truth" or "innovations".
        factors: factor on the assumed standard deviation of each of `GROUPS`.
        log_sigma: standard deviation of the logarithm of each factor.
        settings: the configuration with the suggested noise, and the gates that it needs, in it.
        sigma_rho_a_m: the detector's a with its factor, m; None where the log gives sightings.
        sigma_rho_b_m: the detector's b, likewise, m.
        sigma_alpha_deg: the detector's standard deviation of alpha, likewise, degrees.
        nis_before: the filter's NIS per dimension under the assumed noise.
        nis_after: the same under ``settings``.
        landmarks_before: landmarks in the filter's map under the assumed noise.
        landmarks_after: the same under ``settings``.
        notes: what else the user should know, in sentences.
    """

    source: str
    factors: tuple[float, ...]
    log_sigma: tuple[float, ...]
    settings: RunConfig
    sigma_rho_a_m: float | None
    sigma_rho_b_m: float | None
    sigma_alpha_deg: float | None
    nis_before: float
    nis_after: float
    landmarks_before: int
    landmarks_after: int
    notes: tuple[str, ...] = ()

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Which of `GROUPS` the log does not determine: they stay near what was assumed."""
        both = zip(GROUPS, self.log_sigma, strict=True)
        return tuple(name for name, sigma in both if sigma > UNDETERMINED)

    @property
    def fits(self) -> bool:
        """Whether the filter's NIS per dimension is unsuspicious under ``settings``."""
        return UNSUSPICIOUS[0] <= self.nis_after <= UNSUSPICIOUS[1]


def suggest_noise(
    log: Log,
    measurements: Measurements,
    estimate: Estimate,
    truth: Truth | None = None,
    config: RunConfig | None = None,
) -> NoiseSuggestion:
    """Returns the noise under which what the log holds is most likely.

    One factor each scales the standard deviations of rho, of alpha, of the wheels and of slip. From
    truth they maximise the likelihood of the sightings' residuals against the true lines and of the
    odometry's against the true motion. Without it, or where truth and sightings contradict each
    other, they maximise that of the filter's innovations, whose covariance allows for what was
    estimated from the same data.

    Args:
        log: the recording.
        measurements: what was extracted from it under ``config``.
        estimate: the filter's, from these measurements under ``config``.
        truth: what is true about the run; None to use innovations alone.
        config: what the run assumed; None for the defaults.
    """
    config = config or RunConfig()
    trial = _Trial(log, noise_parts(log, measurements, config.extract.noise), estimate, config)
    notes: tuple[str, ...] = ()
    criterion = None if truth is None else truth_criterion(trial.parts, truth)
    if criterion is not None:
        x, sigma = fit_factors(criterion, np.zeros(len(GROUPS)))
        at = trial.filtered(x) if np.any(x > math.log(GREW)) else estimate
        found = trial.suggestion("ground truth", x, sigma, at)
        if found.fits:
            return found
        notes = (
            f"the noise that ground truth suggests gives NIS per dimension {found.nis_after:.2g}, "
            "so innovations decide: ground truth is coarser than the sightings, or does not "
            "belong to them",
        )
    return replace(trial.suggestion("innovations", *_from_innovations(trial)), notes=notes)


def noise_sentence(comparison: Comparison) -> str | None:
    """Returns a sentence where a filter's NIS says that the assumed noise does not fit, or None."""
    for method in comparison.methods:
        nis = method.nis_per_dof
        if not method.causal or not nis > 0.0 or UNSUSPICIOUS[0] <= nis <= UNSUSPICIOUS[1]:
            continue
        return (
            f"{method.method}: sightings and odometry are {'cleaner' if nis < 1.0 else 'noisier'} "
            f"than assumed: NIS per dimension {nis:.2g}, and {UNSUSPICIOUS[0]} to "
            f"{UNSUSPICIOUS[1]} is unsuspicious. Standard deviations of about "
            f"{math.sqrt(nis):.2g} times the assumed would fit; `graphslam calibrate LOG --noise` "
            "finds them."
        )
    return None


def _from_innovations(trial: _Trial) -> tuple[Array, Array, Estimate]:
    """Returns log factors (4,), their sigmas (4,), and the estimate whose matches they are for.

    Matches made under too large a noise hold; where it turns out larger than assumed, sightings
    were missed, and are matched anew.
    """
    from graphslam.ekf import innovation_log_likelihood

    at, tried, nis = trial.before, np.zeros(len(GROUPS)), trial.nis(trial.before)
    x = tried + (0.5 * math.log(nis) if nis > 0.0 else 0.0)
    for _ in range(ROUNDS):

        def unlikely(x: Array, here: Estimate = at) -> float:
            return -innovation_log_likelihood(trial.parts.scaled(x), here)

        x, sigma = fit_factors(unlikely, x)
        if np.all(x <= tried + math.log(GREW)):
            break
        tried = np.maximum(tried, x)
        at = trial.filtered(x)
    return x, sigma, at


@dataclass(frozen=True, slots=True)
class _Trial:
    """A log, what was assumed about its noise, and the filter to try other noise with.

    Attributes:
        log: the recording.
        parts: its measurements, with the parts of the odometry's covariances.
        before: the filter's estimate under the assumed noise.
        config: what was assumed.
    """

    log: Log
    parts: NoiseParts
    before: Estimate
    config: RunConfig

    def filtered(self, x: Array, ekf: EkfConfig | None = None) -> Estimate:
        """Returns the filter's estimate under log factors ``x`` (4,)."""
        from graphslam.ekf import run_ekf

        return run_ekf(self.parts.scaled(x), ekf or self.config.ekf)

    def nis(self, estimate: Estimate) -> float:
        """Returns the NIS per dimension of an estimate; NaN without any."""
        from compare.comparison import compare

        return compare(None, self.parts.measurements, [estimate]).methods[0].nis_per_dof

    def suggestion(self, source: str, x: Array, sigma: Array, at: Estimate) -> NoiseSuggestion:
        """Returns log factors ``x`` (4,) as settings, tried on the log; ``at`` has the matches."""
        ekf, after = self.with_gates(x, at)
        noise = self.noise(np.exp(x))
        settings = replace(self.config, extract=replace(self.config.extract, noise=noise), ekf=ekf)
        detector, sees = self.config.extract.detector, self.log.sightings is None
        return NoiseSuggestion(
            source=source,
            factors=tuple(np.exp(x).tolist()),
            log_sigma=tuple(sigma.tolist()),
            settings=settings,
            sigma_rho_a_m=noise.rho_factor * detector.sigma_rho_a_m if sees else None,
            sigma_rho_b_m=noise.rho_factor * detector.sigma_rho_b_m if sees else None,
            sigma_alpha_deg=noise.alpha_factor * detector.sigma_alpha_deg if sees else None,
            nis_before=self.nis(self.before),
            nis_after=self.nis(after),
            landmarks_before=len(self.before.map),
            landmarks_after=len(after.map),
        )

    def with_gates(self, x: Array, at: Estimate) -> tuple[EkfConfig, Estimate]:
        """Returns the filter's settings with the gates that ``x`` needs, and what it finds so.

        Errors have heavier tails than a Gaussian of their variance. Under small noise the default
        gates would cut those tails off, and start second landmarks from them; so they are wide
        enough for every match, and for no more landmarks than before.
        """
        from graphslam.ekf import run_ekf

        nis = run_ekf(self.parts.scaled(x), self.config.ekf, linearise_at=at).nis
        largest = np.max(nis[np.isfinite(nis)], initial=0.0)
        matching = self.config.ekf.matching
        gate = matching.gate if largest <= matching.gate else _rounded(GATE_MARGIN * largest)
        for widened in range(WIDENED + 1):
            gate_new = max(matching.gate_new, _rounded(gate * NEW_OVER_GATE * WIDER**widened))
            ekf = replace(self.config.ekf, matching=replace(matching, gate=gate, gate_new=gate_new))
            after = self.filtered(x, ekf)
            if len(after.map) <= len(self.before.map):
                break
        return ekf, after

    def noise(self, factors: Array) -> NoiseConfig:
        """Returns what was assumed, times ``factors`` (4,) in the order of `GROUPS`."""
        from frontend.nodes import assumed_drive

        assumed = self.config.extract.noise
        drive = assumed_drive(self.log, assumed)
        rho, alpha, wheels, slip = factors
        x, y, heading = (_rounded(slip * value) for value in drive.slip)
        return NoiseConfig(
            noise_left=_rounded(wheels * (drive.noise_left or 0.0)),
            noise_right=_rounded(wheels * (drive.noise_right or 0.0)),
            slip=(x, y, heading),
            rho_factor=_rounded(rho * assumed.rho_factor),
            alpha_factor=_rounded(alpha * assumed.alpha_factor),
        )


def _rounded(value: float) -> float:
    """Returns a number with three significant digits."""
    return float(f"{value:.3g}")
