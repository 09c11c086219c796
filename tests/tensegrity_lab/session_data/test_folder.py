# SPDX-License-Identifier: Apache-2.0
"""Which session is meant when none is named."""

import os
import time

import pytest

from hardware_bridge.errors import BagError
from tensegrity_lab.bags.rehearsed_rolls import newest
from tensegrity_lab.errors import SessionError
from tensegrity_lab.session_data.folder import newest_session, open_session, require_free


@pytest.fixture
def bags(tmp_path, monkeypatch):
    monkeypatch.setenv("SIXSTRUT_BAGS", str(tmp_path))
    return tmp_path


def begun(bags, name, at_s, bag=False):
    folder = bags / name
    (folder / "bags").mkdir(parents=True)
    (folder / "session.yaml").touch()
    if bag:
        (folder / "bags" / "session_1.mcap").touch()
    for path in (folder / "session.yaml", folder):
        os.utime(path, (at_s, at_s))
    return folder


def test_the_session_that_was_begun_last_is_the_newest(bags):
    begun(bags, "monday", 2000)
    tuesday = begun(bags, "tuesday", 3000)
    begun(bags, "campaign", 1000)
    (bags / "a_bag.mcap").touch()
    assert newest_session() == tuesday


def test_of_bags_the_newest_or_the_newest_session_that_has_one(bags):
    monday = begun(bags, "monday", 2000, bag=True)
    begun(bags, "tuesday", 3000)
    assert newest() == monday
    demo = bags / "session_demo.mcap"  # of an older bridge
    demo.touch()
    assert newest() == demo
    folder = bags / "session_2"
    folder.mkdir()
    (folder / "metadata.yaml").touch()
    os.utime(folder, (time.time() + 60.0,) * 2)
    assert newest() == folder


def test_what_is_no_session_says_so_in_one_line(bags):
    bag, empty = bags / "session_2", bags / "empty"
    for made in (bag, empty):
        made.mkdir()
    (bag / "metadata.yaml").touch()
    valid = "valid is a folder that `sixstrut trial` made, with session.yaml in it"
    for path, why in (
        (bag, "it is a bag: `report`, `odds`, `fit`, `replay` and `play` take it"),
        (bags / "old.mcap", "it is a bag: `report`, `odds`, `fit`, `replay` and `play` take it"),
        (empty, "session.yaml: No such file or directory"),
    ):
        with pytest.raises(SessionError) as caught:
            open_session(path)
        assert str(caught.value) == f"{path} is not a session of trials ({why}); {valid}"


def test_without_any_it_is_said_how_to_make_one(bags):
    with pytest.raises(SessionError, match="make one with: sixstrut trial --virtual"):
        newest_session()
    with pytest.raises(BagError, match="make one with: sixstrut demo"):
        newest()


def test_a_folder_that_does_not_exist_is_free_and_a_file_is_not(tmp_path):
    require_free(tmp_path / "new")
    (tmp_path / "file").touch()
    with pytest.raises(SessionError, match="is a file"):
        require_free(tmp_path / "file")
