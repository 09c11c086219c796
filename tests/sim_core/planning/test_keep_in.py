# SPDX-License-Identifier: Apache-2.0
"""The keep-in area: what is in it, what leads out, and what is none."""

import numpy as np
import pytest

from sim_core.dynamics.model import build_model
from sim_core.errors import ParameterError
from sim_core.planning.floor_planner import NO_SHIFT, Floor, Shift, Stance
from sim_core.planning.keep_in import parsed_keep_in
from sim_core.structure.parameters import load_prototype


def test_how_far_points_are_outside():
    area = parsed_keep_in("0 0, 2 0, 2 1, 0 1")
    assert area.outside_m(np.array([(1.0, 0.5), (0.3, 0.4)])) == pytest.approx(-0.3)
    assert area.outside_m(np.array([(1.0, 0.5, 9.0), (2.25, 0.4, 0.0)])) == pytest.approx(0.25)
    assert sorted(map(tuple, area.corners_m)) == [(0.0, 0.0), (0.0, 1.0), (2.0, 0.0), (2.0, 1.0)]


@pytest.mark.parametrize("text", ["1 2", "0 0, 1 1, 2 2", "0 0, 1, 2 2", "a b, c d, e f", "0 0, 1 0, nan 1", "0 0, 1 0, inf 1"])
def test_what_is_no_area_is_refused_in_one_line(text):
    with pytest.raises(ParameterError, match="3 or more") as caught:
        parsed_keep_in(text)
    assert "\n" not in str(caught.value)


def test_no_text_is_no_area():
    assert parsed_keep_in("  ") is None


def test_the_face_onto_which_it_would_come_out_is_named():
    floor, start = Floor(build_model(load_prototype())), Stance("TC6", 0.0, 0.0, 0.0)
    faces = ("TO5", "TC3", "TO4", "TC4")
    places = [start]
    for face in faces:
        places.append(floor.rolled(places[-1], face))
    for last in (1, 2, 3, 4):
        hull = np.concatenate([floor.joints_m(place) for place in places[:last]])
        area = parsed_keep_in(", ".join(f"{x} {y}" for x, y in hull + 1e-6 * np.sign(hull - hull.mean(axis=0))))
        assert area.leads_out(floor, start, faces[: last - 1], [NO_SHIFT] * (last - 1)) == ""
        assert area.leads_out(floor, start, faces, [NO_SHIFT] * 4) == faces[last - 1]
    farther = parsed_keep_in(", ".join(f"{x} {y}" for x, y in np.concatenate([floor.joints_m(place) for place in places]) * 1.03))
    assert farther.leads_out(floor, start, faces, [NO_SHIFT] * 4) == ""
    assert farther.leads_out(floor, start, faces, [Shift(1.1)] * 4) == "TC3"
