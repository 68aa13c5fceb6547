"""`graphslam calibrate`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import arg

from compare.commands.common import DONE, USAGE, ConfigFile
from graphslam.errors import BadConfig

if TYPE_CHECKING:
    from compare.config import RunConfig

File = Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")]
Flag = tyro.conf.UseCounterAction[int]


@dataclass(frozen=True, slots=True)
class Calibrate:
    """Find the noise that fits a log, its camera's clock, what its directions are off by, or a
    camera.

    Noise of sightings and wheels (LOG --noise) comes from ground truth where the log has it, else
    from the filter's innovations. A camera comes from points of the floor that you measured
    (--points), from round marks in an image (--dots) or from a chessboard (--chessboard).

    The camera's clock (LOG --time-offset) comes from turns while lines are seen. What directions of
    points are off by (LOG --bearings) comes from known poses and landmarks: offset and waves around
    the robot and, from images, the mirror's centre.

    Example: graphslam calibrate my-log --noise --out noise.toml

    Example: graphslam calibrate my-log --time-offset --out clock.toml

    Example: graphslam calibrate my-log --bearings --out bearings.toml

    Example: graphslam calibrate --points points.csv --image floor.png --picture points.png
    """

    log: Annotated[
        Path | None, tyro.conf.Positional, arg(metavar="[LOG]", help_behavior_hint="")
    ] = None
    """Log folder or bag, for --noise, --time-offset and --bearings."""
    noise: Annotated[Flag, arg(help_behavior_hint="")] = 0
    """Find the noise of sightings and wheels."""
    time_offset: Annotated[Flag, arg(help_behavior_hint="")] = 0
    """Find the constant offset between the clocks of camera and wheels, with its sigma."""
    bearings: Annotated[Flag, arg(help_behavior_hint="")] = 0
    """Find what bearings.csv, or the images of an omnidirectional camera, are off by."""
    harmonics: int = 2
    """How many waves around the robot --bearings finds, 0 to 4; from images the mirror's centre
    stands for the first."""
    robot: File = None
    """Robot file of a bag (docs/bags.md), for --noise and --time-offset."""
    points: File = None
    """Find the camera from a table u,v,x,y: raw pixels, and metres in the robot frame (x forward,
    y left, origin midway between the wheels); four points or more."""
    dots: File = None
    """Find the camera from an image of round dots: a table x,y of their centres, as above; columns
    u,v beside them, roughly where each is, help where the dots look alike."""
    chessboard: Annotated[
        tuple[int, int] | None, arg(metavar="ROWS COLUMNS", help_behavior_hint="")
    ] = None
    """Find the camera from an image of a chessboard with so many inner corners."""
    square: Annotated[float | None, arg(metavar="M", help_behavior_hint="")] = None
    """Side of the chessboard's squares, m."""
    board_pose: Annotated[
        tuple[float, float, float] | None, arg(metavar="X Y HEADING", help_behavior_hint="")
    ] = None
    """Where the chessboard's first inner corner lies, m, and the direction of its first row,
    degrees, in the robot frame; further rows follow to the left of it."""
    image: File = None
    """Image of the floor, as the camera gives it."""
    image_size: Annotated[
        tuple[int, int] | None, arg(metavar="WIDTH HEIGHT", help_behavior_hint="")
    ] = None
    """Size of the camera's images, pixels; for --points without --image."""
    lens: File = None
    """TOML file with matrix and distortion of the lens (OpenCV), where they are known."""
    fit_distortion: Annotated[Flag, arg(help_behavior_hint="")] = 0
    """Find one radial coefficient of the lens from the same points."""
    picture: File = None
    """Picture to write (.png or .jpg): the points, and how far off the camera puts them."""
    out: File = None
    """TOML file to write: settings for `graphslam run LOG --config FILE`, or [camera] for
    log.toml."""
    config_file: ConfigFile = None
    """TOML file of settings to begin from, as `graphslam config` prints them; for --noise and
    --time-offset."""

    def execute(self) -> int:
        """Prints what was found and, where asked to, writes it."""
        ways = {
            "--noise": bool(self.noise),
            "--time-offset": bool(self.time_offset),
            "--bearings": bool(self.bearings),
            "--points": self.points is not None,
            "--dots": self.dots is not None,
            "--chessboard": self.chessboard is not None,
        }
        given = [name for name, there in ways.items() if there]
        if len(given) != 1:
            found = " and ".join(given) or "none of them"
            return _wrong(f"calibrate needs one of {', '.join(ways)}: what to find; found {found}")
        of_log = bool(self.noise or self.time_offset or self.bearings)
        if (self.log is None) == of_log:
            return _wrong("LOG goes with --noise, --time-offset or --bearings, and these with LOG")
        for file in (self.out, self.picture):
            if file is not None and file.is_dir():
                raise BadConfig(f"{file}: is a folder; give a file to --out and --picture")
        if self.time_offset:
            return self._time_offset()
        if self.bearings:
            return self._bearings()
        return self._noise() if self.noise else self._camera()

    def _noise(self) -> int:
        from compare.calibration import calibrate_noise, noise_toml, print_noise
        from compare.console import Progress
        from compare.opening import open_as

        assert self.log is not None, "checked before"
        config = self._config()
        with Progress() as progress:
            log = open_as(self.log, config, progress)
            found = calibrate_noise(log, config, progress)
        print_noise(found, log)
        if self.out is not None:
            _write(self.out, noise_toml(found, log.name).encode())
        return DONE

    def _time_offset(self) -> int:
        from compare.console import Progress
        from compare.opening import open_as
        from compare.time_offset import estimate_time_offset, offset_toml, print_offset

        assert self.log is not None, "checked before"
        config = self._config()
        config = replace(config, extract=replace(config.extract, camera_offset_s=0.0))
        with Progress() as progress:
            log = open_as(self.log, config, progress)
            found = estimate_time_offset(log, config, progress)
        print_offset(found, log)
        if self.out is not None:
            _write(self.out, offset_toml(found, config, log.name).encode())
        return DONE

    def _bearings(self) -> int:
        from compare.bearing_calibration import bearing_toml, print_bearings
        from compare.console import Progress
        from compare.opening import open_as
        from frontend.calibrate_bearings import calibrate_bearings

        assert self.log is not None, "checked before"
        config = self._config()
        with Progress() as progress:
            log = open_as(self.log, config, progress)
            found = calibrate_bearings(log, config.extract, self.harmonics)
        print_bearings(found, log, config.extract.omni)
        if self.out is not None:
            _write(self.out, bearing_toml(found, log.name).encode())
        return DONE

    def _config(self) -> RunConfig:
        from compare.config import RunConfig, load_config

        config = RunConfig() if self.config_file is None else load_config(self.config_file)
        if self.robot is not None:
            config = replace(config, extract=replace(config.extract, robot=str(self.robot)))
        return config

    def _camera(self) -> int:
        from compare.camera_calibration import calibrate_floor, print_camera
        from frontend.calibrate import camera_toml
        from frontend.calibrate_picture import calibration_picture, encoded
        from frontend.calibrate_target import read_image

        found = calibrate_floor(
            points=self.points,
            dots=self.dots,
            chessboard=self.chessboard,
            square=self.square,
            board_pose=self.board_pose,
            image=self.image,
            image_size=self.image_size,
            lens=self.lens,
            fit_distortion=bool(self.fit_distortion),
        )
        print_camera(found)
        if self.out is not None:
            _write(self.out, camera_toml(found).encode())
        if self.picture is not None:
            grey = None if self.image is None else read_image(self.image)
            _write(self.picture, encoded(calibration_picture(found, grey), self.picture))
        return DONE


def _wrong(text: str) -> int:
    print(f"graphslam: error: {text}", file=sys.stderr)
    return USAGE


def _write(file: Path, content: bytes) -> None:
    from compare.folders import whole_file, writing

    with writing(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(file) as beside:
            beside.write_bytes(content)
    print(file)
