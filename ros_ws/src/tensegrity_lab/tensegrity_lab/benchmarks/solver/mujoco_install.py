# SPDX-License-Identifier: Apache-2.0
"""MuJoCo, for this command only: installed on its first run into a folder of its own, exactly as requirements-bench.lock says."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from sim_core.errors import SimError


class BenchError(SimError):
    """The benchmark cannot run; says what to do."""


def make_importable(root: Path, say: Callable[[str], None]) -> Path:
    """Install what requirements-bench.lock names, unless it is there, and put it last on the import path; the folder.

    Raises:
        BenchError: pip failed; with its last lines.
    """
    lock = root / "requirements-bench.lock"
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    stamp = hashlib.sha256(lock.read_bytes()).hexdigest()[:16]
    folder = root / ".sixstrut" / f"bench-{version}-{stamp}"
    if not folder.exists():
        say("installing MuJoCo for the comparison, once; it does not go into .venv")
        _install(lock, folder)
    if str(folder) not in sys.path:
        sys.path.append(str(folder))  # last: numpy and all else stay those of .venv
    return folder


def _install(lock: Path, folder: Path) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    unfinished = folder.with_name(f"{folder.name}.{os.getpid()}")
    command = [sys.executable, "-m", "pip", "install", "--require-hashes", "--no-deps", "--only-binary=:all:", "--no-input"]
    command += ["--disable-pip-version-check", "--quiet", "--target", str(unfinished), "-r", str(lock)]
    environ = {name: value for name, value in os.environ.items() if name not in ("PIP_TARGET", "PIP_PREFIX")} | {"PIP_USER": "0"}
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=environ, stdin=subprocess.DEVNULL, check=False)
        if done.returncode != 0:
            last = "\n".join(done.stderr.strip().splitlines()[-3:])
            raise BenchError(
                f"MuJoCo could not be installed:\n{last}\n"
                "If the network failed, run this again; pip's own settings (proxy, index) are respected."
            )
        unfinished.rename(folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
