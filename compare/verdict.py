"""The verdict in words, each sentence with the figures behind it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from compare.agreement import Agreement
from compare.comparison import Comparison, MethodMetrics
from compare.noise import noise_sentence
from compare.verdict_methods import (
    alarms,
    beaten_by_odometry,
    cautions,
    doubt,
    doubtful,
    honesty,
    landmark_counts,
    right_matches,
)
from compare.words import listed, metres, noun
from graphslam.estimate import Unobserved

WORTH_SHARE = 0.20
"""A difference matters only above this share of the larger figure, ..."""
WORTH_M = 1e-3
"""... and above this length, m."""
OPEN_RATIO = 3.0
"""Where the last position is so much less certain along a direction that no sighting fixes than
across it, neither method is worth choosing before that direction is seen."""
DISAGREE_SIGMAS = 3.0
"""Two maps contradict each other where they differ by more than this many sigmas (RMS)."""

Side = Literal["filter", "smoother", "neither"]
WITHOUT_MEMORY = ("triangulation", "fixes")
"""Methods whose poses each rest on their own node's sightings."""
Pair = tuple[MethodMetrics, MethodMetrics]


@dataclass(frozen=True, slots=True)
class Finding:
    """One quantity in which filter and smoother were compared.

    Attributes:
        quantity: "path", "last pose", "map", or "map of points".
        better: which of them has the better one; "neither" where the difference does not matter;
            None where not both have a figure.
        sentence: the figures in words.
    """

    quantity: str
    better: Side | None
    sentence: str


def verdict(comparison: Comparison) -> tuple[str, ...]:
    """Returns sentences: what to use, why, and what to beware of; the answer comes first.

    Without a true path and true lines the sentences say so, and argue from the methods' own
    covariances and from how far they agree.
    """
    methods = comparison.methods
    pair = filter_and_smoother(methods)
    judged = any(m.trajectory is not None or m.map is not None for m in methods)
    findings = tuple(_judged_findings(methods, pair) if judged else _sigma_findings(methods, pair))
    noise = noise_sentence(comparison)
    return (
        *_neither(methods, pair, comparison.kinds),
        *_headline(methods, findings, pair, judged),
        *([] if judged else doubtful(pair or ())),
        *alarms(methods),
        *([] if judged else [NO_TRUTH]),
        *(finding.sentence for finding in findings),
        *_best_possible(comparison),
        *_causality(pair),
        *_causal_counterparts(methods, pair),
        *_agreements(comparison.agreement, pair),
        *beaten_by_odometry(methods),
        *landmark_counts(methods),
        *right_matches(methods),
        *honesty(methods),
        *cautions(methods),
        *([noise] if noise else []),
    )


def filter_and_smoother(methods: Sequence[MethodMetrics]) -> Pair | None:
    """Returns the first causal method that uses sightings, and the smoother.

    Methods without memory are no filters: they count only where there is no other. Where there is
    no smoother, the first other method that is not causal.
    """
    causal = [m for m in methods if m.causal and m.sightings_used]
    causal.sort(key=lambda m: m.method in WITHOUT_MEMORY)
    batch = sorted((m for m in methods if not m.causal), key=lambda m: m.method != "smoother")
    return (causal[0], batch[0]) if causal and batch else None


# ---- filter against smoother -------------------------------------------------------------------

NO_TRUTH = (
    "There is no ground truth for this run, so nothing here measures an error: what is said rests "
    "on the methods' own covariances and on how far they agree, and errors that they share (a "
    "wrong wheel radius, a wrong homography) do not show."
)


def first_of_all(methods: Sequence[MethodMetrics]) -> Unobserved | None:
    """Returns the direction that needs lines across before any method is worth choosing, or None.

    Filter and smoother share it, and the last position is `OPEN_RATIO` times less certain along it
    than across.
    """
    pair = filter_and_smoother(methods)
    if pair is None:
        return None
    for direction in pair[1].unobserved:
        if direction.quantity != "position" or direction.direction == (0.0, 0.0):
            continue
        shared = any(other.quantity == "position" for other in pair[0].unobserved)
        if shared and direction.sigma > OPEN_RATIO * _across(pair[1], direction):
            return direction
    return None


def _across(m: MethodMetrics, direction: Unobserved) -> float:
    """Returns the standard deviation of the last position across an open direction, m."""
    return math.sqrt(max(m.last_position_sigma_m**2 - direction.sigma**2, 0.0))


