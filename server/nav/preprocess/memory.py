"""What the preprocessing remembers between calls: counters per sensor and the open step, as flat arrays."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.types import Float, Int

# Counters (int64), one table per sensor kind: samples, repeated, and refusals by reason.
N_SAMPLES: Final = 0
N_REPEATED: Final = 1
N_RANGE: Final = 2
N_ORDER: Final = 3
N_STUCK: Final = 4
N_GAPS: Final = 5
N_FIELD: Final = 6
N_NO_FIX: Final = 7
N_CLIPPED: Final = 8
N_COUNTERS: Final = 9
KINDS: Final = 11

NEVER_NS: Final = -1e18

# Float state.
S_T_LAST: Final = 0  # previous IMU stamp, ns; NEVER_NS before the first
S_T_START: Final = 1  # start of the open step, ns
S_CELL: Final = 2  # number of the open step on the time grid
S_Q: Final = 3  # (4) rotation since the start of the step
S_DVEL: Final = 7  # (3)
S_GYRO: Final = 10  # (3) previous sample
S_ACCEL: Final = 13  # (3)
S_GYRO_SUM: Final = 16  # (3)
S_ACCEL_SUM: Final = 19  # (3)
S_COUNT: Final = 22
S_GAP: Final = 23
S_SLOW: Final = 24  # (3) low-passed specific force
S_VIBRATION2: Final = 27
S_TEMPERATURE: Final = 28
S_SAME: Final = 29  # seconds of bit-identical IMU samples
S_LIVELY: Final = 30  # samples seen that differ from the one before
S_MAG_SCALE: Final = 31  # 0 = not yet found
S_MAG_BAD: Final = 32  # samples in a row that the scale does not explain
S_INTERVAL: Final = 33  # mean IMU interval, s
S_T_KIND: Final = 34  # (11) last stamp of each kind, ns; NEVER_NS before the first
S_RATE: Final = 45  # (11) mean interval of each kind, s
S_T_GAP: Final = 56  # end of the last hole, ns; NEVER_NS before the first
S_MAG_GOOD: Final = 57  # samples that the scale explained
S_RAW: Final = 58  # (6) previous IMU sample before calibration and filters
S_CLIP: Final = 64  # (6, 2) largest magnitude of each IMU axis and whether the last sample stood there (`clipping`)
S_T_CLIP: Final = 76  # stamp of the last clipped IMU sample, ns; NEVER_NS before the first
S_CLIP_NEAR: Final = 77  # axes whose last sample stood at their largest
S_SIZE: Final = 78


def new_memory() -> tuple[Float, Int]:
    """Return (s, n) as before the first sample."""
    s = np.zeros(S_SIZE)
    s[S_T_LAST] = NEVER_NS
    s[S_T_GAP] = s[S_T_CLIP] = NEVER_NS
    s[S_Q] = 1.0
    s[S_TEMPERATURE] = np.nan
    s[S_T_KIND : S_T_KIND + KINDS] = NEVER_NS
    return s, np.zeros((KINDS, N_COUNTERS), dtype=np.int64)
