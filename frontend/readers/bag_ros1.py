"""ROS 1 bags (format 2.0), record by record in the file's order, indexed or not, damaged or not."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from frontend.readers.bag_chunks import ChunkedFile
from frontend.readers.bag_parts import (
    BLOCK,
    LARGEST_RECORD,
    Broken,
    Channel,
    CutOff,
    Losses,
    Message,
    Place,
    Progress,
    decompressed,
    decompressed_part,
    unpack,
)
from frontend.readers.bag_types import normal_type

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
OPS = (MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION)
LARGEST_HEADER = 2**20  # bytes of a record's header fields

_U32 = struct.Struct("<I")
_TIME = struct.Struct("<II")
_CHUNK_OP = b"\x04\0\0\0op=\x05"
_BEFORE_OP = 96  # bytes of a chunk's header that may stand before its op


class Ros1File(ChunkedFile):
    """One ROS 1 bag."""

    def __init__(self, path: Path, number: int) -> None:
        super().__init__(path, _content_at)
        self._number = number
        self._channels: dict[int, Channel] = {}

    def messages(self, losses: Losses, progress: Progress) -> Iterator[Message]:
        """Yields the messages in the file's order."""
        size = self.path.stat().st_size
        indexed = False
        with self.path.open("rb") as stream:
            at = len(MAGIC)
            while at < size:
                try:
                    fields, start, length = _record(stream, at, size)
                    op = _op(fields)
                    indexed |= op == CHUNK_INFO
                    if op in (CHUNK, CONNECTION, MESSAGE):
                        yield from self._top(stream, fields, at, start, length, losses)
                    at = start + length
                except Broken as problem:
                    losses.add(str(problem), f"byte {at}")
                    if isinstance(problem, CutOff):
                        yield from self._in_chunk(_content_at(stream, at, size), at, None)
                    at = _next_chunk(stream, at + 1, size)
                progress(min(at, size), size)
        if not indexed:
            losses.add(
                "the bag has no index: recording or copying was cut off, or it was not closed",
                f"byte {size}",
            )
        progress(size, size)

    def _top(
        self,
        stream: BinaryIO,
        fields: dict[bytes, bytes],
        at: int,
        start: int,
        length: int,
        losses: Losses,
    ) -> Iterator[Message]:
        """Yields the messages of a record outside of chunks."""
        if length > LARGEST_RECORD:
            losses.add(f"a record of more than {LARGEST_RECORD} bytes is left out", f"byte {at}")
            return
        stream.seek(start)
        data = stream.read(length)
        if _op(fields) != CHUNK:
            place = Place(self._number, -1, start, length)
            yield from self._message(fields, memoryview(data), place)
            return
        try:
            content = _content(fields, data)
        except Broken as problem:
            losses.add(str(problem), f"byte {at}")
            return
        yield from self._in_chunk(content, at, losses)

    def _in_chunk(self, content: bytes, at: int, losses: Losses | None) -> Iterator[Message]:
        """Yields the messages of a chunk; of one that is cut off (no ``losses``) the whole ones."""
        inside = 0
        while inside < len(content):
            try:
                fields, start, length = _parse(content, inside)
            except Broken as problem:
                if losses is not None:
                    losses.add(f"in a chunk, {problem}", f"byte {at}")
                return
            if _op(fields) == CHUNK:  # beyond the end of one that declares too much
                return
            place = Place(self._number, at, start, length)
            try:
                yield from self._message(fields, memoryview(content)[start : start + length], place)
            except Broken as problem:
                if losses is not None:
                    losses.add(str(problem), f"byte {at}")
            inside = start + length

    def _message(
        self, fields: dict[bytes, bytes], data: memoryview, place: Place
    ) -> Iterator[Message]:
        """Yields the message that a record is; notes connections."""
        op = _op(fields)
        if op == MESSAGE:
            (number,) = unpack(_U32, fields.get(b"conn", b""))
            if number not in self._channels:
                raise Broken(f"a message of connection {number}, which is not described")
            seconds, nanoseconds = unpack(_TIME, fields.get(b"time", b""))
            received = 10**9 * seconds + nanoseconds
            yield Message(self._channels[number], received, data, place)
        elif op == CONNECTION:
            (number,) = unpack(_U32, fields.get(b"conn", b""))
            told = {name: value.decode("utf-8", "replace") for name, value in _fields(data).items()}
            topic = fields.get(b"topic", b"").decode("utf-8", "replace")
            self._channels[number] = Channel(
                topic,
                normal_type(told.get(b"type", "")),
                "ros1",
                told.get(b"message_definition", ""),
                told.get(b"md5sum", ""),
            )


