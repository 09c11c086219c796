# SPDX-License-Identifier: Apache-2.0
"""Messages as the bytes that go over the wire and into a bag.

rclpy's `serialize_message` gives a buffer of the size that the type support *estimates*: after an empty sequence of eight-byte
numbers at the end, it is too long by the alignment that nobody needed, and the rest is whatever was in memory. Strict readers
(rosbags) refuse such messages, so the exact length is counted here.
"""

import re
from collections.abc import Hashable
from functools import cache
from typing import Any, cast

from rclpy.serialization import serialize_message

HEADER = 4
"""Bytes of the encapsulation, before which nothing is aligned."""

_SIZES = {
    **dict.fromkeys(("boolean", "octet", "int8", "uint8", "char"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float"), 4),
    **dict.fromkeys(("int64", "uint64", "double"), 8),
}
_FIELD = re.compile(r"^(?:sequence<(?P<sequence>[^,>]+(?:<\d+>)?)(?:, \d+)?>|(?P<array>[^\[]+)\[(?P<count>\d+)\]|(?P<one>.+))$")


def wire_bytes(message: Any) -> bytes:
    """The message in CDR, as a publisher would send it."""
    data = bytes(serialize_message(message))
    return data[: HEADER + _end(message, 0)]


@cache
def _plan(kind: Any) -> tuple[tuple[str, str, bool, bool], ...]:
    """Per field: name, element type, whether it is a sequence, whether it is one value."""
    plan = []
    for name, text in kind.get_fields_and_field_types().items():
        match = _FIELD.match(text)
        assert match is not None, f"{kind.__name__}.{name}: {text}"
        element = match["sequence"] or match["array"] or match["one"]
        plan.append((name, element.split("<")[0], match["sequence"] is not None, match["one"] is not None))
    return tuple(plan)


def _end(message: Any, at: int) -> int:
    """Where a message that begins at `at` ends."""
    for name, element, sequence, single in _plan(cast(Hashable, type(message))):
        value = getattr(message, name)
        if sequence:
            at = _aligned(at, 4) + 4
        size = _SIZES.get(element)
        if size is not None:
            count = 1 if single else len(value)
            if count:
                at = _aligned(at, size) + size * count
            continue
        for item in (value,) if single else value:
            at = _aligned(at, 4) + 5 + len(item.encode()) if element == "string" else _end(item, at)
    return at


def _aligned(at: int, size: int) -> int:
    return at + -at % size
