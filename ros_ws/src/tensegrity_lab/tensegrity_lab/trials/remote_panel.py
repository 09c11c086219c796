# SPDX-License-Identifier: Apache-2.0
"""A session's panel shown elsewhere, and keys pressed there: for the console in the browser.

What is pressed there counts as pressed at the terminal, so nothing of a session can tell them apart. A key is the answer to what a
panel showed and names it by an id that is used once: keys of a bag that is played, of a page that shows an older panel, or pressed
twice, are none.
"""

import json
import os
import secrets
import threading
from dataclasses import asdict
from typing import Any

from tensegrity_lab.terminal.keys import ENTER
from tensegrity_lab.trials.panel import Shown

_BYTES = {ENTER: b"\r"}
KNOWN = frozenset("yvnuqpm0123456789")
LONGEST = 200
"""Characters of a key's message."""


def key_text(key: str, panel: str) -> str:
    """What is published for a key. `panel`: id of the panel that it answers."""
    return json.dumps({"panel": panel, "key": key})


def key_of(text: str) -> tuple[str, str]:
    """Key and panel's id of what was published; empty texts: it is no such message."""
    try:
        told: Any = json.loads(text if len(text) <= LONGEST else "null")
        key, panel = told["key"], told["panel"]
    except (ValueError, RecursionError, KeyError, TypeError):
        return "", ""
    return (key, panel) if isinstance(key, str) and isinstance(panel, str) else ("", "")


class Remote:
    """A node of its own beside the session: publishes the panel, and writes the keys that it hears into a pipe.

    Attributes:
        keys_from: descriptor to read keys from, as from a terminal.
    """

    def __init__(self) -> None:
        from rclpy.node import Node
        from std_msgs.msg import String

        from tensegrity_lab.stack.ros_thread import Spinner
        from tensegrity_robot.ros.node_process import own_context
        from tensegrity_robot.ros.topics import TRIAL_KEY, TRIAL_PANEL

        self.keys_from, self._keys_to = os.pipe()
        self._string, self._key_topic = String, TRIAL_KEY.name
        self._lock = threading.Lock()
        self._shown: Shown | None = None
        self._id = ""
        self._warned = False
        self._context = own_context()
        self._node = Node("sixstrut_trial", context=self._context)
        self._panel = TRIAL_PANEL.publisher(self._node)
        TRIAL_KEY.subscribe(self._node, self._on_key)
        self._spinner = Spinner(self._node, self._context)

    def _on_key(self, message: Any) -> None:
        key, panel = key_of(str(message.data))
        with self._lock:
            meant = panel != "" and panel == self._id and (key in _BYTES or key in KNOWN)
            if meant:
                os.write(self._keys_to, _BYTES.get(key, key.encode()))
                self._id = secrets.token_urlsafe(9)  # one answer a question: what was pressed twice was pressed once
                self._publish()
        if not meant and not self._warned:
            self._warned = True
            self._node.get_logger().warning(
                f"a key on {self._key_topic} answers no panel of this session: ignored, as all such are; is a bag played beside it?"
            )

    def show(self, shown: Shown | None) -> None:
        """Publish what is on the panel; None: the session is over."""
        with self._lock:
            before, self._shown = self._shown, shown
            asked = lambda one: (one.question, one.keys) if one is not None else None  # noqa: E731
            if asked(before) != asked(shown):
                self._id = secrets.token_urlsafe(9) if shown is not None else ""
            self._publish()

    def _publish(self) -> None:
        shown = "" if self._shown is None else json.dumps(asdict(self._shown) | {"panel": self._id})
        self._panel.publish(self._string(data=shown))

    def close(self) -> None:
        """Say that the session is over, and leave ROS."""
        from rclpy.duration import Duration

        self.show(None)
        self._panel.wait_for_all_acked(Duration(seconds=1.0))
        self._spinner.close()
        self._context.try_shutdown()
        os.close(self._keys_to)
        os.close(self.keys_from)
