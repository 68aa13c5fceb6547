"""Several logs, one after the other, each into a folder of its own, and an index of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from compare.clock import Progress
from compare.config import RunConfig
from compare.folders import writing
from compare.opening import open_as, settings_for
from compare.report import IndexEntry, check_index, write_index
from compare.run import RESULTS, RunResult, run_opened


@dataclass(frozen=True, slots=True)
class Outcome:
    """One of several logs.

    Attributes:
        path: the log as it was named.
        result: what came out; None where it failed.
        error: why it failed; None where it did not.
    """

    path: Path
    result: RunResult | None
    error: Exception | None


def run_logs(
    paths: Sequence[Path | str],
    out: Path | str | None = None,
    config: RunConfig | None = None,
    progress: Progress | None = None,
) -> tuple[Outcome, ...]:
    """Runs several logs, each into ``out/<log name>``, and writes ``out/index.html``.

    A log that fails does not stop the others. Logs of one name get -2, -3, ... in their order.

    Args:
        paths: the logs.
        out: folder of the result folders; ``results`` where None.
        config: what to compute; None for the defaults.
        progress: told about each stage of each log.

    Raises:
        BadConfig: ``out`` holds an index.html that is not ours.
        OSError: the index cannot be written.
    """
    out = RESULTS if out is None else Path(out)
    check_index(out)
    taken: set[str] = set()
    config = config or RunConfig()
    outcomes = tuple(
        _attempt(Path(path), out, taken, settings_for(path, config), progress) for path in paths
    )
    with writing(out):
        write_index(out, [_index_entry(outcome) for outcome in outcomes])
    return outcomes


def _attempt(
    path: Path, out: Path, taken: set[str], config: RunConfig | None, progress: Progress | None
) -> Outcome:
    try:
        log = open_as(path, config, progress)
        name, number = log.name, 1
        while name in taken:
            number += 1
            name = f"{log.name}-{number}"
        taken.add(name)
        return Outcome(path, run_opened(log, out / name, config, progress), None)
    except Exception as error:  # whatever it is, the other logs go on
        return Outcome(path, None, error)


def _index_entry(outcome: Outcome) -> IndexEntry:
    if outcome.result is None:
        return IndexEntry(str(outcome.path), None, {}, str(outcome.error))
    result = outcome.result
    metrics = {} if result.comparison is None else result.comparison.to_dict()
    return IndexEntry(result.log.name, result.folder.name, metrics, "")
