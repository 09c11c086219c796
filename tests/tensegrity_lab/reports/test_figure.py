# SPDX-License-Identifier: Apache-2.0
"""Pictures, on machines with settings of their own."""

import os
import subprocess
import sys

import pytest

from tensegrity_lab.reports.figure import new_figure, picture_file

DRAW = """
import sys
from pathlib import Path
from sim_core.gaits.library import load_library
from tensegrity_lab.reports.library_plot import library_picture

assert library_picture(load_library("robust"), Path(sys.argv[1]))
"""


def drawn(path, **environ):
    command = [sys.executable, "-c", DRAW, str(path)]
    subprocess.run(command, env={**os.environ, **environ}, cwd=path.parent, check=True, timeout=60)
    return path.read_bytes()


@pytest.mark.slow
def test_a_picture_is_the_same_whatever_style_and_backend_the_user_has(tmp_path):
    plain = drawn(tmp_path / "plain.png")
    (tmp_path / "matplotlibrc").write_text("text.usetex: true\nfont.size: 40\nfigure.facecolor: black\nsavefig.dpi: 7\n")
    notebook = "module://matplotlib_inline.backend_inline"
    assert drawn(tmp_path / "styled.png", MATPLOTLIBRC=str(tmp_path / "matplotlibrc"), MPLBACKEND=notebook) == plain


@picture_file
def cross(path, lines):
    figure = new_figure(1, 1)
    figure.text(0, 0, lines)
    figure.savefig(path)
    if lines == "fails":
        raise RuntimeError("no ink\nat all")


@pytest.mark.parametrize("name", ["x.png", "file/x.png"])
def test_a_picture_that_fails_is_a_warning_of_one_line_and_leaves_neither_a_part_nor_an_old_one(name, tmp_path, capsys):
    (tmp_path / "file").touch()
    (tmp_path / "x.png").write_text("of yesterday")
    assert cross(tmp_path / name, "fails") is None
    (told,) = capsys.readouterr().err.splitlines()
    assert told.startswith(f"warning: no picture {tmp_path / name}: ")
    if name == "x.png":
        assert "no ink at all" in told
        assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert cross(tmp_path / "new" / "x.png", "works") == tmp_path / "new" / "x.png"
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["x.png"]
