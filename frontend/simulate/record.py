"""A simulated drive as a log folder."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np

from frontend.camera import Camera
from frontend.readers.log_toml import FORMAT as LOG_FORMAT
from frontend.simulate.drive import TIME_DECIMALS, Drive, drive
from frontend.simulate.render import pixel_grid, render
from frontend.simulate.scenario import Scenario
from frontend.simulate.view import camera_of
from frontend.simulate.world import World, build_world
from graphslam.errors import BadConfig
from graphslam.geometry import Array

Progress = Callable[[int, int], None]


def simulate(
    scenario: Scenario, out: Path | str, seed: int = 0, progress: Progress | None = None
) -> Path:
    """Returns the log folder that one drive of a scenario was written to.

    The folder is written beside its final place and renamed when whole. The same scenario and seed
    give the same bytes.

    Args:
        scenario: what to simulate.
        out: the folder to make; it must not exist.
        seed: decides wheel noise, slip, the floor's patterns and the pixels' noise, each by a
            stream of its own; not negative.
        progress: called after each image with how many are done, and of how many.

    Raises:
        BadConfig: the folder exists or cannot be made, or the scenario's camera is none.
    """
    if seed < 0:
        raise BadConfig(f"seed = {seed}: must be 0 or more")
    out = Path(out)
    _refuse_existing(out)
    camera = camera_of(scenario.camera)
    wheels, slip, patterns, pixels = map(
        np.random.default_rng, np.random.SeedSequence(seed).spawn(4)
    )
    run = drive(scenario, wheels, slip)
    world = build_world(scenario, patterns)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as beside:
            folder = Path(beside) / "log"
            folder.mkdir()
            _write_tables(folder, scenario, camera, run, world)
            _write_images(folder, scenario, camera, run, world, pixels, progress)
            _refuse_existing(out)
            folder.rename(out)
    except OSError as reason:
        raise BadConfig(
            f"{out}: cannot be written ({reason.strerror}); choose another folder"
        ) from reason
    return out


def _refuse_existing(out: Path) -> None:
    if out.exists() or out.is_symlink():
        raise BadConfig(f"{out}: exists already; choose another folder, or remove this one first")


def _write_tables(
    folder: Path, scenario: Scenario, camera: Camera, run: Drive, world: World
) -> None:
    _write(folder / "log.toml", _log_toml(scenario, camera))
    wheels = np.column_stack([run.wheel_t, run.wheel_angle])
    row = f"{{:.{TIME_DECIMALS}f}},{{:.12f}},{{:.12f}}"
    _write(folder / "wheels.csv", ["t,left,right", *(row.format(*values) for values in wheels)])
    images = (
        f"{t:.{TIME_DECIMALS}f},{_image_file(scenario, i)}" for i, t in enumerate(run.image_t)
    )
    _write(folder / "images.csv", ["t,file", *images])
    lines = (f"{i},{rho:.12f},{alpha:.12f}" for i, (rho, alpha) in enumerate(world.lines))
    _write(folder / "map.csv", ["line,rho,alpha", *lines])
    half = 0.5 * run.pose[:, 2]
    tum = np.column_stack([run.t, run.pose[:, :2], np.sin(half), np.cos(half)])
    row = f"{{:.{TIME_DECIMALS}f}} {{:.12f}} {{:.12f}} 0 0 0 {{:.12f}} {{:.12f}}"
    _write(folder / "groundtruth.tum", (row.format(*values) for values in tum))


def _write_images(
    folder: Path,
    scenario: Scenario,
    camera: Camera,
    run: Drive,
    world: World,
    rng: np.random.Generator,
    progress: Progress | None,
) -> None:
    (folder / "images").mkdir()
    grid = pixel_grid(camera, scenario.light)
    quality = scenario.camera.jpeg_quality
    options = [cv2.IMWRITE_JPEG_QUALITY, quality] if quality else []
    poses = run.pose_at_images()
    for i, (t, pose) in enumerate(zip(run.image_t, poses, strict=True)):
        image = render(scenario, world, grid, pose, float(t), rng)
        file = folder / _image_file(scenario, i)
        file.write_bytes(cv2.imencode(file.suffix, image, options)[1].tobytes())
        if progress is not None:
            progress(i + 1, len(poses))


def _image_file(scenario: Scenario, number: int) -> str:
    return f"images/{number:06d}.{'jpg' if scenario.camera.jpeg_quality else 'png'}"


def _log_toml(scenario: Scenario, camera: Camera) -> list[str]:
    robot, start = scenario.robot, scenario.start
    lines = [f'format = "{LOG_FORMAT}"', f'name = "{scenario.name}"']
    names = ("wheel_radius_left", "wheel_radius_right", "wheel_base", "noise_left", "noise_right")
    lines += ["", "[robot]", *(f"{name} = {_toml(getattr(robot, name))}" for name in names)]
    lines += [f'law = "{robot.law}"', f"slip = {_toml(robot.slip)}"]
    lines += ["", "[camera]", f"image_size = {list(camera.image_size)}"]
    for name in ("homography", "matrix", "distortion"):
        array = getattr(camera, name)
        if array is not None:
            lines.append(f"{name} = {_toml(array)}")
    if start.known:
        pose = [start.x, start.y, np.deg2rad(start.heading_deg)]
        lines += ["", "[start]", f"pose = {_toml(pose)}", "sigma = [0.0, 0.0, 0.0]"]
    return lines


def _toml(value: float | Sequence[float] | Array) -> str:
    if np.ndim(value) == 0:
        return repr(float(value))  # type: ignore[arg-type]
    return f"[{', '.join(_toml(v) for v in value)}]"  # type: ignore[union-attr]


def _write(path: Path, lines: Iterable[str]) -> None:
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8", newline="\n")
