# SPDX-License-Identifier: Apache-2.0
"""The console's process: ROS in one thread, the page and its sockets in the main one, the 3D view in viser's own."""

import asyncio
import math
import signal
import threading
import time
import traceback
from collections.abc import Callable
from typing import Any

import numpy as np
import tornado.ioloop

from sim_core.printable import NAME_MOST, printable
from sim_core.structure.topology import FACES
from tensegrity_console.web.floor_clicks import FARTHEST_M, Ground
from tensegrity_console.web.ros_client import Answer, RosSide
from tensegrity_console.web.scene import Scene
from tensegrity_console.web.state import Facts, Page, Selection, document_of
from tensegrity_console.web.view_messages import Click
from tensegrity_console.web.web_server import Server
from tensegrity_lab.terminal.keys import ENTER
from tensegrity_lab.trials.remote_panel import KNOWN

PAGE_S = 0.1
SCENE_S = 0.05


class Orders:
    """What a page may ask for, checked; everything else is refused with a word. `pages`: those that are open, by number."""

    def __init__(self, ros: Any):
        self.pages: dict[str, Page] = {}
        self._ros = ros

    def arrived(self) -> Page:
        """A page was opened."""
        page = Page()
        self.pages[page.number] = page
        return page

    def left(self, page: Page) -> None:
        """It was closed."""
        self.pages.pop(page.number, None)

    def select(self, page: Page, selection: Selection) -> None:
        """A click in a page's 3D view, or on a face's button. It moves nothing, and no other page minds."""
        page.selection = selection
        if selection.target:
            self._ros.rehearse(selection.target, lambda done, words: None)

    def carry_out(self, page: Page, order: dict[str, Any], answer: Callable[[dict[str, Any]], None]) -> None:
        """One order of a page."""
        what = order.get("do")
        if not isinstance(what, str):
            what = repr(what)

        def told(done: bool, words: str) -> None:
            if words:
                answer({"answer": {"do": printable(what, NAME_MOST), "done": done, "words": printable(words)}})

        if what in ("stop", "disarm", "reset", "cancel"):
            getattr(self._ros, what)(told)
        elif what == "arm" and order.get("lifted_and_clear") is True:
            self._ros.arm(told)
        elif what == "arm":
            told(False, "somebody must say first that the robot is lifted and hands are clear")
        elif what in ("select", "roll", "face"):
            self._with_face(page, what, order, told)
        elif what == "travel":
            self._travel(page, order.get("place_m"), told)
        elif what == "key":
            self._press(order, told)
        else:
            told(False, f"unknown order {what!r}")

    def _with_face(self, page: Page, what: str, order: dict[str, Any], told: Answer) -> None:
        face = order.get("face" if what == "face" else "target")
        if not isinstance(face, str) or face not in FACES:
            told(False, f"unknown face {face!r}: valid are TC1..TC8 and TO1..TO12")
        elif what == "select":
            self.select(page, Selection(face, stood=self._ros.facts.face))
        elif what == "face":
            self._ros.set_face(face, told)
        elif face != page.selected(self._ros.facts).target:
            told(False, f"{face} is not what this page has selected now: select it, look how likely it is, then roll")
        else:
            self._ros.roll(face, bool(order.get("anyway")), told)

    def _travel(self, page: Page, asked: Any, told: Answer) -> None:
        place = _place(asked)
        if place is None:
            told(False, f"a place is two numbers in m, at most {FARTHEST_M:g} m away: {asked!r}")
        elif place != page.selection.place_m:
            told(False, "this is not the place that this page has selected now: click on the floor, then travel")
        else:
            self._ros.travel(place, told)

    def _press(self, order: dict[str, Any], told: Answer) -> None:
        key, panel = str(order.get("key")), order.get("panel")
        trial = self._ros.facts.trial
        if key not in KNOWN and key != ENTER:
            told(False, "unknown order 'key'")
        elif trial is None or not panel or panel != trial.get("panel"):
            told(False, "this key answers what the session showed before: look again")
        else:
            self._ros.press(key, panel)


def _place(value: Any) -> tuple[float, float] | None:
    try:
        x, y = (float(part) for part in value)
    except (TypeError, ValueError, OverflowError):
        return None
    return (x, y) if math.hypot(x, y) <= FARTHEST_M else None


def serve(host: str, port: int, token: str, ready: Callable[[str], None]) -> None:
    """Run the console until SIGINT or SIGTERM. Raises ConsoleError: the port is taken.

    Args:
        host: address to listen at.
        port: 0: any free one.
        token: secret that the page's address carries.
        ready: told the address to open.
    """
    ended = threading.Event()
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    ros = RosSide()
    orders = Orders(ros)
    ground = Ground()
    scene = Scene(ground)
    drawing = threading.Thread(target=_draw, args=(scene, ros.facts, orders, ended), name="drawing", daemon=True)

    def clicked(page: Page, click: Click) -> None:
        orders.select(page, ground.clicked(ros.facts, np.array(click.ray_origin), np.array(click.ray_direction)))

    asyncio.set_event_loop(asyncio.new_event_loop())
    loop = tornado.ioloop.IOLoop.current()
    try:
        server = Server(host, port, token, scene.path, orders, clicked)
        for number in before:
            signal.signal(number, lambda *_: loop.add_callback_from_signal(loop.stop))
        tornado.ioloop.PeriodicCallback(
            lambda: server.tell(lambda page: document_of(ros.facts, page.selected(ros.facts), time.monotonic())), 1000 * PAGE_S
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
    """Draws at its own pace, for every page what it selected."""
    while not ended.wait(SCENE_S):
        try:
            scene.update(facts, {number: page.selected(facts) for number, page in list(orders.pages.items())})
        except Exception:  # a picture that fails once must not be the last one
            traceback.print_exc()
            ended.wait(1.0)
