"""What calibrating directions found, as the lines of log.toml and in words."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from frontend.calibrate_bearings import BearingCalibration
from frontend.log import Log
from frontend.omni_config import OmniConfig
from frontend.write_folder import camera_toml, correction_toml


def bearing_toml(found: BearingCalibration, name: str) -> str:
    """Returns the table of log.toml that takes what was found.

    Args:
        found: the calibration.
        name: of the log that it was found from.
    """
    lines = [
        f"# From {found.count} directions of the log {name}: RMS error {found.before_deg:.3g} "
        f"degrees before, {found.after_deg:.3g} on",
        "# poses that had no part in finding this.",
    ]
    if found.camera is None:
        return "\n".join([*lines, "[bearings]", *correction_toml(found.correction), ""])
    return "\n".join([*lines, *camera_toml(found.camera.name, found.camera), ""])


def print_bearings(found: BearingCalibration, log: Log, config: OmniConfig) -> None:
    """Prints what was found, how sure that is, and how well it does, to standard output."""
    for line in told(found, config):
        print(line)
    print()
    print(bearing_toml(found, log.name), end="")


def told(found: BearingCalibration, config: OmniConfig) -> Iterator[str]:
    """Yields in words what was found."""
    numbers, sigma = found.correction.numbers(), np.asarray(found.sigma_deg)
    yield f"Directions of known landmarks from known poses: {found.count}."
    yield (
        f"They err by {found.before_deg:.3g}° (RMS) as they are used now, "
        f"{found.bias_before_deg:+.3g}° of it in the mean; by {found.after_deg:.3g}° with the "
        "numbers below, judged on poses that had no part in finding them (each fifth of the drive "
        "from the other four)."
    )
    yield f"Offset: {numbers[0]:+.3f} ± {sigma[0]:.3f}° (one sigma)."
    if found.camera is not None:
        u, v = found.camera.centre
        sigma_px = found.sigma_centre_px
        yield f"Mirror's centre: u = {u:.2f}, v = {v:.2f} px, ± {sigma_px:.2g} px each."
    for order in range(1, (len(numbers) + 1) // 2):
        c, s = numbers[2 * order - 1 : 2 * order + 1]
        if found.camera is not None and order == 1:
            continue  # the centre stands for it
        size, spread = math.hypot(c, s), math.hypot(*sigma[2 * order - 1 : 2 * order + 1])
        yield f"Wave {order} around the robot: {size:.3f}° high, ± {spread / math.sqrt(2.0):.3f}°."
    if found.after_deg > 0.95 * found.before_deg:
        yield "That is hardly better than now: leave log.toml as it is."
    yield _noise(found, config)


def _noise(found: BearingCalibration, config: OmniConfig) -> str:
    """Returns how what is left compares with the noise that is stated."""
    ratio = found.after_deg / found.stated_deg
    text = f"What is left is {ratio:.2g} times the noise that is stated ({found.stated_deg:.3g}°)"
    if 0.8 <= ratio <= 1.25:
        return f"{text}: it fits."
    if found.camera is None:
        return f"{text}: write {math.radians(found.after_deg):.4g} rad as sigma into bearings.csv."
    rest = found.stated_deg**2 - config.deformation_deg**2
    if rest > found.after_deg**2:
        cure = "--extract.omni.deformation-deg 0 --extract.omni.centre-px 0"
        return f"{text}: {cure} come nearest, as long as the mirror stays as it is."
    fits = math.sqrt(max(found.after_deg**2 - rest, 0.0))
    return f"{text}: --extract.omni.deformation-deg {fits:.3f} makes it fit."
