"""What a comparison of two maps comes to, in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from compare.metrics import rms
from compare.report_tables import fixed, number
from compare.two_maps import MapPair
from compare.two_paths import PathDifference
from graphslam.geometry import Array
from graphslam.line_maps.chi2 import MapTest

LEVEL = 0.05
"""Probability below which two maps are said to differ: of equal ones so many seem to."""
TOO_WELL = 0.999
"""Probability above which maps agree better than their covariances allow."""
SAME_START_M, LEVER_M = 0.5, 1.0
"""Frames that lie so near each other, turns taken at this lever, may be of runs begun alike, m."""
NOTHING = 0.01
"""Part of their own sigmas below which maps are called the same."""
NOTABLE_SIGMAS = 3.0
"""A line that differs by more than this many sigma is named."""
CERTAINTY = {
    "joint": "joint covariance of all lines",
    "blocks": "covariance of each line alone",
    "exact": "taken as exact",
    "unknown": "says nothing about its uncertainty; taken as exact",
}


def verdict(pair: MapPair) -> str:
    """Returns in one sentence whether two maps are the same."""
    a, b, test = pair.a.label, pair.b.label, pair.test
    if pair.alignment is None or test is None:
        missing = [s.label for s in (pair.a, pair.b) if not len(s.map)]
        if missing:
            return f"Only paths are compared: {' and '.join(missing)} has no map of lines."
        return f"No lines of {a} and {b} agree in any position: they are not maps of one floor."
    count = f"{len(test.matches)} common lines"
    size = f"{millimetres(rms(test.offset))} RMS across {count}"
    if not test.freedom:
        return f"The maps differ by {size}; {_no_test(pair)}."
    chance = probability(test.probability)
    figures = f"χ² = {number(test.chi2)} at {test.freedom} degrees of freedom, {chance}"
    if not pair.relation.independent:
        return _correlated(test, size, figures)
    if test.probability < LEVEL:
        return (
            f"The maps differ by more than their covariances allow: {size}, "
            f"{millimetres(expected(test))} expected ({figures})."
        )
    return (
        f"The maps agree: what differs, {size}, is what their covariances allow, "
        f"{millimetres(expected(test))} ({figures})."
    )


def _no_test(pair: MapPair) -> str:
    if pair.a.certainty in ("exact", "unknown") and pair.b.certainty in ("exact", "unknown"):
        return "neither says how uncertain it is, so nothing is tested"
    return "so few lines are always fitted exactly, so nothing is tested"


def _correlated(test: MapTest, size: str, figures: str) -> str:
    if test.probability < LEVEL:
        return (
            f"The maps differ by {size}, more than any correlation of their errors explains "
            f"({figures}, against twice the sum of both covariances)."
        )
    own = np.nanmin(test.own)
    if own < NOTHING:
        return (
            f"The maps are the same to {size}: less than a hundredth of the uncertainty that they "
            "claim."
        )
    shares = in_sigmas(test, independent=False)
    share = number(rms(shares[np.isfinite(shares)]), 2)
    largest = f"no combination of lines by more than {number(float(own), 2)} σ"
    if own < 1.0:
        return (
            f"The maps are the same within what either claims to know: they differ by {size}, "
            f"{share} of the surer map’s σ RMS, and {largest}."
        )
    return f"The maps differ by {size}: {share} of the surer map’s σ RMS, and {largest}."


def expected(test: MapTest) -> float:
    """Returns the RMS offset, m, that both covariances predict for independent maps."""
    return rms(test.sigma[np.isfinite(test.sigma[:, 0]), 0])


def smaller_sigma(test: MapTest) -> Array:
    """Returns (K, 2) the smaller of both maps' own sigmas of offset and angle, m and rad.

    NaN where both know a line exactly, or the motion always fits it.
    """
    own = [np.where(sigma > 0, sigma, np.nan) for sigma in (test.sigma_a, test.sigma_b)]
    return np.asarray(np.fmin(*own))


def in_sigmas(test: MapTest, independent: bool) -> Array:
    """Returns (K, 2) differences of offset and angle in sigmas; NaN where those are 0 or unknown.

    Sigmas are those of the difference for independent maps, else `smaller_sigma`.
    """
    difference = np.column_stack([test.offset, test.d_line[:, 1]])
    sigma = np.where(test.sigma > 0, test.sigma, np.nan) if independent else smaller_sigma(test)
    return np.asarray(difference / sigma)


def reasons(pair: MapPair) -> list[str]:
    """Returns what is behind the verdict, one sentence each."""
    return [text for text in _reasons(pair) if text]


def _reasons(pair: MapPair) -> Iterator[str]:
    a, b = pair.a, pair.b
    if pair.alignment is not None:
        yield _how_tied(pair)
        yield _not_common(pair)
        yield f"{pair.relation.why[0].upper()}{pair.relation.why[1:]}{_consequence(pair)}."
    if pair.test is not None and pair.test.freedom:
        if pair.relation.independent and pair.test.probability > TOO_WELL:
            yield (
                "They agree better than maps with such covariances do once in a thousand times: "
                "the covariances are too large, or the maps are not independent."
            )
        yield _outliers(pair)
        yield _excess(pair)
    yield _by_truth(pair)
    for source in (a, b):
        if source.certainty == "blocks":
            yield (
                f"{source.label} gives the covariance of each line alone. Lines of one run share "
                "errors, above all those of its frame, which then count for each line anew: the "
                "test is too lenient. The method’s folder or its estimate.npz has all of it."
            )
        if source.certainty == "unknown" and len(source.map):
            yield f"{source.label} {CERTAINTY['unknown']}."
    if pair.no_path and (len(a.t) or len(b.t)):
        yield f"The paths are not compared: {pair.no_path}."


def _how_tied(pair: MapPair) -> str:
    x, y, turn = motion_figures(pair.motion)
    where = f"{fixed(x, 3)} m, {fixed(y, 3)} m and {fixed(turn, 2)}°"
    if pair.tied == "start":
        return "Both are drawn in the frame in which the run began; differences are taken after " \
            f"the rigid motion that fits the lines best, {_small_motion(pair)}."  # fmt: skip
    if pair.tied == "path":
        return f"The frames are tied by the paths’ common clock: a motion of {where}."
    if pair.tied == "asked":
        return f"The alignment is the one near the motion that was asked for: {where}."
    return f"Found without a start value: a motion of {where}; {ambiguity_text(pair)}.{_hint(pair)}"


def ambiguity_text(pair: MapPair) -> str:
    """Returns what is known about other alignments that fit as well as the one of a searched pair.

    A clause without its full stop.
    """
    return "; ".join(filter(None, (str(pair.ambiguity), str(pair.choice))))


def _hint(pair: MapPair) -> str:
    """Returns which of several alignments is right if both runs began at one place."""
    if pair.sure or not (pair.a.is_estimate and pair.b.is_estimate):
        return ""
    motions = np.array([alignment.motion for alignment in pair.alternatives])
    near = np.hypot(motions[:, 0], motions[:, 1]) + np.abs(motions[:, 2]) * LEVER_M
    first = int(np.argmin(near))
    if first == 0 or near[first] > SAME_START_M:
        return ""
    return " If both runs began at the same place, it is another one: take it with --near 0 0 0."


def _small_motion(pair: MapPair) -> str:
    assert pair.test is not None
    x, y, turn = pair.test.motion
    return f"{millimetres(math.hypot(x, y))} and {fixed(math.degrees(turn), 3)}°"


def motion_figures(motion: Array) -> tuple[float, float, float]:
    """Returns a motion's shift, m, and turn, degrees; never a negative zero."""
    x, y, turn = (float(v) + 0.0 for v in motion)
    return x, y, math.degrees(turn)


