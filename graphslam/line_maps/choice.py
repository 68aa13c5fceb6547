"""Which of the alignments that fit equally well the small differences of the lines speak for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats

from graphslam.line_maps.alignment import Alignment
from graphslam.line_maps.ambiguity import Ambiguity, ambiguity
from graphslam.line_maps.chi2 import MapTest, same_map
from graphslam.line_maps.config import AlignmentConfig
from graphslam.line_maps.line_map import LineMap

RULED_OUT = 1e-3
"""An alignment whose differences have a smaller probability than this is out of the question."""


@dataclass(frozen=True, slots=True)
class Choice:
    """Alignments that fit equally well by length, told apart by how closely their lines lie.

    A floor that repeats to within the tolerances seldom repeats to within the covariances. What is
    out of the question is judged beside the alignment that fits most closely: where even its
    differences are larger than the covariances allow, all are allowed as much more.

    Attributes:
        rows: alignments, the one to take first, then the others in question, then those that are
            out of it; each part in the order of `Ambiguity.equal`.
        tests: their differences, in the same order.
        in_question: how many of them, from the first on, are in question.
        question: how those differ from each other.
    """

    rows: tuple[int, ...]
    tests: tuple[MapTest, ...]
    in_question: int
    question: Ambiguity

    def __str__(self) -> str:
        if len(self.rows) == 1 or not self.tests[0].freedom:
            return ""
        kept = [test.per_freedom for test in self.tests[: self.in_question]]
        others = [test.per_freedom for test in self.tests[self.in_question :]]
        if not others:
            return "how closely the lines lie tells none of them apart"
        chi2 = f"χ² per degree of freedom is {_figure(min(kept))}"
        beyond = f"{_figure(min(others))} or more for the others"
        if len(kept) == 1:
            return f"how closely the lines lie speaks for this one: {chi2}, and {beyond}"
        return (
            f"how closely the lines lie leaves {len(kept)} of them in question, which "
            f"{self.question.differences()}: {chi2} to {_figure(max(kept))}, and {beyond}"
        )


def choose(
    alignments: Sequence[Alignment],
    unsure: Ambiguity,
    a: LineMap,
    b: LineMap,
    independent: bool = True,
    config: AlignmentConfig | None = None,
) -> Choice:
    """Returns the equal ones among alignments in the order that their differences speak for.

    The best by length stays first unless it is out of the question; else the one that fits most
    closely is first.

    Args:
        alignments: of ``b`` on ``a``, as `find_alignments` returns them.
        unsure: what `ambiguity` says of them.
        a: the map that stays.
        b: the map that moves.
        independent: whether the two maps come from different measurements.
        config: tolerances; None for the defaults.
    """
    tests = [same_map(a, b, alignments[k], independent) for k in unsure.equal]
    misfit = np.array([test.per_freedom for test in tests])
    kept, first = [True] * len(tests), 0
    if not np.isnan(misfit).all():
        closest = int(np.nanargmin(misfit))
        allowed = max(1.0, float(misfit[closest]))
        kept = [_possible(test, allowed) for test in tests]
        first = 0 if kept[0] else closest
    order = sorted(range(len(tests)), key=lambda k: (k != first, not kept[k], k))
    rows = tuple(unsure.equal[k] for k in order)
    question = ambiguity([alignments[k] for k in rows[: sum(kept)]], b, config)
    assert question is not None
    return Choice(rows, tuple(tests[k] for k in order), sum(kept), question)


def _possible(test: MapTest, allowed: float) -> bool:
    """Returns whether differences are no less probable than `RULED_OUT`, χ² divided by a factor."""
    if not test.freedom:
        return True
    return bool(scipy.stats.chi2.sf(test.chi2 / allowed, test.freedom) >= RULED_OUT)


def _figure(value: float) -> str:
    return f"{value:.1f}" if value < 10 else f"{value:.0f}"
