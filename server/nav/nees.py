"""State errors of the main lane against the reference lane, over the lane's own published σ (`consistency`).

Both come as rows of LANE_COLUMNS. The lane's rows are dense, so they are interpolated to the reference's stamps; five
of those a second are enough, for errors change slowly. Nothing is computed while there is no reference.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.consistency import GATHER, REFRESH_NS, Window, WindowTest
from server.nav.earth import curvature_radii
from server.nav.types import LANE_COLUMNS, Float, Int, LaneRows

REFERENCE: Final = "reference"
EVERY_NS: Final = 200_000_000
MAX_GAP_NS: Final = 100_000_000
"""Lane rows further apart than this are not interpolated."""
KEPT: Final = 1024
"""Lane rows remembered for a reference that comes late: 20 s at 50 Hz, 1 s at 1 kHz."""

GROUPS: Final = ("attitude", "velocity", "position")
_VEL: Final = LANE_COLUMNS.index("vel_n_m_s")
_LLA: Final = LANE_COLUMNS.index("lat_deg")
_SIGMA: Final = LANE_COLUMNS.index("sigma_att_x_rad")
_NO_T: Final = np.empty(0, dtype=np.int64)
_NO_ROWS: Final = np.empty((0, len(LANE_COLUMNS)))
_KNOWN: Final = (slice(0, 4), slice(_VEL, _VEL + 3), slice(_LLA, _LLA + 3))


def rotation_errors(q_nb: Float, q_nb_true: Float) -> Float:
    """Return the small rotation vector in NED of q_true ⊗ q*, shape (n, 3), rad, from rows of [w, x, y, z]."""
    w, v, tw, tv = q_nb[:, :1], -q_nb[:, 1:], q_nb_true[:, :1], q_nb_true[:, 1:]
    scalar = tw * w - (tv * v).sum(axis=1, keepdims=True)
    vector = tw * v + w * tv + np.cross(tv, v)
    norm = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(norm, np.abs(scalar))
    share = np.divide(angle, norm, out=np.full_like(norm, 2.0), where=norm > 0.0)
    return np.asarray(np.sign(scalar + (scalar == 0.0)) * vector * share)


def place_errors(lla: Float, lla_true: Float) -> Float:
    """Return north, east, down in m from one place to the true one nearby; latitude, longitude in degrees, height m."""
    lat_rad = np.radians(lla[:, 0])
    radii = np.array([curvature_radii(lat) for lat in lat_rad.tolist()]).reshape(-1, 2) + lla[:, 2:]
    turn_deg = np.remainder(lla_true[:, 1] - lla[:, 1] + 180.0, 360.0) - 180.0
    north_m = np.radians(lla_true[:, 0] - lla[:, 0]) * radii[:, 0]
    east_m = np.radians(turn_deg) * radii[:, 1] * np.cos(lat_rad)
    return np.column_stack([north_m, east_m, lla[:, 2] - lla_true[:, 2]])


def normalised_errors(lane: Float, truth: Float) -> tuple[Float, Float, Float]:
    """Return attitude, velocity and position errors over the lane's σ, each (n, 3), NED; unknown = NaN.

    Args:
        lane: shape (n, len(LANE_COLUMNS)), the estimate with its σ.
        truth: shape (n, len(LANE_COLUMNS)), of the same instants.
    """
    sigma = lane[:, _SIGMA : _SIGMA + 9]
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (
            rotation_errors(lane[:, :4], truth[:, :4]) / sigma[:, :3],
            (truth[:, _VEL : _VEL + 3] - lane[:, _VEL : _VEL + 3]) / sigma[:, 3:6],
            place_errors(lane[:, _LLA : _LLA + 3], truth[:, _LLA : _LLA + 3]) / sigma[:, 6:9],
        )
    return tuple(np.where(np.isfinite(part), part, np.nan) for part in x)  # type: ignore[return-value]  # three parts, as x has


def interpolated(at_ns: Int, t_ns: Int, rows: Float) -> Float:
    """Return rows of LANE_COLUMNS at other stamps, in a straight line between neighbours; NaN outside and over gaps."""
    if len(t_ns) < 2:
        return np.full((len(at_ns), rows.shape[1]), np.nan)
    right = np.clip(np.searchsorted(t_ns, at_ns), 1, len(t_ns) - 1)
    left = right - 1
    gap_ns = t_ns[right] - t_ns[left]
    share = ((at_ns - t_ns[left]) / np.maximum(gap_ns, 1))[:, None]
    before, after = rows[left], rows[right].copy()
    after[(before[:, :4] * after[:, :4]).sum(axis=1) < 0.0, :4] *= -1.0
    found = before + share * (after - before)
    found[:, :4] /= np.linalg.norm(found[:, :4], axis=1, keepdims=True)
    usable = (at_ns >= t_ns[left]) & (at_ns <= t_ns[right]) & (gap_ns <= MAX_GAP_NS)
    found[~usable] = np.nan
    return np.asarray(found)


class NeesBook:
    """Windows of normalised state errors of one lane: attitude, velocity, position."""

    def __init__(self, lane: str) -> None:
        """Watch the named lane."""
        self.lane = lane
        self._windows = {group: Window() for group in GROUPS}
        self._t_ns, self._rows = _NO_T, _NO_ROWS
        self._own: list[LaneRows] = []
        self._true: list[LaneRows] = []
        self._waiting = 0
        self._tests: list[tuple[str, WindowTest]] = []
        self._newest_ns = self._tested_ns = 0
        self._bucket = dict.fromkeys(GROUPS, -1)

    def add(self, lanes: tuple[LaneRows, ...]) -> None:
        """Take the rows of one call of the engine, of any lanes."""
        for rows in lanes:
            if rows.lane in {self.lane, REFERENCE} and len(rows.t_ns):
                (self._own if rows.lane == self.lane else self._true).append(rows)
                self._waiting += len(rows.t_ns)
                self._newest_ns = max(self._newest_ns, int(rows.t_ns[-1]))
        if self._waiting >= GATHER:
            self._settle()

    def tests(self) -> list[tuple[str, WindowTest]]:
        """Return the three tests by group, over a window that ends at most a second ago."""
        if not self._tests or self._newest_ns - self._tested_ns >= REFRESH_NS:
            self._settle()
            self._tests = [(group, window.test()) for group, window in self._windows.items()]
            self._tested_ns = self._newest_ns
        return self._tests

    def _settle(self) -> None:
        """Compare what has come, as far as the lane reaches; keep the rest."""
        if not self._waiting:
            return
        if self._own:
            self._t_ns = np.concatenate([self._t_ns, *(rows.t_ns for rows in self._own)])
            self._rows = np.concatenate([self._rows, *(rows.data for rows in self._own)])
        truth = self._true
        self._own, self._true, self._waiting = [], [], 0
        if truth:
            self._compare(np.concatenate([r.t_ns for r in truth]), np.concatenate([r.data for r in truth]))
        self._t_ns, self._rows = self._t_ns[-KEPT:], self._rows[-KEPT:]

    def _compare(self, t_ns: Int, truth: Float) -> None:
        ahead = t_ns > (self._t_ns[-1] if len(self._t_ns) else -1)
        if ahead.any():
            rest = slice(-KEPT, None)
            self._true = [LaneRows(lane=REFERENCE, t_ns=t_ns[ahead][rest], data=truth[ahead][rest])]
            t_ns, truth = t_ns[~ahead], truth[~ahead]
        for i, group in enumerate(GROUPS):
            chosen = self._thinned(group, t_ns, np.asarray(np.isfinite(truth[:, _KNOWN[i]]).all(axis=1)))
            if len(chosen):
                own = interpolated(t_ns[chosen], self._t_ns, self._rows)
                self._windows[group].add(t_ns[chosen], normalised_errors(own, truth[chosen])[i])

    def _thinned(self, group: str, t_ns: Int, known: NDArray[np.bool_]) -> Int:
        """Return the rows to use: the first known one of every 200 ms."""
        rows = np.flatnonzero(known)
        bucket = t_ns[rows] // EVERY_NS
        fresh = bucket > np.concatenate(([self._bucket[group]], bucket[:-1]))
        if len(rows):
            self._bucket[group] = int(max(self._bucket[group], bucket.max()))
        return rows[fresh]
