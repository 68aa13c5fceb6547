"""What the containers of bags have in common: channels, messages, their places, and losses.

The containers are walked here, not by `rosbags`, for what its readers do not do: they refuse a bag
without an index or an end, order messages by their receive time, and find no single message again
without a search. Messages themselves are its business (`bag_types.py`).
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

from graphslam.errors import BadLog

LARGEST_RECORD = 256 * 2**20
"""Bytes of a message, or of a chunk as it is recorded or decompressed: no robot's is larger, and
what a damaged file declares is not believed beyond it."""
BLOCK = 2**20  # bytes that a search for the next whole record looks at a time

Progress = Callable[[int, int], None]


class Broken(Exception):
    """Bytes that are no record; the text says what is wrong with them."""


class CutOff(Broken):
    """A record that declares more bytes than are left; its beginning may be of use."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One stream of messages.

    Attributes:
        topic: its name.
        type: of its messages, as ROS 2 writes it (``sensor_msgs/msg/Image``).
        encoding: of its messages, "ros1" or "cdr"; anything else cannot be read.
        definition: text of the type's definition, empty where the bag has none.
        md5: ROS 1's checksum of the definition, or empty.
    """

    topic: str
    type: str
    encoding: str
    definition: str = ""
    md5: str = ""


class Place(NamedTuple):
    """Where a message is.

    Attributes:
        file: number of the file of the bag.
        chunk: offset in the file of the record of its chunk, or -1 where it is in none.
        offset: of the message's bytes in the file, or in the decompressed chunk; in a data base,
            its row.
        size: bytes.
    """

    file: int
    chunk: int
    offset: int
    size: int


class Message(NamedTuple):
    """A message as it is recorded.

    Attributes:
        channel: its stream.
        received_ns: when it was received, ns since 1970 or since the clock's zero.
        data: its bytes, valid until the next message.
        place: where it is.
    """

    channel: Channel
    received_ns: int
    data: memoryview
    place: Place


@dataclass(slots=True)
class Losses:
    """What could not be read of a bag, by reason, with the place of the first.

    Attributes:
        count: how often, by reason.
        first: where first, by reason.
    """

    count: dict[str, int] = field(default_factory=dict)
    first: dict[str, str] = field(default_factory=dict)

    def add(self, reason: str, place: str) -> None:
        """Notes a loss."""
        self.count[reason] = self.count.get(reason, 0) + 1
        self.first.setdefault(reason, place)

    def texts(self) -> tuple[str, ...]:
        """Returns one line for each reason."""
        return tuple(
            f"{reason} (first at {self.first[reason]}{f', {n} times in all' if n > 1 else ''})"
            for reason, n in self.count.items()
        )


class Container(Protocol):
    """One file of a bag."""

    path: Path

    def messages(self, losses: Losses, progress: Progress) -> Iterator[Message]:
        """Yields the messages in the file's order; progress is told bytes."""
        ...

    def read(self, place: Place) -> bytes:
        """Returns a message's bytes; raises Broken or OSError where they cannot be read."""
        ...


def decompressed(data: bytes, how: str, size: int) -> bytes:
    """Returns a chunk's content, of which no more than ``size`` bytes are ever made.

    Raises:
        Broken: the way of compression is unknown, or the content has another size.
    """
    if size > LARGEST_RECORD:
        raise Broken(f"a chunk declares {size} bytes, more than any recorder writes")
    if how in ("", "none"):
        content = data
    elif how in _DECOMPRESSORS:
        try:
            content = _DECOMPRESSORS[how](data, size + 1)
        except (OSError, ValueError, EOFError, RuntimeError) as error:
            raise Broken(f"a chunk cannot be decompressed ({how})") from error
    else:
        raise Broken(f"a chunk is compressed by {how!r}; known are none, bz2, lz4, zstd")
    if len(content) != size:
        raise Broken("a chunk has not the size that it declares")
    return content


def decompressed_part(data: bytes, how: str, size: int) -> bytes:
    """Returns what the beginning of a chunk's data holds, at most ``size`` bytes; maybe nothing."""
    size = min(size, LARGEST_RECORD)
    if how in ("", "none"):
        return data[:size]
    try:
        return _DECOMPRESSORS[how](data, size)
    except (KeyError, OSError, ValueError, EOFError, RuntimeError, Broken):
        return b""


def _bz2(data: bytes, most: int) -> bytes:
    return bz2.BZ2Decompressor().decompress(data, most)


def _lz4(data: bytes, most: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    return bytes(LZ4FrameDecompressor().decompress(data, most))


def unzstd(data: bytes, most: int) -> bytes:
    """Returns what zstd packed, at most so many bytes; raises Broken where it is damaged."""
    import sys

    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    try:
        content: bytes = zstd.ZstdDecompressor().decompress(data, most)
    except zstd.ZstdError as error:
        raise Broken("a chunk cannot be decompressed (zstd)") from error
    return content


_DECOMPRESSORS = {"bz2": _bz2, "lz4": _lz4, "zstd": unzstd}


def unpack(layout: struct.Struct, data: bytes | memoryview, offset: int = 0) -> tuple[int, ...]:
    """Returns numbers at an offset; raises Broken where the data end before."""
    try:
        return layout.unpack_from(data, offset)
    except struct.error:
        raise Broken("a record ends before its content does") from None


def check_file(path: Path) -> int:
    """Returns the size of a file, bytes.

    Raises:
        BadLog: it is empty or cannot be looked at.
    """
    try:
        size = path.stat().st_size
    except OSError as reason:
        raise BadLog(f"{path}: cannot be looked at ({reason.strerror}); check the path") from None
    if not size:
        raise BadLog(
            f"{path}: is empty (0 bytes): nothing was written; copy it again from the robot, or "
            "record again"
        )
    return size
