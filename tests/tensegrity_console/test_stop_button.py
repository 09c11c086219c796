# SPDX-License-Identifier: Apache-2.0
"""STOP in a real browser: on top, whole and working at every size of the window and in every state of the page."""

import signal

import pytest

from tensegrity_lab.stack.processes import wait_until
from tests.tensegrity_console.conftest import until

pytestmark = pytest.mark.slow
LIMIT_MS = 60_000
SIZES = [(1280, 800), (833, 700), (832, 700), (640, 400), (600, 800), (400, 700), (320, 600), (320, 200), (1280, 200)]
"""640 × 400 is what is left of 1280 × 800 at a zoom of 200 %."""
ON_TOP = """() => {
    const box = document.getElementById("stop").getBoundingClientRect();
    const whole = box.left >= 0 && box.top >= 0 && box.right <= innerWidth && box.bottom <= innerHeight;
    const corners = [[0.5, 0.5], [0.02, 0.02], [0.98, 0.02], [0.02, 0.98], [0.98, 0.98]];
    const at = ([x, y]) => document.elementFromPoint(box.left + x * box.width, box.top + y * box.height);
    return whole && box.width >= 100 && box.height >= 44 && corners.every((corner) => at(corner)?.closest("#stop"));
}"""


@pytest.fixture
def opened(standing, chromium):
    """Opens pages, and closes them."""
    pages = []

    def blank(page):
        page.route("**/scene?*", lambda route: route.abort())

    def open_one(prepare=blank, size=(1280, 800), scale=1):
        page = chromium.new_page(viewport={"width": size[0], "height": size[1]}, device_scale_factor=scale)
        pages.append(page)
        page.set_default_timeout(LIMIT_MS)
        prepare(page)
        page.goto(standing.url)
        return page

    yield open_one
    for page in pages:
        page.close()


def live(page):
    page.wait_for_selector("#lost", state="hidden")
    return page


def press(page):
    """As a person does: with the mouse, at the button's centre, whatever may lie there."""
    box = page.locator("#stop").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def stops(standing, page, what):
    before = standing.asked().count("stop")
    assert page.evaluate(ON_TOP), what
    press(page)

    def asked():
        page.evaluate("0")  # what a routed socket sends goes through this program, and only while it waits for the page
        return standing.asked().count("stop") > before

    wait_until(asked, 20.0, f"the stop, {what}")


def test_it_is_whole_on_top_and_works_at_every_size(standing, opened):
    page = live(opened(lambda page: None))
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        stops(standing, page, f"at {width} × {height}")
        page.evaluate("scrollTo(0, 100000); document.querySelector('aside').scrollTo(0, 100000)")
        assert page.evaluate(ON_TOP), f"scrolled, at {width} × {height}"
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), f"nothing is cut at {width}"
        page.evaluate("scrollTo(0, 0)")


def test_it_works_zoomed(standing, opened):
    stops(standing, live(opened(size=(640, 400), scale=2)), "zoomed to 200 %")


def test_it_works_while_the_3d_view_is_blank(standing, opened):
    stops(standing, live(opened()), "without a 3D view")


def test_it_works_with_a_list_open_and_the_focus_elsewhere(standing, opened):
    page = live(opened())
    page.focus("#faceSelect")
    page.keyboard.press("Alt+ArrowDown")
    before = standing.asked().count("stop")
    press(page)  # closes the list, where the browser draws it itself
    press(page)
    wait_until(lambda: standing.asked().count("stop") > before, 20.0, "the stop")


def test_before_the_first_facts_it_is_there_and_works(standing, opened):
    """The server is silent: the page says so, and the stop goes out all the same."""

    def silent(page):
        page.route_web_socket("**/link", lambda route: route.connect_to_server().on_message(lambda message: None))

    page = opened(silent)
    assert page.is_visible("#lost")
    assert "use the power switch" in page.inner_text("#lost")
    until(page, "Boolean(socket) && socket.readyState === 1", "the connection")
    stops(standing, page, "before the first facts")
    until(page, "document.querySelector('#told').textContent.includes('NOT STOPPED as far as this page knows')", "the warning")


def test_without_a_connection_it_says_so_goes_on_trying_and_stops_when_there_is_one_again(standing, opened):
    page = live(opened(size=(400, 600)))
    standing.process.signal(signal.SIGSTOP)
    page.wait_for_selector("#lost:visible")
    assert page.inner_text("#lostTitle") == "No connection: use the power switch"
    assert page.evaluate(ON_TOP)
    before = standing.asked().count("stop")
    press(page)
    standing.process.signal(signal.SIGCONT)
    wait_until(lambda: standing.asked().count("stop") > before, 20.0, "the stop")
    live(page)


def test_a_stop_asked_for_while_the_server_is_gone_is_carried_out_by_its_successor(standing, opened):
    page = live(opened(size=(832, 600)))
    standing.process.kill()
    page.wait_for_selector("#lost:visible")
    assert page.evaluate(ON_TOP)
    press(page)
    until(page, "document.querySelector('#lostStop').textContent.startsWith('NOT STOPPED: there is no connection')", "the warning")
    standing.start()
    wait_until(lambda: "stop" in standing.asked(), 30.0, "the stop")
    live(page)
    until(page, "document.querySelector('#lostStop').textContent === ''", "its end")


@pytest.mark.parametrize("key", ["Space", "Escape"])
def test_its_keys_work_in_the_page_and_while_the_connection_is_lost(standing, opened, key):
    page = live(opened())
    before = standing.asked().count("stop")
    page.keyboard.press(key)
    wait_until(lambda: standing.asked().count("stop") > before, 20.0, "the stop")
    standing.process.signal(signal.SIGSTOP)
    page.wait_for_selector("#lost:visible")
    before = standing.asked().count("stop")
    page.keyboard.press(key)
    standing.process.signal(signal.SIGCONT)
    wait_until(lambda: standing.asked().count("stop") > before, 20.0, "the stop that was asked for while nobody answered")


def test_it_is_taken_however_much_else_is_asked(standing, opened):
    page = live(opened())
    page.evaluate("for (let i = 0; i < 500; i += 1) order('select', { target: 'TO5' })")
    stops(standing, page, "behind five hundred other orders")
    assert standing.asked().count("rehearse TO5") < 100, "what nobody can mean is left out"
