"""Strict reading of TOML into trees of frozen dataclasses: no unknown key, no wrong type.

Every message names the file, the dotted key and the cure.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
import types
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from graphslam.errors import BadConfig, GraphSlamError

T = TypeVar("T")

TOML_LIMIT = 16 * 2**20  # bytes; no hand-written file comes near


def read_text(path: Path, error: type[GraphSlamError], limit: int) -> str:
    """Returns the content of a UTF-8 file, without a byte order mark.

    Args:
        path: a regular file, or a link to one.
        error: what to raise.
        limit: largest size accepted, bytes.

    Raises:
        error: there is no such file, it is none, cannot be read, is too large, or is not UTF-8.
    """
    try:
        if not path.is_file():  # a folder, a pipe, a device
            found = "is not a file" if path.exists() else "does not exist"
            raise error(f"{path}: {found}; put a text file there")
        with path.open("rb") as stream:
            data = stream.read(limit + 1) if path.stat().st_size <= limit else None
    except OSError as reason:
        raise error(f"{path}: cannot be read ({reason.strerror}); check its permissions") from None
    if data is None or len(data) > limit:
        raise error(f"{path}: is larger than {limit // 2**20} MiB; split it, or check what it is")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        line = data.count(b"\n", 0, reason.start) + 1
        raise error(f"{path}:{line}: is not UTF-8 text; save the file as UTF-8") from None


def load_toml(path: Path | str, error: type[GraphSlamError] = BadConfig) -> dict[str, Any]:
    """Returns the content of a TOML file.

    Args:
        path: the file.
        error: what to raise: BadLog for recordings, BadConfig otherwise.

    Raises:
        error: the file cannot be read, or is not TOML; the message names the line.
    """
    path = Path(path)
    text = read_text(path, error, TOML_LIMIT)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise error(f"{path}: is nested too deeply; flatten its lists") from None
    except ValueError as reason:  # TOMLDecodeError, or a number with thousands of digits
        found = re.search(r" \(at line (\d+), column \d+\)", str(reason))
        if found is None:
            place, what = f"{path}", str(reason)
        else:
            place, what = f"{path}:{found[1]}", str(reason).replace(found[0], "")
        raise error(
            f"{place}: is not valid TOML: {what}; write `key = value`, texts in double quotes, "
            "lists in square brackets, every key once"
        ) from None


def nearest(name: str, known: Iterable[str]) -> str:
    """Returns the cure for an unknown name: the nearest known one, or all of them."""
    names = [str(k) for k in known]
    lower = {n.lower(): n for n in names}
    match = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.6)
    if match:
        return f"did you mean {lower[match[0]]!r}?"
    return f"known: {', '.join(names)}" if names else "nothing is known here; remove it"


def from_dict(
    cls: type[T],
    data: Mapping[str, Any],
    source: str,
    error: type[GraphSlamError] = BadConfig,
    at: str = "",
) -> T:
    """Returns ``cls`` built from parsed TOML, every value checked against its annotation.

    Fields may be float (an integer is accepted, a bool is not), int, bool, str, Literal, tuples of
    fixed length or ``tuple[X, ...]``, ``list[X]``, ``Mapping[str, X]``, ``X | None``, dataclasses,
    and any nesting of these. Numbers must be finite.

    Args:
        cls: a dataclass.
        data: its fields by name; those with a default may be absent.
        source: the file, as messages name it.
        error: what to raise: BadLog for recordings, BadConfig otherwise.
        at: dotted key of ``data`` inside the file; "" for the whole file.

    Raises:
        error: a key is unknown or missing, a value has the wrong type or length, or ``cls`` itself
            refuses its values. The message names source, dotted key and cure.
    """
    built: T = _Reader(source, error).table(cls, data, at)
    return built


class _Reader:
    """Converts values of one file; ``at`` is everywhere the dotted key of the value in hand."""

    def __init__(self, source: str, error: type[GraphSlamError]) -> None:
        self.source, self.error = source, error

    def fail(self, at: str, message: str) -> GraphSlamError:
        return self.error(f"{self.source}: {at}{' ' if at else ''}{message}")

    def table(self, cls: type[Any], data: Any, at: str) -> Any:
        if not isinstance(data, Mapping):
            raise self.fail(at, f"= {_shown(data)} must be a table: write [{at}] with keys below")
        known = {f.name: f for f in fields(cls) if f.init}
        prefix = f"{at}." if at else ""
        for key in data:
            if key not in known:
                raise self.fail(f"{prefix}{key}", f"is not a known key; {nearest(key, known)}")
        for name, field in known.items():
            if name not in data and _required(field):
                raise self.fail(f"{prefix}{name}", f"is missing; add {self.example(cls, name, at)}")
        hints = get_type_hints(cls)
        values = {key: self.value(hints[key], data[key], f"{prefix}{key}") for key in data}
        try:
            return cls(**values)
        except GraphSlamError as refused:
            raise self.error(f"{self.source}: {f'[{at}] ' if at else ''}{refused}") from None

    def example(self, cls: type[Any], name: str, at: str) -> str:
        kind = get_type_hints(cls)[name]
        if is_dataclass(kind):
            return f"a table [{at + '.' if at else ''}{name}]"
        return f"`{name} = {_spelled(kind)}`" + (f" under [{at}]" if at else "")

    def value(self, kind: Any, data: Any, at: str) -> Any:
        origin, args = get_origin(kind), get_args(kind)
        if kind is Any:
            return data
        if is_dataclass(kind):
            return self.table(kind, data, at)  # type: ignore[arg-type]
        if origin in (Union, types.UnionType):
            return self.optional(args, data, at)
        if origin is Literal:
            return self.choice(args, data, at)
        if origin in (tuple, list):
            return self.sequence(kind, data, at)
        if isinstance(origin, type) and issubclass(origin, Mapping):
            if not isinstance(data, Mapping):
                raise self.fail(at, f"= {_shown(data)} must be a table: write [{at}.NAME]")
            return {key: self.value(args[1], entry, f"{at}.{key}") for key, entry in data.items()}
        return self.scalar(kind, data, at)

    def choice(self, allowed: tuple[Any, ...], data: Any, at: str) -> Any:
        if any(data == a and type(data) is type(a) for a in allowed):
            return data
        shown = ", ".join(repr(a) for a in allowed)
        raise self.fail(at, f"= {_shown(data)} is not known; write one of {shown}")

    def optional(self, args: tuple[Any, ...], data: Any, at: str) -> Any:
        inner = [a for a in args if a is not type(None)]
        if len(inner) != 1:
            raise TypeError(f"{at}: only `X | None` is supported, not {args}")
        return None if data is None and len(args) > 1 else self.value(inner[0], data, at)

    def sequence(self, kind: Any, data: Any, at: str) -> Any:
        origin, args = get_origin(kind), get_args(kind)
        if not isinstance(data, list | tuple):
            raise self.fail(at, f"= {_shown(data)} must be a list; write {_spelled(kind)}")
        kinds = [args[0]] * len(data) if origin is list or args[-1] is Ellipsis else list(args)
        if len(data) != len(kinds):
            message = f"has {len(data)} entries, not {len(kinds)}; write {_spelled(kind)}"
            raise self.fail(at, message)
        items = zip(kinds, data, strict=True)
        return origin(self.value(k, d, f"{at}[{i}]") for i, (k, d) in enumerate(items))

    def scalar(self, kind: Any, data: Any, at: str) -> Any:
        name = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}
        if kind not in name:
            raise TypeError(f"{at}: annotation {kind!r} is not supported")
        accepted = (int, float) if kind is float else kind
        if not isinstance(data, accepted) or (isinstance(data, bool) and kind is not bool):
            quoted = isinstance(data, str) and data.replace(".", "", 1).strip("+-").isdigit()
            cure = "write it without quotes" if quoted else f"write {_spelled(kind)}"
            raise self.fail(at, f"= {_shown(data)} must be {name[kind]}; {cure}")
        if kind is float:
            return self.finite(data, at)
        return data

    def finite(self, data: float, at: str) -> float:
        try:
            number = float(data)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.fail(at, f"= {_shown(data)} must be finite; write a number below 1e308")
        return number


def _required(field: Field[Any]) -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def _shown(data: Any) -> str:
    try:
        text = repr(data)
    except ValueError:  # Python refuses to print integers of thousands of digits
        return "a huge number"
    return text if len(text) <= 60 else text[:57] + "..."


def _spelled(kind: Any) -> str:
    """Returns how a value of this type is written in TOML."""
    origin, args = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return _spelled(next(a for a in args if a is not type(None)))
    if origin is Literal:
        return repr(args[0]).replace("'", '"')
    if origin in (tuple, list):
        open_ended = origin is list or args[-1] is Ellipsis
        parts = [_spelled(args[0]), "..."] if open_ended else [_spelled(a) for a in args]
        return f"[{', '.join(parts)}]"
    if is_dataclass(kind):
        return "{...}"
    return {float: "0.5", int: "1", bool: "true", str: '"..."'}.get(kind, "...")