def _not_common(pair: MapPair) -> str:
    assert pair.alignment is not None
    parts = []
    for source, rows in ((pair.a, pair.only_a), (pair.b, pair.only_b)):
        if len(rows):
            names = ", ".join(str(source.line_id[k]) for k in rows[:12])
            more = "" if len(rows) <= 12 else ", …"
            parts.append(f"only {source.label} has {_lines(len(rows))} {names}{more}")
    count = len(pair.alignment.parts)
    if count:
        parts.append(f"{_lines(count)} more {'is a part' if count == 1 else 'are parts'} of these")
    common = f"{_lines(len(pair.alignment.matches))} in common"
    return f"{common}; {'; '.join(parts)}." if parts else f"{common}, and no other."


def _lines(count: int) -> str:
    return f"{count} line" if count == 1 else f"{count} lines"


def _consequence(pair: MapPair) -> str:
    if pair.relation.independent:
        return ""
    return (
        ": no probability is claimed for their agreement. Differences stand beside what each map "
        "claims for itself"
    )


def _outliers(pair: MapPair) -> str:
    """Returns which lines differ by more than `NOTABLE_SIGMAS`; empty for correlated maps."""
    assert pair.test is not None
    if not pair.relation.independent:
        return ""
    worst = np.nanmax(np.nan_to_num(np.abs(in_sigmas(pair.test, independent=True))), axis=1)
    far = np.flatnonzero(worst > NOTABLE_SIGMAS)
    if not len(far):
        return f"No line differs by more than {NOTABLE_SIGMAS:.0f} σ."
    names = [
        f"{pair.a.line_id[pair.test.matches[k, 0]]} ({number(float(worst[k]), 2)} σ)"
        for k in far[np.argsort(-worst[far], kind="stable")][:8]
    ]
    return f"Beyond {NOTABLE_SIGMAS:.0f} σ, by the first map’s numbers: line {', '.join(names)}."


