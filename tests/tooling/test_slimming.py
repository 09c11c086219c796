# SPDX-License-Identifier: Apache-2.0
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tooling.slimming import LEAST_BYTES, slim


@pytest.fixture
def site_packages(tmp_path: Path) -> Path:
    folder = tmp_path / "lib" / "python3.12" / "site-packages"
    folder.mkdir(parents=True)
    return folder


def test_equal_libraries_become_one_file_and_others_stay_as_they_are(site_packages: Path, tmp_path: Path):
    same = [site_packages / f"{name}.so" for name in "abc"]
    other, small = site_packages / "other.so", [site_packages / f"{name}.py" for name in "ab"]
    for path in same:
        path.write_bytes(b"x" * LEAST_BYTES)
    other.write_bytes(b"y" * LEAST_BYTES)
    for path in small:
        path.write_text("z")
    slim(tmp_path)
    slim(tmp_path)
    assert all(path.samefile(same[0]) for path in same)
    assert other.read_bytes() == b"y" * LEAST_BYTES
    assert not small[0].samefile(small[1])


def test_the_tests_of_packages_go_and_modules_of_that_name_stay(site_packages: Path, tmp_path: Path):
    for name in ("solver/tests/test_solver.py", "templates/tests/__init__.py", "solver/__init__.py"):
        (site_packages / name).parent.mkdir(parents=True, exist_ok=True)
        (site_packages / name).touch()
    slim(tmp_path)
    assert not (site_packages / "solver" / "tests").exists()
    assert (site_packages / "templates" / "tests").exists()
    assert (site_packages / "solver" / "__init__.py").exists()


@pytest.mark.skipif(not shutil.which("strip") or not shutil.which("cc"), reason="no compiler")
def test_a_library_without_its_symbols_is_smaller_and_still_one(site_packages: Path, tmp_path: Path):
    library = site_packages / "zstandard" / "code.so"
    library.parent.mkdir()
    source = tmp_path / "code.c"
    source.write_text("int twice(int x) { return 2 * x; }\n")
    subprocess.run(["cc", "-g3", "-shared", "-fPIC", "-o", library, source], check=True)
    before = library.stat()
    slim(tmp_path)
    assert library.stat().st_size < before.st_size
    assert library.stat().st_mode == before.st_mode
    code = f"import ctypes; print(ctypes.CDLL({str(library)!r}).twice(21))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "42\n"
