"""Strict reading of TOML into dataclasses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pytest

from frontend.strict import from_dict, load_toml, nearest
from graphslam.errors import BadConfig, BadLog


@dataclass(frozen=True, slots=True)
class Inner:
    size: float
    law: Literal["distance", "paper"] = "distance"
    slip: tuple[float, float, float] = (1.0, 2.0, 3.0)
    rows: tuple[tuple[float, ...], ...] = ()
    steps: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.size < 0:
            raise BadConfig(f"size = {self.size}: must not be negative")


@dataclass(frozen=True, slots=True)
class Outer:
    name: str
    inner: Inner
    count: int = 1
    fast: bool = False
    limit: float | None = None
    others: Mapping[str, Inner] = field(default_factory=dict)


def valid(**changes: Any) -> dict[str, Any]:
    return {"name": "a", "inner": {"size": 1.5}, **changes}


def inner(**changes: Any) -> dict[str, Any]:
    return valid(inner={"size": 1.5, **changes})


def test_values_of_every_supported_type_arrive():
    data = {
        "name": "a",
        "inner": {
            "size": 2,
            "law": "paper",
            "slip": [0, 1, 2.5],
            "rows": [[1, 2], [3.5]],
            "steps": [1],
        },
        "count": 3,
        "fast": True,
        "limit": 4,
        "others": {"x": {"size": 1}},
    }
    built = from_dict(Outer, data, "f.toml")
    steps = Inner(2.0, "paper", (0.0, 1.0, 2.5), ((1.0, 2.0), (3.5,)), [1.0])
    assert built == Outer("a", steps, 3, True, 4.0, {"x": Inner(1.0)})
    assert isinstance(built.inner.size, float)


def test_absent_keys_take_their_defaults():
    assert from_dict(Outer, valid(), "f.toml") == Outer("a", Inner(1.5))


@pytest.mark.parametrize(
    ("data", "place", "cure"),
    [
        (valid(nme="b"), "nme is not a known key", "did you mean 'name'?"),
        (valid(NAME="b"), "NAME is not a known key", "did you mean 'name'?"),
        (valid(zzz=1), "zzz is not a known key", "known: name, inner, count"),
        (inner(lawe="paper"), "inner.lawe is not a known key", "did you mean 'law'?"),
        (valid(others={"x": {"size": 1, "sise": 2}}), "others.x.sise", "did you mean 'size'?"),
        ({"inner": {"size": 1}}, "name is missing", 'add `name = "..."`'),
        ({"name": "a"}, "inner is missing", "add a table [inner]"),
        (valid(inner={}), "inner.size is missing", "add `size = 0.5` under [inner]"),
        (inner(size="1.5"), "inner.size = '1.5' must be a number", "without quotes"),
        (inner(size="wide"), "inner.size = 'wide' must be a number", "write 0.5"),
        (inner(size=True), "inner.size = True must be a number", "write 0.5"),
        (inner(size=[1.0]), "inner.size = [1.0] must be a number", "write 0.5"),
        (inner(size=float("nan")), "inner.size = nan must be finite", "below 1e308"),
        (inner(size=float("inf")), "inner.size = inf must be finite", "below 1e308"),
        (inner(size=10**400), "must be finite", "below 1e308"),
        (inner(size=10**5000), "a huge number must be finite", "below 1e308"),
        (inner(size=-1), "[inner] size = -1.0", "must not be negative"),
        (inner(law="pape"), "inner.law = 'pape' is not known", "one of 'distance', 'paper'"),
        (inner(law=1), "inner.law = 1 is not known", "one of 'distance', 'paper'"),
        (inner(slip=[1, 2]), "inner.slip has 2 entries, not 3", "write [0.5, 0.5, 0.5]"),
        (inner(slip=1.0), "inner.slip = 1.0 must be a list", "write [0.5, 0.5, 0.5]"),
        (inner(slip=[1, "b", 2]), "inner.slip[1] = 'b' must be a number", "write 0.5"),
        (inner(rows=[[1], 2]), "inner.rows[1] = 2 must be a list", "write [0.5, ...]"),
        (inner(rows=[[1], [1, None]]), "inner.rows[1][1] = None must be a number", "write 0.5"),
        (inner(steps=[False]), "inner.steps[0] = False must be a number", "write 0.5"),
        (valid(count=1.0), "count = 1.0 must be a whole number", "write 1"),
        (valid(count=True), "count = True must be a whole number", "write 1"),
        (valid(fast=1), "fast = 1 must be true or false", "write true"),
        (valid(name=3), "name = 3 must be a text", 'write "..."'),
        (valid(limit="x"), "limit = 'x' must be a number", "write 0.5"),
        (valid(inner=3), "inner = 3 must be a table", "write [inner] with keys below"),
        (valid(others=3), "others = 3 must be a table", "write [others.NAME]"),
        (valid(others={"x": 3}), "others.x = 3 must be a table", "write [others.x]"),
    ],
)
def test_what_is_wrong_is_refused_with_its_place_and_cure(
    data: dict[str, Any], place: str, cure: str
):
    with pytest.raises(BadConfig) as error:
        from_dict(Outer, data, "f.toml")
    message = str(error.value)
    assert message.startswith("f.toml: ")
    assert place in message
    assert cure in message


def test_the_callers_kind_of_error_is_raised_even_for_what_a_class_refuses():
    with pytest.raises(BadLog, match=r"log\.toml: \[robot\.inner\] size"):
        from_dict(Outer, inner(size=-1), "log.toml", BadLog, at="robot")


def test_none_means_absent_for_an_optional_value_only():
    assert from_dict(Outer, valid(limit=None), "f.toml").limit is None
    with pytest.raises(BadConfig, match="count = None"):
        from_dict(Outer, valid(count=None), "f.toml")


def test_a_long_wrong_value_is_shortened_in_the_message():
    with pytest.raises(BadConfig) as error:
        from_dict(Outer, valid(count="x" * 10_000), "f.toml")
    assert len(str(error.value)) < 200


def test_nearest_names_everything_known_where_nothing_is_near():
    assert nearest("qqq", ("a", "b")) == "known: a, b"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a = 1\nb = \n", "f.toml:2: is not valid TOML"),
        (b"a = 1\na = 2\n", "f.toml:2: is not valid TOML"),
        (b"[robot\n", "f.toml:1: is not valid TOML"),
        (b'a = 1\nb = "\xff"\n', "f.toml:2: is not UTF-8 text; save the file as UTF-8"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "f.toml:1: is not UTF-8 text"),
        (b"a = " + b"[" * 20_000, "f.toml: is nested too deeply"),
        (b"a = " + b"1" * 5_000, "f.toml: is not valid TOML"),
        (b"a = 1" + b" " * 2**24, "f.toml: is larger than 16 MiB"),
    ],
)
def test_a_file_that_is_not_toml_is_refused_with_its_line(
    tmp_path: Path, content: bytes, message: str
):
    path = tmp_path / "f.toml"
    path.write_bytes(content)
    with pytest.raises(BadLog) as error:
        load_toml(path, BadLog)
    assert message in str(error.value)


def test_a_byte_order_mark_is_ignored(tmp_path: Path):
    path = tmp_path / "f.toml"
    path.write_bytes(b"\xef\xbb\xbfa = 1\r\n")
    assert load_toml(path) == {"a": 1}


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path):
    with pytest.raises(BadConfig, match="does not exist"):
        load_toml(tmp_path / "none.toml")
    with pytest.raises(BadConfig, match="is not a file"):
        load_toml(tmp_path)
