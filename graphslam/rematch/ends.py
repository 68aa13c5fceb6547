"""How often the lines of a map end: what tells whether one goes on where nobody looked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graphslam.config import RematchConfig
from graphslam.geometry import Array

POWER = 2.0
"""Ends that were seen, as it were, on ``gap_m`` of line before any was."""
GOES_ON = 0.9
"""Probability from which on a line is taken to go on."""


@dataclass(frozen=True, slots=True)
class Ends:
    """The ends of lines that were in view, and on how much line.

    As if lines ended at random, at a rate that nobody knows, of which ``gap_m`` and `POWER` are the
    prior (a gamma distribution); every end that was seen and every metre without one tells it
    better. While nothing is known, the odds that a line goes on fall as the distance's inverse
    square, and never to nothing. Where lines are seen to go on, they go on where nobody looked;
    where they are seen to end, they hardly do.

    Attributes:
        count: ends of lines that were in view.
        metres: length of line that was seen, each metre once.

    Source: the posterior predictive of a Poisson process under its conjugate prior (the Lomax
    distribution); as any textbook has it.
    """

    count: int = 0
    metres: float = 0.0

    def price(self, gap: Array, config: RematchConfig) -> Array:
        """Returns what gaps (...), m, in lines cost: minus the logarithm of that they go on."""
        scale = config.gap_m + self.metres
        return np.asarray((POWER + self.count) * np.log1p(np.asarray(gap) / scale))

    def sure(self, config: RematchConfig) -> float:
        """Returns how far, m, a line goes on with the probability `GOES_ON`."""
        scale = config.gap_m + self.metres
        return float(scale * np.expm1(-np.log(GOES_ON) / (POWER + self.count)))


UNKNOWN = Ends()