def _neither(
    methods: Sequence[MethodMetrics], pair: Pair | None, kinds: Sequence[str]
) -> Iterator[str]:
    """Yields that no method helps, where all share a direction that no sighting fixes."""
    direction = first_of_all(methods)
    if pair is None or direction is None:
        return
    angle, across = direction.angle_deg, _across(pair[1], direction)
    one, several = noun(kinds)
    first, where, cure = f"before more {several} are seen", "floor frame", f"{several} elsewhere"
    if "line" in kinds:
        sigma = f"± {pair[1].direction_sigma_deg:.2g}° for one sigma"
        first = "before adding a second line direction"
        where = f"floor frame, {sigma}; it is the way that the lines run"
        cure = f"lines with normals along {angle:.0f}°"
    yield (
        f"Do neither {first}: along {angle:.0f}° ({where}) no {one} fixes the position, and the "
        f"last one is known to {metres(direction.sigma)} there, to {metres(across)} across. Filter "
        f"and smoother share this; {cure} end it. (It counts from a ratio of {OPEN_RATIO:g} on.)"
    )


def _best_possible(comparison: Comparison) -> Iterator[str]:
    bound = comparison.bound
    if bound is None or bound.at != "truth":
        return
    figures = {"path": bound.path_m, "last pose": bound.final_m, "map": bound.map_m}
    said = [f"the {name} to {metres(v)}" for name, v in figures.items() if math.isfinite(v)]
    yield (
        "The best there is, on average over runs as noisy as the measurements' covariances say: "
        f"{listed(said)} (RMS, from the common start; Cramér–Rao bound at the truth). Errors far "
        "below it mean that those covariances are too large."
    )


def _headline(
    methods: Sequence[MethodMetrics], findings: Sequence[Finding], pair: Pair | None, judged: bool
) -> Iterator[str]:
    if len(methods) > 1 and not any(m.sightings_used for m in methods):
        yield (
            "No sighting was used: every method gives the odometry, and there is nothing to choose."
        )
    if pair is None or not any(f.better for f in findings):
        return
    by = {side: [f.quantity for f in findings if f.better == side] for side in get_args(Side)}
    ours, theirs, same = (listed(by[side]) for side in ("smoother", "filter", "neither"))
    if ours and theirs:
        answer = f"it depends: smoothing gives the better {ours}, filtering the better {theirs}."
    elif ours:
        answer = f"smooth this run: it gives the better {ours}" + (
            f"; for the {same} the filter does as well." if same else "."
        )
    elif theirs:
        answer = f"filter this run: smoothing makes the {theirs} worse."
    else:
        answer = f"filtering is enough: smoothing changes the {same} by nothing that matters."
    source = "ground truth" if judged else "the methods' own covariances"
    limits = f"above {WORTH_SHARE:.0%} and {metres(WORTH_M)}"
    yield f"By {source}, {answer} (A difference matters {limits}.)"


def _judged_findings(methods: Sequence[MethodMetrics], pair: Pair | None) -> Iterator[Finding]:
    paths = {m.method: m.trajectory for m in methods if m.trajectory is not None}
    maps = {m.method: m.map for m in methods if m.map is not None and m.map.matched}
    if paths:
        scored = next(iter(paths.values())).nodes
        rmse = {name: path.aligned_rmse_m for name, path in paths.items()}
        yield _finding("path", f"Path (aligned RMS error of {scored} nodes)", rmse, pair)
        final = {name: path.final_error_m for name, path in paths.items()}
        yield _finding("last pose", "Last pose (error from the common start)", final, pair)
    if maps:
        offsets = {name: figures.rho_rmse_m for name, figures in maps.items()}
        found = _finding("map", "Map (RMS offset of lines where they were seen)", offsets, pair)
        angles = ", ".join(f"{name} {m.alpha_rmse_deg:.2g}°" for name, m in maps.items())
        sentence = f"{found.sentence} In angle: {angles}."
        wrong = {name: m.spurious + m.duplicates + (m.missed or 0) for name, m in maps.items()}
        better = found.better
        if pair is not None and all(m.method in wrong for m in pair):
            before, after = (wrong[m.method] for m in pair)
            if abs(before - after) > WORTH_SHARE * max(before, after):
                better = "smoother" if after < before else "filter"
                sentence += (
                    f" With fewer lines missed, spurious or double the {better}'s is better."
                )
        yield Finding("map", better, sentence)
    yield from _point_findings(methods, pair)


