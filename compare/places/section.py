"""What a run says of a map of corridors: where the robot was, the way in words, its lamps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from compare.places.building import Building
from compare.places.route import plan_route
from compare.places.sight import LampRecord, lamp_records
from compare.places.whereabouts import NOWHERE, Visit, visits
from frontend.camera import Camera
from graphslam.errors import BadConfig
from graphslam.estimate import Estimate
from graphslam.measurements import Measurements

PREFERRED = ("smoother", "ekf")


def places_section(
    building: Building,
    measurements: Measurements,
    estimates: Mapping[str, Estimate],
    camera: Camera | None = None,
) -> dict[str, Any]:
    """Returns what run.json and the report hold, in types that JSON knows.

    By the smoother, where it ran, else the filter, else the last method.

    Args:
        building: the map.
        measurements: what the estimates were made from.
        estimates: by method, at least one.
        camera: that looks at the ceiling, where one is known.
    """
    method = next((name for name in PREFERRED if name in estimates), [*estimates][-1])
    estimate = estimates[method]
    stays = visits(building, estimate)
    lamps = lamp_records(building, measurements, estimate, camera)
    return {
        "map": building.name,
        "method": method,
        "visits": [
            {"place": v.place, "t_from": v.t_from, "t_to": v.t_to, "sure": round(v.sure, 6)}
            for v in stays
        ],
        "here": stays[-1].place,
        "route": _route(building, stays),
        "lamps": [
            {
                "lamp": lamp.id,
                "place": lamp.place,
                "seen": lamp.seen,
                "expected": lamp.expected,
                "state": state(lamp),
            }
            for lamp in lamps
        ],
        "sentences": [*_sentences(stays, lamps)],
    }


def state(lamp: LampRecord) -> str:
    """Returns in a word or two what is known of a lamp."""
    if lamp.seen:
        return "works, though the map says it is out of order" if lamp.dark else "works"
    if lamp.dark:
        return "out of order, as the map says"
    return "out of order" if lamp.out_of_order else "not seen, not missed"


def _route(building: Building, stays: tuple[Visit, ...]) -> list[str]:
    """Returns the way from the first place to the last, in steps; none where it is not known."""
    known = [stay.place for stay in stays if stay.place != NOWHERE]
    if len(set(known)) < 2:
        return []
    try:
        return list(plan_route(building, known[0], known[-1]).steps())
    except BadConfig:
        return []


def _sentences(stays: tuple[Visit, ...], lamps: tuple[LampRecord, ...]) -> list[str]:
    """Returns what a user should know."""
    here = stays[-1].place
    said = [
        f"At the end the robot is {NOWHERE}."
        if here == NOWHERE
        else f"At the end the robot is in {here!r}."
    ]
    for lamp in lamps:
        if lamp.out_of_order and not lamp.dark:
            said.append(
                f"Lamp {lamp.id} in {lamp.place!r} seems to be out of order: never seen in "
                f"{lamp.expected} frames that should have shown it."
            )
        elif lamp.seen and lamp.dark:
            said.append(f"Lamp {lamp.id} in {lamp.place!r} works again: the map says it does not.")
    return said
