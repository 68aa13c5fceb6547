"""How long the stages of a run take, and who is told how far they are."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")

Progress = Callable[[str, int, int], None]
"""Called with a stage's name, how much of it is done, and of how much."""

LATENCY = ("median_ms", "p99_ms", "worst_ms", "last_tenth_ms")
"""Of a node: median, what 99 % stay below, worst, and the median of the log's last tenth."""


class Clock:
    """Times the stages of a log by name and tells about them."""

    def __init__(self, progress: Progress | None, name: str) -> None:
        self.progress, self.name = progress, name
        self.seconds: dict[str, float] = {}
        self.nodes: dict[str, list[float]] = {}

    def __call__(self, stage: str, work: Callable[[], T]) -> T:
        self.tell(stage, 0, 1)
        began = time.perf_counter()
        self.nodes[stage] = [began]
        done = work()
        self.seconds[stage] = round(time.perf_counter() - began, 4)
        self.tell(stage, 1, 1)
        return done

    def tell(self, stage: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(f"{self.name}: {stage}", done, total)

    def told(self, method: str, node: int) -> None:
        """Takes the time at which a method was through with a node."""
        self.nodes[method].append(time.perf_counter())

    def timings(self) -> dict[str, Any]:
        """Returns seconds by stage, and by method how long a node took, `LATENCY`."""
        latency = {}
        for method, times in self.nodes.items():
            if len(times) > 1:
                each = np.diff(times)
                late = np.median(each[-max(1, len(each) // 10) :])
                figures = (np.median(each), np.percentile(each, 99), np.max(each), late)
                milliseconds = [round(1e3 * float(figure), 4) for figure in figures]
                latency[method] = dict(zip(LATENCY, milliseconds, strict=True))
        return {**self.seconds, "latency": latency} if latency else dict(self.seconds)

    def inside(self, stage: str) -> Callable[[int, int], None]:
        """Returns a callback for progress within a stage."""
        return lambda done, total: self.tell(stage, done, total)
