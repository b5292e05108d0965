from __future__ import annotations

import asyncio
import socket

import pytest

from server.link import LinkState, open_link
from server.link.tcp import TcpListenLink
from server.link.udp import UdpLink
from tests.link.support import listening


def listening_socket(port: int = 0) -> socket.socket:
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.bind(("127.0.0.1", port))
    listener.listen(1)
    listener.settimeout(10)
    return listener


async def test_tcp_connects_reads_and_writes() -> None:
    with listening_socket() as server:
        async with listening(open_link(f"tcp://127.0.0.1:{server.getsockname()[1]}")) as heard:
            peer, _ = await asyncio.to_thread(server.accept)
            with peer:
                peer.sendall(bytes(range(256)) * 400)
                await heard.until(lambda: len(heard.data) == 102_400)
                heard.link.write(b"to the board")
                assert await asyncio.to_thread(peer.recv, 100) == b"to the board"
    assert heard.data == bytes(range(256)) * 400
    assert heard.link.status.bytes_out == 12


async def test_tcp_connects_again_when_the_server_restarts() -> None:
    server = listening_socket()
    port = server.getsockname()[1]
    async with listening(open_link(f"tcp://localhost:{port}")) as heard:
        peer, _ = await asyncio.to_thread(server.accept)
        peer.sendall(b"one")
        await heard.until_data(b"one")
        server.close()
        peer.close()
        await heard.until_code("refused")
        assert heard.link.status.state is LinkState.NOT_FOUND
        with listening_socket(port) as restarted:
            peer, _ = await asyncio.to_thread(restarted.accept)
            peer.sendall(b"two")
            await heard.until_data(b"two")
            peer.close()
    assert [chunk.data for chunk in heard.chunks if chunk.new_session] == [b"one", b"two"]


async def test_an_unknown_host_is_named() -> None:
    async with listening(open_link("tcp://no-such-board.invalid:5760")) as heard:
        await heard.until(lambda: heard.link.status.code in {"host-not-found", "unreachable"})
        assert "no-such-board.invalid" in heard.link.status.cause


async def test_a_board_connects_to_tcp_listen_and_a_newer_one_replaces_it() -> None:
    link = open_link("tcp-listen://:0")
    assert isinstance(link, TcpListenLink)
    async with listening(link) as heard:
        await heard.until_code("waiting-for-peer")
        assert "127.0.0.1" in link.status.cause
        with socket.create_connection(("127.0.0.1", link.port)) as first:
            first.sendall(b"first")
            await heard.until_data(b"first")
            with socket.create_connection(("127.0.0.1", link.port)) as second:
                second.sendall(b"second")
                await heard.until_data(b"second")
                assert await asyncio.to_thread(first.recv, 10) == b""
                link.write(b"answer")
                assert await asyncio.to_thread(second.recv, 10) == b"answer"
        await heard.until_code("waiting-for-peer")
    assert [chunk.data for chunk in heard.chunks if chunk.new_session] == [b"first", b"second"]
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", link.port))


async def test_a_taken_address_is_said_and_tried_again() -> None:
    with listening_socket() as other:
        port = other.getsockname()[1]
        async with listening(open_link(f"tcp-listen://127.0.0.1:{port}")) as heard:
            await heard.until_code("address-in-use")
            assert heard.link.status.state is LinkState.BUSY
            other.close()
            await heard.until_code("waiting-for-peer")


async def test_an_address_of_another_machine_cannot_be_listened_at() -> None:
    async with listening(open_link("udp://192.0.2.1:14550")) as heard:
        await heard.until_code("address-not-here")


async def test_udp_answers_whoever_spoke_last() -> None:
    link = open_link("udp://:0")
    assert isinstance(link, UdpLink)
    async with listening(link) as heard:
        await heard.until(lambda: link.status.state is LinkState.OPEN)
        link.write(b"nobody hears")
        here = ("127.0.0.1", link.port)
        with socket.socket(type=socket.SOCK_DGRAM) as one, socket.socket(type=socket.SOCK_DGRAM) as two:
            for peer, word in ((one, b"one"), (two, b"two"), (one, b"three")):
                peer.settimeout(10)
                peer.sendto(word, here)
                await heard.until_data(word)
                link.write(b"for " + word)
                assert await asyncio.to_thread(peer.recv, 100) == b"for " + word
    assert heard.data == b"onetwothree"
    assert [chunk.new_session for chunk in heard.chunks] == [True, False, False]
    assert link.status.bytes_out == len(b"for onefor twofor three")


async def test_another_udp_peer_after_a_silence_is_a_new_session(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.link.udp.SILENT_AFTER_NS", 0)
    link = open_link("udp://127.0.0.1:0")
    assert isinstance(link, UdpLink)
    async with listening(link) as heard:
        await heard.until(lambda: link.status.state is LinkState.OPEN)
        with socket.socket(type=socket.SOCK_DGRAM) as one, socket.socket(type=socket.SOCK_DGRAM) as two:
            for peer, word in ((one, b"one"), (one, b"more"), (two, b"two")):
                peer.sendto(word, ("127.0.0.1", link.port))
                await heard.until_data(word)
    assert [chunk.new_session for chunk in heard.chunks] == [True, False, True]


async def test_udp_survives_a_peer_that_refuses_the_answer() -> None:
    link = open_link("udp://127.0.0.1:0")
    assert isinstance(link, UdpLink)
    async with listening(link) as heard:
        await heard.until(lambda: link.status.state is LinkState.OPEN)
        with socket.socket(type=socket.SOCK_DGRAM) as gone:
            gone.sendto(b"bye", ("127.0.0.1", link.port))
            await heard.until_data(b"bye")
        for _ in range(3):
            link.write(b"still there?")
        with socket.socket(type=socket.SOCK_DGRAM) as other:
            other.sendto(b"hello", ("127.0.0.1", link.port))
            await heard.until_data(b"hello")
    assert link.status.reconnects == 0


async def test_silent_udp_tells_how_to_hear_the_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.link.retry.SILENT_AFTER_NS", 50_000_000)
    link = open_link("udp://:0")
    assert isinstance(link, UdpLink)
    async with listening(link) as heard:
        await heard.until_code("silent-udp")
        assert f"udp://0.0.0.0:{link.port}" in link.status.remedy


@pytest.mark.parametrize("url", ["loop://", "loop://?baud=57600"])
async def test_any_pyserial_url_reads_and_writes(url: str) -> None:
    async with listening(open_link(url)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        heard.link.write(bytes(range(256)))
        await heard.until_data(bytes(range(256)))
    assert heard.data == bytes(range(256))
    assert heard.link.status.bytes_out == 256


async def test_a_pyserial_socket_reconnects() -> None:
    server = listening_socket()
    port = server.getsockname()[1]
    async with listening(open_link(f"socket://127.0.0.1:{port}")) as heard:
        for word in (b"one", b"two"):
            peer, _ = await asyncio.to_thread(server.accept)
            await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
            peer.sendall(word)
            await heard.until_data(word)
            peer.close()
        server.close()
        await heard.until_code("refused")
    assert [chunk.data for chunk in heard.chunks if chunk.new_session] == [b"one", b"two"]
