"""Sightings that arrive later than they were made: going back to their time, or pretending not to.

A camera's frame takes time to expose, to send and to search. `Arrivals` says which sightings are
known at which node; the filter goes back to the first node that a new one belongs to, takes all
that is known by then, and comes forward again over the same odometry (Bellini section 4). What it
says of a pose at its time is so what a filter could have said then; in the end it is what a filter
says to which everything came in time, to the last bit.
"""

from __future__ import annotations

import copy
from collections import Counter
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from graphslam.config import EkfConfig
from graphslam.estimate import Estimate, Told
from graphslam.geometry import Array
from graphslam.measurements import IntArray, Measurements, Sightings
from graphslam.models import MODELS

if TYPE_CHECKING:
    from graphslam.ekf import Filter

TOO_LATE = "sighting that came too late to go back for"
OUT_OF_ORDER = "sighting that came after others that were made later"

UNCHANGED = {"measurements", "config", "at", "known"}
CONTENT = UNCHANGED | {"history", "match", "used", "nis", "innovation", "first_poses"}
"""What of a filter is not copied to go back to: the rest of it is cut off, or written anew."""


class Arrivals:
    """When each sighting is known, in nodes.

    The last pose waits for what is on its way then: the node behind the last, N, is when all has
    arrived.

    Attributes:
        node: by kind, (K,) the first node at whose time each sighting is there; N where it is not
            there at the last.
        counts: how many came too late, and how many out of order.
        tables: the tables, each with the number of its first sighting over all, in the order in
            which a node takes them: what needs no landmark first, because a landmark shall start
            from the best pose of its node.
    """

    def __init__(self, measurements: Measurements, longest_s: float) -> None:
        t = measurements.t
        self.node: dict[str, IntArray] = {}
        self.counts: Counter[str] = Counter()
        self._made: dict[str, IntArray] = {}
        self._starts = {}
        for _, table in measurements.tables():
            delay = table.t_received - t[table.node]
            late = delay > longest_s
            self.counts[TOO_LATE] += int(late.sum())
            arrival = np.maximum(arrival_nodes(t, table), table.node)
            self.node[table.kind] = np.where(late, len(t) + 1, arrival)
            self._made[table.kind] = table.node
            self._starts[table.kind] = table.starts(len(t))
        self.counts[OUT_OF_ORDER] += _out_of_order(measurements)
        self._back, self._open = self._spans(len(t))
        self.tables = sorted(
            measurements.tables(), key=lambda e: MODELS[e[1].kind].dim_landmark > 0
        )

    @property
    def after_last(self) -> bool:
        """Whether something is still on its way at the last node."""
        return bool(self._back[-1] < len(self._open))

    def back(self, now: int) -> int:
        """Returns the first node that something belongs to which is known since node ``now``."""
        return int(self._back[now])

    def awaits(self, node: int, now: int) -> bool:
        """Returns whether something made at ``node`` is still on its way at node ``now``."""
        return bool(self._open[node] > now)

    def news(self, table: Sightings) -> list[IntArray]:
        """Returns for every node the rows of sightings that are known since then, as made.

        Those that are on their way at the last node count as known there.
        """
        last = len(self._open) - 1
        at = self.node[table.kind]
        known = np.flatnonzero(at <= last + 1)
        at = np.minimum(at[known], last)
        known = known[np.argsort(at, kind="stable")]
        return np.split(known, np.searchsorted(np.sort(at), np.arange(1, last + 1)))

    def rows(self, table: Sightings, node: int, now: int) -> IntArray:
        """Returns the rows of sightings made at ``node`` that are known at node ``now``."""
        rows = np.arange(*self._starts[table.kind][node : node + 2])
        return rows[self.node[table.kind][rows] <= now]

    def _spans(self, nodes: int) -> tuple[IntArray, IntArray]:
        """Returns (N + 1,) the node to go back to at each, and (N,) until when each waits."""
        back = np.arange(nodes + 1)
        until = np.arange(nodes)
        for kind, arrival in self.node.items():
            known = arrival <= nodes
            np.minimum.at(back, arrival[known], self._made[kind][known])
            np.maximum.at(until, self._made[kind][known], arrival[known])
        return back, until


