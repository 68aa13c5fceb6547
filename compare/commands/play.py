"""`graphslam play`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from compare.commands.common import DONE, ConfigFile, Log
from compare.config import RunConfig
from graphslam.errors import BadConfig

if TYPE_CHECKING:
    from compare.console import Progress
    from frontend.show import Show

PAGE = ".html"


@dataclass(frozen=True, slots=True)
class Play:
    """Watch a log: images with what was seen in them, paths and covariance, as it plays.

    In a window where there is one, else as a page or a video. Any log, with any sensors.

    Example: graphslam play my-log --speed 4
    """

    log: Log
    """Log folder, or bag."""
    out: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """File to write instead of opening a window: a page to play, pause and seek in (.html), or a
    video (.mp4, .avi, .webm). Absent, and where no window can be opened:
    results/<log name>-play.html."""
    speed: float = 1.0
    """Seconds of the log in a second of the show."""
    config_file: ConfigFile = None
    """TOML file of settings, as `graphslam config` prints them; flags override it."""
    settings: Annotated[RunConfig, arg(name="")] = field(default_factory=RunConfig)
    """Methods and settings, as of `graphslam run`."""

    def execute(self) -> int:
        """Extracts, estimates, and plays."""
        if not 1e-3 <= self.speed <= 1e4:
            raise BadConfig(f"speed = {self.speed}: must be from 0.001 to 10000")
        from compare.console import Progress, warn
        from compare.play import check_out, make_show
        from frontend.film import has_window, play_in_window

        check_out(self.out)
        with Progress() as progress:
            show = make_show(self.log, self.settings, progress)
            warn(show.name, show.warnings)
            if self.out is not None or not has_window():
                out = self._write(show, progress)
        if self.out is None and has_window():
            play_in_window(show, self.speed)
        else:
            print(out)
        return DONE

    def _write(self, show: Show, progress: Progress) -> Path:
        """Writes page or video and returns where."""
        from compare.play import write_show

        out = self.out or Path("results") / f"{show.name}-play{PAGE}"

        def tell(done: int, total: int) -> None:
            progress(f"{show.name}: {out.name}", done, total)

        write_show(show, out, self.speed, tell)
        return out
