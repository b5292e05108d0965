"""Raw IMU and magnetometer rows → the navigation steps and measurements that the learning takes.

The two sensors arrive in turns of any length: what is held waits until the other has come as far, so that the result
does not depend on where the stream was cut.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.ekf import layout as at
from server.nav.preprocess.accumulate import accumulate
from server.nav.preprocess.memory import new_memory
from server.nav.types import Float, Int, Kind

RATE_HZ: Final = 50.0
MAX_HELD: Final = 100_000  # rows of the sensor that is ahead (a recording of minutes); beyond, the other is given up
REBOOT_NS: Final = 1_000_000_000  # a jump backwards that no reordering makes; the clock goes on after as long a hole


class _Clock:
    """One clock for both sensors that never goes back: each reboot is put a second after what was before it."""

    def __init__(self) -> None:
        self._shifts_ns = [0]
        self._epoch = {Kind.IMU: 0, Kind.MAG: 0}
        self._last_ns: dict[Kind, int] = {}
        self._newest_ns = 0

    def monotone(self, kind: Kind, t_ns: Int) -> Int:
        """Return the stamps of one sensor on that clock."""
        before = np.concatenate(([self._last_ns.get(kind, int(t_ns[0]))], t_ns[:-1]))
        out = np.empty_like(t_ns)
        begin = 0
        for cut in (*np.flatnonzero(t_ns < before - REBOOT_NS).tolist(), len(t_ns)):
            if cut > begin:
                out[begin:cut] = t_ns[begin:cut] + self._shifts_ns[self._epoch[kind]]
                self._newest_ns = max(self._newest_ns, int(out[begin:cut].max()))
            if cut < len(t_ns):
                self._boot(kind, int(t_ns[cut]))
            begin = cut
        self._last_ns[kind] = int(t_ns[-1])
        return out

    def _boot(self, kind: Kind, t_ns: int) -> None:
        self._epoch[kind] += 1
        if self._epoch[kind] == len(self._shifts_ns):
            self._shifts_ns.append(self._newest_ns + REBOOT_NS - t_ns)


class StepFeed:
    """Turns rows into steps of 1/`RATE_HZ` s and measurements; holds what cannot be used yet."""

    def __init__(self) -> None:
        """Start before the first sample."""
        self._clock = _Clock()
        self._memory, self._counters = new_memory()
        self._held: dict[Kind, list[tuple[Int, Float]]] = {Kind.IMU: [], Kind.MAG: []}
        self._count = {Kind.IMU: 0, Kind.MAG: 0}
        self._t0_ns = -1

    @property
    def t0_ns(self) -> int:
        """Board time that steps and measurements count from; −1 before the first sample."""
        return self._t0_ns

    @property
    def held(self) -> int:
        """Rows waiting."""
        return self._count[Kind.IMU] + self._count[Kind.MAG]

    def take(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Hold rows of `Kind.IMU` or `Kind.MAG`, shape (n, ROW_WIDTH)."""
        good = np.isfinite(rows[:, : 6 if kind == Kind.IMU else 3]).all(axis=1)
        if good.any():
            stamps = self._clock.monotone(kind, t_ns[good])
            if self._t0_ns < 0:
                self._t0_ns = int(stamps[0])
            self._held[kind].append((stamps, np.array(rows[good])))
            self._count[kind] += len(stamps)

    def _joined(self, kind: Kind) -> tuple[Int, Float]:
        held = self._held[kind]
        if len(held) > 1:
            held[:] = [(np.concatenate([t for t, _ in held]), np.concatenate([rows for _, rows in held]))]
        return held[0] if held else (np.empty(0, dtype=np.int64), np.empty((0, 14)))

    def _keep(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        self._held[kind] = [(t_ns, rows)] if len(t_ns) else []
        self._count[kind] = len(t_ns)

    def steps(self, is_last: bool = False) -> tuple[Float, Float]:
        """Return the steps and measurements that are complete; `is_last`: no more will come, wait for nothing."""
        t_imu, imu = self._joined(Kind.IMU)
        t_mag, mag = self._joined(Kind.MAG)
        limit = min(int(t_imu[-1]) if len(t_imu) else -1, int(t_mag[-1]) if len(t_mag) else -1)
        if is_last or self.held > MAX_HELD:
            limit = int(t_imu[-1]) if len(t_imu) else -1
        ready = int(np.searchsorted(t_imu, limit, side="right"))
        steps = self._integrate(t_imu[:ready], imu[:ready])
        self._keep(Kind.IMU, t_imu[ready:], imu[ready:])
        ends_ns = steps[:, at.U_T].astype(np.int64) + self._t0_ns
        index = np.searchsorted(ends_ns, t_mag, side="left")
        used = int(np.searchsorted(index, len(steps), side="left"))
        meas = np.full((used, at.M_SIZE), np.nan)
        meas[:, at.M_KIND], meas[:, at.M_STATUS] = Kind.MAG, 0.0
        meas[:, at.M_T], meas[:, at.M_STEP] = t_mag[:used] - self._t0_ns, index[:used]
        meas[:, at.M_DATA : at.M_DATA + 3] = mag[:used, :3]
        self._keep(Kind.MAG, t_mag[used:], mag[used:])
        return steps, meas

    def _integrate(self, t_ns: Int, rows: Float) -> Float:
        n = len(t_ns)
        steps, none = np.empty((n, at.U_SIZE)), np.empty((n, at.M_SIZE))
        if n == 0:
            return steps
        kind = np.full(n, Kind.IMU, dtype=np.uint8)
        t_ns, rows = np.ascontiguousarray(t_ns), np.ascontiguousarray(rows)
        count, _ = accumulate(kind, t_ns, rows, self._t0_ns, RATE_HZ, self._memory, self._counters, steps, none)
        return steps[:count]