def _point_findings(methods: Sequence[MethodMetrics], pair: Pair | None) -> Iterator[Finding]:
    """Yields how the maps of points compare; the path's frame, so that few points are enough."""
    points = {m.method: m.points for m in methods if m.points is not None and m.points.matched}
    if not points:
        return
    kinds = {kind for figures in points.values() for kind in figures.points.kind}
    several = noun(kinds)[1]
    off = {name: figures.unaligned_rmse_m for name, figures in points.items()}
    what = f"Map of {several} (RMS distance from the true ones, from the common start)"
    yield _finding(f"map of {several}", what, off, pair)


def _sigma_findings(methods: Sequence[MethodMetrics], pair: Pair | None) -> Iterator[Finding]:
    path = {m.method: m.position_sigma_m for m in methods}
    found = _finding("path", "Path (own sigma of position, RMS)", path, pair)
    ratio, known = "", True
    if pair is not None:
        variances = pair[0].position_sigma_m ** 2 / pair[1].position_sigma_m ** 2
        ratio = f" The filter's variance is {variances:.3g} times the smoother's."
        known = not any(doubt(m) for m in pair)
    yield Finding(found.quantity, found.better if known else None, found.sentence + ratio)
    last = {m.method: m.last_position_sigma_m for m in methods}
    found = _finding("last pose", "Last pose (own sigma of position)", last, pair)
    yield Finding(found.quantity, found.better if known else None, found.sentence)


def _finding(quantity: str, what: str, figures: dict[str, float], pair: Pair | None) -> Finding:
    listed = ", ".join(f"{name} {metres(value)}" for name, value in figures.items())
    if pair is None or not all(m.method in figures for m in pair):
        return Finding(quantity, None, f"{what}: {listed}.")
    before, after = (figures[m.method] for m in pair)
    size = abs(after - before)
    matters = size > WORTH_M and size > WORTH_SHARE * max(before, after)
    better: Side = "neither" if not matters else "smoother" if after < before else "filter"
    if size <= 0.01 * before:
        change = "changes it by less than 1%"
    else:
        by = f"{size / before:.0%}" if before else metres(size)
        change = f"{'cuts' if after < before else 'raises'} the filter's by {by}"
    worth = "which matters" if matters else "which does not matter"
    return Finding(quantity, better, f"{what}: {listed}; smoothing {change}, {worth}.")


def _causality(pair: Pair | None) -> Iterator[str]:
    if pair is not None:
        yield (
            f"The path of {pair[0].method} is causal: each pose uses only what was known by then, "
            f"as a robot on its way must. That of {pair[1].method} uses the whole run and exists "
            "only afterwards. The last pose and the map use the whole run in both."
        )


def _causal_counterparts(methods: Sequence[MethodMetrics], pair: Pair | None) -> Iterator[str]:
    """Yields how the filter's path compares with others that use the same data at each time."""
    if pair is None or pair[0].trajectory is None:
        return
    for m in methods:
        if m.causal and m.sightings_used and m is not pair[0] and m.trajectory is not None:
            theirs, ours = m.trajectory.rmse_m, pair[0].trajectory.rmse_m
            yield (
                f"With the data up to each time the path of {m.method} errs by {metres(theirs)}, "
                f"that of {pair[0].method} by {metres(ours)} (RMS, from the common start)."
            )


def _agreements(entries: Sequence[Agreement], pair: Pair | None) -> Iterator[str]:
    if pair is None:
        return
    names = {m.method for m in pair}
    for entry in (e for e in entries if {e.first, e.second} == names):
        yield (
            f"{entry.first} and {entry.second} differ by {metres(entry.position_rms_m)} RMS along "
            f"the path (at most {metres(entry.position_max_m)}) and by "
            f"{metres(entry.last_position_m)} at the last pose."
        )
        if entry.map is not None and len(entry.map.row_a):
            text = (
                f"Their {len(entry.map.row_a)} common lines differ by "
                f"{metres(entry.map.offset_rms_m)} and {entry.map.alpha_rms_deg:.2g}° RMS, "
                f"{entry.map.sigmas_rms:.2g} of their sigmas"
            )
            contradict = entry.map.sigmas_rms > DISAGREE_SIGMAS
            yield text + (": at least one of them is wrong about itself." if contradict else ".")
