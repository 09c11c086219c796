# SPDX-License-Identifier: Apache-2.0
"""What a page's 3D view may say to viser: where its camera is. Clicks are taken out for us; everything else is dropped.

viser knows some sixty messages, among them uploads, and "share", which asks an outside host for a tunnel. What passes here is taken
apart strictly and put together anew, so that viser reads no byte of a page's.
"""

import math
from typing import Annotated, Literal

import msgspec

LONGEST = 4096
"""Bytes of a message; a camera has some 400."""
FARTHEST_M = 1e4
NEAREST_M = 1e-4
"""A camera that looks at where it is looks nowhere."""
Coordinate = Annotated[float, msgspec.Meta(ge=-FARTHEST_M, le=FARTHEST_M)]  # no NaN
Three = tuple[Coordinate, Coordinate, Coordinate]
Pixels = Annotated[int, msgspec.Meta(ge=0, le=32768)]


class Camera(msgspec.Struct, tag_field="type", tag="ViewerCameraMessage", forbid_unknown_fields=True):
    """Where a page looks from, as viser has it."""

    wxyz: tuple[Coordinate, Coordinate, Coordinate, Coordinate]
    position: Three
    fov: Annotated[float, msgspec.Meta(gt=0.0, lt=math.pi)]
    near: Coordinate
    far: Coordinate
    image_height: Pixels
    image_width: Pixels
    look_at: Three
    up_direction: Three


class Click(msgspec.Struct, tag_field="type", tag="ScenePointerMessage", forbid_unknown_fields=True):
    """A click: a ray of sight."""

    event_type: Literal["click"]
    ray_origin: Three
    ray_direction: Three
    screen_pos: Annotated[list[tuple[float, float]], msgspec.Meta(max_length=4)]
    modifier: str | None = None


_DECODER = msgspec.msgpack.Decoder(Camera | Click)


def said(data: str | bytes) -> Camera | Click | None:
    """A camera or a click; None: something else, or numbers that are none."""
    if isinstance(data, str) or len(data) > LONGEST:
        return None
    try:
        message = _DECODER.decode(data)
    except (msgspec.MsgspecError, RecursionError):
        return None
    return None if isinstance(message, Camera) and not _looks(message) else message


def for_viser(camera: Camera) -> bytes:
    """The message, made by us."""
    return msgspec.msgpack.encode(camera)


def _looks(camera: Camera) -> bool:
    apart = math.dist(camera.position, camera.look_at)
    return min(apart, math.hypot(*camera.up_direction), math.hypot(*camera.wxyz)) > NEAREST_M
