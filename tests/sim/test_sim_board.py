"""The demo board through a real pseudo-terminal, opened as any serial port is."""

import itertools
import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import serial
from pymavlink.dialects.v20 import ardupilotmega as dialect

from server.sim import SimBoard, SimSettings, SimStream
from server.sim.stream import ONLY_HEARTBEAT


@pytest.fixture
def board() -> Iterator[SimBoard]:
    board = SimBoard(SimSettings(speed=3.0))
    board.start()
    yield board
    board.stop()


class Reader:
    """Reads a port to its messages; fails on a byte that is no part of a frame."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self._parser = dialect.MAVLink(None)

    def until(self, enough: Callable[[list[Any]], bool], timeout_s: float = 20.0) -> list[Any]:
        messages: list[Any] = []
        deadline = time.monotonic() + timeout_s
        while not enough(messages):
            assert time.monotonic() < deadline, f"only {len(messages)} messages came"
            messages += self._parser.parse_buffer(self._port.read(4096)) or []
        return messages


def named(messages: list[Any], name: str) -> list[Any]:
    return [m for m in messages if m.get_type() == name]


def request(message_id: int, interval_us: int) -> bytes:
    ground = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
    return bytes(ground.command_long_encode(1, 1, 511, 0, message_id, interval_us, 0, 0, 0, 0, 0).pack(ground))


def test_a_reader_that_asks_gets_the_streams_and_no_frame_is_lost(board: SimBoard) -> None:
    with serial.Serial(board.path, 921600, timeout=0.02, exclusive=True) as port:
        port.write(request(105, 3003) + request(31, 10_000) + request(108, 10_000))
        messages = Reader(port).until(lambda m: len(named(m, "HIGHRES_IMU")) > 1500)
    acks = named(messages, "COMMAND_ACK")
    assert [a.result for a in acks] == [0, 0, 0]
    sequence = [m.get_seq() for m in messages]
    assert [(b - a) % 256 for a, b in itertools.pairwise(sequence)] == [1] * (len(sequence) - 1)
    stamps = [m.time_usec for m in named(messages, "HIGHRES_IMU")]
    assert {b - a for a, b in itertools.pairwise(stamps)} == {3000}
    assert board.dropped_frames == 0


def test_a_silent_reader_sees_heartbeats_only_and_its_own_bytes_never_come_back(board: SimBoard) -> None:
    with serial.Serial(board.path, 57600, timeout=0.02) as port:
        port.write(b"\xfe\xfd is anybody there?\r\n\x03\x04\x11\x13")
        messages = Reader(port).until(lambda m: len(m) >= 5)
    assert {m.get_type() for m in messages} == {"HEARTBEAT"}


def test_without_a_reader_whole_frames_are_dropped_and_counted(board: SimBoard) -> None:
    """The board goes on without its reader; what the reader later misses is what the board says it dropped."""
    with serial.Serial(board.path, 921600, timeout=0.02) as port:
        reader = Reader(port)
        port.write(request(105, 3000))
        messages = reader.until(lambda m: len(m) > 5)
        deadline = time.monotonic() + 20.0
        while board.dropped_frames < 100:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        port.write(request(105, -1))
        messages += reader.until(lambda m: len(m) > 100 and {x.get_type() for x in m[-2:]} == {"HEARTBEAT"})
    missed = messages[-1].get_seq() - messages[0].get_seq() - (len(messages) - 1)
    assert missed % 256 == board.dropped_frames % 256


def test_the_port_is_gone_after_stop_and_a_new_start_is_a_new_power_up(board: SimBoard) -> None:
    path = board.path
    with pytest.raises(RuntimeError, match="runs already"):
        board.start()
    board.stop()
    board.stop()
    assert not os.path.exists(path)
    with serial.Serial(board.start(), 921600, timeout=0.02) as port:
        first = Reader(port).until(lambda m: len(m) >= 1)[0]
    assert first.get_seq() == 0


def test_the_terminal_carries_the_same_bytes_as_the_stream() -> None:
    board, stream = SimBoard(SimSettings(speed=20.0)), SimStream(SimSettings(), ONLY_HEARTBEAT)
    expected = b"".join(part for _, part in stream.run(20.0))
    fd = os.open(board.start(), os.O_RDONLY | os.O_NOCTTY)
    try:
        got = b""
        while len(got) < 300:
            got += os.read(fd, 4096)
    finally:
        os.close(fd)
        board.stop()
    assert got[:300] == expected[:300]
