"""Scenario files: a user's own, and those that come with the package."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from frontend.simulate.scenario import Scenario
from frontend.strict import from_dict, load_toml, nearest
from graphslam.errors import BadConfig


def scenario_names() -> tuple[str, ...]:
    """Returns the names of the scenarios that are installed with the package, sorted."""
    files = (Path(entry.name) for entry in _folder().iterdir())
    return tuple(sorted(file.stem for file in files if file.suffix == ".toml"))


def load_scenario(path_or_name: str | Path) -> Scenario:
    """Returns a scenario from a TOML file or, by its name, one that came with the package.

    Args:
        path_or_name: a file, or a name of `scenario_names` with or without ".toml"; a file that
            exists comes first.

    Raises:
        BadConfig: there is no such scenario, or the file says something it must not.
    """
    path = Path(path_or_name)
    name = path.name.removesuffix(".toml")
    if not path.is_file() and path.parent == Path() and name in scenario_names():
        with resources.as_file(_folder() / f"{name}.toml") as shipped:
            return from_dict(Scenario, load_toml(shipped), f"scenario {name}")
    if not path.exists() and path.suffix != ".toml":
        raise BadConfig(f"{path}: no such file or scenario; {nearest(name, scenario_names())}")
    return from_dict(Scenario, load_toml(path), str(path))


def _folder() -> Traversable:
    return resources.files("frontend") / "scenarios"
