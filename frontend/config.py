"""Configuration of the front-end. Field docstrings are the command line's help."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

from frontend.lamp_config import LampConfig
from frontend.omni_config import OmniConfig
from frontend.tag_config import SigmaLaw, TagConfig
from frontend.wall_config import WallConfig
from graphslam.errors import BadConfig

Method = Literal["lsd", "hough-p", "hough"]
Polarity = Literal["dark", "bright", "both"]
Binarise = Literal["canny", "global"]

CHOICES: dict[str, tuple[str, ...]] = {
    "method": get_args(Method),
    "polarity": get_args(Polarity),
    "sigma_law": get_args(SigmaLaw),
    "binarise": get_args(Binarise),
}
MAY_BE_ZERO = ("sigma_rho_b_m", "edge_min_grey", "calibration_px", "straightness_m", "binary_grey")


@dataclass(frozen=True, slots=True)
class DetectorConfig:
    """The line detector: edges, pairing of a line's two edges, fit, noise."""

    method: Method = "lsd"
    """Detector. lsd: line segments (a-contrario), paired, joined, measured in profiles. hough-p:
    the same from the probabilistic Hough transform. hough: the papers' Hough transform, refined.
    docs/detectors.md says when to use which."""
    sigma_law: SigmaLaw = "measured"
    """Noise of a line. measured: from its own fit, with correlation. paper: SantanaLoc eq. (22)."""
    polarity: Polarity = "both"
    """Lines to look for: dark (grooves), bright (painted), or both."""
    line_width_m: tuple[float, float] = (0.002, 0.025)
    """Narrowest and widest distance on the floor between the two edges of one line, m."""
    pair_angle_deg: float = 5.0
    """Largest angle on the floor between the two edges of one line, degrees."""
    min_length_m: float = 0.12
    """Shortest stretch of a line that counts, m on the floor."""
    max_break_m: float = 0.3
    """Longest break in a line (a crossing, a stain) over which lsd and hough-p join it, m."""
    min_quality: float = 0.5
    """Smallest quality of a line, 0 to 1 (lsd and hough-p): the share of its stretch where both its
    edges are seen, less where they waver and where the line is short."""
    coarsest_pixel_m: float = 0.03
    """Pixels that cover more floor than this are ignored (near the horizon), m."""
    vaguest_alpha_deg: float = 0.5
    """Lines are left out whose own fit leaves their direction more uncertain than this (one
    standard deviation), degrees."""
    calibration_px: float = 0.1
    """Standard deviation of the calibration: how far off, in undistorted pixels along u and along
    v, homography and lens put each corner of the image; a floor of the measured noise."""
    straightness_m: float = 0.0003
    """Standard deviation of how far a real groove or stripe wanders from a straight line, at each
    end of what is seen of it, m; the other floor of the measured noise."""
    smoothing_px: float = 1.0
    """Standard deviation of the Gaussian that smooths the grey image, pixels."""
    edge_over_noise: tuple[float, float] = (2.0, 4.0)
    """Canny's low and high threshold, in multiples of the image's own gradient noise (a low
    quantile of its gradients, as a standard deviation), so that they follow light and contrast."""
    edge_min_grey: float = 2.0
    """Smallest high threshold, grey levels per pixel: keeps rounding and compression in clean
    images from counting as edges."""
    binarise: Binarise = "canny"
    """Edge pixels of hough and hough-p. canny: SantanaLoc's. global: the border of what is darker
    than one threshold for the whole image, SantanaSLAM's."""
    binary_grey: float = 0.0
    """That threshold, grey levels; 0: chosen anew for each image (Otsu)."""
    hough_angle_deg: float = 2.0
    """Angle step of the Hough accumulator, degrees."""
    hough_offset_px: float = 2.0
    """Offset step of the Hough accumulator, pixels."""
    direction_tolerance_deg: float = 15.0
    """An edge pixel votes for, and supports, only lines within this angle of its gradient."""
    support_px: float = 1.5
    """Largest distance of a supporting edge pixel from its line, pixels."""
    min_support: int = 15
    """Fewest edge pixels that make one edge of a line."""
    min_run: int = 6
    """Fewest edge pixels in a row (without a gap) that count; crossings may part a line into
    several such runs."""
    min_coverage: float = 0.4
    """Smallest share of an edge's stretch that its edge pixels cover (hough); below it, short runs
    that are far apart are in line by chance."""
    max_gap_px: float = 8.0
    """Longest gap inside such a run, pixels."""
    sigma_rho_a_m: float = 0.004
    """a of the noise of rho, `a + b |sin alpha_M| (exp(rho / c) - 1)`, m (SantanaLoc eq. (22))."""
    sigma_rho_b_m: float = 0.3
    """b of the noise of rho, m (SantanaLoc eq. (22))."""
    sigma_rho_c_m: float = 45.0
    """c of the noise of rho, m (SantanaLoc eq. (22))."""
    sigma_alpha_deg: float = 0.5
    """Standard deviation of alpha, degrees; the papers give none."""

    def __post_init__(self) -> None:
        for name in ("line_width_m", "edge_over_noise"):
            low, high = getattr(self, name)
            if not (math.isfinite(high) and 0 <= low < high):
                raise BadConfig(f"{name} = ({low}, {high}): needs 0 <= first < second, both finite")
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                *others, last = choices
                raise BadConfig(
                    f"{name} = {getattr(self, name)!r}: must be {', '.join(others)} or {last}"
                )
        for f in fields(self):
            value: Any = getattr(self, f.name)
            if not isinstance(value, int | float):
                continue
            may_be_zero = f.name in MAY_BE_ZERO
            if not (math.isfinite(value) and (value > 0 or (may_be_zero and value == 0))):
                raise BadConfig(f"{f.name} = {value}: must be finite and positive")


