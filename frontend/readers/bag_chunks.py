"""Single messages of a bag whose messages lie in compressed chunks."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import BinaryIO

from frontend.readers.bag_parts import Broken, Place

KEPT_CHUNKS = 4
"""Decompressed chunks at hand for reading single messages."""


class ChunkedFile:
    """A file that gives any of its messages again, by where it lies.

    Attributes:
        path: the file.
    """

    def __init__(self, path: Path, content_at: Callable[[BinaryIO, int, int], bytes]) -> None:
        """Takes the file, and what gives a chunk's content from its place and the file's size."""
        self.path, self._content_at = path, content_at
        self._chunks: OrderedDict[int, bytes] = OrderedDict()
        self._lock = Lock()

    def read(self, place: Place) -> bytes:
        """Returns a message's bytes."""
        if place.chunk < 0:
            with self.path.open("rb") as stream:
                stream.seek(place.offset)
                data = stream.read(place.size)
        else:
            data = self._chunk_at(place.chunk)[place.offset : place.offset + place.size]
        if len(data) != place.size:
            raise Broken("the file was changed since it was opened")
        return data

    def _chunk_at(self, at: int) -> bytes:
        with self._lock:
            if at not in self._chunks:
                with self.path.open("rb") as stream:
                    self._chunks[at] = self._content_at(stream, at, self.path.stat().st_size)
            self._chunks.move_to_end(at)
            while len(self._chunks) > KEPT_CHUNKS:
                self._chunks.popitem(last=False)
            return self._chunks[at]
