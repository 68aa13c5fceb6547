"""Tells once that code is being compiled: the first run after an installation waits for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

COMPILING = "compiling, once after an installation: takes some seconds"
OURS = ("graphslam", "frontend", "compare")


@contextmanager
def told_when_compiling(tell: Callable[[str], object]) -> Iterator[None]:
    """Calls ``tell`` with a sentence when numba first compiles a function of ours, at most once.

    What numba's cache on disk holds is not compiled. Cached code is found by the version of numba,
    the processor and the source file.
    """
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc]
        told = False

        def on_start(self, started: event.Event) -> None:
            package = started.data["dispatcher"].py_func.__module__.partition(".")[0]
            if package in OURS and not self.told:
                self.told = True
                tell(COMPILING)

        def on_end(self, ended: event.Event) -> None:
            pass

    listener = Listener()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
