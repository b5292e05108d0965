"""How to read a board's port: cost and latency of the link's reader beside the usual ways, on a real pseudo-terminal.

Run by hand: python tests/bench/bench_link.py [seconds]. A process of its own writes 63-byte frames 1000 times a second;
each reader runs in a fresh process, which counts its own CPU time. Trust the ratios to `the link`, not the times.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import resource
import struct
import sys
import threading
import time
import tty
from collections.abc import AsyncIterator, Callable
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import serial
import uvloop

from server.link.causes import Trouble
from server.link.find import Finder
from server.link.pipe import PipeConnection
from server.link.tty import open_tty

FRAME = 63
RATE_HZ = 1000
Reader = Callable[[str, float], AsyncIterator[bytes]]


def write_frames(master: int, time_s: float) -> None:
    """Write a frame every millisecond, each with the time it left."""
    start_ns, count = time.monotonic_ns(), 0
    while count < time_s * RATE_HZ:
        wait_s = (start_ns + count * 1_000_000 - time.monotonic_ns()) * 1e-9
        if wait_s > 0.0:
            time.sleep(wait_s)
        os.write(master, struct.pack("<q", time.monotonic_ns()) + bytes(FRAME - 8))
        count += 1


async def with_link(device: str, drain_s: float) -> AsyncIterator[bytes]:
    connection = PipeConnection(open_tty(Path(device), 921_600, Finder()), Trouble("closed"), drain_s)
    try:
        while True:
            yield await connection.read()
    finally:
        connection.close()


async def with_thread(device: str, drain_s: float) -> AsyncIterator[bytes]:
    """Blocking os.read in a thread, resting `drain_s` after each, handed to the loop with call_soon_threadsafe."""
    port = serial.Serial(device, 921_600)
    tty.setraw(port.fd)
    os.set_blocking(port.fd, True)
    queue: asyncio.Queue[bytes] = asyncio.Queue()
    loop = asyncio.get_running_loop()

    def work() -> None:
        while data := os.read(port.fd, 16_384):
            if loop.is_closed():
                return
            loop.call_soon_threadsafe(queue.put_nowait, data)
            if drain_s:
                time.sleep(drain_s)

    threading.Thread(target=work, daemon=True).start()
    while True:
        yield await queue.get()


async def with_add_reader(device: str, _: float) -> AsyncIterator[bytes]:
    """A wake-up for every write."""
    port = serial.Serial(device, 921_600)
    tty.setraw(port.fd)
    os.set_blocking(port.fd, False)
    queue: asyncio.Queue[bytes] = asyncio.Queue()
    asyncio.get_running_loop().add_reader(port.fd, lambda: queue.put_nowait(os.read(port.fd, 16_384)))
    while True:
        yield await queue.get()


async def with_pyserial(device: str, size: float) -> AsyncIterator[bytes]:
    """Pyserial's read in a thread: `in_waiting or 1`, or a fixed size with a 20 ms time-out."""
    port = serial.Serial(device, 921_600, timeout=0.02 if size else None)
    queue: asyncio.Queue[bytes] = asyncio.Queue()
    loop = asyncio.get_running_loop()

    def work() -> None:
        while True:
            data = port.read(int(size) or port.in_waiting or 1)
            if loop.is_closed():
                return
            loop.call_soon_threadsafe(queue.put_nowait, data)

    threading.Thread(target=work, daemon=True).start()
    while True:
        yield await queue.get()


async def consume(reader: Reader, device: str, argument: float, time_s: float) -> tuple[float, list[int], int]:
    """Return CPU seconds, the age of the newest frame's first byte per batch and the number of batches."""
    ages: list[tuple[int, bytes]] = []
    begun: tuple[float, float] = (0.0, 0.0)
    received = 0
    async for data in reader(device, argument):
        now_ns = time.monotonic_ns()
        if not begun[0]:
            begun = (time.monotonic(), cpu_s())
        received += len(data)
        ages.append((now_ns, data))
        if time.monotonic() - begun[0] > time_s:
            break
    spent_s = (cpu_s() - begun[1]) / (time.monotonic() - begun[0])
    return spent_s, frame_ages(ages), len(ages)


def frame_ages(batches: list[tuple[int, bytes]]) -> list[int]:
    """Return how old each whole frame was when its last byte had arrived, ns."""
    stream = b"".join(data for _, data in batches)
    ends = np.cumsum([len(data) for _, data in batches])
    ages = []
    for at in range(0, len(stream) - FRAME + 1, FRAME):
        arrived_ns = batches[int(np.searchsorted(ends, at + FRAME))][0]
        ages.append(arrived_ns - struct.unpack_from("<q", stream, at)[0])
    return ages


def cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def measure(reader: Reader, argument: float, uv: bool, device: str, time_s: float, answer: Connection) -> None:
    main = consume(reader, device, argument, time_s)
    result = uvloop.run(main) if uv else asyncio.run(main)
    answer.send(result)
    os._exit(0)  # the readers of the peers block in a thread


def run(reader: Reader, argument: float, uv: bool, time_s: float) -> tuple[float, list[int], int]:
    """Measure one reader with a writer and a process of its own."""
    master, slave = os.openpty()
    tty.setraw(slave)
    mine, theirs = multiprocessing.Pipe()
    reading = multiprocessing.Process(target=measure, args=(reader, argument, uv, os.ttyname(slave), time_s, theirs))
    reading.start()
    time.sleep(1.0)
    writing = multiprocessing.Process(target=write_frames, args=(master, time_s + 0.5))
    writing.start()
    result = mine.recv()
    reading.join()
    writing.terminate()  # it may be stuck on a terminal that nobody reads any more
    writing.join()
    os.close(master)
    os.close(slave)
    return result


WAYS: list[tuple[str, Reader, float, bool]] = [
    ("the link: loop timer, 8 ms, uvloop", with_link, 0.008, True),
    ("the link: loop timer, 8 ms, asyncio", with_link, 0.008, False),
    ("the link: loop timer, 5 ms, uvloop", with_link, 0.005, True),
    ("the link: loop timer, 12 ms, uvloop", with_link, 0.012, True),
    ("thread, os.read, rest 8 ms, uvloop", with_thread, 0.008, True),
    ("thread, os.read, rest 5 ms, uvloop", with_thread, 0.005, True),
    ("thread, os.read, every write, uvloop", with_thread, 0.0, True),
    ("add_reader, every write, uvloop", with_add_reader, 0.0, True),
    ("add_reader, every write, asyncio", with_add_reader, 0.0, False),
    ("pyserial read(in_waiting or 1), thread", with_pyserial, 0.0, True),
    ("pyserial read(512), 20 ms time-out, thread", with_pyserial, 512.0, True),
]


def main() -> None:
    time_s = float(sys.argv[1]) if len(sys.argv) > 1 else 8.0
    print(
        f"{'reader at 63 kB/s, 1000 writes/s':44s}"
        f" {'% core':>7} {'ratio':>6} {'batches/s':>9} {'p50 ms':>7} {'p99 ms':>7}"
    )
    first = 0.0
    for name, reader, argument, uv in WAYS:
        spent, ages, batches = run(reader, argument, uv, time_s)
        first = first or spent
        p50, p99 = np.percentile(ages, [50, 99]) * 1e-6
        print(f"{name:44s} {100 * spent:7.2f} {spent / first:6.2f} {batches / time_s:9.0f} {p50:7.2f} {p99:7.2f}")


if __name__ == "__main__":
    main()
