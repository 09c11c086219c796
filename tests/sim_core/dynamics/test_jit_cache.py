# SPDX-License-Identifier: Apache-2.0
import shutil
import subprocess
import sys
from pathlib import Path

import sim_core


def folder_of(package_parent):
    code = "import numba, sim_core.dynamics.support; print(numba.config.CACHE_DIR)"
    run = subprocess.run(
        [sys.executable, "-c", code], env={"PYTHONPATH": str(package_parent)}, capture_output=True, text=True, check=True
    )
    return run.stdout.strip()


def test_a_change_in_any_source_gives_compiled_code_a_new_home(tmp_path):
    """A kernel cached in one file must not outlive a change of a function that it calls in another."""
    copy = tmp_path / "sim_core"
    shutil.copytree(Path(sim_core.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    before = folder_of(tmp_path)
    assert folder_of(tmp_path) == before
    (copy / "dynamics" / "simd.py").write_text((copy / "dynamics" / "simd.py").read_text() + "\n# changed\n")
    changed = folder_of(tmp_path)
    assert changed != before
    (copy / "room").mkdir()
    (copy / "room" / "deep.py").write_text("# new\n")
    assert folder_of(tmp_path) not in (before, changed), "sources in a folder count, too"


def test_the_hash_of_all_counts_the_data(tmp_path):
    copy = tmp_path / "sim_core"
    shutil.copytree(Path(sim_core.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    code = "from sim_core.dynamics.jit_cache import sources_hash; print(sources_hash(), sources_hash('**/*.yaml'))"

    def hashes():
        told = subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=True
        )
        return told.stdout.split()

    before = hashes()
    data = next(copy.rglob("*.yaml"))
    data.write_text(data.read_text() + "\n# changed\n")
    after = hashes()
    assert after[0] == before[0], "kernels are compiled from sources alone"
    assert after[1] != before[1]


def test_what_compiles_nothing_does_not_load_numba():
    """The YAML reader is used by the process that owns the port: it must be light."""
    code = "import sys, sim_core.files.yaml_reader; assert 'numba' not in sys.modules and 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
