"""What the verdict says of each method by itself: its matches, its honesty, what it cannot know."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from compare.comparison import MethodMetrics
from compare.consistency import band
from compare.maps import MapMetrics
from compare.points import PointMetrics
from compare.words import capital, listed, metres, noun
from graphslam.elsewhere import OTHER_PLACES
from graphslam.ending import GAP_M
from graphslam.estimate import LOOP_DOUBTED, LOOP_OPEN, Unobserved

MOST_WAYS = 3
"""So many ways without a sighting are told, the longest first; of the others only the number."""


def beaten_by_odometry(methods: Sequence[MethodMetrics]) -> Iterator[str]:
    """Yields which paths odometry alone beats."""
    alone = [m.trajectory for m in methods if not m.sightings_used and m.trajectory is not None]
    for m in methods:
        if not alone or m.trajectory is None or not m.sightings_used:
            continue
        if m.trajectory.aligned_rmse_m > alone[0].aligned_rmse_m:
            yield f"The path of {m.method} is worse than odometry alone: do not use it as it is."


def landmark_counts(methods: Sequence[MethodMetrics]) -> Iterator[str]:
    """Yields how many landmarks each map has, methods with the same counts together."""
    texts: dict[str, list[str]] = {}
    for m in methods:
        if m.map is not None:
            texts.setdefault(_line_count(m.map), []).append(m.method)
        if m.points is not None:
            texts.setdefault(_point_count(m.points), []).append(m.method)
    for text, names in texts.items():
        yield f"{listed(names)}: {text}."


def _line_count(figures: MapMetrics) -> str:
    if figures.true_lines_seen is None:
        text = f"{figures.matched} true lines mapped (nothing tells how many were to be seen)"
    else:
        text = f"{figures.matched} of {figures.true_lines_seen} seen lines mapped"
    text += f", {figures.duplicates or 'none'} twice, {figures.spurious or 'none'} spurious"
    if figures.unseen:
        text += f", and {figures.unseen} that hardly came into view"
    return text


def _point_count(figures: PointMetrics) -> str:
    return (
        f"{figures.matched} of {figures.true_points_seen} seen {noun({*figures.points.kind})[1]} "
        f"mapped, {figures.duplicates or 'none'} twice, {figures.spurious or 'none'} spurious"
    )


def right_matches(methods: Sequence[MethodMetrics]) -> Iterator[str]:
    """Yields the share of right matches, where the truth is known."""
    for m in methods:
        if m.matching is not None:
            count = int(m.matching.identifications.sum())
            yield f"{m.method}: {m.matching.right_share:.1%} of {count} matches are right."


def honesty(methods: Sequence[MethodMetrics]) -> Iterator[str]:
    """Yields whether errors and innovations are as large as each method claims, and where not."""
    for m in methods:
        if m.overconfidence is not None:
            yield f"{m.method} is {m.overconfidence}."
        yield from _expectations(m)
        yield from _confidence(f"{m.method}, poses", m.pose_nees, 3)
        if m.map is not None:
            yield from _confidence(f"{m.method}, map", m.map.nees, m.map.nees_freedom)


def _expectations(m: MethodMetrics) -> Iterator[str]:
    """Yields whether innovations are as large as a method expects, all along the way."""
    if m.innovations is None or not m.innovations.total >= 0.0:
        return
    if m.surprise is not None:
        yield f"{m.method} is {m.surprise}."
        return
    low, high = band(float(m.innovations.freedom.sum()))
    less = "smaller than it expects" if m.innovations.total < low else "as large as it expects"
    yield (
        f"{m.method}, innovations: on no part of the way too large, and {less} all in all (NIS "
        f"{m.innovations.total:.3g} per degree of freedom over the whole way; {low:.3g} to "
        f"{high:.3g} is unsuspicious)."
    )


def _confidence(what: str, nees: float, freedom: int) -> Iterator[str]:
    """Yields how a NEES per degree of freedom compares with its chi-square bounds."""
    if not nees >= 0.0:
        return
    low, high = band(freedom)
    bounds = f"NEES {nees:.2g} per degree of freedom; {low:.2g} to {high:.2g} is unsuspicious"
    if nees > high:
        yield f"{what}: overconfident, the errors exceed their covariance ({bounds})."
    elif nees < low:
        yield f"{what}: conservative, the errors stay far below their covariance ({bounds})."
    else:
        yield f"{what}: consistent with its covariance ({bounds})."


def doubt(m: MethodMetrics) -> str | None:
    """Returns in words why a method's own covariances are not to be relied on; None if they are.

    They hold for the place it believes to be at, and for a minimum that it has reached.
    """
    if any(reason.startswith("lost") for reason in m.counts):
        return f"{m.method} was lost"
    if not m.converged:
        return f"{m.method} has not converged"
    return None


def doubtful(pair: Sequence[MethodMetrics]) -> Iterator[str]:
    """Yields which of filter and smoother to use where own covariances are no guide."""
    reasons = [doubt(m) for m in pair]
    if all(reasons):
        if reasons:
            yield (
                f"Nothing tells whether to filter or to smooth this run: {listed(reasons)}, and "
                "their own covariances are not to be relied on."
            )
    elif any(reasons):
        answer = "smooth" if reasons[0] else "filter"
        yield (
            f"{capital(answer)} this run: {reasons[0] or reasons[1]}, and its own covariances "
            "are not to be relied on."
        )


def alarms(methods: Sequence[MethodMetrics]) -> Iterator[str]:
    """Yields what makes a method's figures worthless or doubtful: it was lost, or unfinished."""
    for m in methods:
        for reason, times in m.counts.items():
            if reason.startswith("lost"):
                often = "once" if times == 1 else f"{times} times"
                yield f"{m.method} was lost {often}{reason.removeprefix('lost')}."
            if reason.startswith(LOOP_OPEN):
                places = "one place" if times == 1 else f"{times} places"
                yield (
                    f"{m.method} left {places} open where the path comes back to where it was "
                    f"before: {reason.removeprefix(LOOP_OPEN)}. The map may be double there."
                )
            if reason.startswith(LOOP_DOUBTED):
                loops = "one loop" if times == 1 else f"{times} loops"
                yield (
                    f"{m.method} closed {loops} as its first estimate did, but in doubt: "
                    f"{reason.removeprefix(LOOP_DOUBTED)}. Look whether the map fits there."
                )
            if reason.startswith(OTHER_PLACES):
                yield (
                    f"{m.method} does not know its place: {times} {reason}. Give [start] in the "
                    "frame of the known map, or drive where the floor does not repeat."
                )
        if not m.converged and not m.iterations:
            if not any(reason.startswith(OTHER_PLACES) for reason in m.counts):
                yield f"{m.method} has not found its place on the known map: its path is a guess."
        elif not m.converged:
            yield (
                f"{m.method} did not converge in {m.iterations} iterations: its figures are those "
                "of an unfinished optimisation."
            )


