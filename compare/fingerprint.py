"""Which input, configuration and versions a result was made of, in short."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from dataclasses import asdict, replace
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from compare.config import RunConfig
from compare.map_files import read_map_file
from compare.results import read_run
from frontend.log import Log
from graphslam.errors import BadConfig

PACKAGES = ("floorline-slam", "numpy", "scipy", "numba", "gtsam", "opencv-python-headless")


def versions() -> dict[str, str]:
    """Returns the versions of Python and of every package that a result depends on."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def fingerprints(log: Log, config: RunConfig) -> dict[str, str]:
    """Returns SHA-256, hexadecimal, of all that decides "measurements" and "result".

    Two runs with one fingerprint give the same bytes; how many threads look at images is left out.

    Raises:
        BadConfig: the known map is no map.
    """
    config = replace(config, extract=replace(config.extract, workers=0))
    known, places = config.known_map, config.places
    measurements = _digest(
        log=[log.name, log.digest],
        extract=asdict(config.extract),
        known_map=None if known is None else [known, _digest_of(read_map_file(known).path)],
        versions=versions(),
        **({} if places is None else {"places": [places, _digest_of(Path(places))]}),
    )
    return {
        "measurements": measurements,
        "result": _digest(measurements=measurements, config=asdict(config)),
    }


def holds_result(folder: Path, fingerprint: Mapping[str, str]) -> bool:
    """Returns whether a folder is the finished result of a run with these fingerprints."""
    info = _info(folder)
    finished = bool(info.get("methods")) and (folder / "metrics.json").is_file()
    return finished and info["fingerprints"]["result"] == fingerprint["result"]


def holds_measurements(folder: Path, fingerprint: Mapping[str, str]) -> bool:
    """Returns whether a run left the measurements of these fingerprints in a folder."""
    found = _info(folder).get("fingerprints", {})
    return bool(found.get("measurements") == fingerprint["measurements"])


def _info(folder: Path) -> Mapping[str, Any]:
    """Returns the content of run.json; empty where there is none that tells its fingerprints."""
    try:
        info = read_run(folder)
    except BadConfig:
        return {}
    return info if isinstance(info.get("fingerprints"), dict) else {}


def _digest(**parts: Any) -> str:
    return sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _digest_of(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()
