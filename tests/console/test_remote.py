"""A session's panel seen from elsewhere, and keys pressed there: with real ROS and real pipes."""

import json
import os

import pytest

from sixstrut_cli.keys import ENTER, Keys
from sixstrut_cli.trials.panel import Lines

pytestmark = pytest.mark.ros


@pytest.fixture
def remote(domain, monkeypatch):
    from sixstrut_cli.trials.remote import Remote

    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    remote = Remote()
    yield remote
    remote.close()


def test_keys_come_from_either_side(remote, operator):
    from std_msgs.msg import String

    from sixstrut_cli.faults.processes import wait_until
    from sixstrut_cli.trials.remote import KEY_TOPIC

    ours, theirs = os.pipe()
    keys = Keys(ours).and_from(remote.keys_from)
    publisher = operator.node.create_publisher(String, KEY_TOPIC, 10)
    wait_until(lambda: publisher.get_subscription_count() > 0, 10.0, "the session's node")
    assert keys.poll() is None
    os.write(theirs, b"v")
    assert keys.next() == "v"
    for key in ("rm -rf", "y", ENTER, "", "x"):
        publisher.publish(String(data=key))
    assert [keys.next(), keys.next()] == ["y", ENTER], "what is no key of a session is none from elsewhere either"
    os.close(theirs)
    os.close(ours)


def test_the_panel_is_shown_elsewhere_and_gone_with_the_session(domain, operator, monkeypatch):
    from std_msgs.msg import String

    from sixstrut_cli.faults.client import LATCHED
    from sixstrut_cli.faults.processes import wait_until
    from sixstrut_cli.trials.remote import PANEL_TOPIC, Mirrored, Remote

    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    told = []
    operator.node.create_subscription(String, PANEL_TOPIC, lambda m: told.append(m.data), LATCHED)
    remote = Remote()
    panel = Mirrored(Lines("virtual trials"), remote)
    with panel:
        panel.show(source="TC6", target="TO5", question="Does it stand on TO5?", keys="y yes: success")
    wait_until(lambda: told, 10.0, "the panel")
    assert json.loads(told[-1])["question"] == "Does it stand on TO5?"
    remote.close()
    wait_until(lambda: told[-1] == "", 10.0, "the end of the session")