def cautions(methods: Sequence[MethodMetrics]) -> Iterator[str]:
    """Yields what no method can know from this run."""
    for m in methods:
        if m.sightings_used:
            for direction in (u for u in m.unobserved if u.stretch is None):
                yield f"{m.method}: {direction}."
        if m.map is not None and not m.map.matched and m.trajectory is None:
            yield (
                f"No line of {m.method} lies near a seen true line. Without a true path the map is "
                "compared as it stands: [start] must be in the frame of the true map."
            )
    yield from _ways(methods)


def _ways(methods: Sequence[MethodMetrics]) -> Iterator[str]:
    """Yields where nothing was seen that counts, what odometry made of it, and what each knows."""
    found: dict[tuple[float, float], list[tuple[str, Unobserved]]] = {}
    for m in methods:
        for entry in m.unobserved:
            if entry.stretch is not None:
                ends = entry.stretch.from_m, entry.stretch.to_m
                found.setdefault(ends, []).append((m.method, entry))
    ranked = [found[ends] for ends in sorted(found, key=lambda ends: ends[0] - ends[1])]
    for entries in ranked[:MOST_WAYS]:
        way, known = entries[0][1], "no pose is estimated on it"
        assert way.stretch is not None
        if way.stretch.poses:
            sigmas = listed([f"{metres(entry.sigma)} by {name}" for name, entry in entries])
            known = f"the position is known to {sigmas} at worst"
        yield (
            f"{capital(str(way.stretch))}: odometry drifts by {metres(way.sigma_odometry)} there "
            f"(one sigma), and {known}."
        )
    if len(ranked) > MOST_WAYS:
        yield f"There are {len(ranked) - MOST_WAYS} more such ways of {GAP_M:g} m and more."
