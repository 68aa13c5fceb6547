"""What two things that are compared have in common."""

from __future__ import annotations

from dataclasses import dataclass

from compare.two_maps_sources import Source


@dataclass(frozen=True, slots=True)
class Relation:
    """What two sources have in common.

    Attributes:
        same_measurements: both are estimates from the very same measurements.
        same_log: both come from one log, so that they share a clock.
        independent: whether their errors have nothing in common, as far as is known.
        why: the reason, for people.
    """

    same_measurements: bool
    same_log: bool
    independent: bool
    why: str


def relation(a: Source, b: Source) -> Relation:
    """Returns how two sources belong together."""
    same_log = len(a.logs) == 1 and a.logs == b.logs
    same = bool(a.measurements) and a.measurements == b.measurements
    truth = [s for s in (a, b) if s.certainty == "exact"]
    if truth:
        why = f"only one map’s covariance counts, because {truth[0].label} is taken as exact"
        return Relation(same, same_log, True, why)
    if same:
        why = "both are estimates from the same measurements, so their errors are correlated"
        return Relation(True, same_log, False, why)
    if same_log:
        why = "both come from the same log, so their errors are correlated"
        return Relation(False, True, False, why)
    if set(a.logs) & set(b.logs):
        why = "both hold measurements of one log, so their errors are correlated"
        return Relation(False, False, False, why)
    if a.logs and b.logs:
        why = "the maps come from different logs, so their errors are independent"
        return Relation(False, False, True, why)
    unknown = " and ".join(s.label for s in (a, b) if not s.logs)
    why = f"nothing tells which log {unknown} is from, so the maps are taken as independent"
    return Relation(False, False, True, why)
