"""A batch that is killed again and again comes to the same tables, and does nothing twice."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compare.batch import Batch, batch
from compare.config import RunConfig
from tests.compare.batch_logs import (
    QUICK,
    computed,
    corrupt,
    final_files,
    killed_batch,
    results,
    write_logs,
)

LOGS = 9
BAD = "log-4"
CONFIG = RunConfig(methods=QUICK)

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="kills by POSIX signals")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_logs(tmp_path_factory.mktemp("logs"), LOGS)
    corrupt(folder / BAD)
    return folder


@pytest.fixture(scope="module")
def uninterrupted(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> Batch:
    return batch([logs], tmp_path_factory.mktemp("batch") / "out", CONFIG, jobs=2, reports=False)


def check_same(out: Path, uninterrupted: Batch) -> None:
    """Asserts equal bytes, nothing lost, and nothing computed twice."""
    assert final_files(out) == final_files(uninterrupted.folder)
    assert results(out) == results(uninterrupted.folder)
    done = computed(out)
    assert len(done) == len(set(done))
    leftovers = [path.name for path in out.iterdir() if path.name.startswith(".")]
    assert leftovers == []


def test_uninterrupted_batch_reports_the_corrupt_log_and_does_all_others(
    uninterrupted: Batch,
) -> None:
    assert [failure.log for failure in uninterrupted.failures] == [BAD]
    assert "sightings.csv:" in uninterrupted.failures[0].reason
    assert (uninterrupted.computed, uninterrupted.kept) == (LOGS - 1, 0)
    assert sorted(computed(uninterrupted.folder)) == sorted(results(uninterrupted.folder))
    assert len(results(uninterrupted.folder)) == LOGS - 1


def test_killed_and_restarted_batch_gives_the_same_bytes_and_computes_nothing_twice(
    logs: Path, uninterrupted: Batch, tmp_path: Path
) -> None:
    rng, out = np.random.default_rng(4), tmp_path / "out"
    finished: set[str] = set()
    for ends, whole_group in ((1, True), (3, False)):
        killed_batch(logs, out, ends, rng.uniform(0.0, 0.1), whole_group)
        assert not (out / "batch.csv").exists()
        now = set(results(out))
        assert now >= finished
        finished = now
    assert 1 <= len(finished) < LOGS - 1
    restarted = batch([logs], out, CONFIG, jobs=2, reports=False)
    assert restarted.kept >= len(finished)
    check_same(out, uninterrupted)


@pytest.fixture
def cluster() -> Iterator[Any]:
    distributed = pytest.importorskip(
        "distributed", reason="Dask is not installed: pip install 'floorline-slam[cluster]'"
    )
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as started:
        yield started


def test_dask_cluster_gives_the_same_bytes_though_its_client_was_killed(
    logs: Path, uninterrupted: Batch, tmp_path: Path, cluster: Any
) -> None:
    out = tmp_path / "out"
    killed_batch(logs, out, 2, 0.05, whole_group=True, dask=cluster.scheduler_address)
    finished = results(out)
    assert 1 <= len(finished) < LOGS - 1
    restarted = batch([logs], out, CONFIG, dask=cluster.scheduler_address, reports=False)
    assert restarted.kept >= len(finished)
    check_same(out, uninterrupted)
