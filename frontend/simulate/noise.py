"""One scenario at several levels of noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from frontend.simulate.scenario import Scenario
from graphslam.errors import BadConfig


@dataclass(frozen=True, slots=True)
class NoiseLevel:
    """Factors on the standard deviations that a scenario states and draws.

    Attributes:
        wheels: on the wheels' noise and on slip.
        sightings: on the noise of rho and alpha, and of directions.
    """

    wheels: float = 1.0
    sightings: float = 1.0

    def __str__(self) -> str:
        parts = f"{self.wheels:g}", f"{self.sightings:g}"
        return parts[0] if self.wheels == self.sightings else ":".join(parts)

    @staticmethod
    def parse(text: str) -> NoiseLevel:
        """Returns the level that ``"2"`` (both) or ``"2.5:2"`` (wheels, sightings) names.

        Raises:
            BadConfig: it is neither.
        """
        wheels, colon, sightings = text.partition(":")
        try:
            factors = float(wheels), float(sightings if colon else wheels)
        except ValueError:
            factors = (math.nan, math.nan)
        if not all(0.0 < factor < math.inf for factor in factors):
            raise BadConfig(
                f"noise level {text!r}: write one positive factor for all noise, as 2, or two, for "
                "wheels and sightings, as 2.5:2"
            )
        return NoiseLevel(*factors)


def noisier(scenario: Scenario, level: NoiseLevel) -> Scenario:
    """Returns the scenario with its noise, stated and drawn, multiplied."""
    robot, sightings, omni = scenario.robot, scenario.sightings, scenario.omni
    assert robot.noise_left is not None and robot.noise_right is not None  # noqa: PT018
    x, y, heading = robot.slip
    return replace(
        scenario,
        robot=replace(
            robot,
            noise_left=level.wheels * robot.noise_left,
            noise_right=level.wheels * robot.noise_right,
            slip=(level.wheels * x, level.wheels * y, level.wheels * heading),
        ),
        sightings=replace(sightings, factor=level.sightings * sightings.factor),
        omni=omni and replace(omni, sigma_deg=level.sightings * omni.sigma_deg),
    )