def _record(stream: BinaryIO, at: int, size: int) -> tuple[dict[bytes, bytes], int, int]:
    """Returns a record's header fields, where its data begin, and how long they are."""
    stream.seek(at)
    (header,) = unpack(_U32, stream.read(4))
    if header > min(LARGEST_HEADER, size - at - 8):
        raise Broken("bytes that are no record")
    content = stream.read(header + 4)
    (length,) = unpack(_U32, content, header)
    fields = _fields(content[:header])
    _op(fields)
    if length > size - at - 8 - header:
        raise CutOff("a record declares more bytes than are left in the file")
    return fields, at + 8 + header, length


def _parse(content: bytes, at: int) -> tuple[dict[bytes, bytes], int, int]:
    """Returns the same of a record in a chunk."""
    (header,) = unpack(_U32, content, at)
    if header > len(content) - at - 8:
        raise Broken("bytes that are no record")
    fields = _fields(content[at + 4 : at + 4 + header])
    (length,) = unpack(_U32, content, at + 4 + header)
    start = at + 8 + header
    if length > len(content) - start:
        raise Broken("a record declares more bytes than are left")
    _op(fields)
    return fields, start, length


def _fields(header: bytes | memoryview) -> dict[bytes, bytes]:
    fields, at, header = {}, 0, bytes(header)
    while at < len(header):
        (length,) = unpack(_U32, header, at)
        name, equals, value = header[at + 4 : at + 4 + length].partition(b"=")
        if not equals or length > len(header) - at - 4:
            raise Broken("bytes that are no record")
        fields[name] = value
        at += 4 + length
    return fields


def _op(fields: dict[bytes, bytes]) -> int:
    op = fields.get(b"op", b"")
    if len(op) != 1 or op[0] not in OPS:
        raise Broken("bytes that are no record")
    return op[0]


def _content(fields: dict[bytes, bytes], data: bytes) -> bytes:
    (size,) = unpack(_U32, fields.get(b"size", b""))
    return decompressed(data, fields.get(b"compression", b"").decode("ascii", "replace"), size)


def _content_at(stream: BinaryIO, at: int, size: int) -> bytes:
    """Returns the content of a chunk, of one that is cut off what there is of it."""
    try:
        fields, start, length = _record(stream, at, size)
        stream.seek(start)
        return _content(fields, stream.read(length))
    except CutOff:
        stream.seek(at)
        (header,) = unpack(_U32, stream.read(4))
        fields = _fields(stream.read(header))
        if _op(fields) != CHUNK:
            return b""
        (whole,) = unpack(_U32, fields.get(b"size", b""))
        stream.seek(at + 8 + header)
        how = fields.get(b"compression", b"").decode("ascii", "replace")
        return decompressed_part(stream.read(min(LARGEST_RECORD, size - at)), how, whole)


def _next_chunk(stream: BinaryIO, at: int, size: int) -> int:
    """Returns the offset of the next record that is a chunk, or ``size``."""
    while at < size:
        stream.seek(at)
        block = stream.read(BLOCK + 2 * _BEFORE_OP)
        found = block.find(_CHUNK_OP)
        while found >= 0:
            for start in range(max(0, found - _BEFORE_OP), found):
                try:
                    fields, _, _ = _record(stream, at + start, size)
                except Broken:
                    continue
                if _op(fields) == CHUNK:
                    return at + start
            found = block.find(_CHUNK_OP, found + 1)
        at += BLOCK
    return size
