"""Strict tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from frontend.table import Table, read_columns, read_table
from graphslam.errors import BadLog


def read(tmp_path: Path, content: str | bytes) -> Table:
    path = tmp_path / "x.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    table = read_table(
        path,
        ("t", "file"),
        ("value", ("a", "b"), "id"),
        text=("file",),
        whole=("id",),
        blank=("a", "b"),
        least=1,
    )
    table.check_times()
    return table


def test_columns_arrive_in_any_order_with_texts_and_empty_cells(tmp_path: Path):
    table = read(tmp_path, "id,b,file,a,t\n3,1.5, x_1.png ,-2e-3,0\n4,,y.png, ,1\n")
    assert table.numbers["t"].tolist() == [0.0, 1.0]
    assert table.texts["file"] == ("x_1.png", "y.png")
    np.testing.assert_array_equal(table.stack("a", "b"), [[-2e-3, 1.5], [np.nan, np.nan]])
    assert table.line.tolist() == [2, 3]
    assert "a" in table
    assert "value" not in table


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbft,file\n0,a\n1,b\n",
        b"t,file\r\n0,a\r\n1,b\r\n",
        b"t,file\r0,a\r1,b\r",
        b"t,file\n0,a\n1,b",
        b"t,file\n0,a\n1,b\n\n \n\r\n",
        b't , file\n 0 ,"a"\n"1", b \n',
    ],
    ids=["mark", "windows", "old mac", "no end", "empty end", "blanks and quotes"],
)
def test_spellings_of_the_same_table_read_the_same(tmp_path: Path, content: bytes):
    table = read(tmp_path, content)
    assert table.numbers["t"].tolist() == [0.0, 1.0]
    assert table.texts["file"] == ("a", "b")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", ":1: is empty; the first line must name the columns: t,file"),
        ("\n0,a\n", ":1: is empty; the first line must name the columns: t,file"),
        ("0.0,a.png\n", ":1: names no known column; the first line must name"),
        ("t,file\n", ": has 0 rows of data and needs at least 1"),
        ("t,fle\n0,a\n", ":1: 'fle' is not a known column; did you mean 'file'?"),
        ("T,file\n0,a\n", ":1: 'T' is not a known column; did you mean 't'?"),
        ("t,value\n0,1\n", ":1: column 'file' is missing"),
        ("t,file,a\n0,x,1\n", ":1: column 'b' is missing; a, b come together or not at all"),
        ("t,file,t\n0,x,1\n", ":1: column 't' is there twice"),
        ("t;file\n0;x\n", ":1: names no known column"),
        ("t,file\n0,a\n1\n", ":3: has 1 cells where 2 are expected (t,file)"),
        ("t,file\n0,a\n1,b,\n", ":3: has 3 cells where 2 are expected"),
        ("t,file\n0,a\n\n1,b\n", ":3: is empty; remove the empty line"),
        ("t,file\n0,a\nx,b\n", ":3: t = 'x' is not a number; write it like -0.25"),
        ("t,file\n0,a\n1_0,b\n", ":3: t = '1_0' is not a number"),
        ("t,file\n0,a\n١,b\n", ":3: t = '١' is not a number"),
        ("t,file\n0,a\n0x10,b\n", ":3: t = '0x10' is not a number"),
        ('t,file\n0,a\n"1,5",b\n', ":3: t = '1,5' is not a number"),
        ("t,file\n0,a\n,b\n", ":3: t is empty; write a number, or remove the row"),
        ("t,file\n0,a\nnan,b\n", ":3: t = 'nan' is not finite"),
        ("t,file\n0,a\n-inf,b\n", ":3: t = '-inf' is not finite"),
        ("t,file\n0,a\n1e400,b\n", ":3: t = '1e400' is not finite"),
        ("t,file\n0,a\n1.7e18,b\n", ":3: t = '1.7e18' is beyond 1e+12; use seconds"),
        ("t,file,a,b\n0,x,nan,1\n", ":2: a = 'nan' is not finite"),
        ("t,file,id\n0,x,1.5\n", ":2: id = 1.5 is not a whole number"),
        ("t,file\n0,a\n0,b\n", ":3: t = 0 repeats the time above"),
        ("t,file\n5,a\n6,b\n4,c\n", ":4: t = 4 runs backwards"),
        ('t,file\n0,a\n1,"b\n2,c\n', ":3: is not CSV"),
        ('t,file\n0,a\n1,"b"c\n2,c\n', ":3: is not CSV"),
        ('t,file\n0,a\n1,"b\n' + "2,c\n" * 50_000, ":3: is not CSV"),
        ('t,file\n0,a\n1,"b\nc"\n', ":3: a quoted text goes on in the next line"),
        (b"t,file\n0,a\n1,\xe4\n", ":3: is not UTF-8 text; save the file as UTF-8"),
        (bytes(range(256)), "x.csv:"),
        (b"\x00" * 5000, "x.csv:1:"),
    ],
)
def test_what_is_wrong_is_refused_with_file_line_and_cure(
    tmp_path: Path, content: str | bytes, message: str
):
    with pytest.raises(BadLog) as error:
        read(tmp_path, content)
    assert str(tmp_path / "x.csv") in str(error.value)
    assert message in str(error.value)
    assert len(str(error.value)) < len(str(tmp_path)) + 250


def test_an_error_far_down_a_long_table_names_its_line(tmp_path: Path):
    rows = [f"{i},f{i}" for i in range(45_000)]
    rows[40_001] = "40001.0.0,f"
    with pytest.raises(BadLog, match=r"x\.csv:40003: t = '40001\.0\.0' is not a number"):
        read(tmp_path, "\n".join(["t,file", *rows]))


def test_an_empty_line_at_the_edge_of_a_block_is_found(tmp_path: Path):
    rows = [f"{i},f{i}" for i in range(9_999)]
    content = "\n".join(["t,file", *rows, "", ""])
    assert len(read(tmp_path, content)) == 9_999
    with pytest.raises(BadLog, match=r"x\.csv:10001: is empty"):
        read(tmp_path, content + "9999,f\n")


def test_a_table_larger_than_the_limit_is_refused_unread(tmp_path: Path):
    path = tmp_path / "x.csv"
    with path.open("wb") as stream:
        stream.truncate(513 * 2**20)
    with pytest.raises(BadLog, match="is larger than 512 MiB"):
        read_table(path, ("t",))


def test_two_hundred_thousand_rows_are_read(tmp_path: Path):
    path = tmp_path / "x.csv"
    t = np.arange(200_000) * 0.01
    np.savetxt(path, np.column_stack([t, t]), "%.4f", ",", header="t,value", comments="")
    table = read_table(path, ("t", "value"))
    np.testing.assert_allclose(table.numbers["value"], t, atol=1e-9)


def test_repeated_times_pass_where_they_are_normal(tmp_path: Path):
    path = tmp_path / "x.csv"
    path.write_text("t\n0\n0\n1\n0.5\n")
    table = read_table(path, ("t",))
    with pytest.raises(BadLog, match=r":5: t = 0\.5 runs backwards"):
        table.check_times(repeats=True)
    path.write_text("t\n0\n0\n1\n")
    read_table(path, ("t",)).check_times(repeats=True)


def test_columns_without_header_skip_comments_and_keep_line_numbers(tmp_path: Path):
    path = tmp_path / "x.tum"
    path.write_text("# t x\n 0  1\n\n#c\n1\t2 \n")
    table = read_columns(path, ("t", "x"))
    assert table.numbers["x"].tolist() == [1.0, 2.0]
    assert table.line.tolist() == [2, 5]
    path.write_text("# t x\n0 1\n\n1 2 3\n")
    with pytest.raises(BadLog, match=r"x\.tum:4: has 3 cells where 2 are expected"):
        read_columns(path, ("t", "x"))
    path.write_text("# t x\n0 1\n\n1 nan\n")
    with pytest.raises(BadLog, match=r"x\.tum:4: x = 'nan' is not finite"):
        read_columns(path, ("t", "x"))
