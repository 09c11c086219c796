# SPDX-License-Identifier: Apache-2.0
"""The virtual environment: Python packages and the ROS 2 wheels, exactly those of requirements/*.lock.

Packages come in groups. `base` is what every command needs; the others are added when a command first needs them.
"""

import ast
import contextlib
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from tooling import cmake_exports, slimming, stamps
from tooling.layout import Layout, SetupError
from tooling.process import Runner
from tooling.progress import Progress
from tooling.requirements import Requirement, read_lock

GROUPS = ("base", "console", "cluster", "checks", "docs", "bench")
STEPS = 3  # that making the base takes; a further group is one step
BUILT_FROM_SOURCE = ("empy",)  # pure Python, published without a wheel
BUILD_TOOLS = ("cmake",)  # not in .venv: there while ros_ws is built
INSTALLER = "uv"  # not in .venv: there while the base is installed, faster than by pip

_AS_UV_SAYS_IT = {"index-url": "--default-index", "extra-index-url": "--index", "find-links": "--find-links"}
_OF_THE_NETWORK = {"proxy", "trusted-host", "client-cert", "no-index", "use-deprecated", "use-feature", "config-file"}
"""Settings of pip with which only pip knows how to reach its packages."""


def _stamp_file(layout: Layout) -> Path:
    return layout.venv / "sixstrut.stamp"


def made_by_us(layout: Layout) -> bool:
    """The stamp file exists from the first moment on: empty while the environment is incomplete."""
    return _stamp_file(layout).exists()


def missing(layout: Layout, groups: Iterable[str]) -> list[str]:
    """Those of the groups that are not installed as their locks say now, in the order of `GROUPS`; all, if the base is not."""
    there = _installed(layout)
    lacking = [g for g in GROUPS if g in {"base", *groups} and there.get(g) != stamps.packages_stamp(layout, g)]
    return [g for g in GROUPS if g in {"base", *groups, *there}] if "base" in lacking else lacking


def _installed(layout: Layout) -> dict[str, str]:
    """Group -> its stamp when it was installed."""
    if not os.access(layout.venv_python, os.X_OK):
        return {}
    try:
        lines = _stamp_file(layout).read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return {}
    return {group: stamp for group, _, stamp in (line.partition(" ") for line in lines) if group in GROUPS and stamp}


def needed(layout: Layout, groups: Iterable[str]) -> list[Requirement]:
    """The groups' requirements that hold for the running interpreter, each once."""
    found = [r for group in groups for r in read_lock(layout.lock(group)) if r.holds_for(sys.version_info[:2])]
    return list({r.name: r for r in found if r.name not in (*BUILD_TOOLS, INSTALLER)}.values())


@contextlib.contextmanager
def build_tools(layout: Layout, runner: Runner, environ: Mapping[str, str]) -> Iterator[Path]:
    """The folder of CMake's programs, which is gone afterwards."""
    folder = layout.state / "build_tools"
    requirements = [r for r in read_lock(layout.lock("base")) if r.name in BUILD_TOOLS]
    shutil.rmtree(folder, ignore_errors=True)
    try:
        _pip(layout, requirements, runner, _clean(environ), "--target", str(folder))
        yield folder / "cmake" / "data" / "bin"
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def _installer(layout: Layout, runner: Runner, environ: Mapping[str, str]) -> Iterator[Mapping[str, str]]:
    """The environment with uv in its path, gone afterwards; without, if uv cannot be had or knows not what pip is told."""
    folder = layout.state / INSTALLER
    shutil.rmtree(folder, ignore_errors=True)
    try:
        if shutil.which(INSTALLER, path=environ.get("PATH")) is None and _as_uv(_settings(layout, environ)) is not None:
            with contextlib.suppress(SetupError):
                requirements = [r for r in read_lock(layout.lock("base")) if r.name == INSTALLER]
                _pip(layout, requirements, runner, environ, "--target", str(folder))
                environ = {**environ, "PATH": f"{folder / 'bin'}{os.pathsep}{environ['PATH']}"}
        yield environ
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _settings(layout: Layout, environ: Mapping[str, str]) -> str:
    """Pip's own, from its files and variables: lines such as `global.index-url='https://…'`."""
    command = [str(layout.venv_python), "-m", "pip", "--disable-pip-version-check", "config", "list"]
    return subprocess.run(command, env=environ, capture_output=True, text=True, check=False).stdout


def _as_uv(settings: str) -> tuple[list[str], dict[str, str]] | None:
    """Where packages come from, by pip's settings, as options and variables of uv; None: it does not know some of them."""
    options: list[str] = []
    variables: dict[str, str] = {}
    for line in settings.splitlines():
        key, _, value = line.partition("=")
        name = key.rpartition(".")[2]
        if name in _OF_THE_NETWORK:
            return None
        if name in _AS_UV_SAYS_IT:
            options += [word for place in ast.literal_eval(value).split() for word in (_AS_UV_SAYS_IT[name], place)]
        if name == "cert":
            variables["SSL_CERT_FILE"] = ast.literal_eval(value)
    return options, variables


