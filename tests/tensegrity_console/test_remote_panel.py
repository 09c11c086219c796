# SPDX-License-Identifier: Apache-2.0
"""A session's panel seen from elsewhere, and keys pressed there: with real ROS and real pipes."""

import json
import os

import pytest

from tensegrity_lab.terminal.keys import ENTER, Keys
from tensegrity_lab.trials.panel import Panel, Shown
from tensegrity_lab.trials.remote_panel import key_text

pytestmark = pytest.mark.ros


@pytest.fixture
def remote(domain, monkeypatch):
    from tensegrity_lab.trials.remote_panel import Remote

    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    remote = Remote()
    yield remote
    remote.close()


@pytest.fixture
def told(remote, operator):
    """What the session publishes, and a publisher of keys."""
    from std_msgs.msg import String

    from tensegrity_lab.stack.processes import wait_until
    from tensegrity_robot.ros.topics import TRIAL_KEY, TRIAL_PANEL

    panels = []
    TRIAL_PANEL.subscribe(operator.node, lambda m: panels.append(json.loads(m.data or "{}")))
    publisher = TRIAL_KEY.publisher(operator.node)
    wait_until(lambda: publisher.get_subscription_count() > 0, 10.0, "the session's node")

    def shown(**changes):
        remote.show(Shown(**changes))
        wait_until(lambda: panels and json.loads(json.dumps(changes)).items() <= panels[-1].items(), 10.0, "the panel")
        return panels[-1]["panel"]

    return panels, shown, lambda text: publisher.publish(String(data=text))


def test_keys_come_from_either_side(remote, told):
    from tensegrity_lab.stack.processes import wait_until

    panels, shown, press = told
    ours, theirs = os.pipe()
    keys = Keys(ours).and_from(remote.keys_from)
    assert keys.poll() is None
    os.write(theirs, b"v")
    assert keys.next() == "v"
    panel = shown(question="Does it stand?", keys=(("y", "yes"),))
    for key in ("rm -rf", "", "x"):
        press(key_text(key, panel))
    press(key_text("y", panel))
    assert keys.next() == "y", "what is no key of a session is none from elsewhere either"
    wait_until(lambda: panels[-1]["panel"] != panel, 10.0, "the next panel")
    press(key_text(ENTER, panels[-1]["panel"]))
    assert keys.next() == ENTER
    os.close(theirs)
    os.close(ours)


def test_a_key_answers_one_panel_once(remote, told, capfd):
    """What a played bag, an older page, or a finger that was too quick says is nothing, and one warning tells of it."""
    _, shown, press = told
    keys = Keys(remote.keys_from)
    old = shown(question="Does it stand on TO5?", keys=(("y", "yes"),))
    assert shown(question="Does it stand on TO5?", keys=(("y", "yes"),), left_s=3.0) == old, "the same question"
    new = shown(question="Does it stand on TO7?", keys=(("y", "yes"),))
    assert new != old
    nameless = ('{"key": "y"}', '{"panel": "", "key": "n"}', '{"panel": 1, "key": "n"}')
    strange = ("y", "", "{", "[" * 150, "null", *nameless, "x" * 10_000)
    for text in (*strange, key_text("n", old), key_text("n", "another session's"), key_text("y", new), key_text("n", new)):
        press(text)
    assert keys.next() == "y"
    last = shown(question="Why?", keys=(("1", "touched"),))
    press(key_text("n", new))
    press(key_text("1", last))
    assert keys.next() == "1"
    assert capfd.readouterr().err.count("answers no panel of this session") == 1


def test_the_panel_is_shown_elsewhere_and_gone_with_the_session(domain, operator, monkeypatch):

    from tensegrity_lab.stack.processes import wait_until
    from tensegrity_lab.trials.remote_panel import Remote
    from tensegrity_robot.ros.topics import TRIAL_PANEL

    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    told = []
    TRIAL_PANEL.subscribe(operator.node, lambda m: told.append(m.data))
    remote = Remote()
    panel = Panel("virtual trials", told=remote.show)
    with panel:
        panel.show(source="TC6", target="TO5", question="Does it stand on TO5?", keys=(("y", "yes: success"),))
    wait_until(lambda: told, 10.0, "the panel")
    assert json.loads(told[-1])["question"] == "Does it stand on TO5?"
    remote.close()
    wait_until(lambda: told[-1] == "", 10.0, "the end of the session")
