"""ROS 2 bags in SQLite (rosbag2's default until Humble), row by row in the file's order."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from frontend.readers.bag_parts import (
    LARGEST_RECORD,
    Broken,
    Channel,
    Losses,
    Message,
    Place,
    Progress,
    unzstd,
)
from frontend.readers.bag_types import normal_type

MAGIC = b"SQLite format 3\0"
LEAPS = 24  # how often, each time twice as far, a damaged stretch of rows is leapt over
_SELECT = (
    "SELECT id, topic_id, timestamp, length(data), "
    f"CASE WHEN length(data) <= {LARGEST_RECORD} THEN data END FROM messages WHERE id > ? "
    "ORDER BY id"
)


class SqliteFile:
    """One ROS 2 bag file; ``compressed`` where each message is compressed by zstd."""

    def __init__(self, path: Path, number: int, compressed: bool = False) -> None:
        self.path, self._number, self._compressed = path, number, compressed
        self._channels: dict[int, Channel] = {}

    def messages(self, losses: Losses, progress: Progress) -> Iterator[Message]:
        """Yields the messages in the order of their rows."""
        size, done = self.path.stat().st_size, 0
        try:
            with closing(self._connect()) as data_base:
                self._channels = _channels(data_base)
        except sqlite3.Error as error:
            losses.add(f"the data base's table of topics cannot be read ({error})", "its beginning")
            return
        last, leap = -1, 0
        while True:
            try:
                with closing(self._connect()) as data_base:
                    for row, topic, stamp, length, data in data_base.execute(_SELECT, (last,)):
                        last, leap, done = row, 0, done + (length or 0)
                        yield from self._message(row, topic, stamp, length, data, losses)
                        progress(min(done, size), size)
                break
            except sqlite3.Error as error:
                losses.add(f"rows of the data base cannot be read ({error})", f"row {last + 1}")
                last, leap = last + 2**leap, leap + 1
                if leap > LEAPS:
                    break
        progress(size, size)

    def read(self, place: Place) -> bytes:
        """Returns a message's bytes."""
        try:
            with closing(self._connect()) as data_base:
                found = data_base.execute(
                    "SELECT data FROM messages WHERE id = ?", (place.offset,)
                ).fetchone()
        except sqlite3.Error as error:
            raise Broken(str(error)) from error
        if found is None:
            raise Broken("the file was changed since it was opened")
        return self._plain(found[0])

    def _connect(self) -> sqlite3.Connection:
        uri = self.path.resolve().as_uri()
        try:
            data_base = sqlite3.connect(f"{uri}?mode=ro", uri=True)
            # without it SQLite refuses a file that was cut off; nothing can be written all the same
            data_base.execute("PRAGMA writable_schema = ON")
            data_base.execute("SELECT 1 FROM sqlite_master").fetchone()
        except sqlite3.OperationalError:  # a read-only folder keeps a write-ahead log from opening
            data_base = sqlite3.connect(f"{uri}?immutable=1", uri=True)
            data_base.execute("PRAGMA writable_schema = ON")
        return data_base

    def _message(
        self, row: object, topic: object, stamp: object, length: int, data: object, losses: Losses
    ) -> Iterator[Message]:
        place = f"row {row}"
        if not (isinstance(row, int) and isinstance(topic, int) and isinstance(stamp, int)):
            losses.add("rows of the data base hold no message", place)
            return
        channel = self._channels.get(topic)
        if channel is None:
            losses.add(f"a message of topic {topic}, which is not described", place)
            return
        if not isinstance(data, bytes):
            losses.add(f"a message is empty, or has more than {LARGEST_RECORD} bytes", place)
            return
        try:
            content = self._plain(data)
        except Broken as problem:
            losses.add(str(problem), place)
            return
        where = Place(self._number, -1, row, len(content))
        yield Message(channel, stamp, memoryview(content), where)

    def _plain(self, data: bytes) -> bytes:
        if not self._compressed:
            return data
        content = unzstd(data, LARGEST_RECORD + 1)
        if len(content) > LARGEST_RECORD:
            raise Broken(f"a message has more than {LARGEST_RECORD} bytes")
        return content


def _channels(data_base: sqlite3.Connection) -> dict[int, Channel]:
    rows = data_base.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
    try:
        told = dict(
            data_base.execute(
                "SELECT topic_type, encoded_message_definition FROM message_definitions "
                "WHERE encoding = 'ros2msg'"
            ).fetchall()
        )
    except sqlite3.Error:  # bags before Iron hold no definitions
        told = {}
    return {
        number: Channel(str(topic), normal_type(str(kind)), str(form), str(told.get(kind, "")))
        for number, topic, kind, form in rows
    }
