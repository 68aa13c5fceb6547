"""Folders and files that come to their place whole, and what killed processes left of them."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp
from typing import TextIO

LOCK = "lock"
"""File in a working folder; locked while the process that writes there lives."""

SPACE, ACCESS = "free some space, or give another --out", "give an --out that you may write to"
WRITE_CURES = {
    errno.ENOSPC: SPACE,
    errno.EDQUOT: SPACE,
    errno.EACCES: ACCESS,
    errno.EPERM: ACCESS,
    errno.EROFS: ACCESS,
    errno.ENOTDIR: "part of this path is a file; give another --out",
    errno.EEXIST: "part of this path is a file; give another --out",
    errno.EISDIR: "this is a folder; give another --out",
    errno.ENAMETOOLONG: "give a shorter --out",
}
"""What to do about errors of writing."""


def recover(folder: Path) -> None:
    """Removes what killed processes left beside ``folder``, and puts back the result they moved.

    A process that is killed between moving the earlier result away and the new one to its place
    leaves the earlier one in its working folder; it is found there. The working folder of a process
    that still runs is left alone: it holds a lock that the system releases with the process.
    """
    folder = folder.resolve()
    ours = re.compile(re.escape(f".{folder.name}.partial-") + "[a-z0-9_]{8}")
    try:
        names = [name for name in os.listdir(folder.parent) if ours.fullmatch(name)]  # noqa: PTH208
    except OSError:
        return
    for left in (folder.parent / name for name in sorted(names)):
        if left.is_symlink() or not _abandoned(left / LOCK):
            continue
        with suppress(OSError):
            if (left / "old").exists() and not folder.exists():
                (left / "old").rename(folder)
            shutil.rmtree(left)


@contextmanager
def writing(folder: Path, stands_for: Path | None = None) -> Iterator[None]:
    """Makes errors of writing name the place as the user knows it, and the cure.

    Args:
        folder: what is written.
        stands_for: a folder in whose place ``folder`` will stand.

    Raises:
        OSError: with file, reason and cure.
    """
    try:
        yield
    except OSError as reason:
        cure = WRITE_CURES.get(reason.errno or 0)
        if cure is None or cure in str(reason):
            raise
        path = Path(os.fsdecode(reason.filename)) if reason.filename else folder
        if stands_for is not None and path.is_relative_to(stands_for):
            path = folder / path.relative_to(stands_for)
        raise OSError(reason.errno, f"{reason.strerror}; {cure}", str(path)) from reason


@contextmanager
def working_folder(folder: Path) -> Iterator[Path]:
    """Gives a folder beside ``folder``, locked while this process lives; then removes it.

    It takes the name that `recover` looks for only when it is locked.
    """
    made = Path(mkdtemp(prefix=f".{folder.name}.begin-", dir=folder.parent))
    beside = made.with_name(made.name.replace(".begin-", ".partial-"))
    with (made / LOCK).open("x") as lock:
        _lock(lock)
        made.rename(beside)
        try:
            yield beside
        finally:
            shutil.rmtree(beside, ignore_errors=True)
    shutil.rmtree(beside, ignore_errors=True)  # where an open file cannot be removed


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Gives a path beside ``path`` to write to; the file takes its place when it is whole."""
    beside = path.with_name(f".{path.name}.partial")
    yield beside
    beside.replace(path)


def _lock(stream: TextIO) -> None:
    """Locks a file, without waiting, until it is closed; OSError where another process has."""
    try:
        import fcntl
    except ImportError:  # Windows: an open file cannot be removed there, which tells as much
        return
    fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _abandoned(lock: Path) -> bool:
    """Returns whether there is a lock and no process holds it."""
    try:
        with lock.open("r+") as stream:
            _lock(stream)
        if os.name == "nt":
            lock.unlink()
    except OSError:
        return False
    return True
