# SPDX-License-Identifier: Apache-2.0
"""The documentation: its reference is what the code says, its links lead somewhere, and the front page runs as printed."""

import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import typer

from docs.from_code import pages
from docs.from_code.commands import ENVIRONMENT, _parts
from sixstrut_cli import app, registry

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
BLOCK = re.compile(r"^```\n(.*?)^```$", re.MULTILINE | re.DOTALL)
HERE_ALREADY = "./sixstrut test"
"""The one command of the front page that this test does not run: it is one of its tests."""


def markdown_files() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    return [ROOT / name for name in listed]


def anchors(page: Path) -> set[str]:
    """Of its headings, as a Git host makes them."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    found = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in found)
    return {heading.strip().replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("name", list(pages()))
def test_a_reference_page_is_what_the_code_says(name):
    said = (ROOT / "docs/reference" / name).read_text(encoding="utf-8")
    assert said == pages()[name](ROOT), "run ./sixstrut docs, and commit what it writes"


def test_a_page_that_differs_is_named_and_written_anew(tmp_path, monkeypatch, capsys):
    for part in ("reference", "from_code"):
        shutil.copytree(ROOT / "docs" / part, tmp_path / "docs" / part)
    shutil.copytree(
        ROOT / "ros_ws/src", tmp_path / "ros_ws/src", ignore=shutil.ignore_patterns("__pycache__", "sim_core", "hardware_bridge")
    )
    monkeypatch.setenv("SIXSTRUT_ROOT", str(tmp_path))
    assert app.run(["docs", "--check"]) == 0
    page = tmp_path / "docs/reference/commands.md"
    page.write_text("# Something else\n", encoding="utf-8")
    assert app.run(["docs", "--check"]) == 4
    assert "commands.md is not what the code says: run ./sixstrut docs" in capsys.readouterr().err
    assert app.run(["docs", "--pages-only"]) == 0
    assert app.run(["docs", "--check"]) == 0


def test_every_link_leads_somewhere():
    lost = []
    for page in markdown_files():
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for target in LINK.findall(re.sub(r"`[^`\n]*`", "", text)):
            if re.match(r"[a-z]+:", target):
                continue
            path, _, anchor = target.partition("#")
            there = (page.parent / path).resolve() if path else page
            if not there.exists() or (anchor and there.suffix == ".md" and anchor not in anchors(there)):
                lost.append(f"{page.relative_to(ROOT)}: {target}")
    assert not lost, "\n".join(lost)


NOT_OF_USERS = {"SIXSTRUT_ROOT", "SIXSTRUT_TEST_ALL", "SIXSTRUT_TEST_MINUTES"}
"""What our programs tell each other."""


def test_every_variable_of_the_environment_is_in_the_reference():
    folders = ("sim_core", "hardware_bridge", "ros_ws/src", "tooling")
    listed = subprocess.run(["git", "ls-files", "sixstrut", *folders], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    files = [ROOT / name for name in listed.split() if name == "sixstrut" or name.endswith(".py")]
    used = {word for file in files if file.is_file() for word in re.findall(r"SIXSTRUT_[A-Z_]+", file.read_text(encoding="utf-8"))}
    said = {name for name, _ in ENVIRONMENT if name.startswith("SIXSTRUT_")}
    assert used - NOT_OF_USERS == said


def test_an_example_may_begin_with_variables():
    text = "What it does.\n\nsixstrut demo\nROS_DOMAIN_ID=7 sixstrut console  # there"
    assert _parts(text) == (["What it does."], ["./sixstrut demo", "ROS_DOMAIN_ID=7 ./sixstrut console  # there"])


def printed_commands() -> list[str]:
    """Every command line of ours in a block or between backticks of a page that people wrote, without its comment."""
    lines = []
    for page in (page for page in markdown_files() if page.name != "CHANGELOG.md" and "reference" not in page.parts):
        text = page.read_text(encoding="utf-8")
        blocks = re.findall(r"^ *```\w*\n(.*?)^ *```$", text, re.MULTILINE | re.DOTALL)
        lines += [line.strip() for block in blocks for line in block.splitlines()] + re.findall(r"`(\./sixstrut [^`]+)`", text)
    return sorted({re.sub(r"\s+#.*|…|\)\".*", "", line[line.index("./sixstrut") :]) for line in lines if "./sixstrut " in line})


@pytest.mark.parametrize("line", printed_commands())
def test_a_printed_command_is_understood(line):
    """Its options and arguments are there; it is not run. In a sentence it may be without its arguments."""
    values = {"N": "1", "S": "0.1", "D": "3", "LIBRARY": "robust", "PLAN": "robust"}
    name, *words = (values.get(word, f" {word}" if re.fullmatch(r"-[\d.,-]+", word) else word) for word in shlex.split(line)[1:])
    modules = {entry.name: entry.module for entry in registry.entries()}
    if name not in ("--help", "NAME") and modules[name] is not None and "--help" not in words:
        try:
            typer.main.get_command(app.build([name])).commands[name].make_context(name, words)
        except typer.BadParameter as error:
            if type(error).__name__ != "MissingParameter":
                raise


def test_every_page_is_in_the_index():
    index = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    for page in sorted((ROOT / "docs").rglob("*.md")):
        name = page.relative_to(ROOT / "docs").as_posix()
        assert name == "index.md" or index.count(f"]({name})") == index.count(f"\n{name[:-3]}\n") == 1, name


def test_the_front_page_is_short_and_explains_its_words():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 120
    for word in ("TC1", "TO1", "P1", "gait", "primitive", "doi.org/10.1177/17298806231162442", "not an emergency stop"):
        assert any(word in line for line in lines), word
    assert (ROOT / "docs/images/rolls.webp").stat().st_size < 2_000_000


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path, monkeypatch):
    for package in ("sphinx", "myst_parser", "furo"):
        pytest.importorskip(package)
    monkeypatch.setenv("SIXSTRUT_ROOT", str(ROOT))
    assert app.run(["docs", "-o", str(tmp_path / "site")]) == 0
    for page in (tmp_path / "site").rglob("*.html"):
        loaded = re.findall(
            r"<(?:script|link|img|iframe)\b[^>]*?(?:src|href)=\"(https?:[^\"]+)\"", page.read_text(encoding="utf-8")
        )
        assert not loaded, f"{page.name} loads {loaded} from the network"


@pytest.mark.slow
@pytest.mark.ros
@pytest.mark.timeout(900)
def test_the_front_page_runs_top_to_bottom_as_printed_and_leaves_the_tree_clean(tmp_path):
    """In a clone; commands that ask a person something are not in blocks. `./sixstrut` is this environment's command line."""
    clone = tmp_path / "sixstrut"
    subprocess.run(["git", "clone", "-q", "--no-local", str(ROOT), str(clone)], check=True)
    shutil.copy(ROOT / "README.md", clone / "README.md")
    (tmp_path / "bin").mkdir()
    launcher = tmp_path / "bin/sixstrut"
    launcher.write_text('#!/bin/sh\nexec python -m sixstrut_cli "$@"\n', encoding="utf-8")
    launcher.chmod(0o755)
    commands = [line for block in BLOCK.findall((clone / "README.md").read_text(encoding="utf-8")) for line in block.splitlines()]
    assert commands[0].split("#")[0].strip() == "./sixstrut demo"
    environ = {**os.environ, "SIXSTRUT_ROOT": str(clone), "SIXSTRUT_STATE_DIR": str(tmp_path / "state")}
    for line in commands:
        if line.split("#")[0].strip() == HERE_ALREADY:
            continue
        words = line.replace("./sixstrut", str(launcher), 1)
        done = subprocess.run(words, shell=True, cwd=clone, env=environ, capture_output=True, text=True, timeout=400, check=False)
        missed = "rolls succeeded in" in done.stdout  # on a busy computer a roll of the demo may; another test looks at that
        assert done.returncode == 0 or missed, f"{line}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    changed = subprocess.run(["git", "status", "--porcelain"], cwd=clone, capture_output=True, text=True, check=True).stdout
    changed = "\n".join(line for line in changed.splitlines() if line[3:] != "README.md")
    assert not changed, f"the commands of the front page left in the tree:\n{changed}"
