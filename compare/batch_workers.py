"""Who does the jobs of a batch: processes of this machine, or an existing Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from compare.batch_job import Done, Job, do, reason_of
from compare.montecarlo import ORPHAN_S
from graphslam.errors import BadConfig, GraphSlamError

CONNECT_S = 10.0
"""How long to try to reach a scheduler, s."""
DIED = (
    "its worker process died, perhaps for want of memory; give fewer --jobs, or leave this log out"
)


def in_processes(jobs: Sequence[Job], workers: int) -> Iterator[Done]:
    """Yields results as jobs end, from worker processes with one BLAS thread each.

    A job whose worker dies is found by giving each job that may have been at work a worker of its
    own; it has then failed, and the others go on.

    Args:
        jobs: what to do.
        workers: processes; 0: as many as the machine has cores.
    """
    workers = workers or os.cpu_count() or 1
    waiting = {job.number: job for job in jobs}
    while waiting:
        try:
            for done in _parallel(list(waiting.values()), workers):
                del waiting[done.number]
                yield done
        except BrokenProcessPool:
            for suspect in list(waiting.values())[: _ahead(workers)]:
                del waiting[suspect.number]
                yield _on_its_own(suspect)


def _ahead(workers: int) -> int:
    """Returns how many jobs are handed out that have not ended."""
    return 1 if workers == 1 else 2 * workers


def _on_its_own(job: Job) -> Done:
    try:
        (done,) = _parallel([job], 1)
        return done
    except BrokenProcessPool:
        return Done(job.number, "failed", DIED)


def _parallel(jobs: Sequence[Job], workers: int) -> Iterator[Done]:
    import joblib

    # joblib runs a single worker in this process, whose BLAS threads are what they are: ask for
    # two, and hand out one job at a time
    with joblib.parallel_config(
        backend="loky",
        n_jobs=max(workers, 2),
        inner_max_num_threads=1,
        idle_worker_timeout=ORPHAN_S,
    ):
        parallel = joblib.Parallel(
            return_as="generator_unordered", batch_size=1, pre_dispatch=_ahead(workers)
        )
        yield from parallel(joblib.delayed(do)(job) for job in jobs)


# ---- a cluster --------------------------------------------------------------------------------


def on_cluster(jobs: Sequence[Job], address: str) -> Iterator[Done]:
    """Yields results as jobs end, from the workers of a Dask cluster.

    Workers get paths: they must have this package and see the logs and the results' folder under
    the same paths as this machine.

    Args:
        jobs: what to do.
        address: of the scheduler, like tcp://host:8786.

    Raises:
        BadConfig: Dask is not installed here, or no scheduler answers.
        GraphSlamError: the scheduler has no worker, or is lost.
    """
    with _client(address) as (distributed, client):
        if not client.scheduler_info(n_workers=-1)["workers"]:
            raise GraphSlamError(f"{address}: the cluster has no worker; start some: dask worker")
        numbers = {client.submit(do, job, pure=False): job.number for job in jobs}
        for future in distributed.as_completed(list(numbers), loop=client.loop):
            yield _result(distributed, future, numbers.pop(future))


def _result(distributed: Any, future: Any, number: int) -> Done:
    error = future.exception() if future.status == "error" else None
    if future.status == "finished":
        done: Done = future.result()
        return done
    if isinstance(error, distributed.KilledWorker):
        return Done(number, "failed", DIED)
    if isinstance(error, ImportError):
        reason = f"a worker of the cluster lacks a package ({error}); install the same there"
        return Done(number, "failed", reason)
    if error is not None:
        return Done(number, "failed", reason_of(error))
    raise GraphSlamError(
        "the cluster was lost; the same command goes on where it stopped once it is there again"
    )


@contextmanager
def _client(address: str) -> Iterator[tuple[Any, Any]]:
    try:
        import distributed
    except ModuleNotFoundError as missing:
        raise BadConfig(
            "--dask needs the package distributed: pip install 'floorline-slam[cluster]'"
        ) from missing
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:  # a TimeoutError is an OSError
        raise BadConfig(
            f"--dask {address}: no scheduler answers ({error}); check the address, which `dask "
            "scheduler` prints when it starts"
        ) from error
    with client:
        yield distributed, client


def thread_warnings(address: str) -> list[str]:
    """Returns what slows a cluster's workers down: several threads, which take turns with jobs.

    Raises:
        BadConfig: Dask is not installed here, or no scheduler answers.
    """
    with _client(address) as (_, client):
        workers = client.scheduler_info(n_workers=-1)["workers"]
    threads = [int(worker["nthreads"]) for worker in workers.values()]
    many = [count for count in threads if count > 1]
    if not many:
        return []
    return [
        f"{len(many)} of {len(threads)} workers of {address} have several threads (up to "
        f"{max(many)}), and a process does one log at a time; start them with `dask worker "
        "--nworkers N --nthreads 1`"
    ]
