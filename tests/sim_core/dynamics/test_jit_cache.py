# SPDX-License-Identifier: Apache-2.0
import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sim_core.dynamics.jit_cache import KERNEL_SOURCES, PACKAGE, CheckedFiles


@pytest.fixture
def copy(tmp_path):
    """The package's sources somewhere else."""
    return shutil.copytree(PACKAGE, tmp_path / "sim_core", ignore=shutil.ignore_patterns("__pycache__"))


def told(copy, code):
    environ = {"PYTHONPATH": str(copy.parent), "PATH": os.environ["PATH"]}
    return subprocess.run([sys.executable, "-c", code], env=environ, capture_output=True, text=True, check=True).stdout


def change(path):
    path.write_text(path.read_text(encoding="utf-8") + "\n# changed\n", encoding="utf-8")


FOLDERS = """
from sim_core.dynamics.jit_cache import KERNEL_SOURCES, PACKAGE, use_own_folder

def change(path):
    path.write_text(path.read_text(encoding="utf-8") + "\\n# changed\\n", encoding="utf-8")

print(use_own_folder())
for path in PACKAGE.rglob("*.py"):
    if path.relative_to(PACKAGE).as_posix() not in KERNEL_SOURCES:
        change(path)
(PACKAGE / "structure" / "new.py").write_text("# new")
print(use_own_folder())
for name in KERNEL_SOURCES:
    change(PACKAGE / name)
    print(use_own_folder())
"""


def test_a_change_of_what_a_kernel_sees_gives_compiled_code_a_new_home_and_no_other_change_does(copy):
    """A kernel cached in one file must not outlive a change of a function that it calls in another."""
    first, others, *each = told(copy, FOLDERS).split()
    assert Path(first).parent == copy / "__pycache__"
    assert others == first
    assert len({first, *each}) == 1 + len(KERNEL_SOURCES)


class Module:
    """A source of sim_core: what it defines, and what it imports from others as which name."""

    def __init__(self, path):
        self.path, self.tree = path, ast.parse(path.read_text(encoding="utf-8"))
        self.defined, self.imported = {}, {}
        for node in self.tree.body:
            match node:
                case ast.FunctionDef() | ast.ClassDef():
                    self.defined[node.name] = node
                case ast.Assign():
                    for name in (n.id for target in node.targets for n in ast.walk(target) if isinstance(n, ast.Name)):
                        self.defined[name] = node.value
                case ast.AnnAssign(target=ast.Name(id=name)):
                    self.defined[name] = node.value
                case ast.ImportFrom(module=str(module)) if module.startswith("sim_core."):
                    folder = PACKAGE.joinpath(*module.split(".")[1:])
                    for alias in node.names:
                        inside = folder / f"{alias.name}.py"
                        self.imported[alias.asname or alias.name] = (
                            (inside, "") if inside.exists() else (folder.with_suffix(".py"), alias.name)
                        )

    def compiled(self):
        """Its compiled functions: decorated with njit, or with what njit made with options."""
        functions = (node for node in self.tree.body if isinstance(node, ast.FunctionDef))
        return [
            node
            for node in functions
            if any("njit" in ast.unparse(d) or "_compiled" in ast.unparse(d) for d in node.decorator_list)
        ]


def without_annotations(node):
    for part in ast.walk(node):
        for field in ("annotation", "returns"):
            if hasattr(part, field):
                setattr(part, field, None)
    return node


def seen(module, node, modules, visited):
    """Follow every name that a definition uses, into the files where these are defined."""
    parts = list(ast.walk(without_annotations(node)))
    names = {(part.id, "") for part in parts if isinstance(part, ast.Name)}
    names |= {(part.value.id, part.attr) for part in parts if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name)}
    for name, attribute in names:
        path, target = module.imported.get(name, (module.path, name))
        target = target or attribute
        definition = modules[path].defined.get(target)
        if definition is not None and (path, target) not in visited:
            visited.add((path, target))
            seen(modules[path], definition, modules, visited)


def test_whatever_a_compiled_function_sees_of_other_files_is_listed():
    modules = {path: Module(path) for path in PACKAGE.rglob("*.py")}
    compiled = {path: module.compiled() for path, module in modules.items()}
    names = {path.relative_to(PACKAGE).as_posix() for path, functions in compiled.items() if functions}
    assert names <= {*KERNEL_SOURCES}, "numba itself looks at a file that no other uses"
    visited = set()
    for path, functions in compiled.items():
        for function in functions:
            seen(modules[path], function, modules, visited)
    assert (
        {path.relative_to(PACKAGE).as_posix() for path, _ in visited}
        <= {*KERNEL_SOURCES}
        <= {*names, "dynamics/jit_cache.py", "dynamics/actuators.py", "structure/topology.py"}  # the monitor compiles actuators'
    )


def test_the_hash_of_all_sources_counts_the_data(copy):
    """Workers of a cluster must have the same."""
    code = "from sim_core.studies.dask_runner import sources_hash; print(sources_hash())"
    hashes = [told(copy, code)]
    for path in (next(copy.rglob("*.yaml")), copy / "studies" / "local_runner.py"):
        change(path)
        hashes.append(told(copy, code))
    assert len(set(hashes)) == 3


def test_what_compiles_nothing_does_not_load_numba():
    """The YAML reader is used by the process that owns the port: it must be light."""
    code = "import sys, sim_core.files.yaml_reader; assert 'numba' not in sys.modules and 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


SUM = """
import numpy
from sim_core.dynamics.jit_cache import njit

@njit(cache=True)
def total(values):
    return values.sum()

print(total(numpy.arange(4.0)), sum(total.stats.cache_hits.values()))
"""


def damaged(data):
    """A file's bytes, as a power cut, a full disk or a bad disk leave them."""
    yield from (b"", data[: len(data) // 2], bytes(len(data)), data[:-1])
    middle = len(data) // 2
    yield data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


def test_a_damaged_file_of_compiled_code_counts_as_not_there(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(CheckedFiles, "told", False)
    files = CheckedFiles(str(tmp_path), "total", "stamp")
    files.save("key", {"code": bytes(range(256))})
    for path in sorted(tmp_path.iterdir()):
        for broken in damaged(path.read_bytes()):
            assert files.load("key") == {"code": bytes(range(256))}
            path.write_bytes(broken)
            assert files.load("key") is None
            files.save("key", {"code": bytes(range(256))})
        path.unlink()
        path.mkdir()
        files.save("key", 1)
        assert files.load("key") is None
        path.rmdir()
        files.save("key", {"code": bytes(range(256))})
    assert capsys.readouterr().err.splitlines() == [f"{min(tmp_path.iterdir())} is damaged: compiling it again"]


@pytest.mark.slow
def test_damaged_compiled_code_is_compiled_again(tmp_path):
    script = tmp_path / "total.py"
    script.write_text(SUM, encoding="utf-8")

    def run():
        environ = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        return subprocess.run([sys.executable, script], env=environ, capture_output=True, text=True, check=True)

    assert (run().stdout.split(), run().stdout.split()) == (["6.0", "0"], ["6.0", "1"])
    files = list((tmp_path / "cache").rglob("*.nb?"))
    assert len(files) > 1
    for path in files:
        path.write_bytes(bytes(path.stat().st_size))
    told = run()
    assert told.stdout.split() == ["6.0", "0"]
    assert told.stderr.endswith("is damaged: compiling it again\n")
    assert told.stderr.count("\n") == 1
    assert run().stdout.split() == ["6.0", "1"]
