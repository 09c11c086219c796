# SPDX-License-Identifier: Apache-2.0
"""What the page says of the robot is true now, and in the page's own words."""

import json
import os
from pathlib import Path

import pytest

pytestmark = [pytest.mark.ros, pytest.mark.timeout(300)]
PICTURES = os.environ.get("SIXSTRUT_PICTURES", "")
ARM = 'ros2 service call /arm tensegrity_interfaces/srv/Arm "{lifted_and_clear: true}"'
RESET = "ros2 service call /robot_1/reset std_srvs/srv/Trigger"
SET_FACE = 'ros2 service call /set_face tensegrity_interfaces/srv/SetFace "{face: TC6}"'


@pytest.fixture(scope="module")
def page(standing, chromium):
    page = chromium.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(60_000)
    page.goto(standing.url)
    page.wait_for_selector("#lost", state="hidden")
    page.evaluate("socket.onmessage = null")  # from here on the test tells the page
    yield page
    page.close()


def told(page, **changes):
    page.evaluate(f"show({{...facts, ...{json.dumps(changes)}}})")
    return page.inner_text("#doing")


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (f"the robot is not armed: {ARM}", "the robot is not armed: press Arm"),
        (
            f"the bridge is in FAULT (stop pressed): remove the cause, then {RESET}, then {ARM}",
            "the bridge is in FAULT (stop pressed): remove the cause, then press Reset, then press Arm",
        ),
        (f"put it on one, and say so ({SET_FACE})", "put it on one, and say so (choose it below Face)"),
        ("homing has begun; wait for ARMED in bridge/state", "homing has begun; wait for ARMED"),
    ],
)
def test_there_is_a_button_for_what_others_type(page, words, shown):
    assert page.evaluate(f"inWordsOfThePage({json.dumps(words)})") == shown


def test_one_line_tells_what_the_robot_does_now(page):
    assert told(page, state="DISARMED") == "not armed: nothing moves"
    assert told(page, state="HOMING") == "homing: every strut goes to mid stroke"
    assert told(page, state="ARMED", holder="console") == "armed for console"
    assert told(page, roll={"phase": "actuating", "progress": 0.5, "face": "TC6"}) == "roll: actuating"
    assert told(page, roll=None, state="FAULT", reason="stop pressed") == "stop pressed; Reset leaves this"
    assert told(page, alive=False) == "no bridge is heard"


def test_in_mid_travel_nobody_says_that_there_is_no_roll(page):
    travel = {"phase": "rolling", "rolls": 1, "rolls_left": 2, "left_m": 0.3, "odds": 0.9}
    told(page, alive=True, state="ARMED", face="", travel=travel)
    assert "no roll" not in page.inner_text("#foretold")
    told(page, travel=None)
    assert "no face that is known" in page.inner_text("#foretold")


def test_a_good_answer_goes_when_the_state_moves_on_and_a_refusal_stays(page):
    told(page, state="HOMING", face="TC6")
    page.evaluate("tell('homing has begun', 'good'); toldAt = 0")
    told(page, state="HOMING")
    assert page.inner_text("#told") == "homing has begun"
    told(page, state="ARMED")
    assert page.inner_text("#told") == ""
    page.evaluate("tell('refused: it is on no face', 'bad'); toldAt = 0")
    told(page, state="HOLD")
    assert page.inner_text("#told") == "refused: it is on no face"


def test_what_is_over_is_not_told_any_more_though_the_state_is_as_before(page):
    told(page, state="ARMED", roll=None, last="")
    page.evaluate("tell('roll begins', 'good'); toldAt = 0")
    told(page, state="ARMED", roll=None, last="roll failed: too unlikely")
    assert page.inner_text("#told") == ""
    assert page.inner_text("#troubles") == "the last roll failed: too unlikely"
    told(page, last="roll ended well")
    assert page.inner_text("#phase") == "the last roll ended well"


def test_what_nobody_knows_is_not_told_as_a_number(page):
    travel = {"phase": "looking where the robot is", "rolls": 0, "rolls_left": 0, "left_m": None, "odds": None}
    told(page, alive=True, state="ARMED", travel=travel)
    assert page.inner_text("#journey") == "roll 1: looking where the robot is"
    told(page, travel=travel | {"left_m": 0.304, "rolls_left": 3, "odds": 0.95})
    assert page.inner_text("#journey") == "roll 1: looking where the robot is, 30 cm left, 3 rolls planned, probability 95 %"


def test_nothing_is_said_to_be_rehearsed_that_is_not(page):
    told(page, travel=None, face="TC6", rehearsal=None, trial=None, unrehearsed="nobody offers rehearse")
    assert page.inner_text("#foretold") == "nobody offers rehearse"
    told(page, trial={"keys": [], "done": 0, "total": 2, "phase": "", "last": ""})
    assert "nothing is rehearsed for this page" in page.inner_text("#foretold")


def test_what_a_silent_bridge_said_before_is_not_told_as_if_it_were_so_now(page):
    said = {"duty_left_s": 60.0, "battery_v": 7.4, "bag": "a.mcap", "source": "prototype", "face": "TC6"}
    told(page, alive=True, diagnostics=[["duty", 1, "nearly spent"]], **said)
    assert page.inner_text("#duty") == "60 s"
    assert "nearly spent" in page.inner_text("#troubles")
    told(page, alive=False)
    assert [page.inner_text(f"#{part}") for part in ("link", "duty", "battery", "log")] == ["–"] * 4
    assert page.inner_text("#faceSource").startswith("seen by prototype before the bridge fell silent")
    assert "nearly spent" not in page.inner_text("#troubles")


def test_an_inertial_sensor_says_how_sure_it_is_or_why_it_is_not(page):
    said = {"source": "imu", "face": "TC6", "observed": "TC6", "predicted": "TC6"}
    told(page, alive=True, **said, detail="99.9 %")
    assert page.inner_text("#faceSource") == "imu 99.9 %"
    told(page, **said | {"face": ""}, detail="99.5 %")
    assert page.inner_text("#faceSource").startswith("imu 99.5 %, rolling onto TC6")
    told(page, **said | {"face": "", "observed": ""}, detail="no measurement came for 0.5 s, while the struts moved")
    assert page.inner_text("#faceSource").startswith("imu does not know")
    assert "the face is not known: no measurement came for 0.5 s" in page.inner_text("#troubles")


def test_a_stop_is_told_as_long_as_it_is_in_force(page):
    told(page, alive=True, state="ARMED")
    page.evaluate("tell('stopped: in force 4 ms after the call', 'good'); toldAt = 0")
    told(page, state="FAULT")
    assert page.inner_text("#told") == "stopped: in force 4 ms after the call"
    told(page, state="DISARMED")
    assert page.inner_text("#told") == ""


@pytest.mark.parametrize("width", [1280, 900, 600, 420])
def test_the_line_is_in_sight_at_every_width(page, width):
    page.set_viewport_size({"width": width, "height": 800})
    page.evaluate("tell('homing has begun; wait for ARMED in bridge/state', 'good')")
    told(page, state="HOMING")
    box = page.locator("#doing").bounding_box()
    stop = page.locator("#stop").bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= stop["x"] + 1
    assert box["y"] + box["height"] <= page.locator("header").bounding_box()["height"] + 1
    if PICTURES:
        page.wait_for_timeout(1500)
        page.screenshot(path=str(Path(PICTURES) / f"words_{width}.png"))
