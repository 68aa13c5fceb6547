"""Array functions compiled by numba and kept on disk, safely where several processes start at once.

Numba keeps two files for such a function: its code, and a wrapper that calls that code by a name
which differs from process to process. Where two processes compile at the same time, each may leave
one of them, and every later call ends the process without a word. So they take turns.
"""

# mypy: disallow-untyped-calls=False, disallow-any-unimported=False

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba
from filelock import FileLock, Timeout

PATIENCE_S = 180.0
"""How long another process may compile before this one goes ahead, s."""
FOLDERS = (Path(__file__).parent / "__pycache__", Path.home() / ".cache" / "graphslam")
"""Where the lock may lie; the first that can be written."""


def guvectorize(signatures: list[str], layout: str) -> Callable[[Callable[..., None]], Any]:
    """Returns a decorator that makes a function of numba's kind ``guvectorize``, kept on disk.

    Args:
        signatures: types, as numba takes them.
        layout: dimensions, as numba takes them.
    """

    def decorate(function: Callable[..., None]) -> Any:
        with one_at_a_time():
            return numba.guvectorize(signatures, layout, cache=True)(function)

    return decorate


@contextmanager
def one_at_a_time() -> Iterator[None]:
    """Holds a lock between processes; where none can be had, or not soon, goes on without."""
    lock = _lock()
    try:
        yield
    finally:
        if lock is not None:
            lock.release()


def _lock() -> FileLock | None:
    for folder in FOLDERS:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lock = FileLock(folder / "compiling.lock", timeout=PATIENCE_S)
            lock.acquire()
        except (OSError, NotImplementedError, Timeout):
            continue
        return lock
    return None
