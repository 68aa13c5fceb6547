"""What all pages share: the templates, and how a method is shown."""

from __future__ import annotations

import re
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from compare.plots_style import method_colour, themed

KINDS = {
    "odometry": "wheels alone",
    "geometric": "from the lines alone, causal",
    "ekf": "filter, causal",
    "ekf-naive": "filter that ignores delays, causal",
    "ekf-fej": "filter with first-estimates Jacobians, causal",
    "ekf-robot": "filter in the robot's coordinates, causal",
    "triangulation": "each pose from its own bearings, without memory",
    "fixes": "each pose from its own fix, without memory",
    "particle": "particle filter, causal",
    "isam2": "smoothing as it drives, causal",
    "fixed-lag": "smoothing a few seconds late",
    "smoother": "whole run at once",
    "ekf-window": "filter that forgets",
    "loops": "whole run, loops closed",
}


def method_entry(name: str) -> dict[str, str]:
    """Returns a method's name, its colour, and in a few words what it is."""
    return {"name": name, "colour": themed(method_colour(name)), "kind": KINDS.get(name, "")}


def source(name: str) -> str:
    """Returns a file of the templates' folder as it is."""
    return (resources.files("compare") / "templates" / name).read_text(encoding="utf-8")


def template(name: str) -> Any:
    """Returns a template that refuses unknown names and escapes all it is given."""
    environment = Environment(
        loader=PackageLoader("compare"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["code"] = _code
    return environment.get_template(name)


def _code(text: str) -> Markup:
    """Returns escaped text whose parts between back-ticks are set as code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))
