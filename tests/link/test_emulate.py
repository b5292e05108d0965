from __future__ import annotations

import asyncio
import fcntl
import os
import select
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from server.emulate import Emulator, emulate
from server.link import LinkState, open_link
from server.link.tlog import read_tlog
from tests.link.support import listening
from tests.link.tlogs import frames, tlog


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "flight.tlog"
    path.write_bytes(tlog(frames(2000), step_us=500))
    return path


@contextmanager
def running(emulator: Emulator) -> Iterator[threading.Thread]:
    stop = threading.Event()
    thread = threading.Thread(target=emulator.run, args=(stop,))
    thread.start()
    try:
        yield thread
    finally:
        stop.set()
        thread.join()
        emulator.close()


def opened(device: str) -> int:
    return os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


def read_until(descriptor: int, holds: Callable[[bytes], bool], patience_s: float = 15.0) -> bytes:
    got, until_s = b"", time.monotonic() + patience_s
    while not holds(got) and time.monotonic() < until_s:
        if select.select([descriptor], [], [], 0.1)[0]:
            got += os.read(descriptor, 65_536)
    return got


@pytest.mark.parametrize("speed", [0.0, float("inf"), 1.0, 10.0])
async def test_the_link_reads_every_byte_of_the_log(log: Path, speed: float) -> None:
    emulator = Emulator(log, speed=speed)
    with running(emulator) as thread:
        async with listening(open_link(f"serial://{emulator.device}")) as heard:
            await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
            heard.link.write(b"!")
            await heard.until(lambda: not thread.is_alive())
            await heard.until(lambda: len(heard.data) >= 64_000)
    assert heard.data == b"".join(frames(2000))
    assert emulator.stats.bytes_sent == 64_000
    assert emulator.stats.bytes_received == 1


async def test_a_recorded_flight_passes_unharmed(shared_data: Path) -> None:
    path = shared_data / "ardupilot_sitl" / "static.tlog"
    emulator = Emulator(path, speed=40.0)
    with running(emulator) as thread:
        async with listening(open_link(f"serial://{emulator.device}?baud=921600")) as heard:
            await heard.until(lambda: heard.link.status.state is LinkState.OPEN)
            heard.link.write(b"!")
            await heard.until(lambda: not thread.is_alive())
            await heard.until(lambda: len(heard.data) >= emulator.stats.bytes_sent)
    assert heard.data == read_tlog(path).data


def test_it_says_nothing_before_its_reader_does(log: Path) -> None:
    emulator = Emulator(log, speed=0.0)
    with running(emulator):
        reader = opened(emulator.device)
        assert read_until(reader, bool, patience_s=0.3) == b""
        os.write(reader, b"\n")
        assert read_until(reader, bool).startswith(frames(1)[0])
        os.close(reader)


def test_now_does_not_wait(log: Path) -> None:
    emulator = Emulator(log, now=True)
    with running(emulator):
        reader = opened(emulator.device)
        assert read_until(reader, lambda got: len(got) >= 32)[:32] == frames(1)[0]
        os.close(reader)


def test_no_frame_leaves_before_its_time(log: Path) -> None:
    emulator = Emulator(log, speed=4.0)
    with running(emulator):
        reader = opened(emulator.device)
        start_s = time.monotonic()
        os.write(reader, b"!")
        size = 0
        while size < 32_000:
            size += len(read_until(reader, bool))
            assert time.monotonic() - start_s >= (size / 32 - 1) * 500e-6 / 4.0
        os.close(reader)


def test_what_the_reader_says_never_comes_back(log: Path) -> None:
    emulator = Emulator(log, speed=2.0)
    with running(emulator) as thread:
        reader = opened(emulator.device)
        got = b""
        while thread.is_alive():
            os.write(reader, b"\x07\x08echo?\r\n\x03\x04")
            got += read_until(reader, bool, patience_s=0.05)
        got += read_until(reader, lambda got: not got, patience_s=0.2)
        os.close(reader)
    assert got == b"".join(frames(2000))[: len(got)]
    assert len(got) == 64_000


def test_an_echo_and_a_lock_that_a_reader_leaves_are_undone(log: Path) -> None:
    emulator = Emulator(log)
    with running(emulator):
        reader = opened(emulator.device)
        settings = termios.tcgetattr(reader)
        settings[3] |= termios.ECHO | termios.ICANON
        termios.tcsetattr(reader, termios.TCSANOW, settings)
        fcntl.ioctl(reader, termios.TIOCEXCL)
        until_s = time.monotonic() + 15.0
        while termios.tcgetattr(reader)[3] & (termios.ECHO | termios.ICANON):
            assert time.monotonic() < until_s
            time.sleep(0.02)
        os.close(reader)


async def test_a_reader_may_go_and_come_back(log: Path) -> None:
    emulator = Emulator(log, speed=0.0, loop=True, now=True)
    with running(emulator) as thread:
        for _ in range(3):
            async with listening(open_link(emulator.device)) as heard:
                await heard.until(lambda: len(heard.data) > 200_000)
            assert b"".join(frames(3)) in heard.data
        assert thread.is_alive()
    assert emulator.stats.passes >= 9


def test_without_a_reader_the_board_stands_still_and_loses_nothing(log: Path) -> None:
    emulator = Emulator(log, speed=0.0)
    with running(emulator):
        reader = opened(emulator.device)
        os.write(reader, b"!")
        until_s, before = time.monotonic() + 15.0, -1
        while emulator.stats.bytes_sent != before and time.monotonic() < until_s:
            before = emulator.stats.bytes_sent
            time.sleep(0.2)
        assert 0 < before < 64_000
        assert read_until(reader, lambda got: len(got) == 64_000) == b"".join(frames(2000))
        os.close(reader)


def test_a_stable_name_is_made_and_removed(log: Path, tmp_path: Path) -> None:
    name = tmp_path / "board"
    name.symlink_to("/dev/pts/of-an-earlier-run")
    stop = threading.Event()
    seen: list[str] = []

    def ready(emulator: Emulator) -> None:
        seen.extend([emulator.device, os.readlink(name)])
        stop.set()

    emulate(log, link=name, on_ready=ready, stop=stop)
    assert seen[0] == seen[1]
    assert not name.is_symlink()


def test_a_file_is_never_replaced_by_the_stable_name(log: Path) -> None:
    with pytest.raises(FileExistsError):
        Emulator(log, link=log)
    assert log.stat().st_size == 2000 * 40


@pytest.mark.parametrize(("content", "speed", "remedy"), [(b"words", 1.0, "not a .tlog"), (None, -1.0, "negative")])
def test_a_bad_log_or_speed_is_refused(log: Path, content: bytes | None, speed: float, remedy: str) -> None:
    if content is not None:
        log.write_bytes(content)
    with pytest.raises(ValueError, match=remedy):
        Emulator(log, speed=speed)


async def test_stopping_while_it_waits_for_a_reader_ends_it(log: Path) -> None:
    emulator = Emulator(log)
    with running(emulator) as thread:
        await asyncio.sleep(0.05)
        assert thread.is_alive()
    assert not thread.is_alive()
    assert emulator.stats.bytes_sent == 0
