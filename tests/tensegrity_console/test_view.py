# SPDX-License-Identifier: Apache-2.0
"""What a page's 3D view may say, and what viser does not do whoever says it."""

import asyncio
import math

import msgspec
import pytest
import websockets.asyncio.client
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_console.web.view_messages import LONGEST, Camera, Click, for_viser, said

CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0], "position": [0.0, 0.0, 1.0], "fov": 1.0, "near": 0.1, "far": 10.0,
    "image_height": 100, "image_width": 100, "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 1.0, 0.0],
}  # fmt: skip
CLICK = {
    "type": "ScenePointerMessage", "event_type": "click", "ray_origin": [0.0, 0.0, 1.0], "ray_direction": [0.0, 0.0, -1.0],
    "screen_pos": [[0.5, 0.5]], "modifier": None,
}  # fmt: skip
PACK = msgspec.msgpack.encode


def test_cameras_and_clicks_are_understood_and_a_camera_is_told_to_viser_as_viser_reads_it():
    from viser._messages import Message

    camera, click = said(PACK(CAMERA)), said(PACK(CLICK))
    assert isinstance(camera, Camera)
    assert isinstance(click, Click)
    assert click.ray_direction == (0.0, 0.0, -1.0)
    assert Message.deserialize(for_viser(camera)).position == (0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    "message",
    [
        CAMERA | {"position": [math.nan, 0.0, 1.0]},
        CAMERA | {"position": [math.inf, 0.0, 1.0]},
        CAMERA | {"position": [0.0, 1.0]},
        CAMERA | {"position": CAMERA["look_at"]},
        CAMERA | {"up_direction": [0.0, 0.0, 0.0]},
        CAMERA | {"wxyz": [0.0, 0.0, 0.0, 0.0]},
        CAMERA | {"fov": math.nan},
        CAMERA | {"fov": 0.0},
        CAMERA | {"far": 1e300},
        CAMERA | {"image_height": 10**9},
        CAMERA | {"image_height": "high"},
        CAMERA | {"more": 1},
        CLICK | {"ray_origin": [math.nan] * 3},
        CLICK | {"ray_direction": [0.0, 0.0, -math.inf]},
        CLICK | {"ray_origin": None},
        CLICK | {"event_type": "rect-select"},
        CLICK | {"screen_pos": [[0.0, 0.0]] * 1000},
        {"type": "ShareUrlRequest"},
        {"type": "ShareUrlDisconnect"},
        {"type": "FileTransferStartUpload"},
        {"type": "GuiUpdateMessage", "uuid": "x", "updates": {}},
        {},
        [],
    ],
)
def test_everything_else_is_dropped(message):
    assert said(PACK(message)) is None


def test_a_long_message_and_a_text_are_not_even_read():
    assert said("x") is None
    assert said(PACK(CLICK | {"modifier": "x" * LONGEST})) is None
    assert said(b"\x91" * LONGEST) is None, "nested as deep as it is long"


@given(st.binary(max_size=200))
def test_no_bytes_raise(data):
    said(data)


def test_sharing_is_switched_off_whoever_asks_over_viser_s_own_socket(monkeypatch):
    """It asks an outside host for a public tunnel to this machine."""
    import viser._viser

    from tensegrity_console.web.embedded_viser import ViserInside

    tunnels = []
    monkeypatch.setattr(viser._viser, "ViserTunnel", lambda *words: tunnels.append(words))
    server = ViserInside()
    asked = []
    monkeypatch.setattr(server, "disconnect_share_url", lambda: asked.append("disconnect"))

    async def ask():
        async with websockets.asyncio.client.unix_connect(
            str(server.path), uri="ws://localhost/page", subprotocols=[f"viser-v{viser.__version__}"]
        ) as line:
            await line.send(PACK({"type": "ShareUrlRequest"}))
            await line.send(PACK({"type": "ShareUrlDisconnect"}))
            async with asyncio.timeout(20.0):
                while not asked:  # what was sent before has been dealt with, or is being
                    await asyncio.sleep(0.01)

    asyncio.run(ask())
    server._thread_executor.shutdown(wait=True)
    assert asked == ["disconnect"]
    assert tunnels == []
    assert server.request_share_url() is None
    server.stop()
    assert not server.path.exists()
