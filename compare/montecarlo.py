"""Many seeded runs of one job: in parallel, resumable, the same table whatever happened."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

from compare.folders import whole_file
from graphslam.errors import BadConfig, GraphSlamError

Value = float | int | str
Job = Callable[[int], Mapping[str, Value]]
"""Called with the run's number, which is its seed; returns what the run came to, by name."""
Progress = Callable[[str, int, int], None]

FORMAT = "graphslam-runs/1"
FILE = "runs.jsonl"
ORPHAN_S = 20.0
"""Workers that get nothing to do end after this time, s: those of a killed study, too."""


@dataclass(frozen=True, slots=True)
class SeededRun:
    """One run of a job.

    Attributes:
        run: its number and seed.
        values: what it came to, by name; empty where it failed. NaN where a number is undefined.
        error: why it failed; empty where it did not.
    """

    run: int
    values: Mapping[str, Value] = field(default_factory=dict)
    error: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))


def run_seeded(
    job: Job,
    runs: int,
    out: Path | None,
    *,
    jobs: int = 0,
    fingerprint: str = "",
    progress: Progress | None = None,
) -> tuple[SeededRun, ...]:
    """Returns the results of ``job(0)`` to ``job(runs - 1)``, by run number.

    Runs go to worker processes with one BLAS thread each, also where there is only one worker, so
    that their number changes no bit of a result. With ``out`` each finished run is appended to
    ``out/runs.jsonl`` at once; the next call does only what is missing. When all are done the file
    is put in order: killed and resumed or not, its bytes are the same.

    Args:
        job: what to do; pickled for the workers. An exception is the result of its run and stops
            no other.
        runs: how many; more than last time adds runs, fewer leaves some of the file unused.
        out: folder to keep results in, made where it is missing; None keeps nothing.
        jobs: worker processes; 0: as many as the machine has cores.
        fingerprint: says what the job computes; results under another one are not taken over.
        progress: called with "runs", how many are done, and of how many.

    Raises:
        BadConfig: a number is out of range, or ``out`` holds something else than such runs.
        GraphSlamError: a worker process died.
        OSError: the results cannot be written.
    """
    if runs < 1 or jobs < 0:
        raise BadConfig(f"runs = {runs}, jobs = {jobs}: need at least one run, and jobs 0 or more")
    done = {} if out is None else _resume(out, fingerprint)
    missing = [run for run in range(runs) if run not in done]
    kept = runs - len(missing)
    if progress is not None:
        progress("runs", kept, runs)
    stream = None if out is None else (out / FILE).open("a", encoding="utf-8", newline="\n")
    try:
        for count, result in enumerate(_results(job, missing, jobs), start=kept + 1):
            done[result.run] = result
            _append(stream, result)
            if progress is not None:
                progress("runs", count, runs)
    finally:
        if stream is not None:
            stream.close()
    if out is not None:
        ordered = [_line(_content(done[run])) for run in sorted(done)]
        _write(out, _header(fingerprint) + "".join(ordered))
    return tuple(done[run] for run in range(runs))


# ---- workers ----------------------------------------------------------------------------------


def _results(job: Job, runs: list[int], jobs: int) -> Iterator[SeededRun]:
    """Yields results as runs finish."""
    import joblib

    if not runs:
        return
    workers = jobs or os.cpu_count() or 1
    # joblib runs a single worker in this process, whose BLAS threads are what they are: ask for
    # two, and hand out one run at a time
    with joblib.parallel_config(
        backend="loky",
        n_jobs=max(workers, 2),
        inner_max_num_threads=1,
        idle_worker_timeout=ORPHAN_S,
    ):
        parallel = joblib.Parallel(
            return_as="generator_unordered",
            batch_size=1,
            pre_dispatch=1 if workers == 1 else "2*n_jobs",
        )
        try:
            yield from parallel(joblib.delayed(_attempt)(job, run) for run in runs)
        except BrokenProcessPool as died:
            raise GraphSlamError(
                "a worker process was killed, perhaps for want of memory; the same command again "
                "goes on where it stopped, with fewer --jobs if need be"
            ) from died


