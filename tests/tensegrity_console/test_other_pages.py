# SPDX-License-Identifier: Apache-2.0
"""What other origins' pages, other users and second pages can do, in a real Chromium where the operator's page is open: nothing."""

import json
import os
import socket
import subprocess
import threading
from base64 import b64encode
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

import psutil
import pytest

from tensegrity_lab.stack.processes import wait_until
from tests.tensegrity_console.conftest import TOKEN, until

pytestmark = [pytest.mark.slow, pytest.mark.ros]
LIMIT_MS = 60_000
ATTACK = """async ([http, socket, protocols, secret]) => {
    const got = [];
    const within = (work, ms = 9000) => Promise.race([work, new Promise((_, no) => setTimeout(() => no("late"), ms))]);
    const fetched = async (path, mode, method) => {
        const reply = await within(fetch(`${http}/${path}`, { mode, method, credentials: "include" }));
        const words = await reply.text();
        if (reply.type !== "opaque" || words) got.push([mode, method, path, reply.type, words.slice(0, 80)]);
    };
    const talked = (path, protocol) => within(new Promise((yes, no) => {
        const one = protocol ? new WebSocket(`${socket}/${path}`, protocol) : new WebSocket(`${socket}/${path}`);
        one.onopen = () => { got.push(["open", path]); one.send('{"do": "stop"}'); one.send('{"do": "reset"}'); };
        one.onmessage = (event) => { got.push(["read", path, String(event.data).slice(0, 80)]); yes(); };
        one.onclose = one.onerror = () => no("closed");
    }));
    const framed = async (path) => {
        const frame = document.createElement("iframe");
        frame.src = `${http}/${path}`;
        document.body.append(frame);
        await within(new Promise((yes) => { frame.onload = yes; }));
        if (frame.contentDocument.body.textContent) got.push(["frame", path]);
    };
    const run = (path) => within(new Promise((yes, no) => {
        const script = document.createElement("script");
        script.src = `${http}/${path}`;
        script.onload = () => { got.push(["script", path]); yes(); };
        script.onerror = no;
        document.body.append(script);
    }));
    const pages = ["", `${secret}/`, `${secret}/scene`, "?token=" + secret];
    await Promise.allSettled([
        ...pages.flatMap((path) => [["cors", "GET"], ["cors", "POST"], ["no-cors", "GET"]].map((how) => fetched(path, ...how))),
        ...["", "link", secret, `${secret}/link`, `${secret}/scene/x`].flatMap((path) => protocols.map((one) => talked(path, one))),
        framed(`${secret}/`), framed(`${secret}/scene`), run(`${secret}/app.js`),
    ]);
    return got;
}"""


class Elsewhere(BaseHTTPRequestHandler):
    """A page of somebody else's."""

    def do_GET(self):
        self.server.headers_seen.append(str(self.headers) + self.path)
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>elsewhere</title><body>")

    def log_message(self, *words):
        pass


@pytest.fixture(scope="module")
def elsewhere():
    """A server of another user of this machine, at every loopback address."""
    server = ThreadingHTTPServer(("0.0.0.0", 0), Elsewhere)
    server.headers_seen = []
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server
    server.shutdown()
    server.server_close()


@pytest.fixture
def browser(chromium):
    """One person's browser: its pages share cookies."""
    context = chromium.new_context()
    context.set_default_timeout(LIMIT_MS)
    yield context
    context.close()


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "127.0.0.2"])
def test_another_origin_s_page_reads_and_does_nothing_at_the_console(standing, browser, elsewhere, name):
    """Even one that knows the secret, as none can: the Origin is judged, too."""
    own = browser.new_page()
    own.goto(standing.url)
    own.wait_for_selector("#lost", state="hidden")
    before = standing.asked()
    page = browser.new_page()
    page.goto(f"http://{name}:{elsewhere.server_port}/")
    at = f"127.0.0.1:{standing.port}"
    viser = own.evaluate("document.querySelector('#scene').src") or ""
    for secret in ("wrong-wrong-wrong-wrong", TOKEN):
        assert page.evaluate(ATTACK, [f"http://{at}", f"ws://{at}", ["", "viser-v1.1.1"], secret]) == [], (secret, viser)
    assert standing.asked() == before


def test_a_name_that_somebody_else_s_server_gives_to_this_machine_is_none_of_its(standing):
    """DNS rebinding: for the browser, such a page has the console's own origin."""
    before = standing.asked()
    with socket.create_connection(("127.0.0.1", standing.port)) as line:
        line.sendall(f"GET /{TOKEN}/ HTTP/1.1\r\nHost: rebound.example:{standing.port}\r\nConnection: close\r\n\r\n".encode())
        reply = b"".join(iter(lambda: line.recv(65536), b""))
    assert reply.startswith(b"HTTP/1.1 403")
    assert b"sixstrut console" not in reply
    assert standing.asked() == before


