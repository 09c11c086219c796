# SPDX-License-Identifier: Apache-2.0
"""The console in a real browser, before a real stack: load, arm, roll, stop, lose the server, come back. It takes the pictures."""

import json
import os
import re
import signal
from pathlib import Path

import pytest

from tensegrity_interfaces.msg import BridgeState
from tensegrity_lab.errors import StackError
from tensegrity_lab.stack.processes import wait_until
from tensegrity_robot.ros import qos
from tests.tensegrity_console.conftest import TOKEN, until

pytestmark = [pytest.mark.slow, pytest.mark.ros, pytest.mark.timeout(500)]
SIZE = {"width": 1280, "height": 800}
LIMIT_MS = 90_000
PICTURES = os.environ.get("SIXSTRUT_PICTURES", "")
"""A folder: pictures for the documents are written there."""


class Stage:
    """A stack on a virtual prototype, the console before it, and a page.

    Attributes:
        elsewhere: requests of the page that left this machine.
    """

    def __init__(self, processes, operator, chromium):
        self.processes, self.operator = processes, operator
        self.console = self._console("0")
        self.url, self.port = re.search(r"console: (http://127\.0\.0\.1:(\d+)/\S+)", self.console.output).groups()
        self.elsewhere = []
        self.page = chromium.new_page(viewport=SIZE)
        self.page.set_default_timeout(LIMIT_MS)
        self.page.on("request", self._look)
        self.page.goto(self.url)

    def _look(self, request):
        if not request.url.startswith((f"http://127.0.0.1:{self.port}/", "data:", "blob:", "about:")):
            self.elsewhere.append(request.url)

    def _console(self, port):
        console = self.processes.command("console", "--port", port, "--token-file", str(self._token_file()))
        console.says("console: http://127.0.0.1:", limit_s=60.0)
        return console

    def _token_file(self):
        file = Path(self.processes.folder) / "token"
        file.touch(mode=0o600)
        file.write_text(TOKEN)
        return file

    def restart(self):
        """The server of the page, on the same port."""
        self.console = self._console(self.port)

    def shows(self, selector, words):
        """Wait until an element's text holds the words."""
        holds = f"document.querySelector({json.dumps(selector)}).textContent.includes({json.dumps(words)})"
        try:
            until(self.page, holds, words, LIMIT_MS / 1000)
        except StackError as error:
            self.picture("failed.png")
            seen = self.page.inner_text("body")
            raise AssertionError(f"{selector} did not show {words!r}: {seen}\n{self.console.output}") from error

    def picture(self, name):
        if PICTURES:
            self.page.wait_for_timeout(1500)  # the picture's sake only: software rendering lags behind
            Path(PICTURES).mkdir(parents=True, exist_ok=True)
            self.page.screenshot(path=str(Path(PICTURES) / name))

    def arm(self):
        self.page.check("#clear")
        self.page.click("#arm")
        self.shows("#state", "ARMED")


@pytest.fixture(scope="module")
def stage(module_processes, chromium, domain):
    from tests.stack_operator import Operator

    prototype = module_processes.node("virtual_prototype", "--time-scale", "4", "--perturbation", "0", "--actuators", "ideal")
    module_processes.node("twin")
    module_processes.node("gait_planner", settle_timeout_s=200.0)  # of robot time, while other tests may load this machine
    module_processes.node("traveller")
    module_processes.node("hardware_bridge")
    prototype.says("ready")
    operator = Operator(domain=domain)
    operator.wait_for_stack()
    stage = Stage(module_processes, operator, chromium)
    yield stage
    stage.page.close()
    operator.close()


def test_it_shows_what_the_stack_tells(stage):
    stage.shows("#state", "DISARMED")
    stage.shows("#face", "TC6")
    stage.shows("#faceSource", "prototype")
    stage.shows("#link", "open")
    stage.shows("#neighbours", " of ")
    assert sorted(stage.page.eval_on_selector_all("#neighbours button", "all => all.map(one => one.dataset.face)")) == [
        "TO5", "TO7", "TO9",
    ]  # fmt: skip
    assert stage.page.is_visible("#virtual")
    assert stage.page.is_disabled("#roll")


def test_stop_is_in_sight_whatever_is_on_the_page(stage):
    box = stage.page.locator("#stop").bounding_box()
    assert box["y"] == 0
    assert box["x"] + box["width"] == SIZE["width"]
    stage.page.evaluate("document.querySelector('aside').scrollTo(0, 10000)")
    assert stage.page.locator("#stop").bounding_box() == box
    whole = "document.documentElement.scrollWidth <= innerWidth && document.documentElement.scrollHeight <= innerHeight"
    assert stage.page.evaluate(whole)


