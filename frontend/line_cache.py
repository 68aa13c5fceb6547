"""Lines found in images, kept from run to run under the hash of all that decides them.

The cache is a help, never a source of errors: what cannot be read, is damaged or cannot be written
counts as not there.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import tempfile
from contextlib import suppress
from dataclasses import asdict
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np

from frontend.config import DetectorConfig
from frontend.detected import DetectedLines
from frontend.images import image_digest
from frontend.log import Log
from frontend.search import Found
from graphslam import geometry
from graphslam.measurements import IntArray

FOLDER = "GRAPHSLAM_CACHE"
"""Environment variable that names the cache's folder in place of the usual one."""
MOST_BYTES = 200_000_000
"""The entries that were written first go when there are more bytes than this."""
ENTRY = re.compile(r"[0-9a-f]{64}|\.lines-\w+")  # whole ones, and those being written
PARTS = ("z", "cov", "extent", "quality", "source", "unreadable", "rejected")


def cache_folder() -> Path:
    """Returns the folder of the cache, which may not exist.

    That of `FOLDER`, else ``graphslam/lines`` in the user's cache (``$XDG_CACHE_HOME``, on Windows
    ``%LOCALAPPDATA%``, else ``~/.cache``).
    """
    if given := os.environ.get(FOLDER):
        return Path(given)
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return Path(base or Path.home() / ".cache") / "graphslam" / "lines"


def cache_key(log: Log, numbers: IntArray, detector: DetectorConfig) -> str:
    """Returns the SHA-256 of all that decides which lines are found, hexadecimal.

    The bytes of the images and their order, the cameras, the configuration, and the code.
    """
    assert log.images is not None, "only logs with images are searched"
    total = hashlib.sha256()
    said = {"detector": asdict(detector), "code": _code(), "numbers": numbers.tolist()}
    total.update(json.dumps(said, sort_keys=True).encode())
    names = [log.images.camera[number] for number in numbers.tolist()]
    for name in sorted(set(names)):
        camera = log.cameras[name]
        total.update(f"{name} {camera.lens} {camera.image_size} {camera.ignore_px}".encode())
        for array in (camera.homography, camera.matrix, camera.distortion):
            total.update(b"none" if array is None else array.tobytes())
    for name, number in zip(names, numbers.tolist(), strict=True):
        total.update(f"{name} {image_digest(log.images.file[number])}\n".encode())
    return total.hexdigest()


def load(key: str) -> Found[DetectedLines] | None:
    """Returns what is kept under a key; None where there is nothing, or nothing whole."""
    try:
        digest, content = (cache_folder() / key).read_bytes().split(b"\n", 1)
    except (OSError, ValueError):
        return None
    if digest != _sum(key, content).encode():
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        parts = {name: arrays[name] for name in PARTS}
    lines = DetectedLines(
        parts["z"],
        parts["cov"],
        parts["extent"],
        parts["quality"],
        json.loads(parts["rejected"].tobytes()),
    )
    return Found(lines, parts["source"], int(parts["unreadable"]))


def keep(key: str, found: Found[DetectedLines]) -> None:
    """Keeps what was found under a key; does nothing where the folder cannot be written."""
    lines, stream = found.seen, io.BytesIO()
    arrays = {name: getattr(lines, name) for name in ("z", "cov", "extent", "quality")}
    reasons = json.dumps(dict(lines.rejected)).encode()
    np.savez(
        stream,
        **arrays,
        source=found.source,
        unreadable=np.array(found.unreadable),
        rejected=np.frombuffer(reasons, np.uint8),
    )
    content, folder = stream.getvalue(), cache_folder()
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        handle, beside = tempfile.mkstemp(prefix=".lines-", dir=folder)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_sum(key, content).encode() + b"\n" + content)
            Path(beside).replace(folder / key)
        finally:
            Path(beside).unlink(missing_ok=True)
        _shrink(folder)


def _sum(key: str, content: bytes) -> str:
    return hashlib.sha256(key.encode() + content).hexdigest()


def _shrink(folder: Path) -> None:
    """Removes the oldest entries while there are more than `MOST_BYTES`; never another file."""
    files = (file for file in folder.iterdir() if ENTRY.fullmatch(file.name) and file.is_file())
    entries = sorted((file.stat().st_mtime, file.stat().st_size, file) for file in files)
    total = sum(size for _, size, _ in entries)
    for _, size, entry in entries:
        if total <= MOST_BYTES:
            return
        entry.unlink(missing_ok=True)
        total -= size


@lru_cache(maxsize=1)
def _code() -> str:
    """Returns the hash of the code that finds lines, and of the versions of what it calls."""
    total = hashlib.sha256(f"{cv2.__version__} {np.__version__} {version('numba')}".encode())
    for file in (*sorted(Path(__file__).parent.glob("*.py")), Path(geometry.__file__)):
        total.update(file.read_bytes())
    return total.hexdigest()
