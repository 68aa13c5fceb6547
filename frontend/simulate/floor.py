"""What a scenario says of the floor: its lines, its surface and the light on it."""

from __future__ import annotations

from dataclasses import dataclass

from frontend.simulate.checks import between, not_negative, positive, stretch


@dataclass(frozen=True, slots=True)
class FloorLine:
    """One straight line on the floor.

    Attributes:
        rho: distance from the floor's origin, m; may be negative.
        alpha_deg: direction of the line's normal, degrees.
        stretch: where it begins and ends, ``s = -x sin(alpha) + y cos(alpha)`` along it, m; None
            is endless.
    """

    rho: float
    alpha_deg: float
    stretch: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        stretch(self.stretch)


@dataclass(frozen=True, slots=True)
class LineGrid:
    """Parallel lines.

    Attributes:
        alpha_deg: direction of the lines' normal, degrees.
        first: rho of the first line, m.
        spacings: distances from each line to the next, m; one line more than spacings.
        stretch: where each of them begins and ends along itself, m; None is endless.
    """

    alpha_deg: float
    first: float
    spacings: tuple[float, ...] = ()
    stretch: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        stretch(self.stretch)
        for spacing in self.spacings:
            positive("spacings", spacing)


@dataclass(frozen=True, slots=True)
class Groove:
    """How the lines look.

    Attributes:
        width: m, default 0.007.
        contrast: grey of the line minus grey of the floor, grey levels; negative is dark, default
            -90.
        softness: standard deviation of the line's edges across it, m, default 0.001.
    """

    width: float = 0.007
    contrast: float = -90.0
    softness: float = 0.001

    def __post_init__(self) -> None:
        positive("width", self.width)
        between("contrast", self.contrast, -255.0, 255.0)
        not_negative("softness", self.softness)


@dataclass(frozen=True, slots=True)
class Surface:
    """The floor between the lines.

    Attributes:
        grey: mean grey level, default 140.
        texture: standard deviation of the texture, grey levels, default 4.
        texture_scale: shortest wavelength of the texture, m, default 0.03.
    """

    grey: float = 140.0
    texture: float = 4.0
    texture_scale: float = 0.03

    def __post_init__(self) -> None:
        between("grey", self.grey, 0.0, 255.0)
        not_negative("texture", self.texture)
        positive("texture_scale", self.texture_scale)


@dataclass(frozen=True, slots=True)
class Light:
    """Light on the floor and through the lens, as fractions of the mean brightness.

    Attributes:
        gradient: brightness of the right edge minus the left one's, and of the lower edge minus
            the upper one's; default (0.1, 0.1).
        vignette: darkening in the corners of the image, default 0.15.
        patches: standard deviation of light and shade lying on the floor, default 0.06.
        patch_scale: size of those patches, m, default 0.8.
        drift: amplitude of the slow change of all light over time, default 0.05.
        drift_period: s, default 25.
    """

    gradient: tuple[float, float] = (0.1, 0.1)
    vignette: float = 0.15
    patches: float = 0.06
    patch_scale: float = 0.8
    drift: float = 0.05
    drift_period: float = 25.0

    def __post_init__(self) -> None:
        for part in self.gradient:
            between("gradient", part, -1.0, 1.0)
        for name in ("vignette", "patches", "drift"):
            between(name, getattr(self, name), 0.0, 0.9)
        positive("patch_scale", self.patch_scale)
        positive("drift_period", self.drift_period)


@dataclass(frozen=True, slots=True)
class Mess:
    """What lies or stands on the floor beside its lines, each as a number per square metre.

    Attributes:
        specks: crumbs and drops, 2 to 12 mm, dark or bright; default 0.
        stains: blotches of 30 to 200 mm, weak; default 0.
        strokes: scratches and letters: straight strokes, 10 to 70 mm long and 1 to 4 mm wide;
            default 0.
        shadows: straight-edged shadows, 0.08 to 0.5 m wide and longer than that, with a soft
            border; default 0.
        legs: things that stand on the floor, 30 to 80 mm thick, hiding what is behind them;
            default 0.
    """

    specks: float = 0.0
    stains: float = 0.0
    strokes: float = 0.0
    shadows: float = 0.0
    legs: float = 0.0

    def __post_init__(self) -> None:
        for name in ("specks", "stains", "strokes", "shadows", "legs"):
            between(name, getattr(self, name), 0.0, 1000.0)