def _attempt(job: Job, run: int) -> SeededRun:
    try:
        values = {name: _value(value) for name, value in job(run).items()}
    except Exception as error:  # whatever it is, the other runs go on
        name = "" if isinstance(error, GraphSlamError) else f"{type(error).__name__}: "
        return SeededRun(run, error=f"{name}{error}" or type(error).__name__)
    return SeededRun(run, values)


def _value(value: Any) -> Value:
    """Returns a value as the file gives it back: a float that is not finite is NaN."""
    if isinstance(value, str | int):
        return value
    number = float(value)
    return number if math.isfinite(number) else math.nan


# ---- the file ---------------------------------------------------------------------------------


def _header(fingerprint: str) -> str:
    return _line({"format": FORMAT, "fingerprint": fingerprint})


def _line(content: Mapping[str, Any]) -> str:
    return json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n"


def _write(out: Path, content: str) -> None:
    with whole_file(out / FILE) as beside:
        beside.write_text(content, encoding="utf-8", newline="\n")


def _content(result: SeededRun) -> dict[str, Any]:
    if result.error:
        return {"run": result.run, "error": result.error}
    values = {k: None if v != v else v for k, v in result.values.items()}
    return {"run": result.run, "values": values}


def _append(stream: IO[str] | None, result: SeededRun) -> None:
    if stream is not None:
        stream.write(_line(_content(result)))
        stream.flush()


def _resume(out: Path, fingerprint: str) -> dict[int, SeededRun]:
    """Returns the runs that are done, and leaves a file to append to."""
    done, whole = _read(out, fingerprint)
    out.mkdir(parents=True, exist_ok=True)
    if not whole:
        _write(out, _header(fingerprint))
    else:
        with (out / FILE).open("r+b") as stream:
            stream.truncate(len(whole))
    return done


def _read(out: Path, fingerprint: str) -> tuple[dict[int, SeededRun], bytes]:
    """Returns the runs that are done, and the file's content without a half-written last line.

    Raises:
        BadConfig: the folder or the file is not ours, or holds other runs.
    """
    path = out / FILE
    if not path.exists():
        _check_empty(out)
        return {}, b""
    content = path.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    lines = whole.splitlines(keepends=True)
    _check_header(out, lines, fingerprint)
    done: dict[int, SeededRun] = {}
    for number, line in enumerate(lines[1:], start=2):
        result = _parse(line)
        if result is not None:
            done.setdefault(result.run, result)
        elif number == len(lines):
            whole = whole[: -len(line)]
        else:
            raise BadConfig(f"{path}:{number}: is damaged; remove the line to do that run again")
    return done, whole


def _check_empty(out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise BadConfig(f"{out}: is not a folder; give another --out")
    if out.exists() and any(entry.name != f".{FILE}.partial" for entry in out.iterdir()):
        raise BadConfig(
            f"{out}: exists and holds no {FILE} of ours, so nothing is written into it; give "
            "another --out, or move it away"
        )


def _check_header(out: Path, lines: list[bytes], fingerprint: str) -> None:
    try:
        header = json.loads(lines[0])
        ours = isinstance(header, dict) and header.get("format") == FORMAT
    except (IndexError, ValueError, RecursionError):
        ours = False
    if not ours:
        raise BadConfig(f"{out / FILE}: was not written by this program; give another --out")
    if header.get("fingerprint") != fingerprint:
        raise BadConfig(
            f"{out}: holds runs of another scenario, configuration or version; give another --out, "
            "or remove the folder to start again"
        )


def _parse(line: bytes) -> SeededRun | None:
    """Returns the run that a line holds, or None where it is damaged."""
    try:
        content = json.loads(line)
        values = {k: math.nan if v is None else v for k, v in content.get("values", {}).items()}
        return SeededRun(int(content["run"]), values, str(content.get("error", "")))
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
        return None