@dataclass(frozen=True, slots=True)
class NoiseConfig:
    """Noise of wheels and sightings, in place of what log.toml and the detector say.

    `graphslam calibrate --noise LOG` finds it.
    """

    noise_left: float | None = None
    """k of the left wheel's noise, as in log.toml; absent: log.toml's."""
    noise_right: float | None = None
    """The same of the right wheel."""
    slip: tuple[float, float, float] | None = None
    """Slip along x, y (m) and of the heading (rad) for each square root of a metre, as in log.toml;
    absent: log.toml's."""
    process_mps: float | None = None
    """Atali's Q in place of the wheels' noise and slip: this many metres (x, y) and radians
    (heading) of standard deviation for each second between nodes; the paper's n_p is 2. Absent: the
    wheels' noise."""
    rho_factor: float = 1.0
    """Factor on the standard deviation of rho of every line sighting, the detector's or that of
    sightings.csv."""
    alpha_factor: float = 1.0
    """The same for alpha."""

    def __post_init__(self) -> None:
        for name in ("rho_factor", "alpha_factor"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise BadConfig(f"{name} = {value}: must be finite and positive")
        for value in (self.noise_left, self.noise_right, *(self.slip or ())):
            if value is not None and not 0 <= value <= 1e9:
                raise BadConfig(f"noise or slip = {value}: must be from 0 to 1e9")
        if self.process_mps is not None and not 0 < self.process_mps <= 1e9:
            raise BadConfig(f"process_mps = {self.process_mps}: must be above 0, at most 1e9")


@dataclass(frozen=True, slots=True)
class ExtractConfig:
    """From a log to measurements."""

    detector: DetectorConfig = field(default_factory=DetectorConfig)
    omni: OmniConfig = field(default_factory=OmniConfig)
    lamps: LampConfig = field(default_factory=LampConfig)
    tags: TagConfig = field(default_factory=TagConfig)
    walls: WallConfig = field(default_factory=WallConfig)
    """Walls in a laser's scans, for logs without floor images and sightings.csv."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """Noise in place of what log.toml and the detector say."""
    workers: int = 0
    """Threads that look at images at the same time; 0: as many as the machine has cores."""
    cache: bool = True
    """Keep the lines found in images, so that the next run on the same images with the same
    detector starts at the estimators; in $GRAPHSLAM_CACHE, else graphslam/lines in the user's
    cache."""
    from_s: float | None = None
    """Leave out what was recorded before this time, s; absent: from the beginning."""
    to_s: float | None = None
    """Leave out what was recorded after this time, s; absent: to the end."""
    robot: str | None = None
    """Robot file of a bag: geometry, cameras, topics (docs/bags.md); absent: what the bag itself
    tells. A log folder has its log.toml instead."""
    camera_offset_s: float = 0.0
    """Added to the times of images and sightings before anything else, s; for a camera whose clock
    differs from the wheels'. `graphslam calibrate LOG --time-offset` finds it."""
    every: int = 1
    """Use every n-th image (without images, every n-th time of sightings.csv, or every n-th scan),
    n >= 1."""
    landmarks: Literal["known", "mapped"] = "known"
    """What landmarks.csv is for. known: the estimators are given it. mapped: they map its kinds
    themselves, and it only judges them."""

    def __post_init__(self) -> None:
        if self.workers < 0:
            raise BadConfig(f"workers = {self.workers}: must be 0 (all cores) or a positive number")
        if not abs(self.camera_offset_s) <= 1e6:
            raise BadConfig(f"camera_offset_s = {self.camera_offset_s}: must be seconds")
        if self.every < 1:
            raise BadConfig(f"every = {self.every}: must be 1 or more")
        if self.landmarks not in ("known", "mapped"):
            raise BadConfig(f"landmarks = {self.landmarks!r}: must be known or mapped")
        if self.from_s is not None and self.to_s is not None and self.from_s >= self.to_s:
            raise BadConfig(f"from_s = {self.from_s} is not before to_s = {self.to_s}")
