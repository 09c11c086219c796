# SPDX-License-Identifier: Apache-2.0
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOT_A_PYTHON = "#!/bin/sh\necho 'version not installed' >&2\nexit 127\n"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """The launcher, with a bootstrap that only tells what it was given."""
    root = tmp_path / "checkout"
    (root / "tooling").mkdir(parents=True)
    shutil.copy(ROOT / "sixstrut", root)
    (root / "tooling" / "bootstrap.py").write_text("import sys\nprint(sys.argv[1:])\nsys.exit(5)\n")
    return root


def script(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return path


def launch(checkout: Path, *arguments: str, **environ: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [checkout / "sixstrut", *arguments], env={**os.environ, **environ}, capture_output=True, text=True, timeout=30
    )


def test_arguments_and_exit_code_pass_through_unchanged(checkout: Path):
    result = launch(checkout, "roll", "--to", "TO 5", "", SIXSTRUT_PYTHON=sys.executable)
    assert result.stdout == "['roll', '--to', 'TO 5', '']\n"
    assert result.returncode == 5


def test_it_can_be_called_through_a_link_from_anywhere(checkout: Path, tmp_path: Path):
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "sixstrut").symlink_to(checkout / "sixstrut")
    assert launch(tmp_path / "bin", SIXSTRUT_PYTHON=sys.executable).returncode == 5


def test_names_on_the_path_that_do_not_run_are_passed_over(checkout: Path, tmp_path: Path):
    base = Path(os.path.realpath(sys.executable))
    shims = tmp_path / "shims"
    for version in ("3.11", "3.12", "3.13"):
        script(shims / f"python{version}", NOT_A_PYTHON)
    (shims / "python3").symlink_to(base)
    result = launch(checkout, PATH=f"{shims}:/usr/bin:/bin", HOME=str(tmp_path), PYENV_ROOT=str(tmp_path), SIXSTRUT_PYTHON="")
    assert result.returncode == 5, result.stderr


def test_the_interpreter_of_the_last_set_up_is_taken_without_a_search(checkout: Path):
    (checkout / ".sixstrut").mkdir()
    script(checkout / "chosen", '#!/bin/sh\necho chosen "$@"\n')
    (checkout / ".sixstrut" / "python").write_text(f"{checkout}/chosen\n")
    assert launch(checkout, "env", SIXSTRUT_PYTHON="").stdout.startswith("chosen -E -s -S")


def test_an_interpreter_that_is_gone_is_searched_anew(checkout: Path):
    (checkout / ".sixstrut").mkdir()
    (checkout / ".sixstrut" / "python").write_text("/nowhere/python3.12\n")
    path = f"{Path(os.path.realpath(sys.executable)).parent}:{os.environ['PATH']}"
    assert launch(checkout, PATH=path, SIXSTRUT_PYTHON="").returncode == 5


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ("is 3.9", "is 3.9"),
        ("lacks python3.12-venv python3.12-dev", "sudo apt install python3.12-venv python3.12-dev"),
    ],
)
def test_a_python_that_will_not_do_is_told_in_one_line_with_the_remedy(checkout: Path, answer: str, told: str):
    fake = script(checkout / "python", f"#!/bin/sh\necho '{answer}'\n")
    result = launch(checkout, "setup", SIXSTRUT_PYTHON=str(fake))
    assert result.returncode == 3
    assert result.stderr.count("\n") == 1
    assert told in result.stderr


def test_a_python_that_does_not_run_is_told(checkout: Path):
    fake = script(checkout / "python", NOT_A_PYTHON)
    result = launch(checkout, SIXSTRUT_PYTHON=str(fake))
    assert result.returncode == 3
    assert f"SIXSTRUT_PYTHON={fake} does not run" in result.stderr
