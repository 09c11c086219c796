# SPDX-License-Identifier: Apache-2.0
"""Takes out of the virtual environment what its packages bring and nobody uses: copies, their own tests, symbols for debuggers."""

import hashlib
import os
import shutil
import subprocess
from collections import defaultdict
from pathlib import Path

LEAST_BYTES = 100_000  # smaller files are not worth the look
DEBUGGABLE = ("llvmlite", "zstandard", "kiwisolver", "fontTools")  # published with symbols: more than half of some files


def slim(venv: Path) -> None:
    """Shrinks the environment; doing it again does nothing."""
    (site_packages,) = venv.glob("lib/python3*/site-packages")
    for tests in list(site_packages.rglob("tests")):
        if any(tests.glob("test_*.py")):
            shutil.rmtree(tests)
    if strip := shutil.which("strip"):
        for library in [file for name in DEBUGGABLE for file in site_packages.glob(f"{name}/**/*.so")]:
            new = library.with_suffix(".new")
            if subprocess.run([strip, "--strip-unneeded", "-o", new, library], check=False, capture_output=True).returncode == 0:
                new.replace(library)
    _link_copies(venv)


def _link_copies(venv: Path) -> None:
    """One file for all that are the same: the ROS wheels bring some libraries eight times."""
    of_size: dict[int, list[Path]] = defaultdict(list)
    for folder, _, names in os.walk(venv):
        for file in (Path(folder, name) for name in names):
            if not file.is_symlink() and file.stat().st_size >= LEAST_BYTES:
                of_size[file.stat().st_size].append(file)
    first: dict[str, Path] = {}
    for file in (file for files in of_size.values() if len(files) > 1 for file in files):
        same = first.setdefault(hashlib.sha256(file.read_bytes()).hexdigest(), file)
        if not file.samefile(same):
            file.unlink()
            file.hardlink_to(same)
