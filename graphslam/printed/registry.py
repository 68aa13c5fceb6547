"""Every erratum of the two Santana papers, with its switch where a filter feels it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Literal

from graphslam.ekf import Filter
from graphslam.measurements import Measurements
from graphslam.models.wheels import DifferentialDrive
from graphslam.printed import filters, noise

Change = Callable[[Measurements, DifferentialDrive], Measurements]


@dataclass(frozen=True, slots=True)
class Erratum:
    """One misprint.

    Attributes:
        name: stable name of its switch.
        paper: "SantanaLoc" or "SantanaSLAM".
        where: equation or section.
        printed: what is printed.
        right: what is right.
        effect: what the printed form does, in a few words.
        switch: the filter with that equation as printed; None where the filter is as it is.
        change: takes measurements and the robot's drive; returns the measurements with the noise
            as printed. None where they are as they are.
        no_switch: why there is neither; empty where there is one.
    """

    name: str
    paper: Literal["SantanaLoc", "SantanaSLAM"]
    where: str
    printed: str
    right: str
    effect: str
    switch: type[Filter] | None = None
    change: Change | None = None
    no_switch: str = ""

    @property
    def switchable(self) -> bool:
        """Whether a filter can be run with it."""
        return self.switch is not None or self.change is not None


_ALL = (
    Erratum(
        "loc-9-sign",
        "SantanaLoc",
        "(9), (12)",
        "y + ΔL/Δθ [cos(θ + Δθ) − cos θ]",
        "y − ΔL/Δθ [cos(θ + Δθ) − cos θ], as SantanaSLAM (8)",
        "in every curve y moves the wrong way",
        switch=filters.PlusInY,
    ),
    Erratum(
        "loc-14-straight",
        "SantanaLoc",
        "(14)",
        "Δθ cos θ, Δθ sin θ",
        "ΔL cos θ, ΔL sin θ",
        "a robot that drives straight stands still",
        switch=filters.TurnForLength,
    ),
    Erratum(
        "loc-16-prediction",
        "SantanaLoc",
        "(16)",
        "μ̄ = μ + p(u, μ, 0)",
        "μ̄ = p(μ, u, 0)",
        "the pose doubles with every step",
        switch=filters.PoseTwice,
    ),
    Erratum(
        "loc-19-jacobian",
        "SantanaLoc",
        "(19), (21)",
        "K1 = r Σ / (b Δ), K3 = b Δθ_L / 2 (r Δ / b)², one K3 for both columns",
        "V1, V2, V3 of SantanaSLAM (16)",
        "wheel noise reaches the pose magnified in the wrong direction",
        change=partial(noise.with_v, noise.printed_v_loc),
    ),
    Erratum(
        "loc-20-variance",
        "SantanaLoc",
        "(20)",
        "variance proportional to the wheel's rotation",
        "standard deviation proportional to it, as the text and SantanaSLAM (17)",
        "noise of another size, and of another kind when a step is cut",
        change=noise.with_variance_law,
    ),
    Erratum(
        "loc-22-noise",
        "SantanaLoc",
        "'(22)', section 4.3",
        "a + b sin α (exp(ρ/c) − 1)",
        "a + b |sin α| (exp(ρ/c) − 1)",
        "lines behind the robot look as good as exact",
        change=noise.with_signed_sigma,
    ),
    Erratum(
        "loc-29-heading",
        "SantanaLoc",
        "(29), (30)",
        "third entry of the ρ row ∓(x sin α − y cos α)",
        "0",
        "distances to lines turn the heading, by the distance from the origin",
        switch=filters.HeadingInRho,
    ),
    Erratum(
        "loc-31-homography",
        "SantanaLoc",
        "(31) with the matrix '(23)'",
        "floor to pixel",
        "the printed matrix maps pixels to floor, in centimetres",
        "the camera looks at no floor at all",
        no_switch="no line would ever be seen: `frontend.simulate.printed_view` reads it right",
    ),
    Erratum(
        "loc-experiment-1",
        "SantanaLoc",
        "section 5, experiment 1",
        "turns of 90°, 180° and 90° without their senses",
        "the two quarter turns are of opposite sense",
        "the robot ends 50 m away",
        no_switch="a path, not an equation: the scenario `santana-loc-1` drives the right one",
    ),
    Erratum(
        "slam-6-point",
        "SantanaSLAM",
        "(6)",
        "H at μ(t−1)",
        "H at the predicted mean",
        "lever arms of lines are one step old",
        switch=filters.LastMean,
    ),
    Erratum(
        "slam-16-singular",
        "SantanaSLAM",
        "(16)",
        "divides by Δθ_R − Δθ_L",
        "its limit near zero",
        "rounding is taken for wheel noise when the wheels turn nearly alike",
        change=partial(noise.with_v, noise.printed_v_slam),
    ),
    Erratum(
        "slam-27-landmark",
        "SantanaSLAM",
        "(27)",
        "landmark block [[1, 0], [0, −1]]",
        "±[[1, x sin α − y cos α]], [0, 1]",
        "lines are corrected the wrong way",
        switch=filters.LandmarkBlock,
    ),
    Erratum(
        "slam-3.3-names",
        "SantanaSLAM",
        "section 3.3",
        "the sign of the measured α picks the model, and (ρ, α) are compared as they are",
        "compare modulo (ρ, α) ~ (−ρ, α + π)",
        "a line seen from its other side is taken for a new one",
        switch=filters.NamesAsTheyAre,
    ),
    Erratum(
        "slam-feature-map",
        "SantanaSLAM",
        "table 'Feature map'",
        "'corrected' column from 'calculated' by the stated start pose",
        "no rigid motion does it (ρ is up to 0.29 m off)",
        "the table's own columns contradict each other",
        no_switch="a table of results, not an equation",
    ),
)

ERRATA: Mapping[str, Erratum] = MappingProxyType({erratum.name: erratum for erratum in _ALL})
"""All errata of both papers by name, SantanaLoc's first, in the order of the papers."""