def test_arming_needs_a_word_first(stage):
    assert stage.page.is_disabled("#arm")
    stage.arm()
    wait_until(lambda: stage.operator.bridge.lease_holder == "console", 10.0, "the console's lease")
    assert not stage.page.is_checked("#clear"), "the next time it is asked anew"


def test_a_face_is_selected_foretold_and_rolled_to(stage):
    stage.page.click("#neighbours button[data-face=TO7]")
    stage.shows("#foretold", "twins rolled; they ended on TO7")
    stage.picture("console.png")
    stage.page.click("#roll")
    stage.page.wait_for_selector("#progress:visible")
    stage.shows("#face", "TO7")
    stage.shows("#phase", "the last roll ended well")
    stage.shows("#rollFrom", "from TO7")


def test_a_click_on_the_floor_in_3d_selects_a_place_and_travels_there(stage):
    until(stage.page, "document.querySelector('#scene').contentDocument.querySelector('canvas') !== null", "the 3D view")
    box = stage.page.locator("#scene").bounding_box()

    def clicked():
        stage.page.mouse.click(box["x"] + 0.25 * box["width"], box["y"] + 0.75 * box["height"])
        stage.page.wait_for_timeout(500)
        return "selected" in stage.page.inner_text("#place")

    wait_until(clicked, 60.0, "a place, from a click in the 3D view")
    stage.page.click("#travel")
    stage.shows("#journey", "rolling to")
    stage.picture("console_travel.png")


def test_space_stops_even_from_within_the_3d_view_and_says_when(stage):
    stage.operator.sees(BridgeState.ARMED)
    stage.page.click("#scene")
    stage.page.keyboard.press("Space")
    stage.shows("#told", "stopped: in force")
    stage.operator.sees(BridgeState.FAULT)
    assert stage.operator.bridge.reason == "stop pressed"
    stage.shows("#state", "FAULT")
    stage.shows("#troubles", "travel failed")
    stage.picture("console_stopped.png")
    stage.page.click("#reset")
    stage.shows("#state", "DISARMED")


def test_space_that_is_held_stops_once_and_presses_no_button(stage):
    """The focus is on Reset, which would leave the fault that the stop has just latched."""
    stage.operator.trigger("stop")
    stage.shows("#state", "FAULT")
    stage.page.focus("#reset")
    for _ in range(5):
        stage.page.keyboard.down("Space")
    stage.page.keyboard.up("Space")
    stage.shows("#told", "stopped: in force")
    assert stage.operator.bridge.state == BridgeState.FAULT
    stage.operator.trigger("reset")
    stage.shows("#state", "DISARMED")


def test_what_nobody_should_send_does_not_end_the_stop_button(stage):
    from std_msgs.msg import String

    publisher = stage.operator.node.create_publisher(String, "trial/panel", qos.LATCHED)
    wait_until(lambda: publisher.get_subscription_count() > 0, 10.0, "the console")
    publisher.publish(String(data="{"))
    wait_until(lambda: "JSONDecodeError" in stage.console.output, 10.0, "the console's word of what it heard")
    publisher.publish(String(data=""))
    stage.page.click("#stop")
    stage.shows("#told", "stopped: in force")
    stage.page.click("#reset")
    stage.shows("#state", "DISARMED")
    stage.operator.in_executor(lambda: stage.operator.node.destroy_publisher(publisher))


def test_a_server_that_hangs_is_lost_too(stage):
    stage.console.signal(signal.SIGSTOP)
    stage.page.wait_for_selector("#lost:visible")
    stage.console.signal(signal.SIGCONT)
    stage.page.wait_for_selector("#lost", state="hidden")
    stage.shows("#state", "DISARMED")


def test_it_says_that_the_server_is_lost_and_comes_back_with_it(stage):
    stage.console.kill()
    stage.page.wait_for_selector("#lost:visible")
    assert "No connection: use the power switch" in stage.page.inner_text("#lost")
    stage.restart()
    stage.page.wait_for_selector("#lost", state="hidden")
    stage.shows("#state", "DISARMED")
    stage.arm()


def test_no_request_left_this_machine(stage):
    assert stage.elsewhere == []


def test_ctrl_c_ends_it_with_0(stage):
    stage.console.signal(signal.SIGINT)
    assert stage.console.ends() == 0
    stage.page.wait_for_selector("#lost:visible")
