"""Configuration sweeps: one setting, or several, tried at each of a few values."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from itertools import product
from typing import Any

from compare.config import RunConfig
from frontend.strict import from_dict
from graphslam.errors import BadConfig


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """One combination of swept values.

    Attributes:
        values: full dotted name of each swept setting and its value as text; empty without a sweep.
        config: the configuration with these values.
    """

    values: tuple[tuple[str, str], ...]
    config: RunConfig

    @property
    def label(self) -> str:
        """The values for people; empty without a sweep."""
        return ", ".join(f"{key} = {value}" for key, value in self.values)

    @property
    def short_label(self) -> str:
        """The values with the last part of each name, for narrow columns."""
        return ", ".join(f"{key.rsplit('.', 1)[-1]} {value}" for key, value in self.values)

    @property
    def folder(self) -> str:
        """The values as the name of a folder; empty without a sweep."""
        text = ",".join(f"{key}={value}" for key, value in self.values)
        return re.sub(r"[^\w.,=+\[\]-]", "-", text)


def sweep_points(sweeps: Sequence[str], base: RunConfig) -> tuple[SweepPoint, ...]:
    """Returns every combination of the values of ``sweeps``, the last one changing fastest.

    Args:
        sweeps: texts like ``ekf.matching.gate=5,9,14``: a setting's dotted name, or any part of it
            that names no other setting and ends alike (``ekf.gate``), and values as in TOML; the
            quotes of texts may be left out.
        base: all other settings.

    Raises:
        BadConfig: a name is unknown, ambiguous or given twice, or a value does not fit; the message
            names what is near.
    """
    named = [_parse(text) for text in sweeps]
    keys = [key for key, _ in named]
    for key in keys:
        if keys.count(key) > 1:
            raise BadConfig(f"--sweep {key}: is given twice; write all values behind one `=`")
    combinations = product(*(values for _, values in named))
    points = [_point(base, keys, combination) for combination in combinations]
    by_folder: dict[str, SweepPoint] = {}
    for point in points:
        other = by_folder.setdefault(point.folder, point)
        if other.values != point.values:
            raise BadConfig(
                f"--sweep: {other.label} and {point.label} would share the folder {point.folder}; "
                "sweep them one after the other"
            )
    return tuple(by_folder.values())


def setting_name(text: str) -> str:
    """Returns the full dotted name of the setting that ``text`` stands for.

    Raises:
        BadConfig: none, or several, are meant.
    """
    known = list(_settings(RunConfig(), ""))
    if text in known:
        return text
    parts = text.split(".")
    found = [name for name in known if _shortens(parts, name.split("."))]
    if len(found) == 1:
        return found[0]
    if found:
        raise BadConfig(f"--sweep {text}: may mean {' or '.join(found)}; write one of them out")
    inside = [name for name in known if name.startswith(f"{text}.")]
    if inside:
        raise BadConfig(f"--sweep {text}: is a table of settings; name one, such as {inside[0]}")
    raise BadConfig(f"--sweep {text}: is not a known setting; {_near(text, known)}")


def _settings(config: Any, prefix: str) -> Iterator[str]:
    for f in fields(config):
        value = getattr(config, f.name)
        if is_dataclass(value):
            yield from _settings(value, f"{prefix}{f.name}.")
        else:
            yield f"{prefix}{f.name}"


def _shortens(short: Sequence[str], full: Sequence[str]) -> bool:
    """Returns whether ``short`` is ``full`` with parts left out, but not the last."""
    rest = iter(full)
    return short[-1] == full[-1] and all(part in rest for part in short)


def _near(text: str, known: Sequence[str]) -> str:
    """Returns the known setting that is spelled most alike, shortened or not, as a question."""
    spelled: dict[str, str] = {}
    for name in known:
        first, *_, last = name.split(".") if "." in name else ("", name)
        for short in (last, f"{first}.{last}", name):
            spelled.setdefault(short, name)
    match = difflib.get_close_matches(text, spelled, n=1)
    return f"did you mean {spelled[match[0]]}?" if match else "`graphslam config` prints them all"


def _parse(text: str) -> tuple[str, list[Any]]:
    name, equals, values = text.partition("=")
    if not equals or not values.strip():
        raise BadConfig(f"--sweep {text}: write it like ekf.matching.gate=5,9,14")
    found = [_value(part.strip()) for part in re.split(r",(?![^\[]*\])", values)]
    return setting_name(name.strip()), found


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _point(base: RunConfig, keys: Sequence[str], values: Sequence[Any]) -> SweepPoint:
    content = asdict(base)
    for key, value in zip(keys, values, strict=True):
        *tables, name = key.split(".")
        table = content
        for part in tables:
            table = table[part]
        table[name] = value
    shown = ", ".join(f"{k} = {_text(v)}" for k, v in zip(keys, values, strict=True))
    config = from_dict(RunConfig, content, f"--sweep {shown}") if keys else base
    return SweepPoint(tuple((key, _text(_at(config, key))) for key in keys), config)


def _at(config: Any, key: str) -> Any:
    for part in key.split("."):
        config = getattr(config, part)
    return config


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value).removesuffix(".0")
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_text(entry) for entry in value) + "]"
    return str(value)
