"""The raw samples of a job, kept as a sensor folder that `navdeck calibrate` and `navdeck replay` read back.

One CSV per sensor (`imu.csv`, `mag.csv`, …) with the columns of `SAMPLE_COLUMNS`, as server/replay/CONTRACT.md has it;
the contract ignores the columns it does not know (the IMU's temperature), and its `meta.toml` may be absent. Numbers
are the shortest decimals that read back to the same float64, so a fit of the files is the fit of the job, bit for bit.
"""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
import orjson

from server.nav.types import SAMPLE_COLUMNS, Float, Int, Kind

FILES: Final = {Kind.IMU: "imu.csv", Kind.MAG: "mag.csv", Kind.BARO: "baro.csv", Kind.AIRSPEED: "airspeed.csv"}
"""The kinds that are kept; others are not needed for a fit."""
MAX_BYTES: Final = 200_000_000  # of one job
MAX_PENDING_ROWS: Final = 400_000  # ten minutes of a fast board that no disk took


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """What is on disk; `stopped` says why nothing more was taken, "" while all was."""

    rows: int
    size_bytes: int
    stopped: str


class SampleFile:
    """Collects the samples of one job in memory and writes them when told; bounded in memory and on disk.

    `add` never blocks (event loop); `flush` and `close` write (a thread). Past a bound, or when the disk fails, it
    stops for good and says so: a record with an end can be fitted again, one with holes in it cannot.
    """

    def __init__(self, folder: Path, *, max_bytes: int = MAX_BYTES, max_pending_rows: int = MAX_PENDING_ROWS) -> None:
        """Make the folder.

        Raises:
            OSError: it cannot be made.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._max_bytes, self._max_pending = max_bytes, max_pending_rows
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self._pending: list[tuple[Kind, Int, Float]] = []
        self._pending_rows = self._rows = self._bytes = 0
        self._stopped = ""
        self._open: dict[Kind, BinaryIO] = {}

    def add(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples, shape (n,) and (n, ROW_WIDTH) as `Collector.feed` takes them; copied; other kinds ignored."""
        if kind not in FILES or not len(t_ns):
            return
        with self._lock:
            if self._stopped:
                return
            if self._pending_rows + len(t_ns) > self._max_pending:
                self._stopped = f"the disk was too slow: {self._pending_rows} samples were waiting to be written"
                return
            self._pending.append((kind, t_ns.copy(), rows[:, : len(SAMPLE_COLUMNS[kind])].copy()))
            self._pending_rows += len(t_ns)

    def flush(self) -> Kept:
        """Write what is pending; a disk that fails is a reason to stop, not an error."""
        with self._writing:
            with self._lock:
                pending, self._pending, self._pending_rows = self._pending, [], 0
            try:
                for kind, t_ns, rows in pending:
                    self._write(kind, t_ns, rows)
                for file in self._open.values():
                    file.flush()
            except OSError as error:
                self._stop(f"it could not be written: {error.strerror or error}")
            return self.kept

    def close(self) -> Kept:
        """Write the rest so that it outlives a power cut; further samples are not taken."""
        self.flush()
        with self._writing:
            self._stop("closed")
            try:
                for file in self._open.values():
                    with file:
                        file.flush()
                        os.fsync(file.fileno())
            except OSError as error:
                self._stop(f"it could not be written: {error.strerror or error}")
            self._open.clear()
        return self.kept

    @property
    def kept(self) -> Kept:
        """What was written so far."""
        return Kept(rows=self._rows, size_bytes=self._bytes, stopped=self._stopped)

    def _stop(self, reason: str) -> None:
        with self._lock:
            self._stopped = self._stopped or reason

    def _write(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        file, text = self._file(kind), csv_rows(t_ns, rows)
        if self._bytes + len(text) > self._max_bytes:
            self._max_bytes = self._bytes  # a smaller block later on must not slip in behind the hole
            return self._stop(f"it reached its limit of {self._bytes} bytes after {self._rows} samples")
        self._bytes += file.write(text)
        self._rows += len(t_ns)
        return None

    def _file(self, kind: Kind) -> BinaryIO:
        if kind not in self._open:
            file = self._open[kind] = (self.folder / FILES[kind]).open("ab")
            if file.tell() == 0:
                self._bytes += file.write(header(kind))
        return self._open[kind]


def header(kind: Kind) -> bytes:
    """Return the first line of a file of this kind."""
    return (",".join(("t_ns", *SAMPLE_COLUMNS[kind])) + "\n").encode()


def csv_rows(t_ns: Int, rows: Float) -> bytes:
    """Return one line a row; not finite = empty.

    Args:
        t_ns: shape (n,), n ≥ 1.
        rows: shape (n, columns of the kind).
    """
    text = orjson.dumps(np.ascontiguousarray(rows), option=orjson.OPT_SERIALIZE_NUMPY)
    cells = text[2:-2].replace(b"null", b"").decode().split("],[")
    return "".join(f"{stamp},{row}\n" for stamp, row in zip(t_ns.tolist(), cells, strict=True)).encode()
