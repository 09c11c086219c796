# SPDX-License-Identifier: Apache-2.0
"""What a slow judge said is remembered; what it never saw is not permitted."""

from hardware_bridge.safety.shape_cache import ALL_LOADS, NO_LOADS, NOT_JUDGED, ShapeMemory
from tests.hardware_bridge.helpers import MID, MID_M


def long(length_m: float) -> tuple[float, ...]:
    return (length_m, *MID[1:])


def test_a_shape_is_judged_once() -> None:
    asked: list[tuple[float, ...]] = []
    memory = ShapeMemory(asked.append, 6e-4)
    for _ in range(3):
        assert memory.judge(MID) is None
    assert memory.recall(MID) is None
    assert len(asked) == 1


def test_what_nobody_judged_is_not_permitted() -> None:
    assert ShapeMemory(lambda shape: None, 6e-4).recall(MID) == NOT_JUDGED


def test_between_permitted_shapes_a_frame_is_permitted() -> None:
    memory = ShapeMemory(lambda shape: None, 6e-4)
    memory.judge(long(MID_M))
    memory.judge(long(MID_M + 1e-3))
    assert memory.recall(long(MID_M + 4.7e-4)) is None
    assert memory.recall(long(MID_M + 1.7e-3)) == NOT_JUDGED


def test_near_a_refused_shape_nothing_is_permitted() -> None:
    memory = ShapeMemory(lambda shape: "thin ice", 6e-4)
    assert memory.judge(MID) == "thin ice"
    assert memory.recall(MID) == "thin ice"
    assert memory.recall(long(MID_M + 1e-4)) == NOT_JUDGED


def pressed(lengths_m: tuple[float, ...]) -> str | tuple[float, ...]:
    """Forces as of a strut that its length presses, 1 N a mm."""
    return "thin ice" if lengths_m[0] > MID_M + 0.05 else (-1e3 * (lengths_m[0] - MID_M), *(0.0,) * 5)


def test_a_strut_is_loaded_above_its_back_drive_force_and_near_where_it_is() -> None:
    memory = ShapeMemory(pressed, 6e-4, 40.0)
    for stroke_mm in (0, 38, 39, 40, 41, 60):
        memory.judge(long(MID_M + 1e-3 * stroke_mm))
    loaded = (True, *NO_LOADS[1:])
    assert memory.loads(MID) == memory.loads(long(MID_M + 0.0385)) == NO_LOADS
    assert memory.loads(long(MID_M + 0.041)) == memory.loads(long(MID_M + 0.0405)) == loaded, "too much rather than too little"
    assert memory.loads(long(MID_M + 0.02)) == memory.loads(long(MID_M + 0.06)) == ALL_LOADS, "who knows"


def test_of_a_judge_that_tells_no_forces_nothing_is_loaded() -> None:
    memory = ShapeMemory(lambda shape: None, 6e-4, 40.0)
    assert memory.loads(MID) == NO_LOADS
    memory.judge(MID)
    assert memory.loads(MID) == memory.loads(long(MID_M + 0.02)) == NO_LOADS
