"""Configuration of a whole run: one tree of frozen dataclasses, the same in files and flags.

Only the standard library is imported here, so that `graphslam --help` answers at once.
"""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal

from frontend.config import ExtractConfig
from frontend.strict import from_dict, load_toml
from graphslam.config import (
    EkfConfig,
    IncrementalConfig,
    LongConfig,
    ParticleConfig,
    SmootherConfig,
)
from graphslam.errors import BadConfig

Method = Literal[
    "odometry",
    "geometric",
    "ekf",
    "ekf-naive",
    "ekf-fej",
    "ekf-robot",
    "particle",
    "triangulation",
    "fixes",
    "isam2",
    "fixed-lag",
    "smoother",
    "ekf-window",
    "loops",
]


@dataclass(frozen=True, slots=True)
class RunConfig:
    """Everything that decides what a run computes from a log."""

    methods: tuple[Method, ...] = ("odometry", "ekf", "smoother")
    """Methods to run and compare. odometry: the wheels alone. ekf: EKF-SLAM, causal.
    ekf-naive: the same, taking late sightings for ones of the moment they arrive. ekf-fej,
    ekf-robot: EKF-SLAM with covariances that stay honest, by first-estimates Jacobians or by
    correcting what the robot sees. isam2: smoothing as the robot drives, causal. fixed-lag: the
    same, each pose told a few seconds late. smoother: the factor graph over the whole log, started
    from the filter's result. On a known map only: geometric, the pose from the lines by
    trigonometry; particle, Monte Carlo localisation. On known points only: triangulation, each
    pose from its own bearings, without memory. With pose fixes only: fixes, each pose as an
    overhead camera reads it, without memory."""
    laser_methods: tuple[Method, ...] = ("odometry", "ekf-window", "loops")
    """What methods stands for, where it is left as it is, on a log whose lines are a laser's walls.
    ekf-window: odometry calibrated by itself, and a filter that forgets what was left behind.
    loops: from there to a map with all loops closed that can be, all matches decided again."""
    known_map: str | None = None
    """A map to localise on: a map.csv, or the result folder of one method. Its lines stay where
    they are; sightings of none of them are dropped and counted (see ekf.extend_map)."""
    places: str | None = None
    """A map of corridors, .toml (docs/lamps.md): its lamps are known landmarks where the log lists
    none, and the report tells by name where the robot was, and which lamps are out of order."""
    extract: ExtractConfig = field(default_factory=ExtractConfig)
    """Recording to measurements."""
    ekf: EkfConfig = field(default_factory=EkfConfig)
    """EKF-SLAM."""
    smoother: SmootherConfig = field(default_factory=SmootherConfig)
    """Full smoothing by a factor graph."""
    incremental: IncrementalConfig = field(default_factory=IncrementalConfig)
    """Smoothing as the robot drives, node by node (isam2, fixed-lag)."""
    long: LongConfig = field(default_factory=LongConfig)
    """Long logs: self-calibration, the filter's window, loops (ekf-window, loops)."""
    particle: ParticleConfig = field(default_factory=ParticleConfig)
    """Monte Carlo localisation on a known map."""

    def __post_init__(self) -> None:
        if not self.methods:
            raise BadConfig("methods is empty; name at least one of odometry, ekf, smoother")
        object.__setattr__(self, "methods", tuple(dict.fromkeys(self.methods)))
        if not self.laser_methods:
            raise BadConfig("laser_methods is empty; name at least one, such as loops")


def load_config(path: Path | str) -> RunConfig:
    """Returns the defaults with what a TOML file changes.

    Raises:
        BadConfig: the file cannot be read, or holds an unknown key or a wrong value at any depth.
    """
    return from_dict(RunConfig, load_toml(path), str(path))


def to_toml(config: Any) -> str:
    """Returns a configuration as TOML that `load_config` reads, every value with its meaning.

    What is None has no form in TOML and stands in a comment: ``# from_s =``.
    """
    return "\n".join(_table(config, "")).strip() + "\n"


def field_docs(cls: type[Any]) -> dict[str, str]:
    """Returns the docstring below each field of a dataclass on one line, by field name."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    if not isinstance(tree, ast.ClassDef):
        return {}
    docs: dict[str, str] = {}
    for this, following in zip(tree.body, tree.body[1:], strict=False):
        named = isinstance(this, ast.AnnAssign) and isinstance(this.target, ast.Name)
        if named and isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            docs[this.target.id] = " ".join(str(following.value.value).split())
    return docs


def _table(config: Any, name: str) -> Iterator[str]:
    docs = field_docs(type(config))
    values = {f.name: getattr(config, f.name) for f in fields(config)}
    for key, value in values.items():
        if not is_dataclass(value):
            yield from textwrap.wrap(
                docs.get(key, ""), 92, initial_indent="# ", subsequent_indent="# "
            )
            yield f"# {key} =" if value is None else f"{key} = {_value(value)}"
            yield ""
    for key, value in values.items():
        if is_dataclass(value):
            yield f"[{name}{key}]"
            yield from _table(value, f"{name}{key}.")


def _value(value: Any) -> str:
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False)
    return repr(value)
