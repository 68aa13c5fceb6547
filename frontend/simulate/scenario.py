"""What a scenario file says: a floor, a robot, its path and what it sees with."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from typing import Literal

from frontend.readers.log_toml import FORMAT as LOG_FORMAT
from frontend.readers.log_toml import LogTable
from frontend.simulate.ceiling import Ceiling
from frontend.simulate.checks import positive
from frontend.simulate.cones import Cone, OmniSpec
from frontend.simulate.floor import FloorLine, Groove, Light, LineGrid, Mess, Surface
from frontend.simulate.sensors import CameraSpec, Encoder, SightingSpec
from frontend.simulate.workspace import OverheadSpec
from graphslam.errors import BadConfig
from graphslam.models.wheels import DifferentialDrive

ESTIMATORS_FLOOR = DifferentialDrive(1.0, 1.0, 1.0).floor


@dataclass(frozen=True, slots=True)
class Start:
    """Where the robot stands at first.

    Attributes:
        x: m, default 0.
        y: m, default 0.
        heading_deg: degrees, default 0.
        known: whether log.toml tells the start, exactly; false leaves [start] out of it, so that
            estimates begin at the origin. Default true.
    """

    x: float = 0.0
    y: float = 0.0
    heading_deg: float = 0.0
    known: bool = True


@dataclass(frozen=True, slots=True)
class Motion:
    """One piece of the path: exactly one of forward, turn_deg, arc_deg and pause.

    Attributes:
        forward: m; negative drives backwards.
        turn_deg: turn on the spot, degrees, counter-clockwise positive.
        arc_deg: turn while driving forwards along a circle, degrees, counter-clockwise positive.
        radius: radius of that circle, m.
        pause: s.
        speed: m/s, instead of the scenario's.
        turn_rate_deg: degrees/s, instead of the scenario's.
    """

    forward: float | None = None
    turn_deg: float | None = None
    arc_deg: float | None = None
    radius: float | None = None
    pause: float | None = None
    speed: float | None = None
    turn_rate_deg: float | None = None

    def __post_init__(self) -> None:
        kinds = ("forward", "turn_deg", "arc_deg", "pause")
        given = [name for name in kinds if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) if given else "none of them"
            raise BadConfig(f"a motion has one of {', '.join(kinds)}; found {found}")
        if (self.arc_deg is None) != (self.radius is None):
            raise BadConfig("arc_deg and radius come together")
        for name in ("radius", "pause", "speed", "turn_rate_deg"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name))


@dataclass(frozen=True, slots=True)
class Scenario:
    """A world, a robot in it, and how it drives and sees.

    Attributes:
        format: the version of this format.
        name: name of the log.
        robot: wheels, base, noise law and slip, as in log.toml; the log's [robot].
        path: motions, one after the other.
        camera: the camera and its images; may be absent where ``sightings`` has reach and rate.
        repeat: how many times the path is driven, default 1.
        start: pose before the first motion.
        lines: single lines; numbered first in map.csv.
        grids: families of parallel lines, numbered after them.
        speed: m/s, default 0.3.
        turn_rate_deg: degrees/s, default 45.
        encoder: the wheel encoders.
        groove: how the lines look.
        surface: the floor between them.
        light: brightness over floor, image and time.
        mess: dirt, shadows and things on the floor; absent: none.
        sightings: how lines are seen where no images are rendered.
        overhead: a camera above the work space, and tags on the robot; absent: none.
        ceiling: lamps and the camera that looks up at them, instead of a floor with lines.
        cones: coloured cones on the floor, numbered in landmarks.csv in this order.
        omni: a camera that sees them all around; absent: none.
    """

    format: Literal["graphslam-scenario/1"]
    name: str
    robot: DifferentialDrive
    path: tuple[Motion, ...]
    camera: CameraSpec | None = None
    repeat: int = 1
    start: Start = field(default_factory=Start)
    lines: tuple[FloorLine, ...] = ()
    grids: tuple[LineGrid, ...] = ()
    speed: float = 0.3
    turn_rate_deg: float = 45.0
    encoder: Encoder = field(default_factory=Encoder)
    groove: Groove = field(default_factory=Groove)
    surface: Surface = field(default_factory=Surface)
    light: Light = field(default_factory=Light)
    mess: Mess | None = None
    sightings: SightingSpec = field(default_factory=SightingSpec)
    overhead: OverheadSpec | None = None
    ceiling: Ceiling | None = None
    cones: tuple[Cone, ...] = ()
    omni: OmniSpec | None = None

    def __post_init__(self) -> None:
        if self.repeat < 1:
            raise BadConfig(f"repeat = {self.repeat}: must be 1 or more")
        self._check_eyes()
        positive("speed", self.speed)
        positive("turn_rate_deg", self.turn_rate_deg)
        if not self.path:
            raise BadConfig("path is empty: list at least one motion, such as { forward = 1.0 }")
        if self.robot.floor != ESTIMATORS_FLOOR:
            raise BadConfig("robot.floor is the estimators' own and not simulated: remove it")
        LogTable(LOG_FORMAT, self.name)  # refuses names that no log may have

    def _check_eyes(self) -> None:
        """Raises BadConfig unless it is clear how often the robot looks, and how far it sees."""
        if (self.omni is None) != (not self.cones):
            raise BadConfig("cones are what [omni] sees: give both, or none of them")
        if self.ceiling is not None:
            if self.camera is not None or self.lines or self.grids:
                raise BadConfig(
                    "a scenario looks at the floor or at the ceiling: remove [ceiling], or "
                    "[camera], lines and grids"
                )
            return
        if self.camera is not None and self.sightings.rate is not None:
            raise BadConfig("sightings.rate is for floors without a camera: remove it or [camera]")
        if self.overhead is None and self.omni is None and not self.sees_lines:
            raise BadConfig(
                "camera is missing; add a table [camera], or give reach and rate under "
                "[sightings], or add [overhead], or [omni] with [[cones]]"
            )

    @property
    def sees_lines(self) -> bool:
        """Whether the robot looks at the floor, by images or by sightings only."""
        return self.camera is not None or None not in (self.sightings.rate, self.sightings.reach)

    @property
    def rate(self) -> float:
        """Frames per second, whether they become images or sightings only.

        Of a robot that does not look at the floor those of another camera.
        """
        rate = self.sightings.rate if self.camera is None else self.camera.rate
        if self.ceiling is not None:
            rate = self.ceiling.camera.rate
        elif not self.sees_lines:
            other = self.omni if self.overhead is None else self.overhead
            rate = None if other is None else other.rate
        assert rate is not None, "checked on entry"
        return rate

    def digest(self) -> str:
        """Returns the SHA-256 of all that the scenario says, hexadecimal."""
        said = asdict(self)
        # these came later: the digests of scenarios without them stay what they were
        for name in ("mess", "overhead", "ceiling", "omni", "cones"):
            if not said[name]:
                del said[name]
        if self.sightings.factor == 1.0:
            del said["sightings"]["factor"]
        if self.camera is not None and self.camera.lens == "plain":
            del said["camera"]["lens"]
        return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()
