# SPDX-License-Identifier: Apache-2.0
import re
from pathlib import Path

import pytest

from sixstrut_cli import registry
from tooling.packages import GROUPS
from tooling.requirements import read_lock

ROOT = Path(__file__).resolve().parents[2]
LOCKS = {path.stem: path for path in sorted((ROOT / "requirements").glob("*.lock"))}
PYTHONS = [(3, 11), (3, 12), (3, 13)]


def normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_there_is_a_lock_for_each_group_and_each_command_names_groups_that_there_are():
    assert set(LOCKS) == set(GROUPS)
    for name in registry.names():
        assert set(registry.packages_of(name, [name])) <= set(GROUPS) - {"base"}
    assert registry.packages_of("robustness", ["robustness", "--scheduler", "tcp:x"]) == ("cluster",)
    assert registry.packages_of("search", ["search", "--scheduler=tcp:x"]) == ("cluster",)
    assert registry.packages_of("demo", ["demo", "--console"]) == ("console",)
    assert registry.packages_of(None, []) == ()


@pytest.mark.parametrize("group", GROUPS)
def test_a_lock_names_no_host_and_no_path(group: str):
    text = LOCKS[group].read_text()
    assert "://" not in text
    assert not re.search(r"^\s*-(?!-hash=sha256:)", text, re.MULTILINE), "an option, such as an index, in the lock"


@pytest.mark.parametrize("group", GROUPS)
def test_every_requirement_has_an_exact_version_and_sha256_hashes(group: str):
    requirements = read_lock(LOCKS[group])
    assert requirements
    for requirement in requirements:
        assert re.fullmatch(r"[\w.+!]+", requirement.version)
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", h) for h in requirement.hashes), requirement.name


@pytest.mark.parametrize("python", PYTHONS)
def test_a_package_has_the_same_version_in_every_lock(python: tuple[int, int]):
    locked: dict[str, str] = {}
    for path in LOCKS.values():
        for requirement in read_lock(path):
            if requirement.holds_for(python):
                assert locked.setdefault(normalised(requirement.name), requirement.version) == requirement.version, requirement.name
    assert len(locked) > 100


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("python", PYTHONS)
def test_every_direct_requirement_is_locked_once_for_each_python(python: tuple[int, int], group: str):
    names = [normalised(r.name) for r in read_lock(LOCKS[group]) if r.holds_for(python)]
    assert len(names) == len(set(names))
    lines = LOCKS[group].with_suffix(".in").read_text().splitlines()
    direct = {normalised(re.split(r"[\[<>=]", line)[0]) for line in lines if line and not line.startswith("#")}
    assert direct <= set(names)


def test_a_marker_that_is_not_understood_is_an_error(tmp_path: Path):
    lock = tmp_path / "lock"
    lock.write_text("a==1 ; os_name == 'nt' \\\n    --hash=sha256:00\n")
    (requirement,) = read_lock(lock)
    with pytest.raises(ValueError, match="unknown marker"):
        requirement.holds_for((3, 12))


@pytest.mark.parametrize("line", ["a==1\n", "a>=1 \\\n    --hash=sha256:00\n"])
def test_a_requirement_without_hash_or_exact_version_is_an_error(tmp_path: Path, line: str):
    lock = tmp_path / "lock"
    lock.write_text(line)
    with pytest.raises(ValueError, match="no exact version or no hash"):
        read_lock(lock)
