# SPDX-License-Identifier: Apache-2.0
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware_bridge.boards.maestro import Maestro
from hardware_bridge.boards.registry import BOARDS, parse_board
from hardware_bridge.errors import ParameterError

SPECS = ["lsc", "ssc32", "maestro", "maestro:crc", "maestro:device=12", "maestro:device=12:crc"]


@pytest.mark.parametrize("spec", [*SPECS, "maestro:limits=900-2100", "maestro:device=0:crc:limits=500-2500"])
def test_every_board_is_found_by_its_own_name(spec: str) -> None:
    assert parse_board(spec).spec == spec
    assert parse_board(spec.upper()) == parse_board(spec)
    assert spec.startswith(parse_board(spec).name)


def test_options_may_come_in_any_order() -> None:
    assert parse_board("maestro:crc:device=12") == Maestro(12, True)
    assert parse_board("maestro:limits=900-2100:crc") == Maestro(None, True, (900, 2100))
    assert parse_board("maestro:limits=992-2000").spec == "maestro"


@pytest.mark.parametrize(
    "spec",
    [
        "",
        "lsc:crc",
        "ssc32u:x",
        "mastro",
        "maestro:",
        "maestro:crc:crc",
        "maestro:device=128",
        "maestro:device=",
        "maestro:crc=1",
        "maestro:crc=",
        "maestro:crcs",
        "maestro:device=x",
        "maestro:device",
        "maestro:limits=900",
        "maestro:limits=2100-900",
        "maestro:limits=100-2000",
    ],
)
def test_another_board_is_refused_with_those_that_exist(spec: str) -> None:
    with pytest.raises(ParameterError, match="valid is lsc, ssc32, or maestro with"):
        parse_board(spec)


@given(st.text(max_size=30).filter(lambda text: text.strip().lower().split(":")[0] not in BOARDS))
def test_any_other_text_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ParameterError) as caught:
        parse_board(text)
    assert "\n" not in str(caught.value)
