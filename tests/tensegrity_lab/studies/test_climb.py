# SPDX-License-Identifier: Apache-2.0
"""How steep gaits climb, measured."""

import json

import pytest

from sim_core.dynamics.actuators import require_actuators
from sim_core.gaits.climb_limits import load_climbs
from sim_core.gaits.library import gait_of, load_library
from sim_core.structure.parameters import load_prototype
from sim_core.structure.roll_classes import TC_TO
from tensegrity_lab.studies.climb import NEAR_DEG, roll, steepest_deg
from tests.sixstrut_cli.test_commands import sixstrut

LIBRARY = load_library("robust")
LOADED = require_actuators("stand-in")


def reference(name):
    return gait_of(LIBRARY.primitive(name), TC_TO.source, TC_TO.target)


@pytest.mark.parametrize("name", ["P8", "P12"])
def test_the_shipped_number_is_what_is_measured(name):
    assert steepest_deg(load_prototype(), reference(name), LOADED) == load_climbs(LIBRARY).steepest_deg[name]


@pytest.mark.slow
def test_a_mirrored_gait_climbs_as_steeply_and_ideal_actuators_climb_no_less():
    prototype, gait = load_prototype(), reference("P12")
    mirrored = gait_of(gait.primitive, "TC2", "TO1")
    assert not mirrored.proper
    loaded = steepest_deg(prototype, gait, LOADED)
    assert steepest_deg(prototype, mirrored, LOADED) == pytest.approx(loaded, abs=NEAR_DEG)
    assert steepest_deg(prototype, gait, None) >= loaded


def test_a_roll_goes_a_step_over_the_floor():
    gait = reference("P12")
    level = roll(load_prototype(), gait, LOADED, 0.0, 0.0)
    assert level.face == gait.target
    assert 0.03 < abs(complex(*level.shift_m)) < 0.2


@pytest.mark.parametrize("words", [("missing.yaml",), ("robust", "--actuators", "missing.yaml")])
def test_what_is_not_there_is_one_line_that_names_it(words):
    result = sixstrut("climb", *words)
    assert result.returncode == 1
    assert "missing.yaml" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.slow
def test_the_command_tells_scripts_and_people_and_writes_the_file(tmp_path):
    from dataclasses import replace

    from sim_core.gaits.library import library_text

    one = replace(LIBRARY, name="one", primitives=LIBRARY.primitives[11:12])
    path, out = tmp_path / "one.yaml", tmp_path / "climbs.yaml"
    path.write_text(library_text(one), encoding="utf-8")
    result = sixstrut("climb", str(path), "-o", str(out), "--json")
    assert result.returncode == 0, result.stderr
    told = json.loads(result.stdout)
    assert told["steepest_deg"] == {"P12": load_climbs(LIBRARY).steepest_deg["P12"]}
    assert "P12" in out.read_text(encoding="utf-8")
    people = sixstrut("climb", str(path)).stdout
    assert "TC6-TO5: 1 primitives, 0 of them do not roll on level ground; median 1.00°, best 1.00°" in people
