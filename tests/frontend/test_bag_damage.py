"""Damaged bags: what can be read is read and the loss is stated, or the error names the cure."""

from __future__ import annotations

import gzip
import re
import signal
import sqlite3
import struct
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode

from compare.cli import main
from frontend.log import open_log
from tests.frontend.recordings import Bag

MESSAGES = 400
LARGEST_PEAK = 48 * 2**20  # bytes; the bags are about 1 MB
SLOWEST_S = 60
U32, U64 = struct.Struct("<I"), struct.Struct("<Q")


@dataclass(frozen=True)
class Damage:
    """A kind of damage.

    Attributes:
        make: writes the damaged bag into a folder and returns its path.
        told: words of the warning or the error, as a pattern.
        least: fewest poses that must be read; 0: none can be, and the command fails.
    """

    make: Callable[[Path], Path]
    told: str
    least: int = 0


@pytest.fixture(autouse=True)
def no_hang() -> Iterator[None]:
    """Ends a test that hangs."""

    def stop(*ignored: object) -> None:
        raise TimeoutError(f"took more than {SLOWEST_S} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(SLOWEST_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def fill(bag: Bag, encoding: str = "mono8") -> None:
    picture = np.arange(48 * 64, dtype=np.uint8).reshape(48, 64)
    for k in range(MESSAGES):
        bag.odometry(0.05 * k + 1, 0.01 * k)
        if k % 2 == 0:
            bag.image(0.05 * k + 1, picture, encoding)


def ros1(folder: Path, compression: Writer1.CompressionFormat | None = None) -> Path:
    bag = Bag(folder / "x.bag", 1)
    bag.writer.chunk_threshold = 2**17
    if compression is not None:
        bag.writer.set_compression(compression)
    with bag:
        fill(bag)
    return bag.path


def mcap(folder: Path, zstd: bool = False) -> Path:
    """Writes an MCAP file of several chunks: by the writer, whose chunks take 1 MiB."""
    bag = Bag(folder / "x", 2)
    if zstd:
        from rosbags.rosbag2 import CompressionFormat

        bag.writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with bag:
        for part in range(4):
            fill_part(bag, part)
            bag.writer.storage.close_chunk()
    return folder / "x" / "x.mcap"


def fill_part(bag: Bag, part: int) -> None:
    picture = np.arange(48 * 64, dtype=np.uint8).reshape(48, 64)
    for k in range(100 * part, 100 * part + 100):
        bag.odometry(0.05 * k + 1, 0.01 * k)
        if k % 2 == 0:
            bag.image(0.05 * k + 1, picture)


def sqlite(folder: Path) -> Path:
    with Bag(folder / "x", 2, "sqlite3") as bag:
        fill(bag)
    return folder / "x"


def changed(path: Path, change: Callable[[bytearray], bytearray | bytes | None]) -> Path:
    data = bytearray(path.read_bytes())
    new = change(data)
    path.write_bytes(data if new is None else new)
    return path


def cut(share: float) -> Callable[[bytearray], bytearray]:
    return lambda data: data[: int(share * len(data))]


def flip(data: bytearray, at: int, count: int = 8) -> None:
    for k in range(at, at + count):
        data[k] ^= 0xA5


def chunks_of_mcap(data: bytes) -> list[int]:
    """Returns where chunk records begin."""
    found, at = [], 8
    while data[at] != 0x0F:
        if data[at] == 0x06:
            found.append(at)
        at += 9 + U64.unpack_from(data, at + 1)[0]
    return found


def without_index(data: bytearray) -> bytes:
    """Returns a ROS 1 bag as it is when recording is killed: no index, none announced."""
    at = 13
    header = U32.unpack_from(data, at)[0]
    found = data.index(b"index_pos=", at, at + header) + 10
    end = U64.unpack_from(data, found)[0]
    data[found : found + 8] = bytes(8)
    return bytes(data[:end])


def no_summary(data: bytearray) -> bytes:
    at = 8
    while data[at] != 0x0F:
        at += 9 + U64.unpack_from(data, at + 1)[0]
    return bytes(data[:at])


def flip_chunk_of_ros1(data: bytearray) -> None:
    flip(data, [m.start() for m in re.finditer(re.escape(b"op=\x05"), data)][1] - 20, 24)


def huge_record_ros1(data: bytearray) -> None:
    op = [m.start() for m in re.finditer(re.escape(b"op=\x05"), data)][1]
    start = op
    while U32.unpack_from(data, start - 4)[0] != 0 and not _is_header(data, start):
        start -= 1
    header = U32.unpack_from(data, start)[0]
    U32.pack_into(data, start + 4 + header, 0xFFFFFFF0)


def _is_header(data: bytearray, at: int) -> bool:
    """Returns whether the header of a chunk begins here."""
    length = U32.unpack_from(data, at)[0]
    if not 20 < length < 80:
        return False
    end, at = at + 4 + length, at + 4
    while at < end:
        at += 4 + U32.unpack_from(data, at)[0]
    return at == end


def huge_chunk_mcap(data: bytearray) -> None:
    U64.pack_into(data, chunks_of_mcap(data)[1] + 1, 2**60)


def bomb_mcap(data: bytearray) -> None:
    U64.pack_into(data, chunks_of_mcap(data)[1] + 9 + 16, 2**40)


def huge_array(folder: Path) -> Path:
    """Writes a bag in which images declare 4 GB of pixels."""
    path = ros1(folder)

    def change(data: bytearray) -> None:
        size = U32.pack(48 * 64)
        for found in list(re.finditer(re.escape(b"mono8\0" + U32.pack(64) + size), data)):
            U32.pack_into(data, found.end() - 4, 0xFFFFFFFF)

    return changed(path, change)


def nonsense_type(folder: Path) -> Path:
    with Bag(folder / "x", 2) as bag:
        message = bag.type("std_msgs/msg/String", data="x")
        bag.write("/secret", "std_msgs/msg/String", 1.0, message)
    return changed(
        folder / "x" / "x.mcap",
        lambda data: data.replace(b"std_msgs/msg/String", b"my_robot/msg/Wheels"),
    )


def json_messages(folder: Path) -> Path:
    return changed(mcap(folder), lambda data: data.replace(b"\x03\0\0\0cdr", b"\x03\0\0\0xml"))


def unknown_image(folder: Path) -> Path:
    with Bag(folder / "x.bag", 1) as bag:
        fill(bag, "depth7")
    return folder / "x.bag"


def packed(folder: Path) -> Path:
    path = ros1(folder)
    path.write_bytes(gzip.compress(path.read_bytes()))
    return path


def written(name: str, content: bytes) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        (folder / name).write_bytes(content)
        return folder / name

    return make


def lost_part(folder: Path) -> Path:
    path = sqlite(folder)
    changed(path / "metadata.yaml", lambda d: d.replace(b"- x.db3", b"- x.db3\n  - x_1.db3", 1))
    return path


def no_files(folder: Path) -> Path:
    path = sqlite(folder)
    (path / "x.db3").rename(path / "x.db3.zstd")
    return path


def no_table(folder: Path) -> Path:
    path = sqlite(folder)
    with sqlite3.connect(path / "x.db3") as data_base:
        data_base.execute("DROP TABLE topics")
    return path


def clocks_run_back(folder: Path) -> Path:
    with Bag(folder / "x.mcap-folder", 2) as bag:
        for k in range(MESSAGES):
            bag.odometry(0.05 * k + (1 if k < 300 else -9), 0.01 * k)
    return folder / "x.mcap-folder"


def bad_numbers(folder: Path) -> Path:
    with Bag(folder / "x.bag", 1) as bag:
        for k in range(MESSAGES):
            bag.odometry(0.05 * k + 1, float("nan") if k % 10 == 0 else 0.01 * k)
    return folder / "x.bag"


AGAIN = "copy it again from the robot, or record again"
KINDS = {
    "ros1-empty": Damage(written("x.bag", b""), "is empty .*copy it again from the robot"),
    "mcap-empty": Damage(written("x.mcap", b""), "is empty .*copy it again from the robot"),
    "sqlite-empty": Damage(written("x.db3", b""), "is empty .*copy it again from the robot"),
    "ros1-cut-off": Damage(lambda f: changed(ros1(f), cut(0.6)), f"no index.*{AGAIN}", 150),
    "ros1-cut-off-compressed": Damage(
        lambda f: changed(ros1(f, Writer1.CompressionFormat.BZ2), cut(0.6)),
        f"no index.*{AGAIN}",
        50,
    ),
    "mcap-cut-off": Damage(lambda f: changed(mcap(f), cut(0.6)), f"no end.*{AGAIN}", 150),
    "sqlite-cut-off": Damage(
        lambda f: changed(sqlite(f) / "x.db3", cut(0.6)), f"rows of the data base.*{AGAIN}", 200
    ),
    "ros1-head-only": Damage(lambda f: changed(ros1(f), lambda d: d[:13]), "nothing of it.*again"),
    "mcap-head-only": Damage(lambda f: changed(mcap(f), lambda d: d[:8]), "nothing of it.*again"),
    "ros1-unindexed": Damage(lambda f: changed(ros1(f), without_index), "has no index", MESSAGES),
    "mcap-unindexed": Damage(lambda f: changed(mcap(f), no_summary), "has no end", MESSAGES),
    "ros1-flipped-record": Damage(
        lambda f: changed(ros1(f), flip_chunk_of_ros1), "no record.*again", 200
    ),
    "ros1-flipped-compressed": Damage(
        lambda f: changed(
            ros1(f, Writer1.CompressionFormat.LZ4), lambda d: flip(d, len(d) // 2, 64)
        ),
        "a chunk.*again",
        100,
    ),
    "mcap-flipped-zstd": Damage(
        lambda f: changed(mcap(f, True), lambda d: flip(d, chunks_of_mcap(d)[1] + 62, 64)),
        "decompressed.*again",
        300,
    ),
    "mcap-flipped-record": Damage(
        lambda f: changed(mcap(f), lambda d: flip(d, chunks_of_mcap(d)[2], 2)),
        "no record.*again",
        200,
    ),
    "sqlite-flipped": Damage(
        lambda f: changed(sqlite(f) / "x.db3", lambda d: flip(d, len(d) // 2, 4096)),
        "(rows of the data base|cannot be|nothing).*again",
    ),
    "sqlite-no-topics": Damage(no_table, "table of topics.*again"),
    "ros1-huge-record": Damage(
        lambda f: changed(ros1(f), huge_record_ros1), "more bytes than are left.*again", 200
    ),
    "mcap-huge-record": Damage(
        lambda f: changed(mcap(f), huge_chunk_mcap), "more bytes than are left.*again", 300
    ),
    "mcap-bomb": Damage(lambda f: changed(mcap(f), bomb_mcap), "declares 1099511627776", 300),
    "ros1-huge-array": Damage(huge_array, "does not follow its type.*again", MESSAGES),
    "mcap-unknown-type": Damage(nonsense_type, "nothing tells how the robot moved.*Name them"),
    "mcap-unknown-encoding": Damage(json_messages, "encoded as 'xml'; known are ros1 and cdr"),
    "ros1-unknown-image": Damage(unknown_image, "'depth7'.*publish one of mono8", MESSAGES),
    "mcap-unknown-compression": Damage(
        lambda f: changed(mcap(f, True), lambda d: d.replace(b"\x04\0\0\0zstd", b"\x04\0\0\0rar5")),
        "compressed by 'rar5'; known are none, bz2, lz4, zstd",
    ),
    "overwritten-beginning": Damage(
        lambda f: changed(ros1(f), lambda d: bytes(64) + d[64:]), "is no bag.*copy it again"
    ),
    "text": Damage(written("x.mcap", b"t,left,right\n0,0,0\n"), "is no bag.*another kind of file"),
    "packed": Damage(packed, "is packed; unpack it first: gunzip x.bag"),
    "old-format": Damage(written("x.bag", b"#ROSBAG V1.2\n" + bytes(99)), "rosbag fix OLD NEW"),
    "packed-files": Damage(no_files, "unpack it: zstd -d x.db3.zstd"),
    "lost-part": Damage(lost_part, "metadata.yaml lists is not there .*x_1.db3", MESSAGES),
    "clocks-run-back": Damage(
        clocks_run_back, "run back by 9.95 s; 100 messages.*cut the bag", 300
    ),
    "not-a-number": Damage(bad_numbers, "holds NaN, infinity.*40 times.*again", 360),
}


@pytest.mark.parametrize("name", KINDS)
def test_damage_is_told_with_its_cure_and_the_rest_is_read(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    kind = KINDS[name]
    path = kind.make(tmp_path)
    code = main(["extract", str(path), "--out", str(tmp_path / "out")])
    told = " ".join(capsys.readouterr().err.split())
    assert "Traceback" not in told
    assert "defect of graphslam" not in told
    assert re.search(kind.told, told), told
    assert str(path) in told or code == 0
    if kind.least:
        assert code == 0, told
        tracemalloc.start()
        log = open_log(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert log.odometry is not None
        assert len(log.odometry.t) >= kind.least
        assert peak < LARGEST_PEAK
    else:
        assert code in (0, 1)


def test_bytes_flipped_anywhere_never_end_in_a_traceback(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    rng = np.random.default_rng(5)
    for make, name in ((ros1, "x.bag"), (mcap, "x.mcap"), (sqlite, "x.db3")):
        (tmp_path / name).mkdir()
        path = make(tmp_path / name)
        path = path / "x.db3" if path.is_dir() else path
        whole = path.read_bytes()
        for _ in range(5):
            data = bytearray(whole)
            for at in rng.integers(0, len(data), 30).tolist():
                data[at] ^= int(rng.integers(1, 256))
            path.write_bytes(data)
            code = main(["extract", str(path), "--out", str(tmp_path / "out")])
            told = capsys.readouterr().err
            assert code in (0, 1)
            assert "defect of graphslam" not in told, told
