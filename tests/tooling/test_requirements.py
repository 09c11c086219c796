# SPDX-License-Identifier: Apache-2.0
import re
from pathlib import Path

import pytest

from tooling.requirements import read_lock

ROOT = Path(__file__).resolve().parents[2]
LOCK = ROOT / "requirements.lock"
PYTHONS = [(3, 11), (3, 12), (3, 13)]


def normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_the_lock_names_no_host_and_no_path():
    text = LOCK.read_text()
    assert "://" not in text
    assert not re.search(r"^\s*-(?!-hash=sha256:)", text, re.MULTILINE), "an option, such as an index, in the lock"


def test_every_requirement_has_an_exact_version_and_sha256_hashes():
    requirements = read_lock(LOCK)
    assert len(requirements) > 100
    for requirement in requirements:
        assert re.fullmatch(r"[\w.+!]+", requirement.version)
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", h) for h in requirement.hashes), requirement.name


@pytest.mark.parametrize("python", PYTHONS)
def test_every_direct_requirement_is_locked_once_for_each_python(python: tuple[int, int]):
    names = [normalised(r.name) for r in read_lock(LOCK) if r.holds_for(python)]
    assert len(names) == len(set(names))
    lines = (ROOT / "requirements.in").read_text().splitlines()
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
