"""When the messages of a bag happened: two clocks, jumps of either, stamps that repeat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from frontend.readers.bag_content import Stream
from graphslam.geometry import Array
from graphslam.measurements import IntArray

Clock = Literal["header", "receive"]

JUMP_S = 0.5
"""A step of one clock against the other beyond this is a jump, s: no message is so late so
suddenly, and no pause looks like it, since it shows on both clocks."""
CLOCKS_APART_S = 1.0
"""Streams whose stamps differ by more than this from the receive times, one against the other, are
stamped by different clocks, s."""


@dataclass(frozen=True, slots=True)
class Times:
    """When the messages of a stream happened.

    Attributes:
        t: (K,) s, increasing.
        row: (K,) number of each message in its stream; messages may be left out.
        notes: what was mended or left out.
    """

    t: Array
    row: IntArray
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Mended:
    """Both clocks of a stream, without jumps.

    Attributes:
        header: (K,) s.
        received: (K,) s.
        order: (K,) number of each message in the bag.
        notes: what was mended.
        stamped: whether the headers hold times at all.
    """

    header: Array
    received: Array
    order: IntArray
    notes: tuple[str, ...]
    stamped: bool


def times_of(streams: Mapping[str, Stream], clock: Clock, reference: str) -> dict[str, Times]:
    """Returns when the messages of streams happened, on one clock.

    The stamp in a message's header says when it was measured, and is the default; the time when
    it was received comes later by what computing and transport took, each time another bit.

    - A jump of one of both clocks against the other is taken out.
    - Where both run back, the longest part of the reference is kept; the rest is left out.
    - Headers of different clocks are each moved by their median distance from the receive times.
    - Messages whose time repeats, or runs back by less, are left out.

    Args:
        streams: by name.
        clock: which of both times.
        reference: name of the stream that decides about the part that is kept.
    """
    mended = {name: _without_jumps(stream) for name, stream in streams.items()}
    stamped = {
        name: float(np.median(one.header - one.received))
        for name, one in mended.items()
        if one.stamped and len(one.header)
    }
    apart = bool(stamped) and np.ptp(list(stamped.values())) > CLOCKS_APART_S
    chosen: dict[str, Array] = {}
    notes: dict[str, list[str]] = {}
    for name, one in mended.items():
        notes[name] = list(one.notes)
        chosen[name] = one.received if clock == "receive" or not one.stamped else one.header
        if clock == "header" and not one.stamped and len(one.header):
            notes[name].append("its headers hold no times: those of receiving are used")
        if clock == "header" and one.stamped and apart and len(one.header):
            chosen[name] = one.header - stamped[name]
            notes[name].append(
                f"the stamps of this bag are of different clocks; those of this topic were moved "
                f"by {-stamped[name]:+.6g} s to the clock of the receive times"
            )
    first, last, dropped = _kept_part(chosen[reference], mended[reference].order)
    found = {}
    for name, t in chosen.items():
        inside = (mended[name].order >= first) & (mended[name].order < last)
        cut = int(np.count_nonzero(~inside))
        if cut:
            notes[name].append(
                f"the clocks of the bag run back by {dropped:.3g} s; {cut} messages beyond that "
                "are left out: cut the bag there to use them"
            )
        found[name] = replace(_increasing(t, inside), notes=())
        lost = int(np.count_nonzero(inside)) - len(found[name].t)
        if lost:
            notes[name].append(f"{lost} messages whose times repeat or run back are left out")
        found[name] = replace(found[name], notes=tuple(notes[name]))
    return found


def _without_jumps(stream: Stream) -> _Mended:
    """Returns both clocks of a stream, what one jumps against the other taken out."""
    header_ns, received_ns = (np.array(c, np.int64) for c in (stream.stamp, stream.received))
    order = np.array(stream.order, np.int64)
    header, received = header_ns / 1e9, received_ns / 1e9
    stamped = not len(header) or bool(np.any(header_ns != 0)) or len(header) == 1
    if len(header) < 2 or not stamped:
        return _Mended(header, received, order, (), stamped)
    step_header, step_received = np.diff(header_ns) / 1e9, np.diff(received_ns) / 1e9
    jumps = np.flatnonzero(np.abs(step_header - step_received) > JUMP_S)
    if not len(jumps):
        return _Mended(header, received, order, (), stamped)
    moves = np.concatenate([step_header, step_received])
    usual = float(np.median(moves[moves > 0])) if np.any(moves > 0) else 0.0
    of_header = np.abs(step_header[jumps] - usual) > np.abs(step_received[jumps] - usual)
    notes = []
    for which, clock, mine, other in (
        (of_header, "of its stamps", step_header, step_received),
        (~of_header, "of receiving", step_received, step_header),
    ):
        at = jumps[which]
        if not len(at):
            continue
        jump = np.zeros(len(header))
        jump[at + 1] = mine[at] - other[at]
        if clock == "of its stamps":
            header = header - np.cumsum(jump)
        else:
            received = received - np.cumsum(jump)
        largest = jump[np.argmax(np.abs(jump))]
        notes.append(
            f"the clock {clock} jumps {len(at)} times, at most by {largest:+.3g} s; the jumps "
            "are taken out by the other clock"
        )
    return _Mended(header, received, order, tuple(notes), stamped)


def _kept_part(t: Array, order: IntArray) -> tuple[int, int, float]:
    """Returns the messages of a bag, from and to, that are kept, and the largest jump back, s."""
    back = np.flatnonzero(np.diff(t) < -JUMP_S) + 1
    everything = (0, np.iinfo(np.int64).max, 0.0)
    if not len(back):
        return everything
    edges = np.array([0, *back, len(t)])
    longest = int(np.argmax(np.diff(edges)))
    first = order[edges[longest]] if longest else 0
    last = order[edges[longest + 1]] if longest < len(back) else np.iinfo(np.int64).max
    return int(first), int(last), float(-np.diff(t).min())


def _increasing(t: Array, inside: NDArray[np.bool_]) -> Times:
    """Returns the times that are later than all before them."""
    rows = np.flatnonzero(inside)
    if not len(rows):
        return Times(np.zeros(0), rows, ())
    latest = np.maximum.accumulate(t[rows])
    new = np.concatenate([[True], latest[1:] > latest[:-1]])
    return Times(t[rows][new], rows[new], ())
