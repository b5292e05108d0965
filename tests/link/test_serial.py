from __future__ import annotations

import asyncio
import errno
import fcntl
import os
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest

from server.link import LinkState, open_link
from server.link.pipe import DRAIN_S
from server.link.retry import FIRST_PAUSE_S, LONGEST_PAUSE_S
from tests.link.support import FakeMachine, PtyBoard, listening, ordinary_user, other_program


@pytest.fixture
def machine(tmp_path: Path) -> FakeMachine:
    return FakeMachine(tmp_path)


@pytest.fixture
def board(machine: FakeMachine) -> Iterator[PtyBoard]:
    board = PtyBoard(machine)
    yield board
    board.unplug()


async def test_every_byte_value_arrives_unchanged_and_in_order(machine: FakeMachine, board: PtyBoard) -> None:
    device = board.plug("ttyACM0")
    sent = b""
    async with listening(open_link(f"serial://{device}?baud=921600", finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        for k in range(50):
            frame = bytes((k + i) % 256 for i in range(256))
            board.say(frame)
            sent += frame
            await asyncio.sleep(0)
        await heard.until_data(sent)
    assert heard.data == sent
    assert [chunk.new_session for chunk in heard.chunks] == [True] + [False] * (len(heard.chunks) - 1)
    stamps = [chunk.t_rx_ns for chunk in heard.chunks]
    assert stamps == sorted(stamps)
    assert heard.link.status.bytes_in == len(sent)


async def test_a_port_is_opened_by_its_bare_name_too(machine: FakeMachine, board: PtyBoard) -> None:
    device = board.plug("ttyUSB0")
    async with listening(open_link(str(device), finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        board.say(b"hello")
        await heard.until_data(b"hello")


async def test_what_waited_before_opening_is_thrown_away(machine: FakeMachine, board: PtyBoard) -> None:
    device = board.plug("ttyACM0")
    board.say(b"stale" * 500)
    async with listening(open_link(f"serial://{device}", finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        board.say(b"fresh")
        await heard.until_data(b"fresh")
    assert heard.data == b"fresh"


async def test_writes_reach_the_board_whole_and_are_counted(machine: FakeMachine, board: PtyBoard) -> None:
    device = board.plug("ttyACM0")
    async with listening(open_link(f"serial://{device}", finder=machine.finder)) as heard:
        heard.link.write(b"too early")
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        heard.link.write(b"\x00\xff\x03\x04heartbeat\r\n")
        assert board.hear(100) == b"\x00\xff\x03\x04heartbeat\r\n"
        assert heard.link.status.bytes_out == 15
    heard.link.write(b"too late")
    assert heard.link.status.bytes_out == 15


async def test_a_board_that_does_not_read_costs_whole_writes_and_no_memory(
    machine: FakeMachine, board: PtyBoard
) -> None:
    device = board.plug("ttyACM0")
    frame = bytes(range(100))
    async with listening(open_link(f"serial://{device}", finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        for _ in range(5000):
            heard.link.write(frame)
        received = b""
        while len(received) < heard.link.status.bytes_out or heard.link.status.bytes_out % 100:
            received += board.hear(65_536)
            await asyncio.sleep(0.01)
    assert 0 < len(received) < 100_000
    assert received == frame * (len(received) // 100)


async def test_a_replugged_board_is_found_under_another_name(machine: FakeMachine, board: PtyBoard) -> None:
    device = board.plug("ttyACM0")
    async with listening(open_link(f"serial://{device}", finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        board.say(b"one")
        await heard.until_data(b"one")
        board.unplug()
        await heard.until_code("unplugged")
        assert heard.link.status.state is LinkState.LOST
        board.plug("ttyACM7")
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        board.say(b"two")
        await heard.until_data(b"two")
    assert heard.link.status.reconnects == 1
    assert [chunk.data for chunk in heard.chunks if chunk.new_session] == [b"one", b"two"]


def test_the_pauses_between_attempts_leave_a_replugged_board_under_two_seconds() -> None:
    assert FIRST_PAUSE_S <= LONGEST_PAUSE_S
    assert LONGEST_PAUSE_S + DRAIN_S + 0.1 < 2.0


async def test_another_device_at_the_same_name_is_not_taken_for_the_board(
    machine: FakeMachine, board: PtyBoard
) -> None:
    device = board.plug("ttyACM0")
    other = PtyBoard(machine, "usb-Modem-if00")
    async with listening(open_link(f"serial://{device}", finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        board.unplug()
        other.plug("ttyACM0")
        await heard.until_code("other-device")
        assert "usb-Board_1-if00" in heard.link.status.cause
        board.plug("ttyACM1")
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
    other.unplug()


async def test_without_an_id_the_same_name_is_opened_again(machine: FakeMachine, board: PtyBoard) -> None:
    device = board.plug("ttyUSB0", by_id=False)
    async with listening(open_link(f"serial://{device}", finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        board.unplug()
        await heard.until_code("unplugged")
        board.plug("ttyUSB0", by_id=False)
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)


async def test_a_missing_port_is_waited_for(machine: FakeMachine, board: PtyBoard) -> None:
    async with listening(open_link(f"serial://{machine.dev}/ttyACM0", finder=machine.finder)) as heard:
        await heard.until_code("port-missing")
        assert heard.link.status.state is LinkState.NOT_FOUND
        board.plug("ttyACM0")
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
    assert heard.link.status.reconnects == 0


async def test_a_busy_port_names_its_holder_and_is_taken_when_free(machine: FakeMachine, board: PtyBoard) -> None:
    device = board.plug("ttyACM0")
    with other_program(board.tty) as holder:
        async with listening(open_link(f"serial://{device}", finder=machine.finder)) as heard:
            await heard.until_code("port-busy")
            assert heard.link.status.state is LinkState.BUSY
            assert f"(process {holder.pid})" in heard.link.status.cause
            holder.communicate()
            await heard.until(lambda: heard.link.status.state is LinkState.OPEN)


async def test_an_open_port_is_closed_to_others_and_free_afterwards(machine: FakeMachine, board: PtyBoard) -> None:
    board.plug("ttyACM0")
    os.chmod(board.tty, 0o666)
    async with listening(open_link(f"serial://{board.tty}", finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        with ordinary_user(), pytest.raises(OSError, match=os.strerror(errno.EBUSY)):
            os.close(os.open(board.tty, os.O_RDWR | os.O_NOCTTY))
    with ordinary_user():
        free = os.open(board.tty, os.O_RDWR | os.O_NOCTTY)
        fcntl.flock(free, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.close(free)


async def test_a_forbidden_port_says_which_group_to_join(machine: FakeMachine, board: PtyBoard) -> None:
    board.plug("ttyACM0")
    os.chmod(board.tty, 0o000)
    with ordinary_user():
        async with listening(open_link(f"serial://{board.tty}", finder=machine.finder)) as heard:
            await heard.until_code("no-permission")
            assert heard.link.status.state is LinkState.NO_PERMISSION
            assert "sudo usermod -aG" in heard.link.status.remedy


async def test_a_file_is_not_a_serial_port(machine: FakeMachine, tmp_path: Path) -> None:
    (tmp_path / "note").write_text("no port")
    async with listening(open_link(f"serial://{tmp_path}/note", finder=machine.finder)) as heard:
        await heard.until_code("not-a-port")
        assert heard.link.status.state is LinkState.FAILED


async def test_an_open_port_without_a_byte_is_silent(
    machine: FakeMachine, board: PtyBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.link.retry.SILENT_AFTER_NS", 50_000_000)
    device = board.plug("ttyACM0")
    async with listening(open_link(f"serial://{device}", finder=machine.finder)) as heard:
        await heard.until_code("silent")
        assert heard.link.status.state is LinkState.SILENT
        assert str(device) in heard.link.status.cause
        board.say(b"x")
        await heard.until_data(b"x")
        await heard.until_code("silent")
        assert heard.link.status.since_ns == heard.link.status.t_last_rx_ns + 50_000_000


async def test_closing_does_not_lower_dtr_and_echoes_nothing(machine: FakeMachine, board: PtyBoard) -> None:
    board.plug("ttyACM0")
    watcher = os.open(board.tty, os.O_RDWR | os.O_NOCTTY)
    before = termios.tcgetattr(watcher)
    before[2] |= termios.HUPCL
    before[3] |= termios.ECHO | termios.ICANON
    termios.tcsetattr(watcher, termios.TCSANOW, before)
    async with listening(open_link(f"serial://{board.tty}", finder=machine.finder)) as heard:
        await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
        flags = termios.tcgetattr(watcher)
    os.close(watcher)
    assert not flags[2] & termios.HUPCL
    assert not flags[3] & (termios.ECHO | termios.ICANON)
    assert flags[2] & termios.CSIZE == termios.CS8
    assert not flags[2] & (termios.PARENB | termios.CSTOPB)


async def test_close_ends_the_chunks_of_a_link_that_never_opened(machine: FakeMachine) -> None:
    async with listening(open_link("serial:///dev/no-such-port", finder=machine.finder)) as heard:
        await heard.until_code("port-missing")
    assert heard.ended
    assert heard.link.status.state is LinkState.ENDED


async def test_a_closed_link_can_be_listened_to_again(machine: FakeMachine, board: PtyBoard) -> None:
    device = board.plug("ttyACM0")
    link = open_link(f"serial://{device}", finder=machine.finder)
    for word in (b"first", b"second"):
        async with listening(link) as heard:
            await heard.until(lambda: link.status.state is LinkState.OPEN)
            board.say(word)
            await heard.until_data(word)
    assert link.status.bytes_in == 11
