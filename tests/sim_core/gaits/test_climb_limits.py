# SPDX-License-Identifier: Apache-2.0
"""How steep gaits climb: the shipped numbers, and what becomes of them."""

import pytest

from sim_core.gaits import climb_limits
from sim_core.gaits.climb_limits import LEAST_DEG, USUAL_DEG, Climbs, climbs_text, load_climbs, usual_deg
from sim_core.gaits.library import gait_of, load_library
from sim_core.structure.roll_classes import TC_TO, TO_TC


@pytest.mark.parametrize("name", ["robust", "staged", "continuous", "improved", "previous"])
def test_every_shipped_library_was_measured(name):
    library = load_library(name)
    found = load_climbs(library)
    assert found is not None
    assert list(found.steepest_deg) == [primitive.name for primitive in library.primitives]
    assert all(0.0 <= deg <= 16.0 for deg in found.steepest_deg.values())


def test_text_and_back_for_the_library_that_it_is_of_and_no_other(tmp_path, monkeypatch):
    library = load_library("robust")
    found = load_climbs(library)
    monkeypatch.setattr(climb_limits, "DATA", tmp_path)
    assert load_climbs(library) is None
    path = tmp_path / "climbs" / "robust.yaml"
    path.parent.mkdir()
    path.write_text(climbs_text(found), encoding="utf-8")
    assert load_climbs(library) == found
    path.write_text(climbs_text(Climbs("another", found.how, found.steepest_deg)), encoding="utf-8")
    assert load_climbs(library) is None
    path.write_text("steepest_deg: none", encoding="utf-8")
    assert load_climbs(library) is None


def test_what_hardly_climbs_is_hardly_sure_on_level_ground():
    first, second, third = load_library("robust").primitives[:3]
    gaits = [gait_of(primitive, TC_TO.source, TC_TO.target) for primitive in (first, second, third)]
    found = Climbs("", "", {first.name: 0.0, second.name: 0.25, third.name: 3.0})
    assert [found.on_level(gait) for gait in gaits] == pytest.approx([0.27, 0.5, 1.0], abs=0.01)
    assert [found.of(gait) for gait in gaits] == [LEAST_DEG, LEAST_DEG, 3.0]


def test_what_nobody_measured_is_as_usual_for_its_kind():
    library = load_library("robust")
    for roll_class in (TC_TO, TO_TC):
        primitive = next(one for one in library.primitives if one.roll_class == roll_class)
        gait = gait_of(primitive, roll_class.source, roll_class.target)
        assert usual_deg(gait) == USUAL_DEG[roll_class.source[:2]]
