"""The demo board on a real pseudo-terminal: whoever opens the port finds what a serial board would show there."""

from __future__ import annotations

import contextlib
import os
import queue
import select
import threading
import time
import tty
from collections import deque
from concurrent.futures import Future
from dataclasses import replace
from typing import Final

from server.sim.settings import SimSettings
from server.sim.stream import ONLY_HEARTBEAT, SimStream
from server.simulator import Command, DropLink, SimulatorState

BATCH_S: Final = 0.004
"""Bytes leave at least this far apart: a wake-up costs more than what it sends."""
IDLE_S: Final = 0.05
"""Longest sleep; bounds how long `stop` waits."""
BUFFER_BYTES: Final = 65536
"""What the board holds back for a reader that is late, as boards on USB do: a second and a half of full streams."""
MAX_LAG_S: Final = 1.0
"""A host that stalls longer than this has stopped the board's clock too: nothing is sent in a hurry afterwards."""

_Question = tuple[Command | None, Future[SimulatorState]]


class SimBoard:
    """A demo board behind a port of its own; one thread, paced by the monotonic clock, never stuck on its reader."""

    def __init__(self, settings: SimSettings | None = None) -> None:
        self._settings = settings or SimSettings()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._port = _Port()
        self._asked: queue.SimpleQueue[_Question] = queue.SimpleQueue()
        self._mute_until_ns = 0
        self.path = ""

    @property
    def bytes_out(self) -> int:
        """Bytes the terminal took."""
        return self._port.bytes_out

    @property
    def dropped_frames(self) -> int:
        """Frames that found the terminal full, because nobody read, and were lost whole."""
        return self._port.dropped_frames

    def start(self) -> str:
        """Power the board up and return the path of its port, such as /dev/pts/3."""
        if self._thread is not None:
            raise RuntimeError("the demo board runs already; make another one, or stop it first")
        self.path = self._port.open()
        self._stopping.clear()
        self._thread = threading.Thread(target=self._live, name="sim-board", daemon=True)
        self._thread.start()
        return self.path

    def stop(self) -> None:
        """Pull the plug: the port is gone when this returns. Without a running board nothing happens."""
        if self._thread is None:
            return
        self._stopping.set()
        self._thread.join()
        self._thread = None
        self._port.close()
        self._answer(None, 0)

    def ask(self, command: Command | None = None) -> Future[SimulatorState]:
        """Have the board's own thread carry a command out, or None; the answer is its state then.

        The future ends with `ValueError` for what this board cannot do, with `ConnectionError` when it does not run.
        """
        answer: Future[SimulatorState] = Future()
        self._asked.put((command, answer))
        if self._thread is None or not self._thread.is_alive():
            self._answer(None, 0)
        return answer

    def _answer(self, stream: SimStream | None, board_ns: int) -> None:
        """Answer everything that was asked; without a stream there is no board any more."""
        while True:
            try:
                command, answer = self._asked.get_nowait()
            except queue.Empty:
                return
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                answer.set_result(self._carried_out(stream, command, board_ns))
            except (ValueError, ConnectionError) as error:
                answer.set_exception(error)

    def _carried_out(self, stream: SimStream | None, command: Command | None, board_ns: int) -> SimulatorState:
        if stream is None:
            raise ConnectionError("the demo board does not run")
        if isinstance(command, DropLink):
            self._mute_until_ns = time.monotonic_ns() + round(command.duration_s * 1e9)
        elif command is not None:
            stream.control(command)
        back_s = max(self._mute_until_ns - time.monotonic_ns(), 0) * 1e-9
        return replace(stream.state(board_ns), link_back_s=back_s)

    def _live(self) -> None:
        stream = SimStream(self._settings, ONLY_HEARTBEAT)
        speed = self._settings.speed
        start_ns = last_ns = time.monotonic_ns()
        while not self._stopping.is_set():
            now_ns = time.monotonic_ns()
            start_ns += max(now_ns - last_ns - round(MAX_LAG_S * 1e9), 0)
            last_ns = now_ns
            board_ns = round((now_ns - start_ns) * speed)
            self._answer(stream, board_ns)
            request = self._port.read()
            heard = now_ns >= self._mute_until_ns
            if request and heard:
                stream.receive(request, board_ns)
            frames = stream.advance(board_ns)
            self._port.write(frames if heard else [])
            wait_s = (stream.next_due_ns - board_ns) * 1e-9 / speed
            self._port.wait(min(max(wait_s, BATCH_S), IDLE_S))


class _Port:
    """The two ends of a pseudo-terminal; holding the far end too keeps its settings when readers come and go."""

    def __init__(self) -> None:
        self._near = self._far = -1
        self._queue: deque[bytes] = deque()
        self._waiting = 0
        self.bytes_out = 0
        self.dropped_frames = 0

    def open(self) -> str:
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        return os.ttyname(self._far)

    def close(self) -> None:
        os.close(self._near)
        os.close(self._far)
        self._near = self._far = -1
        self._queue.clear()
        self._waiting = 0

    def wait(self, timeout_s: float) -> None:
        """Sleep, but wake up when the ground says something."""
        select.select([self._near], [], [], timeout_s)

    def read(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            return os.read(self._near, 4096)
        return b""

    def write(self, frames: list[bytes]) -> None:
        """Send what waits and these frames, in order; frames past the buffer's end are dropped whole."""
        for frame in frames:
            if self._waiting + len(frame) > BUFFER_BYTES:
                self.dropped_frames += 1
            else:
                self._queue.append(frame)
                self._waiting += len(frame)
        while self._queue:
            batch = b"".join(self._queue)
            sent = self._take(batch)
            self._queue = deque([batch[sent:]] if sent < len(batch) else [])
            self._waiting -= sent
            if sent < len(batch):
                return

    def _take(self, data: bytes) -> int:
        try:
            taken = os.write(self._near, data)
        except BlockingIOError:
            taken = 0
        self.bytes_out += taken
        return taken
