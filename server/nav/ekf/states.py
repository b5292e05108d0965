"""The state table of `ins_ekf`: nominal state, error state, and how the packed covariance is laid out.

Error state: the attitude error is a small rotation vector in NED, q_true = Exp(δθ_n) ⊗ q_nominal, so its third
component is the heading error itself; every other error is true minus nominal. The fifteen states of the inertial
error model are followed by one for the local declination, which the magnetic model knows to half a degree only: without
it that half degree goes into the heading. Earth-field, magnetic-bias and wind blocks append themselves when they come.
"""

from __future__ import annotations

from typing import Final

from numba import njit

# Nominal state x: q_nb (4), velocity NED m/s, latitude rad, longitude rad, height m, gyro bias rad/s, accel bias m/s²,
# correction to the model's declination rad.
X_Q: Final = 0
X_VEL: Final = 4
X_POS: Final = 7
X_GYRO_BIAS: Final = 10
X_ACCEL_BIAS: Final = 13
X_DECLINATION: Final = 16
X_SIZE: Final = 17

# Error state: rotation NED rad, velocity NED m/s, position NED m, gyro bias rad/s, accel bias m/s², declination rad.
ATT: Final = 0
VEL: Final = 3
POS: Final = 6
GYRO_BIAS: Final = 9
ACCEL_BIAS: Final = 12
DECLINATION: Final = 15
N: Final = 16
PACKED: Final = N * (N + 1) // 2
"""Entries of the upper triangle of P, row by row."""


@njit("int64(int64, int64)", cache=True, inline="always")
def packed(i: int, j: int) -> int:
    """Return where P[i, j] = P[j, i] stands in the packed upper triangle."""
    if i > j:
        i, j = j, i
    return i * N - (i * (i - 1)) // 2 + (j - i)
