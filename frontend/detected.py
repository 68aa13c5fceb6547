"""Lines seen in one image, and the noise that the papers give them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from frontend.config import DetectorConfig
from graphslam.geometry import Array, is_canonical, twin, wrap


@dataclass(frozen=True, slots=True)
class DetectedLines:
    """Lines seen in one image, robot frame.

    Attributes:
        z: (K, 2) centre lines ``(rho, alpha)``, m and rad, canonical.
        cov: (K, 2, 2) their covariances, m^2, m rad, rad^2.
        extent: (K, 2) stretch that supporting pixels cover, smallest and largest position along
            the line, m.
        quality: (K,) how well a line is seen, 0 to 1: the share of its stretch where both of its
            edges are, of lsd and hough-p less where they waver and where the line is short.
        rejected: how many straight edges or lines were left out, by reason.
    """

    z: Array
    cov: Array
    extent: Array
    quality: Array
    rejected: Mapping[str, int]

    def __len__(self) -> int:
        return len(self.z)


NO_LINES = DetectedLines(
    np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros(0), MappingProxyType({})
)
"""What an image without a line shows."""


def line_covariance(z: Array, config: DetectorConfig) -> Array:
    """Returns covariances (K, 2, 2) of lines (K, 2) seen by a camera at the origin, robot frame.

    ``sigma_rho = a + b |sin alpha_M| (exp(rho / c) - 1)`` with ``alpha_M = alpha + pi/2``, rho in
    metres; rho and alpha are independent.

    Source: SantanaLoc noise '(22)'. Printed without the absolute value, which makes it negative for
    alpha_M = -90 degrees beyond rho = 0.6 m; called both variance and sigma there, used as sigma
    here; it gives no sigma of alpha.
    """
    z = np.asarray(z, float)
    growth = np.abs(np.cos(z[..., 1])) * np.expm1(np.abs(z[..., 0]) / config.sigma_rho_c_m)
    cov = np.zeros((*z.shape, 2))
    cov[..., 0, 0] = (config.sigma_rho_a_m + config.sigma_rho_b_m * growth) ** 2
    cov[..., 1, 1] = np.radians(config.sigma_alpha_deg) ** 2
    return cov


def detected(
    z: Array,
    cov: Array,
    extent: Array,
    quality: Array,
    rejected: Mapping[str, int],
    config: DetectorConfig,
) -> DetectedLines:
    """Returns lines made canonical, with the noise that the configuration asks for.

    Args:
        z: (K, 2) lines, rho of either sign, alpha not wrapped.
        cov: (K, 2, 2) their measured covariances.
        extent: (K, 2) stretch of each, m along it.
        quality: (K,) as of `DetectedLines`.
        rejected: counts by reason.
        config: its noise law.
    """
    z = np.column_stack([z[:, 0], wrap(z[:, 1])])
    flip = ~is_canonical(z)
    if flip.any():
        z[flip], extent[flip] = twin(z[flip]), -extent[flip][:, ::-1]
        cov[flip, 0, 1], cov[flip, 1, 0] = -cov[flip, 0, 1], -cov[flip, 1, 0]
    if config.sigma_law == "paper":
        cov = line_covariance(z, config)
    return DetectedLines(z, cov, extent, quality, MappingProxyType(dict(rejected)))
