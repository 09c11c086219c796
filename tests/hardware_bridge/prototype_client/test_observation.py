# SPDX-License-Identifier: Apache-2.0
"""Lines of an observer that are none."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.errors import ObserverError
from hardware_bridge.prototype_client.observation import decode_observation

GOOD = {"robot_time_ns": 5, "face": "TC6", "settled": True, "nodes_m": [[0.0] * 3] * 12, "box_m": [0.0] * 3, "late_s": 0.0}


def line(**changes: object) -> bytes:
    return json.dumps({**GOOD, **changes}).encode()


def test_a_good_line_is_read() -> None:
    assert decode_observation(line()).face == "TC6"
    assert decode_observation(line(face="\x1b[31m" + "x" * 1000)).face.isprintable()  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "bad",
    [
        line(nodes_m=[[float("nan")] * 3] * 12),
        line(box_m=[1e300, 0.0, 0.0]),
        line(robot_time_ns=float("inf")),
        line(late_s=float("nan")),
        line(nodes_m=[[0.0] * 3] * 11),
        b"[" * 60_000,
        b"[]",
        b"null",
        b'{"robot_time_ns": 1' + b"0" * 5000 + b"}",
        b"\xff\xfe",
    ],
)
def test_what_is_no_observation_is_one_short_line(bad: bytes) -> None:
    with pytest.raises(ObserverError) as caught:
        decode_observation(bad)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 250


@given(st.binary(max_size=200))
def test_whatever_bytes_the_error_comes_of_them(data: bytes) -> None:
    with pytest.raises(ObserverError):
        decode_observation(data)
