"""Single images and scans of a bag, read when they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontend.readers import bag_types as types
from frontend.readers.bag_parts import Broken, Channel, Container, Place
from frontend.recorded import Scan

Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class BagImage:
    """An image of a bag.

    Attributes:
        name: topic and number.
        digest: SHA-256 of its message, hexadecimal.
        file: file that it is in.
        channel: its stream.
        place: where in the file.
    """

    name: str
    digest: str
    file: Container
    channel: Channel
    place: Place

    def grey(self) -> NDArray[np.uint8] | None:
        """Returns (H, W) grey levels, or None where it cannot be read whole."""
        from frontend.encodings import grey_of
        from frontend.images import decoded

        return self._read(decoded, grey_of)

    def bgr(self) -> NDArray[np.uint8] | None:
        """Returns (H, W, 3) colours, BGR, or None where it cannot be read whole."""
        from frontend.encodings import bgr_of
        from frontend.images import decoded_bgr

        return self._read(decoded_bgr, bgr_of)

    def _read(
        self, unpacked: Callable[..., Picture | None], plain: Callable[..., Picture | None]
    ) -> Picture | None:
        """Returns the image by a function of a file's bytes, or by one of a plain image's."""
        content = _content(self.file, self.channel, self.place)
        if content is None:
            return None
        if self.channel.type == types.COMPRESSED:
            return unpacked(content.data)
        size = (int(content.width), int(content.height), int(content.step))
        return plain(content.data, content.encoding, *size, bool(content.is_bigendian))

    def packed(self) -> bytes | None:
        """Returns the bytes of the image file that was recorded, or None where it is none."""
        if self.channel.type != types.COMPRESSED:
            return None
        content = _content(self.file, self.channel, self.place)
        return None if content is None else content.data.tobytes()


@dataclass(frozen=True, slots=True)
class BagScan:
    """A scan of a bag.

    Attributes:
        name: topic and number.
        file: file that it is in.
        channel: its stream.
        place: where in the file.
        upside_down: whether the laser hangs with its z axis down, so that it turns the other way.
    """

    name: str
    file: Container
    channel: Channel
    place: Place
    upside_down: bool = False

    def scan(self) -> Scan | None:
        """Returns the scan, or None where it cannot be read whole."""
        content = _content(self.file, self.channel, self.place)
        if content is None:
            return None
        ranges = np.array(content.ranges, float)
        sense = -1.0 if self.upside_down else 1.0
        return Scan(
            ranges,
            sense * float(content.angle_min),
            sense * float(content.angle_increment),
            float(content.range_min),
            float(content.range_max),
            max(0.0, float(content.time_increment)) * max(0, len(ranges) - 1),
        )


def _content(file: Container, channel: Channel, place: Place) -> Any:
    """Returns a message, or None where it cannot be read."""
    try:
        definition = types.differing_definition(
            channel.type, channel.encoding, channel.definition, channel.md5
        )
        data = file.read(place)
        return types.decode(channel.type, channel.encoding, data, definition)
    except (OSError, Broken, types.Undecodable):
        return None
