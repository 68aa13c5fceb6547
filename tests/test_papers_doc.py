"""docs/papers.md: every equation and every misprint, each with a function and a test that exist."""

from __future__ import annotations

import ast
import importlib
import re
from collections import Counter
from pathlib import Path

import pytest

from graphslam.printed import ERRATA

TESTS = Path(__file__).parent
PAGE = (TESTS.parent / "docs" / "papers.md").read_text(encoding="utf-8")
NUMBERED = {
    "SantanaLoc": [*(f"({n})" for n in range(1, 32)), "'(22)'", "'(23)'"],
    "SantanaSLAM": [f"({n})" for n in range(1, 29)],
}
"""Equation numbers of each paper; SantanaLoc gives 22 and 23 to two equations each."""
TEXTS = {"SantanaLoc": "santana-localization.txt", "SantanaSLAM": "santana-slam.txt"}


def rows(heading: str) -> list[list[str]]:
    """Returns the cells of all tables under a heading of the second level, without their heads."""
    section = re.split(r"^## ", PAGE, flags=re.MULTILINE)
    text = next(part for part in section if part.startswith(f"{heading}\n"))
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines]
    return [
        [c.strip() for c in row]
        for row in cells
        if row[0].strip() not in ("eq.", "erratum", "section")
    ]


def resolve(name: str) -> object:
    """Returns what an import path names; an error where there is no such thing."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[cut:]:
            found = getattr(found, attribute)
        return found
    raise ModuleNotFoundError(name)


def names_in(file: str) -> set[str]:
    tree = ast.parse((TESTS / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("paper", NUMBERED)
def test_no_equation_is_missing_or_twice(paper: str) -> None:
    listed = [row[0] for row in rows(paper) if "(" in row[0]]
    assert Counter(listed) == Counter(NUMBERED[paper])


@pytest.mark.parametrize("paper", NUMBERED)
def test_the_numbers_are_those_of_the_paper(paper: str, shared_data: Path) -> None:
    text = shared_data.parent / "papers" / TEXTS[paper]
    if not text.is_file():
        pytest.skip(f"the paper's text is not here: {text}")
    printed = re.findall(r"\\quad \((\d+)\)|\((\d+)\)\s*\$\$", text.read_text(encoding="utf-8"))
    numbers = {int(a or b) for a, b in printed}
    listed = {int(number.strip("'()")) for number in NUMBERED[paper]}
    assert numbers <= listed
    assert max(listed) == max(numbers)


@pytest.mark.parametrize("paper", NUMBERED)
def test_each_equation_has_a_function_that_exists_or_says_why_not(paper: str) -> None:
    for number, _, function, _ in rows(paper):
        if function.startswith("none: "):
            assert len(function) > 20, number
        else:
            assert callable(resolve(function.strip("`"))) or isinstance(
                resolve(function.strip("`")), property
            ), number


@pytest.mark.parametrize("heading", [*NUMBERED, "Errata"])
def test_each_row_names_a_test_that_exists(heading: str) -> None:
    for row in rows(heading):
        file, _, name = row[-1].strip("`").partition("::")
        assert name.startswith("test_"), row
        assert name in names_in(file), row


def test_every_erratum_is_listed_as_the_registry_has_it() -> None:
    listed = {
        row[0].strip("`"): [c.replace(r"\|", "|") for c in row[1:4]] for row in rows("Errata")
    }
    assert listed == {
        name: [f"{e.paper} {e.where}", e.printed, e.right] for name, e in ERRATA.items()
    }
    assert list(listed) == list(ERRATA)


@pytest.mark.parametrize("paper", NUMBERED)
def test_equations_with_a_misprint_are_marked(paper: str) -> None:
    marked = {
        row[0] for row in rows(paper) if "**misprint**" in row[1] or "**misprint**:" in row[1]
    }
    for erratum in ERRATA.values():
        if erratum.paper == paper:
            for number in re.findall(r"'?\(\d+\)'?", erratum.where):
                assert number in marked, erratum.name
