"""Reads a recorded session back, with no ROS installed: what was sent, what was seen, what the twin said."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from hardware_bridge.errors import BridgeError


class BagError(BridgeError):
    """A bag that cannot be read."""


class Recorded(NamedTuple):
    """One message of a bag: its topic, when it was logged (ns, ROS time) and its decoded fields."""

    topic: str
    log_time_ns: int
    message: Any


@dataclass(frozen=True)
class Session:
    """A bag in memory.

    Attributes:
        path: the file.
        messages: topic without the recording prefix and namespace's leading slash ("bridge/struts_sent") -> messages in log order.
        attachments: name -> bytes. metadata: name -> mapping of strings.
    """

    path: Path
    messages: dict[str, list[Recorded]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)

    def of(self, topic: str) -> Iterator[Any]:
        """Decoded messages of a topic, such as "bridge/struts_sent", whatever namespace it was recorded in."""
        for name, messages in self.messages.items():
            if name == topic or name.endswith("/" + topic):
                yield from (recorded.message for recorded in messages)


def seconds_of(stamp: Any) -> float:
    """A ROS stamp in seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def read_session(path: Path | str, since_ns: int | None = None, until_ns: int | None = None) -> Session:
    """Read a bag, or only what was logged within a span.

    Args:
        since_ns, until_ns: log times (ROS time), the second not included; None: from the beginning, to the end.

    Raises:
        BagError: missing, not an MCAP file, or not closed (then: how to mend it).
    """
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    file = Path(path)
    session = Session(file)
    try:
        with file.open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            for attachment in reader.iter_attachments():
                session.attachments[attachment.name] = attachment.data
            for metadata in reader.iter_metadata():
                session.metadata[metadata.name] = dict(metadata.metadata)
            for _schema, channel, message, decoded in reader.iter_decoded_messages(start_time=since_ns, end_time=until_ns):
                topic = channel.topic.removeprefix("/recorded/").lstrip("/")
                session.messages.setdefault(topic, []).append(Recorded(topic, message.log_time, decoded))
    except OSError as error:
        raise BagError(f"cannot read bag {file}: {error.strerror}; give the path of an .mcap file") from error
    except (McapError, EOFError, ValueError) as error:
        raise BagError(
            f"{file} is not a complete MCAP file ({error}); a session that was cut short is mended at the bridge's next start"
        ) from error
    return session
