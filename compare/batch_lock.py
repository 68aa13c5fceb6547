"""One at a time: processes that would write the same result wait for each other."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO


@contextmanager
def alone_at(folder: Path) -> Iterator[None]:
    """Waits until no other process is at work on ``folder``, then keeps the others waiting.

    The lock is the system's: it ends with the process, however that ends. Where a file system has
    none (and on Windows) nobody waits; two who write one result then do the work twice, and the
    folder of the later one stays.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    path = folder.with_name(f".{folder.name}.lock")
    stream = _locked(path)
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        stream.close()


def _locked(path: Path) -> IO[str]:
    """Returns the open file that is ``path`` and locked, for as long as it is open."""
    while True:
        stream = path.open("a")
        try:
            import fcntl

            fcntl.flock(stream, fcntl.LOCK_EX)
        except (ImportError, OSError):
            return stream
        with suppress(OSError):  # whoever had it removed it when done, and a third may have made it
            if os.path.samestat(os.fstat(stream.fileno()), path.stat()):
                return stream
        stream.close()
