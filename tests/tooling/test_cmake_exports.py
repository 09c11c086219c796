# SPDX-License-Identifier: Apache-2.0
import os
from pathlib import Path

import pytest

from tooling import cmake_exports

BEFORE = """\
set_target_properties(std_msgs::std_msgs__rosidl_generator_py PROPERTIES
  INTERFACE_INCLUDE_DIRECTORIES "${_IMPORT_PREFIX}/include/std_msgs;\
/opt/python/cp312-cp312/include/python3.12;\
/opt/python/cp312-cp312/lib/python3.12/site-packages/numpy/_core/include;/opt/python/other"
)
"""
AFTER = BEFORE.replace("/opt/python/cp312-cp312/include/python3.12", "/usr/include/python3.11").replace(
    "/opt/python/cp312-cp312/lib/python3.12/site-packages/numpy/_core/include", "/v/numpy/include"
)


@pytest.fixture
def export(tmp_path: Path) -> Path:
    path = tmp_path / "share" / "std_msgs" / "cmake" / "export.cmake"
    path.parent.mkdir(parents=True)
    path.write_text(BEFORE)
    return path


def repair(venv: Path) -> int:
    return cmake_exports.repair(venv, "/usr/include/python3.11", "/v/numpy/include")


def test_only_the_builders_two_paths_are_replaced(tmp_path: Path, export: Path):
    assert repair(tmp_path) == 1
    assert export.read_text() == AFTER


def test_a_second_repair_changes_nothing(tmp_path: Path, export: Path):
    repair(tmp_path)
    assert repair(tmp_path) == 0


def test_files_without_these_paths_are_left_untouched(tmp_path: Path, export: Path):
    other = export.with_name("other.cmake")
    other.write_text("set(x 1)\n")
    before = other.stat()
    repair(tmp_path)
    assert os.path.samestat(other.stat(), before)


def test_a_file_linked_from_an_installers_cache_stays_as_it_is_there(tmp_path: Path, export: Path):
    cached = tmp_path / "cached"
    os.link(export, cached)
    repair(tmp_path)
    assert cached.read_text() == BEFORE


def test_a_repair_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path, export: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="no space left"):
        repair(tmp_path)
    assert [path.name for path in export.parent.iterdir()] == ["export.cmake"]
    assert export.read_text() == BEFORE