def _by_truth(pair: MapPair) -> str:
    """Returns what ground truth says of two estimates; empty where it says nothing of both."""
    parts = []
    for what, k in (("paths", 0), ("maps", 1)):
        a, b = pair.a.truth_errors[k], pair.b.truth_errors[k]
        if a is not None and b is not None:
            parts.append(f"the {what} are off by {millimetres(a)} and {millimetres(b)} RMS")
    if not parts:
        return ""
    return f"By ground truth, after a rigid motion of its own each, {' and '.join(parts)}."


def _excess(pair: MapPair) -> str:
    """Returns how large an error would explain the difference; empty where nothing needs it."""
    test = pair.test
    assert test is not None
    if not pair.relation.independent or not test.probability < LEVEL:
        return ""
    text = (
        f"A further error of {millimetres(test.excess)} (one σ) at either end of each line would "
        "explain all of it: lines that are not quite straight, or a camera’s homography or "
        "distortion that is a little off"
    )
    exact = [source.label for source in (pair.a, pair.b) if source.certainty == "exact"]
    text += f", or {' and '.join(exact)} that is no more exact than this" if exact else ""
    if not pair.sure:
        text += "; or another alignment is the right one"
    return f"{text}."


def path_sentence(path: PathDifference) -> str:
    """Returns the paths' difference in one sentence."""
    worst = int(np.argmax(path.distance))
    heading = fixed(math.degrees(rms(path.difference[:, 2])), 3)
    return (
        f"At {len(path.t):,} common times the positions differ by "
        f"{millimetres(rms(path.distance))} RMS and at most "
        f"{millimetres(float(path.distance[worst]))}, {path.t[worst] - path.t[0]:.1f} s after the "
        f"first, and the headings by {heading}° RMS; after the motion that fits the paths best, "
        f"{millimetres(path.aligned_rms_m)} RMS is left."
    )


def millimetres(metres: float) -> str:
    """Returns a length in mm with two or three digits."""
    return f"{number(1e3 * metres)} mm"


def probability(value: float) -> str:
    """Returns a probability as text."""
    if value < 1e-4:
        return "p < 0.0001"
    decimals = 4 if value > 0.999 or value < 0.001 else 3
    return f"p = {min(value, 0.9999):.{decimals}f}"
