"""The console's process: ROS in one thread, the page and its sockets in the main one, the 3D view in viser's own."""

from __future__ import annotations

import asyncio
import math
import signal
import threading
import time
import traceback
from collections.abc import Callable
from typing import Any

import tornado.ioloop

from sim_core.structure import FACES
from sixstrut_cli.console.facts import Facts, Selection, document_of
from sixstrut_cli.console.ground import Ground
from sixstrut_cli.console.ros_side import RosSide
from sixstrut_cli.console.scene import Scene
from sixstrut_cli.console.server import Server
from sixstrut_cli.keys import ENTER
from sixstrut_cli.trials.remote import KNOWN

PAGE_S = 0.1
SCENE_S = 0.05
FARTHEST_M = 20.0
"""Of a travel's goal."""


class Orders:
    """What a page may ask for, checked; everything else is refused with a word.

    Attributes:
        selection: what was clicked on last.
    """

    def __init__(self, ros: Any):
        self.selection = Selection()
        self._ros = ros

    def select(self, selection: Selection) -> None:
        """A click in the 3D view, or on a face's button. It moves nothing."""
        self.selection = selection
        if selection.target:
            self._ros.rehearse(selection.target, lambda done, words: None)

    def carry_out(self, order: dict[str, Any], answer: Callable[[dict[str, Any]], None]) -> None:
        """One order of a page."""
        what, key = order.get("do"), str(order.get("key"))
        if not isinstance(what, str):
            what = repr(what)

        def told(done: bool, words: str) -> None:
            if words:
                answer({"answer": {"do": what, "done": done, "words": words}})

        plain = {"stop": self._ros.stop, "disarm": self._ros.disarm, "reset": self._ros.reset}
        if what in plain:
            plain[what](told)
        elif what == "arm" and order.get("lifted_and_clear") is True:
            self._ros.arm(told)
        elif what == "arm":
            told(False, "somebody must say first that the robot is lifted and hands are clear")
        elif what == "cancel":
            self._ros.cancel(told)
        elif what in ("select", "roll", "face"):
            self._with_face(what, order, told)
        elif what == "travel":
            place = _place(order.get("place_m"))
            if place is None:
                told(False, f"a place is two numbers in m, at most {FARTHEST_M:g} m away: {order.get('place_m')!r}")
            else:
                self._ros.travel(place, told)
        elif what == "key" and (key in KNOWN or key == ENTER):
            self._ros.press(key)
        else:
            told(False, f"unknown order {what!r}")

    def _with_face(self, what: str, order: dict[str, Any], told: Callable[[bool, str], None]) -> None:
        face = order.get("face" if what == "face" else "target")
        if not isinstance(face, str) or face not in FACES:
            told(False, f"unknown face {face!r}: valid are TC1..TC8 and TO1..TO12")
        elif what == "select":
            self.select(Selection(face))
        elif what == "roll":
            self._ros.roll(face, bool(order.get("anyway")), told)
        else:
            self._ros.set_face(face, told)


def _place(value: Any) -> tuple[float, float] | None:
    try:
        x, y = (float(part) for part in value)
    except (TypeError, ValueError):
        return None
    return (x, y) if math.hypot(x, y) <= FARTHEST_M else None


def serve(host: str, port: int, token: str, ready: Callable[[str], None]) -> None:
    """Run the console until SIGINT or SIGTERM.

    Args:
        ready: told the address to open.

    Raises:
        ConsoleError: the port is taken. SimError: the nominal robot cannot be settled.
    """
    ended = threading.Event()
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    ros = RosSide()
    orders = Orders(ros)
    scene = Scene(Ground(), orders.select, ros.facts)
    drawing = threading.Thread(target=_draw, args=(scene, ros.facts, orders, ended), name="drawing", daemon=True)
    asyncio.set_event_loop(asyncio.new_event_loop())
    loop = tornado.ioloop.IOLoop.current()
    try:
        server = Server(host, port, token, scene.port, orders.carry_out)
        for number in before:
            signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
        tornado.ioloop.PeriodicCallback(
            lambda: server.tell(document_of(ros.facts, orders.selection, time.monotonic())), 1000 * PAGE_S
        ).start()
        drawing.start()
        ready(server.url)
        loop.start()
        server.close()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        ended.set()
        if drawing.is_alive():
            drawing.join(2.0)
        scene.close()
        ros.close()


def _draw(scene: Scene, facts: Facts, orders: Orders, ended: threading.Event) -> None:
    """Draws at its own pace; a selection of a face that is no neighbour any more is dropped."""
    stood = facts.face
    while not ended.wait(SCENE_S):
        if facts.face and facts.face != stood:
            stood, orders.selection = facts.face, Selection("", orders.selection.place_m)
        try:
            scene.update(facts, orders.selection)
        except Exception:  # a picture that fails once must not be the last one
            traceback.print_exc()
            ended.wait(1.0)
