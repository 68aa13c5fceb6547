"""The logs that a batch is given: folders, patterns, and lists in text files."""

from __future__ import annotations

import glob
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from frontend.strict import read_text
from graphslam.errors import BadConfig

LIST_LIMIT = 64 * 2**20  # bytes of a list of paths


@dataclass(frozen=True, slots=True)
class NamedLog:
    """One log of a batch.

    Attributes:
        name: its name in the tables, and that of its result folder; unique in the batch.
        path: where it is, absolute; whether it is a log shows when it is opened.
    """

    name: str
    path: Path


def find_logs(given: Sequence[Path | str]) -> tuple[NamedLog, ...]:
    """Returns the logs that are meant, each once, in the order given.

    Args:
        given: each a log; a folder of logs and bags, which stands for those in it, sorted; a
            pattern such as ``day*/run?``, sorted; or a file that ends in .txt with one of these a
            line, relative to that file, empty lines and those that begin with # left out.

    Logs are called as their folders (files: without ending); of several alike, the second and
    later get -2, -3, ... in their order.

    Raises:
        BadConfig: nothing is given, a list cannot be read, or a pattern fits nothing.
    """
    paths = dict.fromkeys(path.resolve() for text in given for path in _meant(Path(text)))
    if not paths:
        raise BadConfig("no log is given; name log folders, patterns, or a .txt file of paths")
    return tuple(_named(paths))


def _meant(given: Path) -> Iterator[Path]:
    if given.suffix == ".txt" and not given.is_dir():
        yield from _listed(given)
    elif glob.has_magic(str(given)) and not given.exists():
        found = sorted(glob.glob(str(given), recursive=True))  # noqa: PTH207  absolute ones, too
        if not found:
            raise BadConfig(f"{given}: no file or folder fits; check the pattern")
        for path in found:
            yield from _inside(Path(path))
    else:
        yield from _inside(given)


def _listed(path: Path) -> Iterator[Path]:
    for line in read_text(path, BadConfig, LIST_LIMIT).splitlines():
        text = line.strip()
        if text and not text.startswith("#"):
            yield from _meant(path.parent / Path(text).expanduser())


def _inside(path: Path) -> Iterable[Path]:
    """Returns the logs in a folder of logs; of all else, the path itself."""
    if not path.is_dir() or (path / "log.toml").exists():
        return [path]
    from frontend.readers.bag_files import METADATA, is_bag

    try:
        if (path / METADATA).is_file():  # without it, loose files are a bag each
            return [path]
        logs = [below.parent for below in path.glob("*/log.toml")]
        return sorted({*logs, *(below for below in path.iterdir() if is_bag(below))}) or [path]
    except OSError:
        return [path]


def _named(paths: Iterable[Path]) -> Iterator[NamedLog]:
    taken: set[str] = set()
    for path in paths:
        base = path.stem if path.is_file() else path.name
        name, number = base or "log", 1
        while name.casefold() in taken:
            number += 1
            name = f"{base}-{number}"
        taken.add(name.casefold())
        yield NamedLog(name, path)
