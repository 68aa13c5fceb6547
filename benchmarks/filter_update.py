"""The filter's update by two sightings, in passes over its covariance.

Run with ``python benchmarks/filter_update.py``. A pass reads and writes every entry of the
covariance once, compiled and in place. Update and pass take turns; figures are medians.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

import time

import numpy as np
from numba import njit

from graphslam.kalman import JointState

LINES = (20, 200, 2_000)
ROUNDS = 15


@njit(cache=True)
def one_pass(P, factor):  # type: ignore[no-untyped-def]
    """Scales every entry by ``factor``, which the compiler must not know."""
    for i in range(len(P)):
        row = P[i]
        for j in range(len(P)):
            row[j] *= factor


def state_with(lines: int) -> JointState:
    """Returns a state with that many lines, all correlated."""
    rng = np.random.default_rng(1)
    state = JointState(np.zeros(3), 1e-2 * np.eye(3))
    for _ in range(lines):
        state.add(rng.normal(size=2), rng.normal(size=(2, 3)), 1e-4 * np.eye(2))
    return state


def measure(lines: int) -> tuple[float, float, float]:
    """Returns the medians of update, prediction and pass over the covariance, ms."""
    state, rng = state_with(lines), np.random.default_rng(2)
    columns = 3 + 2 * rng.choice(lines, 2, replace=False)[:, None] + np.arange(2)
    J_pose, J_line = rng.normal(size=(2, 2, 3)), np.tile(np.eye(2), (2, 1, 1))
    innovation, cov = 1e-3 * rng.normal(size=(2, 2)), np.tile(1e-4 * np.eye(2), (2, 1, 1))
    works = (
        lambda: state.correct(innovation, J_pose, J_line, columns, cov),
        lambda: state.move(state.mean[:3], np.eye(3), 1e-8 * np.eye(3)),
        lambda: one_pass(state.P, 1.0),
    )
    times = np.empty((ROUNDS + 1, len(works)))
    for row in times:
        for k, work in enumerate(works):
            begin = time.process_time()
            work()
            row[k] = time.process_time() - begin
    update, move, whole = 1e3 * np.median(times[1:], axis=0)
    return float(update), float(move), float(whole)


def main() -> None:
    """Prints the table."""
    print("lines  update ms  prediction ms  pass ms  update in passes")
    for lines in LINES:
        update, move, whole = measure(lines)
        print(f"{lines:5d}  {update:9.3f}  {move:13.3f}  {whole:7.3f}  {update / whole:16.1f}")


if __name__ == "__main__":
    main()
