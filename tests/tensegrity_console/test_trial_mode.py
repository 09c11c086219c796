# SPDX-License-Identifier: Apache-2.0
"""A session of trials judged in the browser: the page's big keys are the session's own."""

import re

import pytest

from tensegrity_lab.session_data.ledger import Ledger
from tests.isolated_stack import IsolatedStack
from tests.tensegrity_lab.terminal import Terminal
from tests.tensegrity_lab.trials.test_trial import PLAN

pytestmark = [pytest.mark.ros, pytest.mark.timeout(500)]
LIMIT_MS = 20_000
VIRTUAL = ("--virtual", "--time-scale", "3")
"""Slowly: the browser draws in software, and a prototype whose orders come late makes a trial void."""


@pytest.mark.slow
def test_a_person_judges_in_the_browser(tmp_path, compiled, chromium):
    words = ("trial", str(tmp_path / "s"), "--experimenter", "Ada", "--judge", "hand", *PLAN, *VIRTUAL)
    person = Terminal(*words, folder=tmp_path)
    processes = None
    try:
        person.says("./sixstrut console", limit_s=150)
        own = int(re.search(r"ROS_DOMAIN_ID=(\d+) ./sixstrut console", person.text)[1])
        processes = IsolatedStack(tmp_path, own)
        person.says("Lift the robot, keep hands clear", limit_s=150)
        console = processes.command("console", "--port", "0")
        console.says("console: http://127.0.0.1:", limit_s=60.0)
        page = chromium.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(LIMIT_MS)
        page.goto(re.search(r"http://127\.0\.0\.1:\d+/\S+", console.output)[0])

        def offers(key):
            person.reads_until(lambda: page.is_visible(f"#trialKeys button[data-key='{key}']"), limit_s=150)

        offers("enter")
        page.click("#trialKeys button[data-key=enter]")
        offers("y")
        assert "Does it stand on" in page.inner_text("#trialQuestion")
        tallest = page.locator("#trialKeys button[data-key=y]").bounding_box()["height"]
        assert tallest >= 50, "big enough for a finger"
        page.keyboard.press("y")  # as at the terminal
        person.reads_until(lambda: not page.is_visible("#trialKeys button[data-key=y]"))
        offers("n")
        assert "1 of 2 done, 100 % succeeded" in page.inner_text("#trialDone")
        page.click("#trialKeys button[data-key=n]")
        offers("0")
        page.click("#trialKeys button[data-key='0']")
        assert person.ends() == 0
        page.wait_for_selector("#trialCard", state="hidden")
        page.close()
    finally:
        person.close()
        if processes is not None:
            processes.kill()
    outcomes = [(line.experimenter, line.outcome) for line in Ledger(tmp_path / "s").standing().trials.values()]
    assert outcomes == [("Ada", "success"), ("Ada", "failure")]
