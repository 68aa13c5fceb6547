"""From a bag's messages to its content, in one pass."""

from __future__ import annotations

from pathlib import Path

from frontend.log import Progress
from frontend.readers import bag_types as types
from frontend.readers.bag_content import BagContent, Topic
from frontend.readers.bag_files import files_of
from frontend.readers.bag_parts import Message
from frontend.readers.bag_readers import READERS, check


def collect(path: Path, progress: Progress | None = None) -> BagContent:
    """Returns what a bag holds.

    Args:
        path: a bag's file, or the folder of a ROS 2 bag.
        progress: told bytes.

    Raises:
        BadLog: there is no bag, or nothing of it can be read.
    """
    found = BagContent(path, [])
    files = found.files
    files += files_of(path, found.losses)
    sizes = [file.path.stat().st_size for file in files]
    for number, file in enumerate(files):
        before, total = sum(sizes[:number]), sum(sizes)

        def tell(done: int, size: int, before: int = before, total: int = total) -> None:
            if progress is not None:
                progress(before + done, total)

        for message in file.messages(found.losses, tell):
            found.messages += 1
            _note(found, message)
    return found


def _note(found: BagContent, message: Message) -> None:
    channel = message.channel
    topic = found.topics.get(channel.topic)
    if topic is None:
        topic = found.topics[channel.topic] = Topic(channel, first_ns=message.received_ns)
    topic.count += 1
    topic.bytes += len(message.data)
    topic.last_ns = message.received_ns
    reader = READERS.get(channel.type)
    if reader is None:
        return
    place = f"message {topic.count} of {channel.topic}"
    if channel.encoding not in types.ENCODINGS:
        found.losses.add(
            f"{channel.topic} holds messages encoded as {channel.encoding!r}; known are "
            f"{' and '.join(types.ENCODINGS)}",
            place,
        )
        return
    try:
        definition = types.differing_definition(
            channel.type, channel.encoding, channel.definition, channel.md5
        )
        content = types.decode(channel.type, channel.encoding, message.data, definition)
        for stream, stamp, values in reader(found, channel.topic, content, message):
            check(values)
            stream.received.append(message.received_ns)
            stream.stamp.append(stamp)
            stream.order.append(found.messages)
            stream.values.extend(values)
    except types.Undecodable as problem:
        found.losses.add(f"a message of {channel.topic} {problem}", place)