def arrival_nodes(t: Array, table: Sightings) -> IntArray:
    """Returns (K,) the first node at whose time each sighting is there; N where none is.

    Args:
        t: (N,) times of the nodes, s.
        table: sightings.
    """
    return np.searchsorted(t, table.t_received, side="left")


def _out_of_order(measurements: Measurements) -> int:
    """Returns how many sightings arrive after one that was made later, whatever its kind."""
    tables = [table for _, table in measurements.tables()]
    if not tables:
        return 0
    received = np.concatenate([table.t_received for table in tables])
    made = np.concatenate([table.node for table in tables])
    order = np.lexsort([made, received])
    latest = np.maximum.accumulate(made[order]) if len(order) else made
    return int(np.count_nonzero(made[order] < latest))


class Past:
    """What a filter goes back to: copies of all that changes, as it was before each node."""

    def __init__(self, run: Filter) -> None:
        self._run = run
        self._kept: dict[int, tuple[dict[str, Any], int]] = {}

    def keep(self, node: int) -> None:
        """Keeps how everything is now, before a node."""
        run = self._run
        shared: dict[int, Any] = {id(value): value for value in (run, *self._content())}
        changing = {name: value for name, value in vars(run).items() if name not in CONTENT}
        self._kept[node] = copy.deepcopy(changing, shared), len(run.history)

    def go_back(self, node: int) -> None:
        """Makes everything as it was before a node, which was kept."""
        run = self._run
        kept, entries = self._kept.pop(node)
        vars(run).update(kept)
        run.history.cut(entries)
        for first, table in run.measurements.tables():
            since = slice(first + int(np.searchsorted(table.node, node)), first + len(table))
            self._unmatch(since)
            for track in run.waiting.tracks:  # a landmark that started later took these, too
                if track.kind == table.kind:
                    self._unmatch(first + np.array(track.rows))

    def _unmatch(self, sightings: slice | IntArray) -> None:
        run = self._run
        run.match[sightings], run.used[sightings], run.nis[sightings] = -1, False, np.nan

    def forget(self, arrivals: Arrivals, now: int) -> None:
        """Drops what nothing awaits any more at node ``now``."""
        for node in [node for node in self._kept if not arrivals.awaits(node, now)]:
            del self._kept[node]

    def _content(self) -> list[Any]:
        return [value for name, value in vars(self._run).items() if name in CONTENT]


def run_naive(
    measurements: Measurements, config: EkfConfig | None = None, told: Told | None = None
) -> Estimate:
    """Returns what the filter says that takes every sighting for one of the moment it arrives.

    The faster the robot and the longer the delay, the worse: it stands for what many robots do.

    Args:
        measurements: nodes, odometry, sightings.
        config: as of the filter.
        told: called after each node.
    """
    from graphslam.ekf import run_ekf

    tables, places = {}, []
    for first, table in measurements.tables():
        arrival = arrival_nodes(measurements.t, table)
        rows = np.flatnonzero(arrival < len(measurements.t))
        rows = rows[np.argsort(arrival[rows], kind="stable")]
        columns = {f.name: getattr(table, f.name)[rows] for f in fields(table) if f.name != "kind"}
        columns["node"] = arrival[rows]
        columns["t_received"] = measurements.t[arrival[rows]]
        tables[table.kind] = Sightings(table.kind, **columns)
        places.append(first + rows)
    estimate = run_ekf(replace(measurements, sightings=tables), config, told=told)
    place = np.concatenate(places) if places else np.zeros(0, np.int64)
    count = measurements.sighting_count

    def back(values: Any, otherwise: Any) -> Any:
        whole = np.full(count, otherwise)
        whole[place] = values
        return whole

    return replace(
        estimate,
        method="ekf-naive",
        match=back(estimate.match, -1),
        used=back(estimate.used, False),
        nis=back(estimate.nis, np.nan),
        weight=back(estimate.weight, 1.0),
    )
