"""A log opened as settings say, and the settings that suit a log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from compare.clock import Progress
from compare.config import RunConfig
from frontend.log import Log, is_log_folder, open_log, with_camera_offset


def open_as(
    path: Path | str, config: RunConfig | None = None, progress: Progress | None = None
) -> Log:
    """Returns a log, opened as the settings say: with their robot file and clock of the camera.

    Args:
        path: the log.
        config: its ``extract`` part counts; None for the defaults.
        progress: told how much of a bag is read.
    """
    settings = (config or RunConfig()).extract
    tell = None if progress is None else reading(progress, Path(path).name)
    return with_camera_offset(open_log(path, settings.robot, tell), settings.camera_offset_s)


def reading(progress: Progress, name: str) -> Callable[[int, int], None]:
    """Returns what tells the progress of reading a bag, in MB, from bytes."""
    return lambda done, total: progress(f"{name}: read, MB", -(-done // 10**6), -(-total // 10**6))


def settings_for(path: Path | str, config: RunConfig) -> RunConfig:
    """Returns the settings of one log among several: a robot file is for bags only.

    Log folders describe their robot themselves.
    """
    if config.extract.robot is None or not is_log_folder(Path(path)):
        return config
    return replace(config, extract=replace(config.extract, robot=None))


def suited(config: RunConfig, log: Log) -> RunConfig:
    """Returns a configuration with a laser's methods, if the log is one and none were chosen."""
    if not log.has_walls() or config.methods != RunConfig().methods:
        return config
    return replace(config, methods=config.laser_methods)
