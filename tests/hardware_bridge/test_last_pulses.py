from __future__ import annotations

import json
from pathlib import Path

import pytest

from hardware_bridge.errors import StateFileError
from hardware_bridge.last_pulses import LastPulses, state_directory

CHANNELS = (1, 2, 3, 4, 5, 6)
PULSES = (1500, 1501, 1502, 1503, 1504, 1505)


def test_what_was_saved_is_known_after_a_restart(tmp_path: Path) -> None:
    LastPulses(tmp_path / "new" / "folder", "/dev/rfcomm0").save(CHANNELS, PULSES)
    assert LastPulses(tmp_path / "new" / "folder", "/dev/rfcomm0").load(CHANNELS) == PULSES


def test_pulses_belong_to_channels_not_to_struts(tmp_path: Path) -> None:
    LastPulses(tmp_path, "p").save(CHANNELS, PULSES)
    assert LastPulses(tmp_path, "p").load((2, 1, 9)) == (1501, 1500, None)


def test_another_port_or_another_robot_has_its_own_record(tmp_path: Path) -> None:
    LastPulses(tmp_path, "/dev/rfcomm0", "one").save(CHANNELS, PULSES)
    assert LastPulses(tmp_path, "/dev/rfcomm1", "one").load(CHANNELS) == (None,) * 6
    assert LastPulses(tmp_path, "/dev/rfcomm0", "two").load(CHANNELS) == (None,) * 6


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"robot": ""}', '{"robot": "", "pulses_us": {"1": "x", "2": true}}'])
def test_a_broken_record_is_no_knowledge(tmp_path: Path, text: str) -> None:
    record = LastPulses(tmp_path, "p")
    record.path.write_text(text)
    assert record.load(CHANNELS) == (None,) * 6


def test_a_record_that_cannot_be_kept_is_an_error_naming_the_file(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StateFileError, match=r"last_pulses-p\.json"):
        LastPulses(tmp_path / "file", "p").save(CHANNELS, PULSES)


def test_the_record_is_replaced_whole_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    record = LastPulses(tmp_path, "p")
    for pulse in range(1500, 1510):
        record.save(CHANNELS, (pulse,) * 6)
        assert json.loads(record.path.read_text())["pulses_us"]["6"] == pulse
    assert list(tmp_path.iterdir()) == [record.path]


def test_the_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SIXSTRUT_STATE_DIR", str(tmp_path))
    assert state_directory() == tmp_path
    monkeypatch.delenv("SIXSTRUT_STATE_DIR")
    monkeypatch.setenv("HOME", "/home/somebody")
    assert state_directory() == Path("/home/somebody/.local/state/sixstrut")