def test_what_the_browser_keeps_tells_another_port_of_the_same_host_nothing(standing, browser, elsewhere):
    """A cookie would: it is sent to every port of its host."""
    own = browser.new_page()
    own.goto(standing.url)
    own.wait_for_selector("#lost", state="hidden")
    elsewhere.headers_seen.clear()
    own.evaluate(f"location.href = 'http://127.0.0.1:{elsewhere.server_port}/'")
    wait_until(lambda: own.wait_for_timeout(50) or elsewhere.headers_seen, 20.0, "the visit there")
    assert all(TOKEN not in seen for seen in elsewhere.headers_seen)
    assert browser.cookies() == []


def test_the_console_listens_at_its_page_s_port_alone(standing):
    listening = [one.laddr.port for one in psutil.Process(standing.process.pid).net_connections("tcp") if one.status == "LISTEN"]
    assert listening == [standing.port]


def test_another_user_of_this_machine_reaches_nothing(standing):
    if os.geteuid() != 0 or not os.access("/usr/bin/python3", os.X_OK):
        pytest.skip("only root can be another user")
    (place,) = {
        one.laddr for one in psutil.Process(standing.process.pid).net_connections("unix") if "sixstrut-view" in str(one.laddr)
    }
    assert Path(place).parent.stat().st_mode & 0o077 == 0
    script = """
import socket, sys
line = socket.socket(socket.AF_UNIX)
try:
    line.connect(sys.argv[1])
    print("viser: connected")
except PermissionError:
    print("viser: refused")
line = socket.create_connection(("127.0.0.1", int(sys.argv[2])))
line.sendall(b"GET /link HTTP/1.1\\r\\nHost: 127.0.0.1\\r\\nConnection: close\\r\\n\\r\\n")
print("console:", line.recv(100).split()[1].decode())
"""
    words = ["/usr/bin/env", "-i", "/usr/bin/python3", "-c", script, place, str(standing.port)]
    told = subprocess.run(words, user=65534, group=65534, extra_groups=[], cwd="/", capture_output=True)
    assert told.stdout.split(b"\n")[:2] == [b"viser: refused", b"console: 403"], told


def test_what_one_page_selects_is_no_other_s(standing, browser):
    one, other = browser.new_page(), browser.new_page()
    for page in (one, other):
        page.route("**/scene?*", lambda route: route.abort())  # two at once, drawn in software, take the whole machine
        page.goto(standing.url)
        page.wait_for_selector("#lost", state="hidden")
    one.click("#neighbours button[data-face=TO7]")
    until(one, "document.querySelector('#roll').textContent === 'Roll to TO7'", "the selection")
    other.click("#neighbours button[data-face=TO5]")
    until(other, "document.querySelector('#roll').textContent === 'Roll to TO5'", "the other selection")
    assert one.inner_text("#roll") == "Roll to TO7"
    rolls = lambda: [call for call in standing.asked() if call.startswith("roll")]  # noqa: E731
    other.evaluate("order('roll', { target: 'TO7' })")
    until(other, "document.querySelector('#told').textContent.includes('not what this page has selected')", "the refusal")
    assert rolls() == []
    one.click("#roll")
    wait_until(rolls, 20.0, "the roll")
    assert rolls() == ["roll TO7 False"]


def test_a_key_says_which_question_it_answers(standing, browser):
    page = browser.new_page()
    page.route("**/scene?*", lambda route: route.abort())
    page.goto(standing.url)
    page.wait_for_selector("#lost", state="hidden")
    page.click("#trialKeys button[data-key=n]")
    page.keyboard.press("y")
    wait_until(lambda: "press y the-newest" in standing.asked(), 20.0, "the key")
    assert "press n the-newest" in standing.asked()
    page.evaluate("order('key', { key: 'y', panel: 'an older one' })")
    until(page, "document.querySelector('#told').textContent.includes('look again')", "the refusal")
    assert standing.asked().count("press y the-newest") == 1


def test_each_page_s_3d_view_shows_its_own_selection(standing, browser):
    """By what viser sends to each: a ghost, a chosen face."""
    frames = {}
    pages = [browser.new_page() for _ in range(2)]
    for number, page in enumerate(pages):
        told = frames.setdefault(number, [])

        def listen(line, told=told):
            if "/scene/" in line.url:
                line.on("framereceived", lambda data: told.append(data))

        page.on("websocket", listen)
        page.goto(standing.url)
        page.wait_for_selector("#lost", state="hidden")
    wait_until(lambda: pages[0].wait_for_timeout(50) or all(frames.values()), 60.0, "both 3D views")
    scene = lambda page: page.frame_locator("#scene").locator("canvas")  # noqa: E731
    for page in pages:
        scene(page).first.wait_for()
    pages[0].wait_for_timeout(1000)
    before = {number: len(told) for number, told in frames.items()}
    pages[0].click("#neighbours button[data-face=TO9]")
    updates = lambda number: [data for data in frames[number][before[number] :] if b"ghost_struts" in unpacked(data)]  # noqa: E731
    wait_until(lambda: pages[0].wait_for_timeout(50) or updates(0), 60.0, "the ghost")
    assert updates(1) == []


