"""MCAP files, record by record in the file's order (mcap.dev/spec), whole or damaged."""

from __future__ import annotations

import re
import struct
import zlib
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

MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
LAST_OP = 0x0F  # above 0x7F lie private records, which are skipped

_U16, _U32, _U64 = struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<Q")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQI")
_HEAD = 9  # bytes of a record's op and length
# a chunk: op, length (its upper bytes 0), times, size, checksum, then the name of a compression
_CHUNK_LIKE = re.compile(
    rb"\x06.{4}\0{4}.{16}.{4}\0{4}.{4}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd)", re.DOTALL
)


class McapFile(ChunkedFile):
    """One MCAP file."""

    def __init__(self, path: Path, number: int) -> None:
        super().__init__(path, _content_at)
        self._number = number
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, Channel] = {}

    def messages(self, losses: Losses, progress: Progress) -> Iterator[Message]:
        """Yields the messages in the file's order."""
        size = self.path.stat().st_size
        with self.path.open("rb") as stream:
            at, whole = len(MAGIC), False
            while at + _HEAD <= size:
                try:
                    op, length = _head(stream, at, size)
                    if op == DATA_END:
                        whole = True
                        break
                    yield from self._record(stream, op, at, length, losses)
                    at += _HEAD + length
                except Broken as problem:
                    losses.add(str(problem), f"byte {at}")
                    if isinstance(problem, CutOff):
                        yield from self._records(_content_at(stream, at, size), at, None)
                    at = _next_chunk(stream, at + 1, size)
                progress(min(at, size), size)
            if not whole:
                losses.add("the file has no end: recording or copying was cut off", f"byte {size}")
        progress(size, size)

    def _record(
        self, stream: BinaryIO, op: int, at: int, length: int, losses: Losses
    ) -> Iterator[Message]:
        """Yields the messages of a record at the top level."""
        if op not in (SCHEMA, CHANNEL, MESSAGE, CHUNK):
            return
        if length > LARGEST_RECORD:
            losses.add(f"a record of more than {LARGEST_RECORD} bytes is left out", f"byte {at}")
            return
        stream.seek(at + _HEAD)
        data = stream.read(length)
        if op != CHUNK:
            yield from self._in_chunk(op, memoryview(data), Place(self._number, -1, at + _HEAD, 0))
            return
        try:
            content = _chunk_content(data)
        except Broken as problem:
            losses.add(str(problem), f"byte {at}")
            return
        yield from self._records(content, at, losses)

    def _records(self, content: bytes, at: int, losses: Losses | None) -> Iterator[Message]:
        """Yields the messages of a chunk; of one that is cut off (no ``losses``) the whole ones."""
        inside, view = 0, memoryview(content)
        while inside + _HEAD <= len(content):
            op, (length,) = view[inside], unpack(_U64, view, inside + 1)
            start = inside + _HEAD
            if op == CHUNK or length > len(content) - start:
                if losses is not None:
                    losses.add("a chunk holds bytes that are no record of one", f"byte {at}")
                return
            place = Place(self._number, at, start, 0)
            try:
                yield from self._in_chunk(op, view[start : start + length], place)
            except Broken as problem:
                if losses is not None:
                    losses.add(str(problem), f"byte {at}")
            inside = start + length

    def _in_chunk(self, op: int, data: memoryview, start: Place) -> Iterator[Message]:
        """Yields the message that a record is; notes schemas and channels."""
        if op == MESSAGE:
            number, _, logged, _ = unpack(_MESSAGE, data)
            if number not in self._channels:
                raise Broken(f"a message of channel {number}, which is not described")
            offset, size = start.offset + _MESSAGE.size, len(data) - _MESSAGE.size
            place = start._replace(offset=offset, size=size)
            yield Message(self._channels[number], logged, data[_MESSAGE.size :], place)
        elif op == SCHEMA:
            (number,) = unpack(_U16, data)
            name, at = _text(data, 2)
            encoding, at = _text(data, at)
            (length,) = unpack(_U32, data, at)
            body = bytes(data[at + 4 : at + 4 + length]).decode("utf-8", "replace")
            self._schemas[number] = (name, body if encoding in ("ros2msg", "ros1msg") else "")
        elif op == CHANNEL:
            number, schema = unpack(struct.Struct("<HH"), data)
            topic, at = _text(data, 4)
            encoding, _ = _text(data, at)
            name, body = self._schemas.get(schema, ("", ""))
            self._channels[number] = Channel(topic, normal_type(name), encoding, body)


def _head(stream: BinaryIO, at: int, size: int) -> tuple[int, int]:
    stream.seek(at)
    head = stream.read(_HEAD)
    if len(head) < _HEAD:
        raise Broken("the file ends within a record")
    op, (length,) = head[0], unpack(_U64, head, 1)
    if op == 0 or LAST_OP < op < 0x80:
        raise Broken("bytes that are no record")
    if length > size - at - _HEAD:
        raise CutOff("a record declares more bytes than are left in the file")
    return op, length


def _content_at(stream: BinaryIO, at: int, size: int) -> bytes:
    """Returns the content of a chunk, of one that is cut off what there is of it."""
    try:
        _, length = _head(stream, at, size)
        stream.seek(at + _HEAD)
        return _chunk_content(stream.read(length))
    except CutOff:
        stream.seek(at)
        if stream.read(1) != bytes([CHUNK]):
            return b""
        stream.seek(at + _HEAD)
        data = stream.read(min(LARGEST_RECORD, size - at))
        try:
            _, _, whole, _ = unpack(_CHUNK, data)
            how, start = _text(memoryview(data), _CHUNK.size)
        except Broken:
            return b""
        return decompressed_part(data[start + 8 :], how, whole)


def _chunk_content(data: bytes) -> bytes:
    _, _, size, checksum = unpack(_CHUNK, data)
    how, at = _text(memoryview(data), _CHUNK.size)
    (length,) = unpack(_U64, data, at)
    content = decompressed(data[at + 8 : at + 8 + length], how, size)
    if checksum and zlib.crc32(content) != checksum:
        raise Broken("a chunk has not the checksum that it declares: bytes were changed")
    return content


def _text(data: memoryview, at: int) -> tuple[str, int]:
    """Returns the text at an offset, and the offset behind it."""
    (length,) = unpack(_U32, data, at)
    if length > len(data) - at - 4:
        raise Broken("a text declares more bytes than its record has")
    return bytes(data[at + 4 : at + 4 + length]).decode("utf-8", "replace"), at + 4 + length


def _next_chunk(stream: BinaryIO, at: int, size: int) -> int:
    """Returns the offset of the next record that looks like a chunk, or ``size``."""
    overlap = 64
    while at < size:
        stream.seek(at)
        block = stream.read(BLOCK + overlap)
        for found in _CHUNK_LIKE.finditer(block):
            start = at + found.start()
            (length,) = unpack(_U64, block, found.start() + 1)
            if 32 <= length <= size - start - _HEAD:
                return start
        at += BLOCK
    return size
