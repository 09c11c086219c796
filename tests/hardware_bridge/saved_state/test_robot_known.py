# SPDX-License-Identifier: Apache-2.0
"""The robot is known, not the name of its port: what a bridge believes after another robot, calibration, board or port."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from hardware_bridge.boards.registry import parse_board
from hardware_bridge.calibration.pulse_map import Calibration
from hardware_bridge.driver.bridge import Bridge
from hardware_bridge.errors import DutyError, PortBusy, PositionUnknown
from hardware_bridge.safety.limit_checks import Rules
from hardware_bridge.safety.supervisor_messages import LinkDown, Mode
from hardware_bridge.safety.trajectory import Trajectory
from tests.hardware_bridge.driver.test_bridge import armed
from tests.hardware_bridge.helpers import MID, MID_M, Wire, wait_for

Make = Callable[..., Bridge]
OUT_M = MID_M + 0.005


@pytest.fixture
def other_wire() -> Iterator[Wire]:
    wire = Wire()
    yield wire
    wire.cut()


def shifted(calibration: Calibration, shift_us: int) -> Calibration:
    """The same robot, measured again; or another one of the same make."""
    struts = tuple(replace(strut, trim_us=shift_us, stroke_mm=(-49.0, 49.0)) for strut in calibration.struts)
    return replace(calibration, struts=struts)


@pytest.fixture
def of(rules: Rules) -> Callable[..., Rules]:
    def rules_of(robot: str | None, shift_us: int = 0) -> Rules:
        return replace(rules, calibration=replace(shifted(rules.calibration, shift_us), robot=robot))

    return rules_of


def session(bridge: Bridge, confirmed: tuple[float, ...] | None = MID) -> None:
    """S1 ends 5 mm out."""
    bridge.open()
    with armed(bridge, confirmed) as lease:
        assert bridge.execute(Trajectory([0.5], [[OUT_M, *MID[1:]]]), lease).wait(20.0)
    bridge.close()


def refused(bridge: Bridge) -> str:
    """What arming says to a robot whose struts nobody has looked at."""
    bridge.open()
    assert not any(bridge.snapshot().known)
    with pytest.raises(PositionUnknown, match="look where each strut is, and confirm the six lengths in m with arm") as caught:
        bridge.arm("test", True)
    assert bridge.snapshot().mode is Mode.DISARMED
    return str(caught.value)


def test_two_robots_behind_one_port_name_do_not_share_what_is_known(make_bridge: Make, of: Callable, wire: Wire) -> None:
    session(make_bridge(wire.port, rules=of("a")))
    other = make_bridge(wire.port, rules=of("b", 90), rested_s=0.0)
    assert "S1: nobody knows its length: no last pulses of robot 'b' with calibration" in refused(other)
    assert not [move for move in wire.moves() if move.pulses_us[0] > 1560], "not one move with b's trim"
    assert other.snapshot().duty_left_s == 0.0, "nor does it inherit that a has rested"
    other.close()
    again = make_bridge(wire.port, rules=of("a"), rested_s=0.0)
    again.open()
    assert again.snapshot().lengths_m == pytest.approx([OUT_M, *MID[1:]])
    assert again.snapshot().duty_left_s > 0.0


def test_a_robot_on_another_port_is_still_known(make_bridge: Make, of: Callable, wire: Wire, other_wire: Wire) -> None:
    session(make_bridge(wire.port, rules=of("a")))
    bridge = make_bridge(other_wire.port, rules=of("a"), rested_s=0.0)
    bridge.open()
    assert bridge.snapshot().lengths_m == pytest.approx([OUT_M, *MID[1:]])
    with armed(bridge, None):
        assert other_wire.moves()[0].pulses_us == (1550,)


def test_another_calibration_of_the_same_robot_knows_no_positions_but_its_duty(make_bridge: Make, of: Callable, wire: Wire) -> None:
    session(make_bridge(wire.port, rules=of("a")))
    edited = make_bridge(wire.port, rules=of("a", 90), rested_s=0.0)
    before, now = of("a").calibration.hash[:8], of("a", 90).calibration.hash[:8]
    told = refused(edited)
    assert (
        f"the last pulses are of robot 'a' with calibration {before} on board lsc, this is robot 'a' with calibration {now}" in told
    )
    left_s = edited.snapshot().duty_left_s
    assert 46.0 < left_s < 54.0
    edited.close()
    kept = make_bridge(wire.port, rules=of("a"))
    kept.open()
    assert all(kept.snapshot().known), "a wrong file that was given and moved nothing loses nothing"
    kept.close()
    session(make_bridge(wire.port, rules=of("a", 90)))
    assert "this is robot 'a' with calibration " + before in refused(make_bridge(wire.port, rules=of("a")))


def test_another_board_knows_no_positions(make_bridge: Make, of: Callable, wire: Wire) -> None:
    session(make_bridge(wire.port, rules=of("a")))
    told = refused(make_bridge(wire.port, rules=of("a"), board=parse_board("ssc32")))
    assert "on board lsc, this is robot 'a'" in told
    assert "on board ssc32" in told


def test_a_robot_without_a_name_is_not_remembered(make_bridge: Make, of: Callable, wire: Wire) -> None:
    bridge = make_bridge(wire.port, rules=of(None))
    assert "the calibration names no robot" in refused(bridge)
    bridge.close()
    session(make_bridge(wire.port, rules=of(None)))
    again = make_bridge(wire.port, rules=of(None), rested_s=0.0)
    assert "the calibration names no robot" in refused(again)
    with armed(again) as lease, pytest.raises(DutyError, match="nobody knows how long"):
        again.execute(Trajectory([0.5], [[OUT_M, *MID[1:]]]), lease)


def test_a_robot_that_was_moved_with_its_old_file_is_not_believed_to_be_where_the_new_one_left_it(
    make_bridge: Make, of: Callable, wire: Wire
) -> None:
    session(make_bridge(wire.port, rules=of("a")))
    session(make_bridge(wire.port, rules=of(None)))
    bridge = make_bridge(wire.port, rules=of("a"))
    assert "a calibration without a name moved a robot, maybe this one" in refused(bridge)


def test_the_same_name_at_two_ports_at_once_is_refused(make_bridge: Make, of: Callable, wire: Wire, other_wire: Wire) -> None:
    first, second = make_bridge(wire.port, rules=of("a")), make_bridge(other_wire.port, rules=of("a", 10))
    first.open()
    with pytest.raises(PortBusy, match="another bridge drives robot 'a' now; two robots need two names"):
        second.open()
    third = make_bridge(other_wire.port, rules=of("b"))
    third.open()
    third.close()
    first.close()
    second.open()


def test_a_port_that_is_busy_lets_go_of_the_robot(make_bridge: Make, of: Callable, wire: Wire, other_wire: Wire) -> None:
    make_bridge(wire.port, rules=of("a")).open()
    with pytest.raises(PortBusy, match="is in use"):
        make_bridge(wire.port, rules=of("b")).open()
    make_bridge(other_wire.port, rules=of("b")).open()


def test_within_one_process_closing_and_opening_reads_what_others_have_written(make_bridge: Make, of: Callable, wire: Wire) -> None:
    bridge = make_bridge(wire.port, rules=of("a"))
    session(bridge)
    session(make_bridge(wire.port, rules=of("a", 90)))
    refused(bridge)


def test_the_records_of_older_software_are_no_knowledge(make_bridge: Make, of: Callable, wire: Wire, tmp_path: Path) -> None:
    slug = wire.port.strip("/").replace("/", "-")
    folder = tmp_path / "state"
    folder.mkdir()
    pulses = json.dumps({"robot": "", "pulses_us": {str(channel): 1600 for channel in range(1, 7)}})
    (folder / f"last_pulses-{slug}.json").write_text(pulses)
    (folder / f"duty-{slug}.json").write_text('{"robot": "", "boot": "x", "steady_s": 0, "wall_s": 0, "spells": []}')
    for robot in ("a", None):
        bridge = make_bridge(wire.port, rules=of(robot), rested_s=0.0)
        refused(bridge)
        assert bridge.snapshot().duty_left_s == 0.0
        bridge.close()


# ---- the virtual prototype ------------------------------------------------------------------------------------------


def test_a_virtual_prototype_is_known_while_it_lives_and_the_next_one_is_new(start_prototype: Callable, make_bridge: Make) -> None:
    running = start_prototype()
    options = {"rested_s": 0.0, "silent_board": False}
    bridge = make_bridge(str(running.link), **options)
    bridge.open()
    assert bridge.snapshot().duty_left_s == pytest.approx(54.0), "it has never run"
    bridge.close()
    session(bridge)
    spelled = running.link.parent / "." / ".." / running.link.parent.name / running.link.name
    again = make_bridge(str(spelled), **options)
    again.open()
    assert all(again.snapshot().known)
    assert again.snapshot().duty_left_s < 53.9
    running.kill()
    wait_for(lambda: again.snapshot().mode is Mode.FAULT, "the lost link")
    start_prototype()
    again.reset()
    assert not any(again.snapshot().known), "another robot stands there now"
    assert again.snapshot().duty_left_s == pytest.approx(54.0)
    with pytest.raises(PositionUnknown, match="the last pulses are of the virtual prototype"):
        again.arm("test", True)


def test_a_reset_believes_memory_and_not_a_record_that_could_not_be_written(
    start_prototype: Callable, make_bridge: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    bridge = make_bridge(str(start_prototype().link))
    bridge.open()
    with armed(bridge):
        pass

    def fails(*words: object, **more: object) -> None:
        raise OSError(30, "Read-only file system")

    with monkeypatch.context() as broken, bridge._engine.lock:
        broken.setattr(Path, "unlink", fails)
        bridge._engine.forget_positions()
        bridge._link.is_up = False
        bridge._engine.apply(LinkDown("the board reports an error"))
    bridge.reset()
    with pytest.raises(PositionUnknown, match="the board may have moved or released the struts"):
        bridge.arm("test", True)
