"""Which files a bag is made of, told by their content, never by their names alone."""

from __future__ import annotations

import re
from pathlib import Path

from frontend.readers import bag_mcap, bag_ros1, bag_sqlite
from frontend.readers.bag_parts import Container, Losses, check_file
from graphslam.errors import BadLog

METADATA = "metadata.yaml"
METADATA_LIMIT = 16 * 2**20  # bytes
LONGEST_MAGIC = 16
PACKED = {
    b"\x28\xb5\x2f\xfd": "zstd -d",
    b"\x1f\x8b": "gunzip",
    b"BZh": "bunzip2",
    b"PK\x03\x04": "unzip",
}
"""First bytes of packed files, and what unpacks them."""


def is_bag(path: Path) -> bool:
    """Returns whether a path holds a bag, or what is left of one."""
    if path.is_dir():
        return (path / METADATA).is_file() or bool(_bag_files(path))
    if not path.is_file():
        return False
    known_name = path.suffix in (".bag", ".mcap", ".db3") or path.name == METADATA
    return known_name or kind_of(path) is not None


def kind_of(path: Path) -> str | None:
    """Returns "ros1", "mcap" or "sqlite" by a file's first bytes, or None."""
    with path.open("rb") as stream:
        head = stream.read(LONGEST_MAGIC)
    for kind, module in (("ros1", bag_ros1), ("mcap", bag_mcap), ("sqlite", bag_sqlite)):
        if head.startswith(module.MAGIC):
            return kind
    return None


def files_of(path: Path, losses: Losses) -> list[Container]:
    """Returns the files of a bag, in the order of the recording.

    Args:
        path: a bag's file, or the folder of a ROS 2 bag.
        losses: where files that are missing are noted.

    Raises:
        BadLog: there is no bag; the message says what is there instead.
    """
    if path.name == METADATA:
        path = path.parent
    compressed = False
    if path.is_dir():
        told = _metadata(path)
        mode = re.search(r"compression_mode:\s*['\"]?(\w+)", told)
        compressed = mode is not None and mode[1].upper() == "MESSAGE"
        paths = _bag_files(path)
        named = re.findall(r"^\s*-\s+['\"]?([^'\"\s]+\.(?:db3|mcap))['\"]?\s*$", told, re.MULTILINE)
        for name in sorted({Path(name).name for name in named} - {file.name for file in paths}):
            losses.add("a file that metadata.yaml lists is not there", name)
        if not paths:
            packed = sorted(path.glob("*.zstd"))
            cure = "copy the bag's files again"
            if packed:
                cure = f"unpack it: zstd -d {packed[0].name}"
            raise BadLog(f"{path}: holds no .db3 or .mcap file; {cure}")
    else:
        paths = [path]
    found: list[Container] = []
    for number, file in enumerate(paths):
        check_file(file)
        kind = kind_of(file)
        if kind == "ros1":
            found.append(bag_ros1.Ros1File(file, number))
        elif kind == "mcap":
            found.append(bag_mcap.McapFile(file, number))
        elif kind == "sqlite":
            found.append(bag_sqlite.SqliteFile(file, number, compressed))
        else:
            raise BadLog(f"{file}: {_what_else(file)}")
    return found


def _bag_files(folder: Path) -> list[Path]:
    """Returns the bag files in a folder by number: bag_2 comes before bag_10."""
    found = [p for p in folder.iterdir() if p.suffix in (".db3", ".mcap") and p.is_file()]
    return sorted(found, key=lambda p: (len(p.name), p.name))


def _metadata(folder: Path) -> str:
    """Returns the text that lies beside a bag's files; of a damaged one what can be read."""
    path = folder / METADATA
    if not path.is_file():
        return ""
    with path.open("rb") as stream:
        return stream.read(METADATA_LIMIT).decode("utf-8", "replace")


def _what_else(path: Path) -> str:
    with path.open("rb") as stream:
        head = stream.read(LONGEST_MAGIC)
    if head.startswith(b"#ROSBAG V1"):
        return "is a bag of format 1, from before 2010; convert it: rosbag fix OLD NEW"
    for magic, cure in PACKED.items():
        if head.startswith(magic):
            return f"is packed; unpack it first: {cure} {path.name}"
    return (
        "is no bag: its first bytes are none of a ROS 1 bag, an MCAP file or an SQLite data base; "
        "its beginning was overwritten, or it is another kind of file: copy it again from the robot"
    )
