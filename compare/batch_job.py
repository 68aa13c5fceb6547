"""One job of a batch: one log under one configuration, done in whichever process."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Literal

from compare.batch_lock import alone_at
from compare.config import RunConfig
from compare.fingerprint import fingerprints, holds_measurements, holds_result
from graphslam.errors import GraphSlamError
from graphslam.measurements import Measurements

JOURNAL = "computed.jsonl"
State = Literal["computed", "kept", "failed"]

_one_job = Lock()
"""Jobs in threads of one process take turns: what draws the plots is not made for threads."""


@dataclass(frozen=True, slots=True)
class Job:
    """What a worker is told: paths and settings, no data.

    Attributes:
        number: of the job in its batch.
        log: path of the log, absolute.
        folder: its result folder, absolute.
        config: what to compute.
        reports: whether the result needs report.html and plots.
        siblings: result folders of the same log under other configurations; measurements are taken
            from there where they are the same.
        journal: file to note in what was computed.
    """

    number: int
    log: Path
    folder: Path
    config: RunConfig
    reports: bool
    siblings: tuple[Path, ...]
    journal: Path


@dataclass(frozen=True, slots=True)
class Done:
    """How a job ended.

    Attributes:
        number: of the job.
        state: computed; kept, because the result was there already; or failed.
        reason: why it failed; empty where it did not.
    """

    number: int
    state: State
    reason: str = ""


def do(job: Job) -> Done:
    """Does a job, unless its result is there already; whatever goes wrong is its result."""
    try:
        with _one_job, alone_at(job.folder):
            return _compute(job)
    except Exception as error:  # whatever it is, the other jobs go on
        return Done(job.number, "failed", reason_of(error))


def reason_of(error: BaseException) -> str:
    """Returns one line about an error, and how to report it if it is not the user's."""
    if isinstance(error, GraphSlamError):
        text = str(error)
    elif isinstance(error, OSError):
        text = f"{error.filename or 'a file'}: {error.strerror or error}"
    else:
        text = (
            f"{type(error).__name__}: {error}; this is a defect of graphslam: please report it "
            "with what `graphslam run` prints for this log under GRAPHSLAM_TRACEBACK=1"
        )
    return " ".join(text.split())


def _compute(job: Job) -> Done:
    from compare.opening import open_as, settings_for
    from compare.run import run_opened

    config = settings_for(job.log, job.config)
    log = open_as(job.log, config)
    if config.extract.workers == 0:  # the other cores have jobs of their own
        config = replace(config, extract=replace(config.extract, workers=1))
    wanted = fingerprints(log, config)
    if holds_result(job.folder, wanted) and has_report(job.folder) >= job.reports:
        return Done(job.number, "kept")
    began = time.time()
    run_opened(
        log,
        job.folder,
        config,
        measurements=_measured(job.siblings, wanted),
        report=job.reports,
    )
    _note(job, began)
    return Done(job.number, "computed")


def has_report(folder: Path) -> bool:
    """Returns whether a result folder has its page; `graphslam report` makes missing ones."""
    return (folder / "report.html").is_file()


def _measured(siblings: Sequence[Path], wanted: dict[str, str]) -> Measurements | None:
    """Returns the measurements that another configuration's run left, if they are the same."""
    for folder in siblings:
        if holds_measurements(folder, wanted):
            with suppress(GraphSlamError, OSError):
                return Measurements.load(folder / "measurements.npz")
    return None


def _note(job: Job, began: float) -> None:
    """Appends a line to the journal: for people; nothing reads it, nothing fails without it."""
    note = {
        "result": job.folder.relative_to(job.journal.parent).as_posix(),
        "began_unix_s": round(began, 3),
        "took_s": round(time.time() - began, 3),
        "host": platform.node(),
        "process": os.getpid(),
    }
    with suppress(OSError), job.journal.open("a", encoding="utf-8", newline="\n") as stream:
        stream.write(json.dumps(note, ensure_ascii=False) + "\n")
