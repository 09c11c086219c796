# SPDX-License-Identifier: Apache-2.0
"""The stack's fixtures, and a real browser."""

import os
import re
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tensegrity_lab.stack.processes import Process, wait_until
from tests.tensegrity_robot.conftest import compiled, domain, module_processes, operator, processes

__all__ = ["compiled", "domain", "module_processes", "operator", "processes", "until"]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = [
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
]  # fmt: skip


@pytest.fixture(autouse=True)
def own_environment() -> Iterator[None]:
    """A session's node chooses how ROS discovers, for its process: not for the tests that come after."""
    before = dict(os.environ)
    yield
    os.environ.clear()
    os.environ.update(before)


TOKEN = "a-token-of-the-tests"
STANDING = Path(__file__).parent / "standing.py"


class Standing:
    """A console before a robot that only stands there.

    Attributes:
        process: the server. port: its. url: of the page.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self.port = 0
        self.start()

    def start(self) -> None:
        """Also again, at the same port."""
        log = self._folder / f"standing-{time.monotonic_ns()}.log"
        self.process = Process("standing", [sys.executable, str(STANDING), str(self.port), TOKEN], log)
        self.process.says("console: http://127.0.0.1:", limit_s=60.0)
        found = re.search(r"console: (http://127\.0\.0\.1:(\d+)/\S*)", self.process.output)
        assert found is not None
        self.url, self.port = found[1], int(found[2])

    def asked(self) -> list[str]:
        """What would have been asked of a stack."""
        return re.findall(r"ASKED (.*)", self.process.output)


def until(page: Any, expression: str, what: str, limit_s: float = 60.0) -> None:
    """Wait until something is so in a page. (Its rules forbid what Playwright's own waiting does: to make code of texts.)"""

    def so() -> bool:
        page.wait_for_timeout(30)
        return bool(page.evaluate(expression))

    wait_until(so, limit_s, what)


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory, compiled: None) -> Iterator[Standing]:
    """For a module's tests."""
    standing = Standing(tmp_path_factory.mktemp("standing"))
    yield standing
    standing.process.kill()


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A headless Chromium, driven by Playwright."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip("no Chromium is installed: sudo apt install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=str(Path(found)), args=FLAGS)
        yield browser
        browser.close()
