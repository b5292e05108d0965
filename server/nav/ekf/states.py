"""The state table of `ins_ekf`: nominal state, error state, and how the packed covariance is laid out.

Error state: the attitude error is a small rotation vector in NED, q_true = Exp(δθ_n) ⊗ q_nominal, so its third
component is the heading error itself; every other error is true minus nominal. Fifteen states of the inertial error
model come first, then the magnetic block (Earth field and the bias fixed to the body), then the wind: the 23 states
of the model of the vehicle; a multirotor has its drag as well, through which it feels the wind. On top come the
sensors' own slow errors: the datum of the baro, the error of a stand-alone receiver that lasts for a minute
(ionosphere, orbits, multipath) and, where their data are told, the receiver's quicker error of about a second and the
gyro's scale and axes. A filter without them follows such an error, and no variance it computes knows of it; kept as
states [Bar-Shalom 2001, § 8.2: coloured measurement noise], P holds everything and σ is taken from it as it is.

The covariance is packed row by row of its lower triangle, so a filter without the later blocks is a prefix of the same
array and pays nothing for them: `work[W_DIM]` says how many states are active. A block inside the prefix that is not
in use has zero covariance and takes no noise; the first measurement that needs it starts it.
"""

from __future__ import annotations

from typing import Final

from server.nav.kernel import kernel

# Nominal state x: q_nb (4), velocity NED m/s, latitude rad, longitude rad, height m, gyro bias rad/s, accel bias m/s²,
# Earth field NED gauss, magnetic bias in the body gauss, wind (the air's motion over ground) north, east m/s, drag
# over mass and air speed 1/s, height less baro height m, error of the receiver's position NED m: slow part, quick
# part; what each gyro axis feels of the rate about each axis, less that about its own, row by row.
X_Q: Final = 0
X_VEL: Final = 4
X_POS: Final = 7
X_GYRO_BIAS: Final = 10
X_ACCEL_BIAS: Final = 13
X_FIELD: Final = 16
X_MAG_BIAS: Final = 19
X_WIND: Final = 22
X_DRAG: Final = 24
X_BARO: Final = 25
X_WANDER: Final = 26
X_JITTER: Final = 29
X_MIX: Final = 32
X_SIZE: Final = 41

# Error state: rotation NED rad, velocity NED m/s, position NED m, then as above.
ATT: Final = 0
VEL: Final = 3
POS: Final = 6
GYRO_BIAS: Final = 9
ACCEL_BIAS: Final = 12
FIELD: Final = 15
MAG_BIAS: Final = 18
WIND: Final = 21
DRAG: Final = 23
BARO: Final = 24
WANDER: Final = 25
JITTER: Final = 28
MIX: Final = 31
N: Final = 40
INERTIAL: Final = 15
"""Number of states without the magnetic and wind blocks."""
WITH_MAG: Final = 21
WITH_WIND: Final = 23
WITH_DRAG: Final = 24
WITH_BARO: Final = 25
WITH_WANDER: Final = 28
WITH_JITTER: Final = 31
PACKED: Final = N * (N + 1) // 2
"""Entries of the lower triangle of P, row by row."""


@kernel("int64(int64, int64)", inline=True)
def packed(i: int, j: int) -> int:
    """Return where P[i, j] = P[j, i] stands in the packed lower triangle."""
    if i < j:
        i, j = j, i
    return i * (i + 1) // 2 + j
