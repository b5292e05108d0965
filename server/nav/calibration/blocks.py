"""Cuts IMU samples into short blocks of board time, sample by sample, so that where the stream was cut is forgotten."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.kernel import kernel
from server.nav.types import Float, Int

# One row per block. Channels 0-2 are the gyro, 3-5 the accelerometer.
B_T0: Final = 0  # ns of the first and the last sample
B_T1: Final = 1
B_N: Final = 2  # samples
B_GAP: Final = 3  # 1 when a hole or a step back in time lies before it
B_TEMPERATURE: Final = 4  # mean, °C
B_GYROS: Final = 5  # samples that had a gyro
B_FIRST: Final = 6  # number of the first sample in the stream
B_MEAN: Final = 7  # (6)
B_VAR: Final = 13  # (6) population variance within the block
B_MIN: Final = 19  # (6)
B_MAX: Final = 25  # (6)
B_AT_MIN: Final = 31  # (6) samples exactly at that value
B_AT_MAX: Final = 37  # (6)
B_ANGLE: Final = 43  # (3) ∫ gyro dt from the previous block's last sample, trapezoidal
B_SPAN: Final = 46  # s covered by that integral
B_SIZE: Final = 47

# Head of the state: then rows of 6 for the open block.
H_T_LAST: Final = 0
H_SEEN: Final = 1
H_ROW: Final = 2
H_OPEN: Final = 3  # samples in the open block
H_GAP: Final = 4
H_T0: Final = 5
H_TEMP: Final = 6
H_TEMPS: Final = 7
H_GYROS: Final = 8
H_ACCELS: Final = 9
H_FIRST: Final = 10
H_SPAN: Final = 11
H_GYRO: Final = 12  # (3) the last rate, NaN unknown
H_ANGLE: Final = 15  # (3)
H_T_GYRO: Final = 18
H_STEP: Final = 19  # ns, the smallest step of time so far, 0 before there is one
H_SIZE: Final = 20

W_FIRST, W_SUM, W_SQUARE, W_MIN, W_MAX, W_AT_MIN, W_AT_MAX, W_QUANTUM, W_PREVIOUS = range(9)

CHUNK: Final = 65536  # samples at a time, so that room is made for the blocks that came, not for those that could
GAP_S: Final = 0.35  # three lost samples at 10 Hz; a turn or a pose is not continued over more
GAP_STEPS: Final = 3.5  # nor over three lost samples of a slower log


@kernel("void(float64[::1], float64[:, ::1], float64[:, ::1], int64)")
def _emit(h: Float, w: Float, out: Float, at: int) -> None:
    """Write the open block to out[at] and start the next one."""
    row = out[at]
    row[B_T0], row[B_T1], row[B_N], row[B_GAP] = h[H_T0], h[H_T_LAST], h[H_OPEN], h[H_GAP]
    row[B_TEMPERATURE] = h[H_TEMP] / h[H_TEMPS] if h[H_TEMPS] > 0.0 else math.nan
    row[B_GYROS], row[B_FIRST], row[B_SPAN] = h[H_GYROS], h[H_FIRST], h[H_SPAN]
    for i in range(6):
        n = h[H_GYROS] if i < 3 else h[H_ACCELS]
        known = n > 0.0
        shift = w[W_SUM, i] / n if known else math.nan
        row[B_MEAN + i] = w[W_FIRST, i] + shift if known else math.nan
        row[B_VAR + i] = max(0.0, w[W_SQUARE, i] / n - shift * shift) if known else math.nan
        row[B_MIN + i], row[B_MAX + i] = w[W_MIN, i], w[W_MAX, i]
        row[B_AT_MIN + i], row[B_AT_MAX + i] = w[W_AT_MIN, i], w[W_AT_MAX, i]
    for i in range(3):
        row[B_ANGLE + i] = h[H_ANGLE + i]
        h[H_ANGLE + i] = 0.0
    h[H_OPEN], h[H_GAP], h[H_SPAN] = 0.0, 0.0, 0.0


@kernel("void(float64[::1], float64[:, ::1], int64, float64)")
def _take(h: Float, w: Float, i: int, x: float) -> None:
    """Add one value to channel i of the open block."""
    n = h[H_GYROS] if i < 3 else h[H_ACCELS]
    if n == 0.0:
        w[W_FIRST, i], w[W_SUM, i], w[W_SQUARE, i] = x, 0.0, 0.0
        w[W_MIN, i], w[W_MAX, i], w[W_AT_MIN, i], w[W_AT_MAX, i] = x, x, 0.0, 0.0
    step = abs(x - w[W_PREVIOUS, i])
    if step > 0.0 and step < w[W_QUANTUM, i]:
        w[W_QUANTUM, i] = step
    w[W_PREVIOUS, i] = x
    d = x - w[W_FIRST, i]
    w[W_SUM, i] += d
    w[W_SQUARE, i] += d * d
    if x < w[W_MIN, i]:
        w[W_MIN, i], w[W_AT_MIN, i] = x, 0.0
    if x > w[W_MAX, i]:
        w[W_MAX, i], w[W_AT_MAX, i] = x, 0.0
    w[W_AT_MIN, i] += 1.0 if x == w[W_MIN, i] else 0.0
    w[W_AT_MAX, i] += 1.0 if x == w[W_MAX, i] else 0.0


@kernel("void(float64[::1], float64, float64[::1])")
def _integrate(h: Float, t: float, row: Float) -> None:
    """Add the angle since the last sample that had a gyro."""
    dt = (t - h[H_T_GYRO]) * 1e-9
    for i in range(3):
        last = h[H_GYRO + i]
        if not math.isnan(last):
            h[H_ANGLE + i] += 0.5 * (last + row[i]) * dt
        h[H_GYRO + i] = row[i]
    if not math.isnan(last):
        h[H_SPAN] += dt
    h[H_T_GYRO] = t


@kernel("void(float64[::1])")
def _break(h: Float) -> None:
    """Nothing is continued over what follows."""
    h[H_GAP], h[H_OPEN], h[H_SPAN] = 1.0, 0.0, 0.0
    for i in range(3):
        h[H_GYRO + i], h[H_ANGLE + i] = math.nan, 0.0


@kernel("int64(int64[::1], float64[:, ::1], int64, float64, float64, float64[::1], float64[:, ::1], float64[:, ::1])")
def cut_blocks(
    t_ns: Int, rows: Float, needs: int, least_n: float, least_s: float, h: Float, w: Float, out: Float
) -> int:
    """Cut samples into blocks; return how many were completed.

    Args:
        t_ns: shape (n,), board time.
        rows: shape (n, ≥ 7), gyro, accelerometer, temperature.
        needs: samples without this sensor are passed over: 0 gyro, 1 accelerometer, 2 both.
        least_n, least_s: a block is complete when it has as many samples and spans as long.
        h, w: state, shapes (H_SIZE,) and (9, 6).
        out: shape (≥ (n + open samples) / least_n, B_SIZE).
    """
    done = 0
    for k in range(t_ns.shape[0]):
        row, t = rows[k], float(t_ns[k])
        h[H_ROW] += 1.0
        has_gyro = math.isfinite(row[0]) and math.isfinite(row[1]) and math.isfinite(row[2])
        has_accel = math.isfinite(row[3]) and math.isfinite(row[4]) and math.isfinite(row[5])
        if not ((has_gyro or needs == 1) and (has_accel or needs == 0)) or (h[H_SEEN] > 0.0 and t == h[H_T_LAST]):
            continue
        step = t - h[H_T_LAST]
        if h[H_SEEN] > 0.0 and (step < 0.0 or step > max(GAP_S * 1e9, GAP_STEPS * h[H_STEP])):
            if h[H_OPEN] >= least_n:
                _emit(h, w, out, done)
                done += 1
            _break(h)
        if h[H_SEEN] > 0.0 and step > 0.0 and (step < h[H_STEP] or h[H_STEP] == 0.0):
            h[H_STEP] = step
        if h[H_OPEN] == 0.0:
            h[H_T0], h[H_TEMP], h[H_TEMPS], h[H_GYROS], h[H_ACCELS] = t, 0.0, 0.0, 0.0, 0.0
            h[H_FIRST] = h[H_ROW] - 1.0
        h[H_T_LAST] = t
        h[H_SEEN] += 1.0
        h[H_OPEN] += 1.0
        if has_gyro:
            for i in range(3):
                _take(h, w, i, row[i])
            h[H_GYROS] += 1.0
            _integrate(h, t, row)
        if has_accel:
            for i in range(3, 6):
                _take(h, w, i, row[i])
            h[H_ACCELS] += 1.0
        if math.isfinite(row[6]):
            h[H_TEMP] += row[6]
            h[H_TEMPS] += 1.0
        if h[H_OPEN] >= least_n and t - h[H_T0] >= least_s * 1e9:
            _emit(h, w, out, done)
            done += 1
    return done


class BlockTable:
    """The blocks of a stream so far, at most one open; memory is 376 bytes a block."""

    def __init__(self, *, needs: int, least_n: int, least_s: float) -> None:
        """Start empty.

        Args:
            needs: 0 samples with a gyro, 1 with an accelerometer, 2 with both.
            least_n: samples in a block, at least.
            least_s: seconds it spans, at least.
        """
        self._needs, self._least_n, self._least_s = needs, float(least_n), least_s
        self._head = np.zeros(H_SIZE)
        self._head[H_GYRO : H_GYRO + 3] = math.nan
        self._work = np.zeros((9, 6))
        self._work[W_QUANTUM], self._work[W_PREVIOUS] = math.inf, math.nan
        self._rows = np.empty((64, B_SIZE))
        self._used = 0

    def feed(self, t_ns: Int, rows: Float) -> None:
        """Take samples, rows as in `SAMPLE_COLUMNS[Kind.IMU]`."""
        t, data = np.ascontiguousarray(t_ns, dtype=np.int64), np.ascontiguousarray(rows, dtype=np.float64)
        for at in range(0, len(t), CHUNK):
            self._take(t[at : at + CHUNK], data[at : at + CHUNK])

    def _take(self, t_ns: Int, rows: Float) -> None:
        most = self._used + int((self._head[H_OPEN] + len(t_ns)) / self._least_n) + 1
        if most > len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty((max(most - self._used, self._used), B_SIZE))])
        out = self._rows[self._used :]
        self._used += cut_blocks(t_ns, rows, self._needs, self._least_n, self._least_s, self._head, self._work, out)

    def flush(self) -> None:
        """Complete the open block however short it is: the stream, or the range that was asked for, ends here."""
        if self._head[H_OPEN] > 0.0:
            if self._used == len(self._rows):
                self._rows = np.concatenate([self._rows, np.empty((1, B_SIZE))])
            _emit(self._head, self._work, self._rows, self._used)
            self._used += 1

    @property
    def rows(self) -> Float:
        """The complete blocks, shape (k, B_SIZE); a view."""
        return self._rows[: self._used]

    @property
    def samples(self) -> int:
        """Samples taken, those of the open block included."""
        return int(self._head[H_SEEN])

    @property
    def open_samples(self) -> int:
        """Samples of the open block."""
        return int(self._head[H_OPEN])

    def resolution(self, at: int, largest: float) -> float:
        """Return the step of the sensor that begins at channel `at`; 0 when it is too fine to show, or never moved.

        Args:
            at: 0 gyro, 3 accelerometer.
            largest: what a step may be; two poses without noise differ by much more than one.
        """
        step = float(self.quantum[at : at + 3].min())
        return step if step <= largest else 0.0

    @property
    def quantum(self) -> Float:
        """The smallest step between two samples of each channel, shape (6,); infinite when it never moved."""
        return np.asarray(self._work[W_QUANTUM])
