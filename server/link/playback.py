"""A file as a link: a .tlog at the pace of its stamps, any other file as raw bytes at a given rate."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Final

from server.link.causes import Trouble
from server.link.retry import RetryLink

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_BATCH_S: Final = 0.008
"""Frames due within this time leave together, as they would from a serial port."""

_FAST_BATCH: Final = 4096


class Playback:
    """What a file says and when: byte `offsets[i]` and what follows it is due `due_s[i]` after the start."""

    def __init__(self, data: bytes, offsets: NDArray[np.int64], due_s: NDArray[np.float64]) -> None:
        self.data, self.offsets, self.due_s = data, offsets, due_s

    @classmethod
    def of(cls, path: Path, bytes_per_s: float) -> Playback:
        """Return the file's contents; raise `OSError`, or `ValueError` for a .tlog that is none."""
        import numpy as np

        from server.link.tlog import read_tlog, schedule_s

        if path.suffix.lower() == ".tlog":
            log = read_tlog(path)
            return cls(log.data, log.offsets, schedule_s(log.stamps_us))
        data = path.read_bytes()
        if not data:
            raise ValueError("the file is empty.")
        step = max(1, round(bytes_per_s * _BATCH_S))
        starts = np.arange(0, len(data), step, dtype=np.int64)
        return cls(data, np.append(starts, len(data)), starts / bytes_per_s)


class PlaybackConnection:
    """A `Connection` that reads a file as a board would have sent it."""

    def __init__(self, playback: Playback, speed: float, loop: bool, ended: Trouble) -> None:
        self._playback, self._speed, self._loop, self._ended = playback, speed, loop, ended
        self._record = 0
        self._start_s = asyncio.get_running_loop().time()
        self._closed = asyncio.Event()
        self.fresh = True
        self.bytes_out = 0

    async def read(self) -> bytes:
        """Return what is due by now; at speed 0 the next piece at once."""
        if self._record >= len(self._playback.due_s):
            self._rewind()
        if self._speed:
            await self._wait_until_due()
        else:
            await asyncio.sleep(0)
        if self._closed.is_set():
            raise Trouble("closed")
        return self._take()

    def _rewind(self) -> None:
        if not self._loop:
            raise self._ended
        self._record, self.fresh = 0, True
        self._start_s = asyncio.get_running_loop().time()

    async def _wait_until_due(self) -> None:
        due_s = self._start_s + float(self._playback.due_s[self._record]) / self._speed + _BATCH_S
        pause_s = due_s - asyncio.get_running_loop().time()
        if pause_s > 1.0:  # a pause in the log: `close` must not wait for it
            try:
                await asyncio.wait_for(self._closed.wait(), pause_s)
            except TimeoutError:
                return
        else:
            await asyncio.sleep(max(0.0, pause_s))

    def _take(self) -> bytes:
        first, offsets = self._record, self._playback.offsets
        if self._speed:
            now_s = (asyncio.get_running_loop().time() - self._start_s) * self._speed
            last = int(self._playback.due_s.searchsorted(now_s, side="right"))
        else:
            last = int(offsets.searchsorted(int(offsets[first]) + _FAST_BATCH, side="right")) - 1
        self._record = min(max(last, first + 1), len(offsets) - 1)
        return self._playback.data[offsets[first] : offsets[self._record]]

    def write(self, data: bytes) -> None:
        """Drop: nobody listens."""

    def close(self) -> None:
        """End a pending read."""
        self._closed.set()


class FileLink(RetryLink):
    """`file://path?speed=1&loop=1&bytes_per_s=11520`; speed 0 is as fast as the reader takes it.

    Arrival times are those of the playback, so at another speed than 1 the board's clock seems to run at that speed.
    """

    def __init__(self, url: str, path: Path, speed: float, loop: bool, bytes_per_s: float) -> None:
        super().__init__(url)
        self._path, self._speed, self._loop, self._bytes_per_s = path, speed, loop, bytes_per_s

    def _open_details(self) -> dict[str, str]:
        return {"device": str(self._path), "path": str(self._path)}

    async def _connect(self) -> PlaybackConnection:
        try:
            playback = await asyncio.to_thread(Playback.of, self._path, self._bytes_per_s)
        except FileNotFoundError as error:
            raise Trouble("file-missing", path=str(self._path)) from error
        except OSError as error:
            raise Trouble("file-unreadable", path=str(self._path), error=f"{error.strerror}.") from error
        except ValueError as error:
            raise Trouble("file-unreadable", path=str(self._path), error=str(error)) from error
        return PlaybackConnection(playback, self._speed, self._loop, Trouble("file-ended", path=str(self._path)))
