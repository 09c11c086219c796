# SPDX-License-Identifier: Apache-2.0
"""Last pulses belong to a robot with its calibration and board, never to the name of a port."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from hardware_bridge.errors import StateFileError
from hardware_bridge.saved_state import state_file
from hardware_bridge.saved_state.last_pulses import LastPulses
from hardware_bridge.saved_state.robot_identity import NAMELESS, Identity

CHANNELS = (1, 2, 3, 4, 5, 6)
PULSES = (1500, 1501, 1502, 1503, 1504, 1505)
NOBODY = (None,) * 6
BLUE = Identity("blue", "c1c1c1c1c1", "lsc")
VIRTUAL = Identity("instance 1", "c1c1c1c1c1", "lsc", "/run/prototype")


def load(folder: Path, identity: Identity) -> tuple[tuple[int | None, ...], str]:
    record = LastPulses(folder, identity)
    return record.load(CHANNELS), record.why


@pytest.mark.parametrize("who", [BLUE, VIRTUAL])
def test_what_was_saved_is_known_after_a_restart(tmp_path: Path, who: Identity) -> None:
    LastPulses(tmp_path / "new" / "folder", who).save(CHANNELS, PULSES)
    assert load(tmp_path / "new" / "folder", who) == (PULSES, "")


def test_pulses_belong_to_channels_not_to_struts(tmp_path: Path) -> None:
    LastPulses(tmp_path, BLUE).save(CHANNELS, PULSES)
    record = LastPulses(tmp_path, BLUE)
    assert record.load((2, 1, 9)) == (1501, 1500, None)
    assert "not known of all its channels" in record.why


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (replace(BLUE, calibration="d2d2d2d2d2"), "c1c1c1c1 on board lsc, this is robot 'blue' with calibration d2"),
        (replace(BLUE, board="ssc32"), "on board lsc, this is robot 'blue' with calibration c1c1c1c1 on board ssc32"),
        (replace(BLUE, robot="Blue"), "no last pulses of robot 'Blue' with calibration c1c1c1c1 on board lsc are kept"),
        (NAMELESS, "the calibration names no robot"),
        (replace(BLUE, link="/run/prototype"), "no last pulses of the virtual prototype blue"),
    ],
)  # fmt: skip
def test_another_robot_calibration_or_board_is_unknown_and_why_is_said(tmp_path: Path, other: Identity, why: str) -> None:
    LastPulses(tmp_path, BLUE).save(CHANNELS, PULSES)
    pulses, told = load(tmp_path, other)
    assert pulses == NOBODY
    assert why in told


def test_names_that_make_one_file_name_are_two_robots(tmp_path: Path) -> None:
    LastPulses(tmp_path, replace(BLUE, robot="a b")).save(CHANNELS, PULSES)
    for name in ("a-b", "a/b", "a  b", "../a b"):
        assert load(tmp_path, replace(BLUE, robot=name))[0] == NOBODY
    assert [path.parent for path in tmp_path.rglob("*.json")] == [tmp_path]


def test_a_wrong_calibration_that_moves_nothing_loses_nothing_and_one_that_moves_does(tmp_path: Path) -> None:
    LastPulses(tmp_path, BLUE).save(CHANNELS, PULSES)
    wrong = LastPulses(tmp_path, replace(BLUE, calibration="d2"))
    wrong.load(CHANNELS)
    wrong.save(CHANNELS, NOBODY, force=True)
    assert load(tmp_path, BLUE)[0] == PULSES
    wrong.save(CHANNELS, (1600,) * 6)
    assert load(tmp_path, BLUE)[0] == NOBODY
    wrong.save(CHANNELS, NOBODY, force=True)
    assert load(tmp_path, BLUE)[0] == NOBODY


def test_a_virtual_prototype_started_anew_is_another_robot(tmp_path: Path) -> None:
    LastPulses(tmp_path, VIRTUAL).save(CHANNELS, PULSES)
    assert load(tmp_path, replace(VIRTUAL, robot="instance 2"))[0] == NOBODY
    LastPulses(tmp_path, replace(VIRTUAL, robot="instance 2")).save(CHANNELS, PULSES)
    assert len(list(tmp_path.iterdir())) == 1, "one file a link, not one a start"


def test_what_moves_without_a_name_may_be_any_robot(tmp_path: Path) -> None:
    """Else a robot that was moved with an old calibration would be believed where the new one left it."""
    LastPulses(tmp_path, BLUE).save(CHANNELS, PULSES)
    LastPulses(tmp_path, VIRTUAL).save(CHANNELS, PULSES)
    nameless = LastPulses(tmp_path, NAMELESS)
    assert nameless.load(CHANNELS) == NOBODY
    nameless.save(CHANNELS, NOBODY, force=True)
    assert load(tmp_path, BLUE)[0] == PULSES, "nothing has moved yet"
    nameless.save(CHANNELS, PULSES)
    pulses, why = load(tmp_path, BLUE)
    assert pulses == NOBODY
    assert "a calibration without a name moved a robot, maybe this one" in why
    assert load(tmp_path, VIRTUAL)[0] == PULSES, "it was no virtual one"
    assert load(tmp_path, NAMELESS)[0] == NOBODY, "and itself is not remembered"
    again = LastPulses(tmp_path, BLUE)
    again.load(CHANNELS)
    again.save(CHANNELS, PULSES)
    assert load(tmp_path, BLUE)[0] == PULSES
    LastPulses(tmp_path, NAMELESS).save(CHANNELS, PULSES)
    assert load(tmp_path, BLUE)[0] == NOBODY, "each opening counts"


def test_struts_that_may_have_moved_by_themselves_are_forgotten_even_on_a_full_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = LastPulses(tmp_path, BLUE)
    record.save(CHANNELS, PULSES)

    def full(*words: object) -> None:
        raise StateFileError("x.json", "No space left on device", "it")

    monkeypatch.setattr(state_file, "write", full)
    record.forget(CHANNELS)
    assert load(tmp_path, BLUE)[0] == NOBODY


def test_pulses_of_a_robot_that_was_being_calibrated_become_its_calibrations(tmp_path: Path) -> None:
    measured = LastPulses(tmp_path, replace(BLUE, calibration=""))
    measured.save((1,), (1500,))
    measured.becomes("d2", dict(zip(CHANNELS, PULSES, strict=True)))
    assert load(tmp_path, replace(BLUE, calibration="d2"))[0] == PULSES


KEY = '"robot": "blue", "calibration": "c1c1c1c1c1", "board": "lsc", "mark": null'


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        '{"robot": "", "pulses_us": {"1": 1500}}',
        "{%s}",
        '{%s, "pulses_us": [1500]}',
        *('{%s, "pulses_us": {"1": %%}}'.replace("%%", pulse) for pulse in ('"x"', "true", "1e9", "NaN", "-1500", "null")),
    ],
)
def test_a_broken_record_is_no_knowledge_and_is_named(tmp_path: Path, text: str) -> None:
    record = LastPulses(tmp_path, BLUE)
    record.path.write_text(text.replace("%s", KEY))
    assert record.load(CHANNELS) == NOBODY
    assert str(record.path) in record.why


def test_a_broken_mark_is_doubt(tmp_path: Path) -> None:
    LastPulses(tmp_path, BLUE).save(CHANNELS, PULSES)
    (tmp_path / "last_pulses-nameless.json").symlink_to("/dev/null")
    pulses, why = load(tmp_path, BLUE)
    assert pulses == NOBODY
    assert "last_pulses-nameless.json" in why


def test_a_record_of_an_older_software_is_no_knowledge(tmp_path: Path) -> None:
    old = json.dumps({"robot": "", "pulses_us": dict(zip(map(str, CHANNELS), PULSES, strict=True))})
    (tmp_path / "last_pulses-dev-rfcomm0.json").write_text(old)
    assert load(tmp_path, BLUE)[0] == load(tmp_path, NAMELESS)[0] == NOBODY


def test_a_record_that_cannot_be_kept_is_an_error_naming_the_file(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for identity in (BLUE, NAMELESS):
        with pytest.raises(StateFileError, match=r"last_pulses-.*\.json"):
            LastPulses(tmp_path / "file", identity).save(CHANNELS, PULSES)
