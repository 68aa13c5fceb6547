"""Configuration of the front-end. Field docstrings are the command line's help."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

from frontend.wall_config import WallConfig
from graphslam.errors import BadConfig

Method = Literal["lsd", "hough-p", "hough"]
Polarity = Literal["dark", "bright", "both"]
SigmaLaw = Literal["measured", "paper"]
Hsv = tuple[int, int, int]
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
class OmniConfig:
    """Directions of coloured landmarks in images of an omnidirectional camera."""

    open_px: int = 3
    """Specks of colour narrower than this are removed, pixels; 0 and 1 remove none."""
    close_px: int = 3
    """Holes and gaps in a colour narrower than this are closed, pixels; 0 and 1 close none."""
    min_area_px: int = 6
    """Smallest blob that counts, pixels, its base left out."""
    base_share: float = 0.6
    """Share of a blob, from its end nearest to the mirror's centre, that is left out: the base of a
    cone is square, and moves the centroid as the robot goes around it. 0 where bases are covered,
    or there are none."""
    widest_deg: float = 60.0
    """Widest blob that counts, degrees around the mirror's centre."""
    centre_px: float = 0.1
    """Standard deviation of the mirror's centre, pixels; near landmarks feel it most."""
    deformation_deg: float = 0.05
    """Standard deviation of what lens and mirror do to a direction after calibration, degrees."""

    def __post_init__(self) -> None:
        for name in ("open_px", "close_px", "centre_px", "deformation_deg"):
            if not 0 <= getattr(self, name) < math.inf:
                raise BadConfig(f"{name} = {getattr(self, name)}: must be finite and not negative")
        if self.min_area_px < 1:
            raise BadConfig(f"min_area_px = {self.min_area_px}: must be 1 or more")
        if not 0 <= self.base_share < 1:
            raise BadConfig(f"base_share = {self.base_share}: must be from 0 to below 1")
        if not 0 < self.widest_deg <= 180:
            raise BadConfig(f"widest_deg = {self.widest_deg}: must be above 0 and at most 180")


@dataclass(frozen=True, slots=True)
class LampConfig:
    """The detector of ceiling lamps, in the images of cameras with looks_at = "ceiling"."""

    size_m: tuple[float, float] | None = None
    """Length and width of a lamp, m, in the plane of the lamps. With it lamps that the border of
    the image cuts are completed from their edges, and what is much smaller or larger than a lamp
    is none; absent: cut lamps are left out."""
    area_m2: tuple[float, float] = (0.02, 1.5)
    """Smallest and largest area of a lamp, m^2, where its size is not given."""
    least_share: float = 0.6
    """Smallest area of a bright spot, as a share of a lamp's, that counts as a whole lamp; the
    inverse is the largest. Needs size_m."""
    least_visible: float = 0.67
    """Share of a cut lamp that must be visible to complete it (Bellini: 4000 of 6000 pixels)."""
    least_elongation: float = 1.4
    """Shortest lamp, as its length over its width, whose axis is taken."""
    least_fill: float = 0.75
    """Smallest share of its own rectangle that a lamp fills; below it, it is no lamp."""
    contrast_grey: float = 30.0
    """An image whose brightest spot is less than this above the ceiling, grey levels, is black: no
    lamp is in view."""
    threshold: float = 0.5
    """Where between ceiling (0) and brightest spot (1) of an image the border of a lamp is; so it
    follows exposure."""
    clean_px: int = 1
    """Radius of erosion and dilation, pixels: what is narrower than twice this goes (fringes,
    grids), gaps narrower than that close; 0 leaves all as it is."""
    edge_px: float = 0.15
    """Standard deviation of where a whole edge of a lamp appears, pixels (blur, fringes)."""
    calibration_px: float = 0.1
    """Standard deviation of the calibration, pixels: how far off homography and lens put a spot."""
    cut_end_m: float = 0.01
    """Standard deviation of the one visible end of a cut lamp, along the lamp, m: a reflection may
    be taken for it."""
    timing_s: float = 0.005
    """Standard deviation of when within its exposure an image was taken, s: noise that grows with
    the robot's speed, as Bellini's does."""
    coarsest_pixel_m: float = 0.05
    """Pixels that cover more of the ceiling than this are ignored, m."""

    def __post_init__(self) -> None:
        pairs = {"size_m": self.size_m and self.size_m[::-1], "area_m2": self.area_m2}
        for name, pair in pairs.items():
            if pair is not None and not 0 < pair[0] <= pair[1] < math.inf:
                raise BadConfig(
                    f"lamps.{name} = {getattr(self, name)}: needs two positive numbers, "
                    + ("the length first" if name == "size_m" else "the smaller one first")
                )
        for name in ("least_share", "least_visible", "least_fill", "threshold"):
            if not 0 < getattr(self, name) < 1:
                raise BadConfig(f"lamps.{name} = {getattr(self, name)}: must be between 0 and 1")
        for name in ("contrast_grey", "edge_px", "coarsest_pixel_m"):
            if not 0 < getattr(self, name) < math.inf:
                raise BadConfig(f"lamps.{name} = {getattr(self, name)}: must be positive")
        for name in ("calibration_px", "cut_end_m", "timing_s"):
            if not 0 <= getattr(self, name) < math.inf:
                raise BadConfig(f"lamps.{name} = {getattr(self, name)}: must be 0 or more")
        if not 0 <= self.clean_px <= 50:
            raise BadConfig(f"lamps.clean_px = {self.clean_px}: must be from 0 to 50")
        if not self.least_elongation >= 1:
            raise BadConfig(f"lamps.least_elongation = {self.least_elongation}: must be 1 or more")


