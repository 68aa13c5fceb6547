"""How the line detectors do on rendered floors of known truth; prints the tables of the docs.

python benchmarks/detectors.py [--frames 40] [--only moderate] [--sizes 640x480]
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from frontend.camera import Camera
from frontend.config import DetectorConfig
from frontend.lines import DetectedLines, detect_lines
from frontend.simulate.floor import Groove, Light, LineGrid, Mess, Surface
from frontend.simulate.render import pixel_grid, render
from frontend.simulate.scenario import Motion, Scenario
from frontend.simulate.sensors import CameraSpec
from frontend.simulate.view import camera_of
from frontend.simulate.world import build_world
from graphslam.geometry import (
    Array,
    line_to_robot,
    nearest_twin,
    offset_error,
    wrap,
)
from graphslam.models.wheels import DifferentialDrive

METHODS = ("lsd", "hough-p", "hough")
SIZES = {"640x480": (640, 480), "160x120": (160, 120)}
MATCH_M, MATCH_DEG = 0.010, 3.0
IN_VIEW_M = 0.25
FLOORS = 8
"""Frames of one condition are taken on this many different floors."""


@dataclass(frozen=True)
class Condition:
    """A kind of floor, light and picture; moderate quality where nothing else is said."""

    width: float = 0.007
    contrast: float = -60.0
    pitch: float = 0.6
    grey: float = 140.0
    texture: float = 4.0
    blur: float = 0.8
    noise: float = 2.0
    jpeg: int = 85
    light: Light = field(default_factory=Light)
    mess: Mess | None = None

    def scenario(self, size: tuple[int, int]) -> Scenario:
        """Returns it with a camera that sees 0.3 to 1.1 m ahead."""
        half = round(6.0 / self.pitch)
        spacings = (self.pitch,) * (2 * half)
        grids = tuple(LineGrid(alpha, -half * self.pitch, spacings) for alpha in (0.0, 90.0))
        camera = CameraSpec(
            size,
            4.0,
            view_width=0.9,
            view_near=0.3,
            view_far=1.1,
            noise=self.noise,
            blur=self.blur,
            jpeg_quality=self.jpeg,
        )
        return Scenario(
            "graphslam-scenario/1",
            "floor",
            DifferentialDrive(0.042, 0.042, 0.2),
            (Motion(forward=1.0),),
            camera,
            grids=grids,
            groove=Groove(self.width, self.contrast),
            surface=Surface(self.grey, self.texture),
            light=self.light,
            mess=self.mess,
        )


DIRT = {"specks": 40.0, "stains": 3.0, "strokes": 6.0}
CONDITIONS = {
    "moderate": Condition(),
    "groove 3 mm": Condition(width=0.003),
    "groove 5 mm": Condition(width=0.005),
    "groove 10 mm": Condition(width=0.010),
    "groove 15 mm": Condition(width=0.015),
    "contrast 15": Condition(contrast=-15.0),
    "contrast 30": Condition(contrast=-30.0),
    "contrast 110": Condition(contrast=-110.0),
    "blur 0.5 px": Condition(blur=0.5),
    "blur 1.5 px": Condition(blur=1.5),
    "blur 2.5 px": Condition(blur=2.5),
    "noise 0": Condition(noise=0.0),
    "noise 5": Condition(noise=5.0),
    "noise 10": Condition(noise=10.0),
    "JPEG 60": Condition(jpeg=60),
    "JPEG 75": Condition(jpeg=75),
    "JPEG 95": Condition(jpeg=95),
    "light gradient": Condition(light=Light(gradient=(0.6, 0.5), vignette=0.4, patches=0.15)),
    "dim light": Condition(grey=50.0, contrast=-20.0, texture=1.5),
    "rough texture": Condition(texture=10.0),
    "grid 0.3 m": Condition(pitch=0.3),
    "grid 1 m": Condition(pitch=1.0),
    "painted 15 mm": Condition(width=0.015, contrast=80.0, grey=110.0),
    "shadows": Condition(mess=Mess(shadows=1.5)),
    "dirt": Condition(mess=Mess(**DIRT)),
    "shadows, dirt": Condition(mess=Mess(shadows=1.5, **DIRT)),
    "furniture legs": Condition(mess=Mess(legs=1.0)),
}


@dataclass
class Score:
    """Sums over the frames of one condition."""

    frames: int = 0
    wanted: int = 0
    seen: int = 0
    false: int = 0
    seconds: float = 0.0
    errors: list[Array] = field(default_factory=list)
    covariances: list[Array] = field(default_factory=list)
    calibrated: list[float] = field(default_factory=list)
    offsets: list[Array] = field(default_factory=list)
    rejected: Counter[str] = field(default_factory=Counter)

    def add(self, found: DetectedLines, true: Array, camera: Camera) -> Array:
        """Judges the lines of one frame; returns which of them are false."""
        stretch = camera.visible_stretch(true)
        in_view = np.flatnonzero(np.ptp(stretch, axis=1) > IN_VIEW_M)
        d = found.z[:, None] - nearest_twin(true[None], found.z[:, None])
        d[..., 1] = wrap(d[..., 1])
        offset = offset_error(d, found.extent.mean(axis=1)[:, None])
        fits = (np.abs(offset) < MATCH_M) & (np.abs(d[..., 1]) < np.radians(MATCH_DEG))
        nearest = np.argmin(np.where(fits, np.abs(offset), np.inf), axis=1)
        right = fits.any(axis=1)
        _, first = np.unique(nearest, return_index=True)
        twice = ~np.isin(np.arange(len(nearest)), first)
        false = ~right | (right & twice)
        self.frames += 1
        self.wanted += len(in_view)
        self.seen += len(np.intersect1d(in_view, nearest[right]))
        self.false += int(false.sum())
        rows = np.flatnonzero(~false)
        self.errors.extend(d[rows, nearest[rows]])
        self.offsets.extend(offset[rows, nearest[rows]])
        self.covariances.extend(found.cov[rows])
        self.rejected.update(found.rejected)
        return np.asarray(false)

    def cells(self) -> list[str]:
        """Returns the figures of the table."""
        e = np.array(self.errors).reshape(-1, 2)
        cov = np.array(self.covariances).reshape(-1, 2, 2)
        nees = np.einsum("ki,kij,kj->k", e, np.linalg.inv(cov), e) / 2.0
        rms = np.sqrt(np.mean(e**2, axis=0)) if len(e) else np.full(2, np.nan)
        offset = np.array(self.offsets)
        return [
            f"{100.0 * self.seen / max(self.wanted, 1):.1f}",
            f"{self.false / self.frames:.3f}",
            f"{1e3 * e[:, 0].mean():+.3f}" if len(e) else "-",
            f"{1e3 * rms[0]:.3f}",
            f"{1e3 * np.sqrt(np.mean(offset**2)):.3f}" if len(e) else "-",
            f"{np.degrees(e[:, 1].mean()):+.4f}" if len(e) else "-",
            f"{np.degrees(rms[1]):.4f}",
            f"{nees.mean():.2f}" if len(e) else "-",
            f"{self.frames / self.seconds:.0f}",
        ]


HEADINGS = (
    "recall %", "false / frame", "bias rho mm", "RMS rho mm", "RMS middle mm", "bias alpha deg",
    "RMS alpha deg", "NEES / 2", "frames / s",
)  # fmt: skip


def frames(
    condition: Condition, size: tuple[int, int], count: int, seed: int = 0
) -> Iterator[tuple[np.ndarray, Array, Camera]]:
    """Yields grey images, the true lines in the robot frame and the camera."""
    scenario = condition.scenario(size)
    camera = camera_of(scenario.camera)
    for floor in range(min(FLOORS, count)):
        rng = np.random.default_rng([seed, floor])
        scenario_here = replace(scenario, light=vary(condition.light, rng))
        grid = pixel_grid(camera, scenario_here.light)
        world = build_world(scenario_here, rng)
        for _ in range(floor, count, FLOORS):
            pose = np.append(rng.uniform(-1.5, 1.5, 2), rng.uniform(-np.pi, np.pi))
            image = render(scenario_here, world, grid, pose, rng.uniform(0.0, 25.0), rng)
            if condition.jpeg:
                options = [cv2.IMWRITE_JPEG_QUALITY, condition.jpeg]
                image = cv2.imdecode(cv2.imencode(".jpg", image, options)[1], 0)
            yield image, line_to_robot(world.lines, pose), camera


def vary(light: Light, rng: np.random.Generator) -> Light:
    """Returns light whose gradient points anywhere."""
    turn, size = rng.uniform(-np.pi, np.pi), np.hypot(*light.gradient)
    return replace(light, gradient=(size * np.cos(turn), size * np.sin(turn)))


def evaluate(condition: Condition, size: tuple[int, int], count: int) -> dict[str, Score]:
    """Returns the score of each detector on the same frames."""
    scores = {name: Score() for name in METHODS}
    config = {
        name: DetectorConfig(
            method=name,
            sigma_law="measured",
            calibration_px=0.0,
            straightness_m=0.0,
            vaguest_alpha_deg=0.8,
        )
        for name in METHODS
    }
    for number, (image, true, camera) in enumerate(frames(condition, size, count)):
        for name in METHODS:
            if not number:
                detect_lines(image, camera, config[name])
            began = time.thread_time()
            found = detect_lines(image, camera, config[name])
            scores[name].seconds += time.thread_time() - began
            scores[name].add(found, true, camera)
    return scores


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=40, help="frames of each condition")
    parser.add_argument("--only", nargs="*", default=list(CONDITIONS), help="conditions")
    parser.add_argument("--sizes", nargs="*", default=list(SIZES), help="sizes of the image")
    parser.add_argument("--why", action="store_true", help="print what was rejected too")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for size in options.sizes:
        print(f"\n| {size} | detector | " + " | ".join(HEADINGS) + " |")
        print("|---" * (len(HEADINGS) + 2) + "|")
        for name in options.only:
            scores = evaluate(CONDITIONS[name], SIZES[size], options.frames)
            for method, score in scores.items():
                print(f"| {name} | {method} | " + " | ".join(score.cells()) + " |", flush=True)
                if options.why:
                    print("   ", {k: v for k, v in score.rejected.items() if v})


if __name__ == "__main__":
    main()
