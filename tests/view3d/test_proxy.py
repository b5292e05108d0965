"""The door of /view/: what is served, who may enter, and what never passes."""

import asyncio
import os
from pathlib import Path

import httpx
import pytest
from viser import _messages
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Subprotocol

from server.view3d import View3D
from server.view3d.proxy import same_origin, viser_protocol
from tests.view3d.synthetic import SyntheticBoard, Watcher, camera_message, eventually, served

LISTENING = "0A"


def listening_addresses() -> set[str]:
    """Addresses (hexadecimal, as in /proc/net/tcp) on which this very process listens."""
    sockets = {os.readlink(fd) for fd in Path("/proc/self/fd").iterdir() if fd.is_symlink() and fd.exists()}
    addresses = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/self/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == LISTENING and f"socket:[{fields[9]}]" in sockets:
                addresses.add(fields[1].split(":")[0])
    return addresses


async def test_viser_listens_on_loopback_only_and_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    before = listening_addresses()
    view = View3D(tuple)
    await view.start()
    after = listening_addresses()
    url = view.upstream_url
    await view.stop()
    assert after - before <= {"0100007F"}
    assert "0100007F" in after
    assert url is not None
    assert url.startswith("ws://127.0.0.1:")
    assert view.upstream_url is None
    assert capfd.readouterr() == ("", "")


async def test_nobody_can_ask_viser_for_a_public_tunnel() -> None:
    """Even past our guard: a client on the loopback port itself finds no handler."""
    view = View3D(tuple)
    await view.start()
    try:
        handlers = view._server._websock_server._incoming_handlers
        assert not handlers.get(_messages.ShareUrlRequest)
        assert not handlers.get(_messages.ShareUrlDisconnect)
    finally:
        await view.stop()


async def test_cameras_pass_and_forbidden_messages_do_not_reach_viser() -> None:
    arrived: list[object] = []
    with served([SyntheticBoard()]) as at:
        server = at.view._server._websock_server
        for message in (_messages.ShareUrlRequest, _messages.GuiUpdateMessage, _messages.ViewerCameraMessage):
            server.register_handler(message, lambda _client, message: arrived.append(message))
        async with Watcher.connected(at.port) as watcher:
            await watcher.send({"type": "ShareUrlRequest"})
            await watcher.send({"type": "GuiUpdateMessage", "uuid": "u", "updates": {"value": 1}})
            await watcher._socket.send("text")
            await watcher.send(camera_message(position=[7, 8, 9]))
            await eventually(lambda: any(getattr(m, "position", None) == (7, 8, 9) for m in arrived))
    assert {type(message) for message in arrived} == {_messages.ViewerCameraMessage}


async def test_a_foreign_page_gets_403_and_a_wrong_version_no_socket() -> None:
    with served([SyntheticBoard()]) as at:
        url = f"ws://127.0.0.1:{at.port}/view"
        ours = [Subprotocol(viser_protocol())]
        with pytest.raises(InvalidStatus) as refused:
            await connect(url, origin="http://evil.example", subprotocols=ours, proxy=None)
        assert refused.value.response.status_code == 403
        with pytest.raises(InvalidStatus):
            await connect(url, subprotocols=[Subprotocol("viser-v0.0.1")], proxy=None)
        async with Watcher.connected(at.port, origin=f"http://127.0.0.1:{at.port}") as watcher:
            await watcher.node("/ned")


def test_origin_must_be_our_host_and_null_is_nobody() -> None:
    assert same_origin({"host": "nav:8080", "origin": "http://nav:8080"})
    assert same_origin({"host": "nav:8080"})
    assert not same_origin({"host": "nav:8080", "origin": "http://nav:8081"})
    assert not same_origin({"host": "nav:8080", "origin": "null"})


async def test_the_page_is_visers_client_with_our_additions_and_may_fetch_from_here_only() -> None:
    with served([SyntheticBoard()]) as at:
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{at.port}", trust_env=False) as http:
            page = await http.get("/view/?camera=top")
            again = await http.get("/view/", headers={"if-none-match": page.headers["etag"]})
            plain = await http.get("/view/", headers={"accept-encoding": "identity"})
            moved = await http.get("/view?board=b&camera=top")
    assert page.status_code == 200
    assert page.headers["content-encoding"] == "gzip"
    assert plain.text == page.text
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'self'" in policy
    assert "http:" not in policy
    for ours in ("Document.prototype.hasFocus", "canvas[data-engine]", "NavdeckViewCommand"):
        assert page.text.index(ours) < page.text.index("data-p=")  # before viser's own script
    assert "__NAVDECK_CONFIG__" not in page.text
    assert (again.status_code, again.content) == (304, b"")
    assert (moved.status_code, moved.headers["location"]) == (307, "/view/?board=b&camera=top")


async def test_when_viser_goes_the_browsers_socket_closes_so_that_it_reconnects() -> None:
    with served([SyntheticBoard()]) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.node("/ned/here/vehicle")
            at.view._server._websock_server.disconnect_all_clients()
            async with asyncio.timeout(10):
                await watcher._socket.wait_closed()
        with pytest.raises(ConnectionClosed):
            await watcher.send(camera_message())
        async with Watcher.connected(at.port) as watcher:
            await watcher.node("/ned/here/vehicle")
