# SPDX-License-Identifier: Apache-2.0
import shutil
from pathlib import Path

import pytest

from tooling import stamps
from tooling.layout import Layout


@pytest.fixture
def layout(tmp_path: Path) -> Layout:
    """A checkout with one package."""
    (tmp_path / "requirements").mkdir()
    (tmp_path / "requirements" / "base.lock").write_text("numpy==2.0.0 --hash=sha256:00\n")
    package = tmp_path / "ros_ws" / "src" / "robot"
    for folder in ("msg", "launch", "robot"):
        (package / folder).mkdir(parents=True)
    (package / "package.xml").write_text("<package/>")
    (package / "msg" / "State.msg").write_text("uint64 step\n")
    (package / "launch" / "all.launch.py").write_text("one = 1\n")
    (package / "robot" / "node.py").write_text("one = 1\n")
    return Layout(tmp_path)


def package(layout: Layout) -> Path:
    return layout.sources / "robot"


def test_the_same_checkout_has_the_same_stamps(layout: Layout):
    assert stamps.workspace_stamp(layout) == stamps.workspace_stamp(layout)
    assert stamps.packages_stamp(layout, "base") == stamps.packages_stamp(layout, "base")


@pytest.mark.parametrize("name", ["package.xml", "setup.py", "setup.cfg", "CMakeLists.txt", "msg/State.msg", "srv/Arm.srv"])
def test_the_content_of_a_build_input_changes_the_workspace_stamp_only(layout: Layout, name: str):
    before = stamps.packages_stamp(layout, "base"), stamps.workspace_stamp(layout)
    path = package(layout) / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("changed")
    after = stamps.packages_stamp(layout, "base"), stamps.workspace_stamp(layout)
    assert after[0] == before[0]
    assert after[1] != before[1]


def test_a_package_of_ros_is_built_only_where_the_wheels_lack_it(layout: Layout):
    lacking = layout.without_ros / "tf2_msgs"
    lacking.mkdir(parents=True)
    (lacking / "package.xml").write_text("<package/>")
    assert [folder.name for folder in stamps.package_folders(layout)] == ["robot", "tf2_msgs"]
    (layout.venv / "share" / "tf2_msgs").mkdir(parents=True)
    assert [folder.name for folder in stamps.package_folders(layout)] == ["robot"]


def test_a_package_behind_a_link_counts(layout: Layout, tmp_path: Path):
    shutil.move(package(layout), tmp_path / "robot")
    package(layout).symlink_to("../../robot")
    before = stamps.workspace_stamp(layout)
    (tmp_path / "robot" / "msg" / "State.msg").write_text("uint32 step\n")
    assert stamps.workspace_stamp(layout) != before


def test_a_new_launch_file_needs_a_build_but_a_changed_one_does_not(layout: Layout):
    before = stamps.workspace_stamp(layout)
    (package(layout) / "launch" / "all.launch.py").write_text("one = 2\n")
    assert stamps.workspace_stamp(layout) == before
    (package(layout) / "launch" / "more.launch.py").touch()
    assert stamps.workspace_stamp(layout) != before


def test_python_sources_are_used_in_place_and_need_no_build(layout: Layout):
    before = stamps.workspace_stamp(layout)
    (package(layout) / "robot" / "node.py").write_text("one = 2\n")
    (package(layout) / "robot" / "other.py").touch()
    assert stamps.workspace_stamp(layout) == before


def test_another_lock_or_interpreter_or_place_changes_both_stamps(layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    seen = {(stamps.packages_stamp(layout, "base"), stamps.workspace_stamp(layout))}
    layout.lock("base").write_text("numpy==2.0.1 --hash=sha256:00\n")
    seen.add((stamps.packages_stamp(layout, "base"), stamps.workspace_stamp(layout)))
    monkeypatch.setattr(stamps, "python_identity", lambda: "cpython-313 /elsewhere")
    seen.add((stamps.packages_stamp(layout, "base"), stamps.workspace_stamp(layout)))
    moved = Layout(tmp_path / "moved")
    shutil.copytree(layout.root, moved.root, ignore=shutil.ignore_patterns("moved"))
    seen.add((stamps.packages_stamp(moved, "base"), stamps.workspace_stamp(moved)))
    assert len({p for p, _ in seen}) == len({w for _, w in seen}) == 4
