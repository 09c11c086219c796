# SPDX-License-Identifier: Apache-2.0
import pytest

from sim_core.gaits.library import load_library
from sim_core.structure.parameters import SPECS
from sim_core.studies import sensitivity as s


def test_policies_near_a_library_contain_it_and_stay_within_the_bound():
    library = load_library("robust")
    jobs = s.policies_near(library, 45, 4, 1)
    assert len(jobs) == 4 * len(library.primitives)
    assert {p.policy for p in library.primitives} <= {job.policy for job in jobs}
    assert all(abs(v) <= 45 for job in jobs for v in job.policy)
    assert jobs == s.policies_near(library, 45, 4, 1)


def test_rope_stretch_matters_and_a_tighter_rest_rule_does_not(prototype, monkeypatch):
    monkeypatch.setattr(s, "SPECS", {name: SPECS[name] for name in ("tendon_stretch", "rest_hold_s")})
    found = s.influences(prototype, load_library("improved"), each=1)
    assert found["tendon_stretch"].flips > 0.1
    assert found["rest_hold_s"].flips == 0.0


def test_what_is_stored_belongs_to_the_shipped_numbers_and_covers_them(prototype):
    stored = s.stored_influences(prototype)
    assert stored is not None
    assert stored.keys() == {name for name, spec in SPECS.items() if not spec.whole}


def test_nothing_is_shown_for_other_numbers(prototype):
    from dataclasses import replace

    assert s.stored_influences(replace(prototype, box_mass_kg=0.2)) is None


def test_a_change_that_is_no_valid_robot_is_left_out(prototype):
    from dataclasses import replace

    stiff = replace(prototype, friction_static=0.5)
    assert s._changed(stiff, "friction_static", -1.0) is None
    assert s._changed(stiff, "friction_static", 1.0).friction_static == pytest.approx(0.55)