def unpacked(data):
    """The named part of one of viser's messages."""
    import zstandard

    size = int.from_bytes(data[8:16], "little")
    return zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])


def test_numbers_that_are_none_and_requests_to_share_come_to_nobody(standing, browser):
    """What a hostile page that was let in says over its own 3D view's socket; another page goes on seeing and stopping."""
    import msgspec

    camera = {
        "type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0], "position": [0.0, 0.0, 1.0], "fov": 1.0, "near": 0.1, "far": 10.0,
        "image_height": 100, "image_width": 100, "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 1.0, 0.0],
    }  # fmt: skip
    nan, inf = float("nan"), float("inf")
    click = {"type": "ScenePointerMessage", "event_type": "click", "screen_pos": [[0.5, 0.5]], "modifier": None}
    said = [
        camera,
        camera | {"position": [nan, 0.0, 1.0]},
        camera | {"look_at": camera["position"]},
        camera | {"fov": inf},
        click | {"ray_origin": [nan] * 3, "ray_direction": [0.0, 0.0, -1.0]},
        click | {"ray_origin": [0.0, 0.0, 1.0], "ray_direction": [inf, 0.0, -1.0]},
        click | {"ray_origin": [0.0, 0.0, 1.0], "ray_direction": [0.0, 0.0, nan]},
        click | {"ray_origin": [0.0, 0.0, 1e300], "ray_direction": [1.0, 0.0, -1e-300]},
        {"type": "ShareUrlRequest"},
        {"type": "RunJavascriptMessage", "source": "1"},
    ]
    hostile = browser.new_page()
    hostile.goto(standing.url)
    hostile.wait_for_selector("#lost", state="hidden")
    hostile.evaluate(
        """async ([texts]) => {
            const place = new URL(document.querySelector("#scene").src).searchParams.get("websocket");
            const line = new WebSocket(place, "viser-v1.1.1");
            await new Promise((yes, no) => { line.onopen = yes; line.onerror = no; });
            for (const text of texts) line.send(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)));
            line.send("text");
            line.send(new Uint8Array([0xc1]));
        }""",
        [[b64encode(msgspec.msgpack.encode(one)).decode() for one in said]],
    )
    own = browser.new_page()
    documents = []
    own.on(
        "websocket", lambda line: line.on("framereceived", lambda data: documents.append(data) if isinstance(data, str) else None)
    )
    own.goto(standing.url)
    own.wait_for_selector("#lost", state="hidden")
    own.frame_locator("#scene").locator("canvas").first.wait_for()
    wait_until(lambda: own.wait_for_timeout(50) or len(documents) > 20, 30.0, "facts")

    def refuse(text):
        raise AssertionError(text)

    for text in documents:
        json.loads(text, parse_constant=refuse)
    assert "Share URL" not in standing.process.output
    assert "Traceback" not in standing.process.output
    before = standing.asked().count("stop")
    own.click("#stop")
    wait_until(lambda: standing.asked().count("stop") > before, 20.0, "the stop")


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_another_origin_s_page_reads_and_stops_nothing_at_the_foxglove_server(domain, monkeypatch, browser, elsewhere, name):
    import rclpy
    from rclpy.context import Context
    from rclpy.node import Node
    from rclpy.signals import SignalHandlerOptions
    from std_srvs.srv import Trigger

    from tensegrity_console.foxglove.foxglove_server import FoxgloveServer
    from tensegrity_lab.stack.ros_thread import Spinner

    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    context = Context()
    rclpy.init(context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    node, came = Node("rest_of_the_stack", context=context), []

    def stop(request, response):
        came.append("stop")
        return response

    node.create_service(Trigger, "stop", stop)
    spinner = Spinner(node, context)
    server = FoxgloveServer(0, True, TOKEN)
    try:
        at = urlsplit(server.url).netloc
        page = browser.new_page()
        page.goto(f"http://{name}:{elsewhere.server_port}/")
        for secret in ("wrong-wrong-wrong-wrong", TOKEN):
            assert page.evaluate(ATTACK, [f"http://{at}", f"ws://{at}", ["foxglove.sdk.v1", ""], secret]) == []
        assert came == []
    finally:
        server.close()
        spinner.close()
        context.try_shutdown()
