"""What a browser may send to viser: its camera. Everything else is ours or is dropped."""

from __future__ import annotations

import math
from typing import Final

import msgspec

from server.view3d.viewer import ViewCommand

MAX_MESSAGE_BYTES: Final = 4096
"""A camera is about 400 bytes; viser itself would take 50 MB."""

_Vec3 = tuple[float, float, float]


class CameraReport(
    msgspec.Struct, kw_only=True, tag_field="type", tag="ViewerCameraMessage", forbid_unknown_fields=True
):
    """viser's own camera message, field by field: a malformed one would end the viewer's task with a traceback."""

    wxyz: tuple[float, float, float, float]
    position: _Vec3
    fov: float
    near: float
    far: float
    image_height: int
    image_width: int
    look_at: _Vec3
    up_direction: _Vec3

    def plausible(self) -> bool:
        """True when every number is finite and the picture has a size."""
        numbers = (*self.wxyz, *self.position, *self.look_at, *self.up_direction, self.fov, self.near, self.far)
        return all(map(math.isfinite, numbers)) and 0 < self.image_height < 65536 and 0 < self.image_width < 65536


_decoder: Final = msgspec.msgpack.Decoder(CameraReport | ViewCommand)


def admit(data: bytes) -> CameraReport | ViewCommand | None:
    """Return what a browser's message asks for; None when it is not one of the two that may pass."""
    if len(data) > MAX_MESSAGE_BYTES:
        return None
    try:
        message = _decoder.decode(data)
    except msgspec.DecodeError:
        return None
    return None if isinstance(message, CameraReport) and not message.plausible() else message