@dataclass(frozen=True, slots=True)
class TagConfig:
    """The coloured tags of a robot in images of an overhead camera."""

    centre_low: Hsv = (100, 90, 30)
    """Colour of the tag in the robot's centre (blue): smallest hue (0 to 179, two degrees each),
    saturation and value (0 to 255). A hue above that of the largest goes over the end of the
    circle, as red does."""
    centre_high: Hsv = (130, 255, 255)
    """The largest."""
    front_low: Hsv = (40, 70, 30)
    """Colour of the tag at its front (green): smallest hue, saturation and value."""
    front_high: Hsv = (85, 255, 255)
    """The largest."""
    open_px: int = 3
    """Specks of colour narrower than this are removed, pixels; 0 and 1 remove none."""
    close_px: int = 3
    """Holes narrower than this are closed, pixels; 0 and 1 close none."""
    min_area_px: float = 12.0
    """Smallest blob that is looked at, pixels."""
    size_ratio: tuple[float, float] = (0.5, 2.5)
    """Smallest and largest area of a tag over the stated one; beyond it is partly hidden, or merged
    with something else. Only where log.toml gives the diameter."""
    distance_tolerance_m: float = 0.015
    """Largest difference between the distance of the tags as seen and as log.toml has it, m."""
    sigma_law: SigmaLaw = "measured"
    """Noise of a pose. measured: from the noise of pixels, the size of the tags and their distance.
    paper: Atali's, the same for all."""
    sigma_px: float = 0.1
    """Standard deviation of what calibration, lens and light do to the middle of a tag, pixels
    along u and along v, beside what whole pixels do to its border."""
    sigma_m: float = 0.002
    """Standard deviation of where a tag is on the robot, m along x and along y: the robot tilts,
    the tag comes loose."""
    paper_sigma_m: float = 0.1
    """n_m of Atali's R, m."""
    paper_sigma_deg: float = 2.0
    """Floor of the angle in Atali's R, degrees; the paper prints 0."""
    check: bool = True
    """Leave poses out that odometry contradicts, those of tags.csv too."""

    def __post_init__(self) -> None:
        for low, high in (("centre_low", "centre_high"), ("front_low", "front_high")):
            _check_colour(low, getattr(self, low), getattr(self, high))
        smallest, largest = self.size_ratio
        if not 0 < smallest < largest < math.inf:
            raise BadConfig(f"size_ratio = {self.size_ratio}: needs 0 < first < second")
        if self.sigma_law not in CHOICES["sigma_law"]:
            raise BadConfig(f"sigma_law = {self.sigma_law!r}: must be measured or paper")
        for name in ("open_px", "close_px", "sigma_px", "sigma_m"):
            if not 0 <= getattr(self, name) < math.inf:
                raise BadConfig(f"{name} = {getattr(self, name)}: must be finite, not negative")
        for name in ("min_area_px", "distance_tolerance_m", "paper_sigma_m", "paper_sigma_deg"):
            if not 0 < getattr(self, name) < math.inf:
                raise BadConfig(f"{name} = {getattr(self, name)}: must be finite and positive")


def _check_colour(name: str, low: Hsv, high: Hsv) -> None:
    most = (179, 255, 255)
    if any(not 0 <= v <= m for limit in (low, high) for v, m in zip(limit, most, strict=True)):
        raise BadConfig(
            f"{name} = {list(low)} or its high limit {list(high)}: hue is 0 to 179 (two degrees "
            "each), saturation and value are 0 to 255"
        )
    if low[1] > high[1] or low[2] > high[2]:
        raise BadConfig(f"{name} = {list(low)}: saturation or value is above the high limit's")


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
