"""That compiling is told, once, and only of code of ours."""

from __future__ import annotations

from numba import njit

from compare.compiling import COMPILING, told_when_compiling


def compiled_in(module: str):  # type: ignore[no-untyped-def]
    def add(a, b):  # type: ignore[no-untyped-def]
        return a + b

    add.__module__ = module
    return njit(add)


def test_compiling_is_told_once_and_what_is_compiled_already_is_not() -> None:
    told: list[str] = []
    add = compiled_in("frontend.made")
    with told_when_compiling(told.append):
        add(1, 2)
        add(1.0, 2.0)
    assert told == [COMPILING]
    with told_when_compiling(told.append):
        add(3, 4)
    assert told == [COMPILING]


def test_code_of_others_and_what_comes_later_is_not_told() -> None:
    told: list[str] = []
    with told_when_compiling(told.append):
        compiled_in("elsewhere")(1, 2)
    compiled_in("frontend.made")(1, 2)
    assert told == []
