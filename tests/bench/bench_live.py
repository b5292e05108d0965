"""What navdeck costs and how late it is while a recorded board speaks to it: a real `serve`, a real pseudo-terminal.

Run by hand: python tests/bench/bench_live.py [--seconds 40] [--only start,headless,latency,browser] [--log LOG.tlog].
With --only equal the whole log is played once (182 s) and the rows of a WebSocket client are compared with `navdeck
replay`'s, bit for bit.
The server's CPU time is read from /proc (all its threads; the browser, the board and this program excluded), in
windows of which the median counts, because other programs share the machine: its load is printed. Latency is the
time from the end of the write of that IMU frame which closes a navigation step to the receipt of its row. Exit code 1
when a target is missed.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import multiprocessing
import os
import shutil
import statistics
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import numpy as np
from websockets.asyncio.client import connect

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY))  # what the tests have too

from tests.conftest import CHROMIUM_ARGS, CHROMIUM_NAMES, use_own_node_without_libatomic  # noqa: E402
from tests.live.processes import Server, emulated_board, serving, wait_for  # noqa: E402

MISSION = REPOSITORY.parent / "shared/data/ardupilot_sitl/mission.tlog"
WINDOWS = 4
SETTLE_S = 6.0
HIGHRES_IMU = 105
VIEWPORT = {"width": 1200, "height": 800}
MS = 1e3


class Figure(NamedTuple):
    """One line of the table."""

    name: str
    measured: float
    target: float
    unit: str
    note: str = ""

    @property
    def line(self) -> str:
        verdict = "ok" if self.measured <= self.target else "MISSED"
        measured, target = f"{self.measured:.2f} {self.unit}", f"≤ {self.target:g} {self.unit}"
        return f"{self.name:34s} | {measured:>13} | {target:>9} | {verdict:6} | {self.note}"


def start_time(folder: Path, link: str, times: int = 3) -> Figure:
    """Start it several times; the first one reads the files from the disk and is not counted."""
    taken = []
    for _ in range(times + 1):
        server = Server(folder, link)
        try:
            taken.append(server.wait())
        finally:
            server.stop()
    note = ", ".join(f"{one:.2f}" for one in taken[1:]) + f"; first {taken[0]:.2f}"
    return Figure("start: GET / and /readyz", statistics.median(taken[1:]), 3.0, "s", note)


def headless(folder: Path, link: str, seconds: float) -> Figure:
    """Nobody looks."""
    with serving(folder, link) as server:
        time.sleep(SETTLE_S)
        shares = server.percent(seconds, WINDOWS)
        return Figure("CPU of the server, headless", statistics.median(shares), 5.0, "%", _shares(server, shares))


def with_browser(folder: Path, link: str, seconds: float) -> Figure:
    """One real page with its 3D view."""
    from playwright.sync_api import sync_playwright

    use_own_node_without_libatomic()
    chromium = os.environ.get("NAVDECK_CHROMIUM") or next(filter(None, map(shutil.which, CHROMIUM_NAMES)))
    with serving(folder, link) as server, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=CHROMIUM_ARGS)
        page = browser.new_page(viewport=VIEWPORT)
        page.goto(f"http://127.0.0.1:{server.port}/", wait_until="domcontentloaded")
        view = page.frame_locator("section.view iframe")
        view.locator("canvas[data-engine^=three]").wait_for(state="attached", timeout=60_000)
        page.wait_for_timeout(2 * SETTLE_S * MS)
        shares = server.percent(seconds, WINDOWS)
        note = f"{_shares(server, shares)}; page says: {page.locator('#state-sentence').inner_text()[:40]!r}"
        browser.close()
    return Figure("CPU of the server, one browser", statistics.median(shares), 15.0, "%", note)


def _shares(server: Server, shares: list[float]) -> str:
    return f"{', '.join(f'{share:.1f}' for share in shares)}; board {server.board()['state']}"


def _record(log: Path, link: Path, seconds: float, answer: Connection) -> None:
    """Be the board; tell when the last byte of each IMU frame had been written."""
    from server.emulate import Emulator

    written: dict[int, int] = {}

    class Recorder(Emulator):
        def _write(self, frame: memoryview) -> None:
            super()._write(frame)
            if int.from_bytes(frame[7:10], "little") == HIGHRES_IMU:
                written[struct.unpack_from("<Q", frame, 10)[0]] = time.monotonic_ns()

    stop = threading.Event()
    with Recorder(log, now=True, link=link) as board:
        threading.Timer(seconds, stop.set).start()
        board.run(stop)
        answer.send(written)


async def _receive(
    port: int, seconds: float, on_subscribed: Callable[[], object] = lambda: None
) -> tuple[dict[int, int], dict[int, bytes]]:
    """Return when the row of each stamp (ns) was received, and the row as it was sent."""
    received: dict[int, int] = {}
    rows: dict[int, bytes] = {}
    async with connect(f"ws://127.0.0.1:{port}/api/v1/stream", compression=None, ping_interval=None) as client:
        wish = {"op": "subscribe", "id": 1, "topic": "boards/board/lanes/ins_ekf", "rate_hz": 1000}
        await client.send(json.dumps(wish))
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            message = await client.recv()
            now_ns = time.monotonic_ns()
            if isinstance(message, str):
                if json.loads(message)["op"] == "subscribed":
                    on_subscribed()
            else:
                _, _, n_rows, n_cols, _ = struct.unpack_from("<BBHHH", message)
                for row in np.frombuffer(message, "<f8", offset=8).reshape(n_rows, n_cols + 1):
                    received[int(row[0])], rows[int(row[0])] = now_ns, row[1:].tobytes()
    return received, rows


def _tick(late_ms: list[float], stop: threading.Event) -> None:
    """What the machine itself does to a program that sleeps as long as the link does."""
    while not stop.is_set():
        begin_s = time.monotonic()
        time.sleep(0.008)
        late_ms.append((time.monotonic() - begin_s) * MS - 8.0)


def latency(folder: Path, log: Path, seconds: float) -> list[Figure]:
    """A board in a process of its own, a client in this one; both read the same clock."""
    link = folder / "board"
    mine, theirs = multiprocessing.Pipe()
    board = multiprocessing.get_context("spawn").Process(
        target=_record, args=(log, link, seconds + SETTLE_S + 20.0, theirs), daemon=True
    )
    board.start()
    wait_for("the recording board", link.is_symlink)
    with serving(folder, f"serial://{link}?baud=921600") as server:
        time.sleep(SETTLE_S)
        stop, late_ms = threading.Event(), list[float]()
        ticking = threading.Thread(target=_tick, args=(late_ms, stop))
        ticking.start()
        received, _ = asyncio.run(_receive(server.port, seconds))
        stop.set()
        ticking.join()
        written = mine.recv()
    board.join()
    ages_ms = np.array([received[us * 1000] - at for us, at in written.items() if us * 1000 in received]) * 1e-6
    if len(ages_ms) < 0.99 * len(received) or not len(ages_ms):
        raise SystemExit(f"{len(received)} rows, only {len(ages_ms)} of them at the stamp of an IMU frame")
    p50, p99 = np.percentile(ages_ms, [50, 99])
    note = f"{len(ages_ms)} rows; p90 {np.percentile(ages_ms, 90):.1f}, max {ages_ms.max():.1f} ms"
    beside = f"a bare 8 ms sleep beside it: {np.percentile(late_ms, 99):.1f} ms late (p99), max {max(late_ms):.1f}"
    return [Figure("byte to WebSocket frame, p50", p50, 10.0, "ms", note), Figure("… p99", p99, 30.0, "ms", beside)]


def equal(folder: Path, log: Path) -> list[Figure]:
    """The whole log at its own pace, up to a client's rows; nothing but the tables of `replay` is the judge."""
    from server.emulate import Emulator
    from server.link.tlog import read_tlog
    from server.nav.types import CSV_LANE_COLUMNS
    from tests.live.boards import replayed

    t_ns, expected, _ = replayed(log, folder / "replay")
    stream = read_tlog(log)
    length_s = float(stream.stamps_us[-1] - stream.stamps_us[0]) * 1e-6
    link = folder / "board"
    with Emulator(log, now=True, link=link) as emulator, serving(folder, f"serial://{link}?baud=921600") as server:
        board = threading.Thread(target=emulator.run)
        _, rows = asyncio.run(_receive(server.port, length_s + SETTLE_S, board.start))
        board.join()
        time.sleep(1.0)
        stats = server.health()["protocol"]
    got = {stamp: np.frombuffer(row)[:CSV_LANE_COLUMNS] for stamp, row in rows.items()}
    wrong = sum(
        stamp not in got or not np.array_equal(got[stamp], row, equal_nan=True)
        for stamp, row in zip(t_ns.tolist(), expected, strict=True)
    )
    lost = len(stream.data) - stats["bytes_frames"]
    note = f"{stats['frames']} frames; board late {emulator.stats.late_s:.2f} s, paused {emulator.stats.paused_s:.2f} s"
    return [
        Figure("real time: rows that differ", wrong, 0, "", f"of {len(t_ns)} at a WebSocket client"),
        Figure("… bytes not in whole frames", lost, 0, "", f"of {len(stream.data)}; {note}"),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the running service at the pace of a recorded board.")
    parser.add_argument("--seconds", type=float, default=40.0, help="of each measurement")
    parser.add_argument("--only", default="start,headless,latency,browser", help="which, separated by commas")
    parser.add_argument("--log", type=Path, default=MISSION, help="the recorded board")
    wish = parser.parse_args()
    parts: dict[str, Callable[[Path], list[Figure]]] = {}
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))

        def emulated(measure: Callable[[str], Figure]) -> list[Figure]:
            with emulated_board(wish.log, folder) as link:
                return [measure(link)]

        parts["start"] = lambda folder: emulated(lambda link: start_time(folder, link))
        parts["headless"] = lambda folder: emulated(lambda link: headless(folder, link, wish.seconds))
        parts["equal"] = lambda folder: equal(folder, wish.log)
        parts["latency"] = lambda folder: latency(folder, wish.log, wish.seconds)
        parts["browser"] = lambda folder: emulated(lambda link: with_browser(folder, link, wish.seconds))
        print(f"{'figure':34s} | {'measured':>13} | {'target':>9} |        | windows", flush=True)
        missed = 0
        for name in wish.only.split(","):
            for figure in parts[name](folder):
                missed += figure.measured > figure.target
                print(figure.line + f"  [load {os.getloadavg()[0]:.1f}]", flush=True)
    raise SystemExit(1 if missed else 0)


if __name__ == "__main__":
    main()
