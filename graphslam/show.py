"""How an estimate shows itself in a notebook: a table and a plan."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from html import escape

import numpy as np

from graphslam.estimate import Estimate
from graphslam.plan import ELLIPSE_PROBABILITY, estimate_layers, plan_svg

PLAN_SIZE = 560
"""Of the plan's longer side on the screen, pixels."""
MOST_POINTS = 1500
"""Points of a path that a small plan draws."""


def estimate_html(estimate: Estimate) -> str:
    """Returns an estimate as HTML: a table of what it is and how certain, and a plan."""
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th>'
        f'<td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in _facts(estimate)
    )
    plan = plan_svg(estimate_layers(estimate), PLAN_SIZE, MOST_POINTS)
    return (
        f"<div><table><caption>Estimate: {escape(estimate.method)}</caption>{rows}</table>"
        f'<figure style="margin:0">{plan}<figcaption>Floor frame, metres. Blue: lines with their '
        "numbers; orange: the path, and the last position's ellipse of "
        f"{ELLIPSE_PROBABILITY:.0%} probability.</figcaption></figure></div>"
    )


def _facts(estimate: Estimate) -> Iterator[tuple[str, str]]:
    """Yields what to say about an estimate, with what to call it."""
    steps = np.linalg.norm(np.diff(estimate.pose[:, :2], axis=0), axis=1)
    duration = estimate.t[-1] - estimate.t[0]
    yield "path", f"{len(estimate.t)} nodes, {steps.sum():.2f} m, {duration:.1f} s"
    (x, y, theta), sigma = estimate.pose[-1], np.sqrt(np.diag(estimate.cov_floor[-1]))
    yield (
        "last pose (± one sigma)",
        f"x {x:.3f} m ± {1e3 * sigma[0]:.1f} mm, y {y:.3f} m ± {1e3 * sigma[1]:.1f} mm, "
        f"heading {np.degrees(theta):.2f}° ± {np.degrees(sigma[2]):.2f}°",
    )
    kinds = sorted(Counter(estimate.map.kind).items())
    yield "map", ", ".join(f"{count} of kind {kind}" for kind, count in kinds) or "none"
    yield "sightings used", f"{int(estimate.used.sum())} of {len(estimate.used)}"
    yield "the pose at a time uses", "data up to it" if estimate.causal else "all data"
    if np.isfinite(estimate.cost):
        end = "converged" if estimate.converged else "did not converge"
        yield "cost", f"{estimate.cost:.6g}, {end} after {estimate.iterations} iterations"
    for direction in estimate.unobserved:
        yield "not observed", str(direction)
