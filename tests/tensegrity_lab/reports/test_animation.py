# SPDX-License-Identifier: Apache-2.0
"""The moving picture of a session, and the robot with its parts named."""

import numpy as np
from PIL import Image

from sim_core.structure.parameters import load_prototype
from sim_core.structure.topology import NODES
from tensegrity_lab.reports.animation import LONGEST_REST_S, Moment, Stand, _frames, animate
from tensegrity_lab.reports.words_picture import words_picture


def moment(time_s, x_m):
    joints = 0.234 * NODES + (x_m, 0.0, 0.12)
    return Moment(time_s, joints, joints.mean(axis=0), np.full(6, 0.234))


def test_a_session_becomes_a_short_picture_that_loops(tmp_path):
    moments = [moment(0.1 * k, 0.01 * k) for k in range(20)]
    path = tmp_path / "rolls.webp"
    assert animate(moments, [Stand(0.5, "TC6"), Stand(1.5, "TO5")], path, "a test", seconds=0.4) == path
    with Image.open(path) as image:
        assert image.n_frames == 6
        assert image.info["loop"] == 0
    assert path.stat().st_size < 200_000


def test_a_long_rest_is_cut_short():
    moments = [moment(0.0, 0.0), moment(1.0, 0.1)]
    moments += [moment(1.0 + 0.1 * k, 0.1) for k in range(1, 600)]
    moments += [moment(61.0, 0.1), moment(62.0, 0.2)]
    shown = _frames(moments, 100)
    resting = sum(1.0 < one.time_s < 61.0 for one in shown)
    assert shown[0].time_s == 0.0
    assert shown[-1].time_s == 62.0
    assert 0 < resting / 100 < 1.5 * LONGEST_REST_S / (2.0 + LONGEST_REST_S)


def test_nothing_to_show_is_said(tmp_path, capsys):
    assert animate([moment(0.0, 0.0)], [], tmp_path / "x.webp", "") is None
    assert "nothing to show" in capsys.readouterr().err


def test_the_robot_is_drawn_with_its_parts_named(tmp_path):
    words_picture(tmp_path / "words.png", load_prototype())
    with Image.open(tmp_path / "words.png") as image:
        assert image.size == (720, 460)
