"""Only a camera and our own commands pass from a browser to viser."""

import dataclasses
import math

import msgspec
import pytest
from viser import _messages

from server.view3d.guard import MAX_MESSAGE_BYTES, CameraReport, admit
from server.view3d.viewer import ViewCommand
from tests.view3d.synthetic import camera_message

encode = msgspec.msgpack.encode


def test_a_camera_passes_with_the_fields_of_visers_own_message() -> None:
    report = admit(encode(camera_message()))
    assert isinstance(report, CameraReport)
    own = {field.name for field in dataclasses.fields(_messages.ViewerCameraMessage)}
    assert own == set(CameraReport.__struct_fields__)


def test_our_command_passes() -> None:
    command = admit(encode({"type": "NavdeckViewCommand", "camera": "top", "fit": True}))
    assert isinstance(command, ViewCommand)
    assert (command.camera, command.fit, command.board) == ("top", True, None)


@pytest.mark.parametrize(
    "message",
    [
        {"type": "ShareUrlRequest"},
        {"type": "ShareUrlDisconnect"},
        {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": 1}},
        {"type": "FileTransferStartUpload", "source_component_uuid": "x", "transfer_uuid": "y", "filename": "z"},
        {"type": "TransformControlsUpdateMessage", "name": "/ned", "wxyz": [1, 0, 0, 0], "position": [0, 0, 0]},
        {"type": "NavdeckViewCommand", "camera": "upside-down"},
        camera_message(position=[math.nan, 0, 0]),
        camera_message(position=[0, 0]),
        camera_message(image_height=0),
        camera_message(extra=1),
        {},
        [],
        "ViewerCameraMessage",
    ],
)
def test_everything_else_is_dropped(message: object) -> None:
    assert admit(encode(message)) is None


def test_every_message_type_of_viser_but_the_camera_is_dropped() -> None:
    names = {cls.__name__ for cls in _messages.Message.get_subclasses()} - {"ViewerCameraMessage"}
    assert len(names) > 50
    assert [name for name in names if admit(encode({"type": name})) is not None] == []


def test_broken_and_oversized_bytes_are_dropped() -> None:
    good = encode(camera_message())
    assert admit(good[:-1]) is None
    assert admit(b"") is None
    assert admit(b"\xff" * 64) is None
    assert admit(encode({"type": "NavdeckViewCommand", "board": "x" * MAX_MESSAGE_BYTES})) is None