def install(layout: Layout, groups: Sequence[str], runner: Runner, environ: Mapping[str, str]) -> None:
    """Installs groups.

    With the base among them the environment is made from nothing: what an interrupted or older set-up left is removed first. Else
    only what no group has brought yet is added.
    """
    environ = _clean(environ)
    progress = runner.progress
    there = {} if "base" in groups else _installed(layout)
    if "base" in groups:
        with progress.step(f"making .venv with Python {sys.version.split()[0]}"):
            _make(layout, runner, environ)
    brought = {r.name: r.version for r in needed(layout, there)}
    requirements = [r for r in needed(layout, groups) if brought.get(r.name) != r.version]
    with progress.step(f"installing {len(requirements)} packages{_purpose(groups)}"):
        with _installer(layout, runner, environ) if "base" in groups else contextlib.nullcontext(environ) as inside:
            _pip(layout, requirements, runner, inside)
        progress.result(f"{len(requirements)} packages")
    if "base" in groups:
        with progress.step("repairing the CMake files of the ROS wheels"):
            numpy_include = _ask(layout, "import numpy; print(numpy.get_include())")
            count = cmake_exports.repair(layout.venv, sysconfig.get_path("include"), numpy_include)
            slimming.slim(layout.venv)
            progress.result(f"{count} files")
    now = there | {group: stamps.packages_stamp(layout, group) for group in groups}
    stamp = _stamp_file(layout)
    stamp.with_suffix(".new").write_text("".join(f"{group} {of}\n" for group, of in now.items()), encoding="utf-8")
    stamp.with_suffix(".new").replace(stamp)


def _purpose(groups: Sequence[str]) -> str:
    more = [group for group in groups if group != "base"]
    return f" for {', '.join(more)}" if more else ""


def remove(layout: Layout) -> None:
    """Removes .venv. The stamp goes last, so that a removal cut short is still known as ours."""
    if not layout.venv.exists():
        return
    for path in layout.venv.iterdir():
        if path == _stamp_file(layout):
            path.write_text("", encoding="utf-8")
        elif path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
    shutil.rmtree(layout.venv)


def _make(layout: Layout, runner: Runner, environ: Mapping[str, str]) -> None:
    if layout.venv.exists() and not made_by_us(layout):
        raise SetupError(f"{layout.venv} exists and was not made by ./sixstrut: move it away and run this again")
    remove(layout)
    layout.venv.mkdir()
    _stamp_file(layout).touch()
    command = [sys.executable, "-m", "venv", str(layout.venv)]
    runner.run("making the virtual environment", command, cwd=layout.root, environ=environ)


def _pip(layout: Layout, requirements: list[Requirement], runner: Runner, environ: Mapping[str, str], *more: str) -> None:
    """Two runs: first setuptools, which builds the one package that has no wheel.

    So pip fetches no build tools of its own choice, and nothing is ever run that was not checked against the lock.

    The lock is complete, so pip is told to resolve nothing: older pips stumble over a dependency with extras as soon as
    a release newer than the locked one appears.
    """
    python = str(layout.venv_python)
    exactly = ["--require-hashes", "--no-deps", "--no-build-isolation", *more, "-r"]
    pip = [python, "-m", "pip", "install", "--only-binary=:all:", f"--no-binary={','.join(BUILT_FROM_SOURCE)}", "--no-compile"]
    pip += ["--no-input", "--disable-pip-version-check", "--progress-bar=off", *exactly]
    uv = shutil.which(INSTALLER, path=environ.get("PATH"))
    told = _as_uv(_settings(layout, environ)) if uv else None
    site_packages = Path(sysconfig.get_path("purelib", vars={"base": str(layout.venv)}))
    counter = _Counter(len(requirements), site_packages, runner.progress)
    with tempfile.TemporaryDirectory() as folder:
        for part in [r for r in requirements if r.name == "setuptools"], requirements:
            file = Path(folder) / f"{len(part)}.txt"
            file.write_text("".join(f"{r.text}\n" for r in part), encoding="utf-8")

            def run(command: list[str], variables: Mapping[str, str], file: Path = file) -> None:
                counter.restart()
                now, inside = [*command, str(file)], {**environ, **variables}
                runner.run("installing packages", now, cwd=layout.root, environ=inside, on_line=counter.line, on_tick=counter.tick)

            if not part:
                continue
            if uv and told is not None:
                with contextlib.suppress(SetupError):  # then pip does it
                    # From any index, as pip does it; what comes from a stranger's is not what the lock says.
                    run(
                        [uv, "pip", "install", "--python", python, "--index-strategy", "unsafe-best-match", *told[0], *exactly],
                        told[1],
                    )
                    continue
            try:
                run(pip, {})
            except SetupError as error:
                hint = "If the network failed, run this again; pip's own settings (proxy, index) are respected."
                raise SetupError(f"{error}\n{hint}") from None


class _Counter:
    """Turns pip's lines and what appears on disk into '84 of 163 packages'."""

    def __init__(self, total: int, site_packages: Path, progress: Progress) -> None:
        self._total, self._site_packages, self._progress = total, site_packages, progress
        self.restart()

    def restart(self) -> None:
        self._fetched = 0
        self._installing = False

    def line(self, line: str) -> None:
        if line.startswith(("Collecting ", "Requirement already satisfied")):
            self._fetched += 1
            self._progress.update(f"fetched {self._fetched} of {self._total} packages")
        elif line.startswith("Installing collected packages"):
            self._installing = True

    def tick(self) -> None:
        if self._installing:
            count = sum(1 for _ in self._site_packages.glob("*.dist-info"))
            self._progress.update(f"installed {min(count, self._total)} of {self._total} packages")
        else:
            self._progress.tick()


def _ask(layout: Layout, code: str) -> str:
    answer = subprocess.run([layout.venv_python, "-c", code], capture_output=True, text=True, check=True)
    return answer.stdout.strip()


def _clean(environ: Mapping[str, str]) -> dict[str, str]:
    """Without what would make pip or Python look elsewhere."""
    unwanted = (
        "PYTHONHOME",
        "PYTHONPATH",
        "PIP_USER",
        "PIP_TARGET",
        "PIP_PREFIX",
        "PIP_REQUIRE_VIRTUALENV",
        "LD_LIBRARY_PATH",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
    )
    return {name: value for name, value in environ.items() if name not in unwanted} | {"PIP_USER": "0"}
