"""Counts per sensor and per aid since power-up, kept by the engine and read by the snapshot."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.consistency import NisBook, WindowTest, as_health, lane_verdict
from server.nav.nees import NeesBook
from server.nav.preprocess import memory as acc
from server.nav.preprocess.check import STUCK_S
from server.nav.types import (
    AID_COLUMNS,
    Aid,
    AidHealth,
    AidRows,
    AidStatus,
    ConsistencyHealth,
    Event,
    Float,
    Int,
    Kind,
    SensorHealth,
)

SENSORS: Final = (
    ("imu", Kind.IMU),
    ("mag", Kind.MAG),
    ("baro", Kind.BARO),
    ("gnss", Kind.GNSS),
    ("airspeed", Kind.AIRSPEED),
)
REASONS: Final = (
    ("range", acc.N_RANGE),
    ("order", acc.N_ORDER),
    ("stuck", acc.N_STUCK),
    ("gap", acc.N_GAPS),
    ("field-strength", acc.N_FIELD),
    ("no-fix", acc.N_NO_FIX),
)


PSEUDO: Final = (Aid.ZERO_VELOCITY, Aid.ZERO_RATE, Aid.GRAVITY, Aid.DRAG)
"""Aids that measure nothing but assume."""
OBSERVED: Final = AID_COLUMNS.index("observation_0")
RECENT_NS: Final = 10e9
"""How long a hole in the data stays worth a caution; the count stays for ever."""


def sensor_health(s: Float, n: Int, t0_ns: int) -> tuple[SensorHealth, ...]:
    """Return one entry per sensor that was ever seen, from the preprocessing's memory (`accumulate`)."""
    entries = []
    for name, kind in SENSORS:
        counters = n[kind]
        if not counters.any():
            continue
        refused = tuple((reason, int(counters[i])) for reason, i in REASONS if counters[i])
        interval_s = float(s[acc.S_RATE + kind])
        scale = float(s[acc.S_MAG_SCALE]) if kind == Kind.MAG and s[acc.S_MAG_SCALE] > 0.0 else 1.0
        seen = s[acc.S_T_KIND + kind] > acc.NEVER_NS
        entries.append(
            SensorHealth(
                name=name,
                t_last_ns=int(s[acc.S_T_KIND + kind]) + t0_ns if seen else -1,
                rate_hz=1.0 / interval_s if interval_s > 0.0 else math.nan,
                samples=int(counters[acc.N_SAMPLES]),
                repeated=int(counters[acc.N_REPEATED]),
                refused=refused,
                scale=scale,
                note=_note(kind, scale, counters, s),
                clipped=int(counters[acc.N_CLIPPED]),
            )
        )
    return tuple(entries)


def _note(kind: Kind, scale: float, counters: Int, s: Float) -> str:
    if kind == Kind.MAG and s[acc.S_MAG_BAD] > 0.0:
        return "mag-field-implausible"
    if kind == Kind.MAG and scale != 1.0:
        return "mag-scale-corrected"
    if kind == Kind.IMU and s[acc.S_SAME] > STUCK_S:
        return "imu-stuck"
    if kind == Kind.IMU and s[acc.S_T_LAST] - s[acc.S_T_CLIP] < RECENT_NS:
        return "imu-clipped"
    if kind == Kind.IMU and s[acc.S_T_LAST] - s[acc.S_T_GAP] < RECENT_NS:
        return "imu-gaps"
    return ""


class AidBook:
    """Fused and refused counts, the last record and the consistency of every aid."""

    def __init__(self) -> None:
        self._nis = NisBook()
        self._counts = np.zeros((len(Aid), len(AidStatus)), dtype=np.int64)
        self._last = np.full((len(Aid), len(AID_COLUMNS)), np.nan)
        self._t_fused_ns = np.full(len(Aid), -1, dtype=np.int64)

    def add(self, rows: AidRows) -> None:
        """Count the records of one call."""
        if not len(rows.t_ns):
            return
        self._nis.add(rows)
        aid, status = rows.data[:, 0].astype(np.int64), rows.data[:, 1].astype(np.int64)
        np.add.at(self._counts, (aid, status), 1)
        self._last[aid] = rows.data  # with repeated indices the last one stays
        fused = status == AidStatus.FUSED
        self._t_fused_ns[aid[fused]] = rows.t_ns[fused]

    def gnss_speed_m_s(self) -> float:
        """Return the horizontal speed in the newest GNSS velocity, believed or not; NaN when there was none."""
        row = self._last[Aid.GNSS_VELOCITY]
        return math.hypot(row[OBSERVED], row[OBSERVED + 1])  # many receivers give no vertical one

    def health(self) -> tuple[AidHealth, ...]:
        """Return one entry per aid that was ever seen."""
        entries, tests = [], self._nis.tests()
        for aid in Aid:
            counts = self._counts[aid]
            if counts.any():
                refused = tuple((status, int(counts[status])) for status in AidStatus if status and counts[status])
                nis = tests[aid]
                entries.append(
                    AidHealth(
                        aid=aid,
                        fused=int(counts[AidStatus.FUSED]),
                        refused=refused,
                        t_fused_ns=int(self._t_fused_ns[aid]),
                        last=tuple(self._last[aid].tolist()),
                        nis_mean=nis.mean,
                        nis_low=nis.low,
                        nis_high=nis.high,
                        nis_samples=nis.samples,
                        verdict=nis.verdict,
                    )
                )
        return tuple(entries)

    def sensor_tests(self) -> list[tuple[str, WindowTest]]:
        """Return the innovation tests of the aids that are sensors.

        Zero velocity, zero rate and gravity have variances for the worst board that still counts as resting, so that on
        a quiet bench they are conservative, and mean to be; so is drag, whose errors last from one to the next.
        """
        return [(f"{aid.name.lower()} NIS", test) for aid, test in self._nis.tests().items() if aid not in PSEUDO]


def consistency(book: AidBook, nees: NeesBook) -> tuple[ConsistencyHealth, ...]:
    """Return the state groups of a lane that have a reference, then the verdict on the lane as a whole."""
    groups = [(group, test) for group, test in nees.tests() if test.samples]
    everything = [(f"{group} NEES", test) for group, test in groups] + book.sensor_tests()
    whole = lane_verdict(nees.lane, everything)
    return (*(as_health(nees.lane, group, test) for group, test in groups), whole)


def mag_scale_event(scale: float, t_ns: int) -> Event | None:
    """Return what to tell a person when the board's field is in another unit than its protocol says."""
    if scale in (0.0, 1.0):
        return None
    text = (
        f"The board's magnetic field is {1.0 / scale:g} times too large for gauss; it is scaled by {scale:g}."
        " Nothing to do; newer firmware may send the specified unit."
    )
    return Event(t_ns=t_ns, code="mag-scale-corrected", severity="info", text=text, values=(("scale", scale),))
