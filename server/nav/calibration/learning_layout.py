"""Memory of the magnetometer's learning in flight: two filters of the same form, what they share, and parameters.

The field is followed in the frame that the raw gyro's integral makes, i; `R` maps the body to it. What the
magnetometer reads is then R m = f + R b + τ (R ω) × f: linear in the field f and in the offset b that is sought, with
the magnetometer's age τ, and a gyro bias w turns f slowly, df/dt = (R w) × f. Between two instants this is
m2 − R12 m1 = (I − R12) b; its length alone is S0's pair (3.21), |B2|² − |B1|² = 2 (B2 − B1)·b.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.types import Float

# Error state of one filter.
OFFSET: Final = 0  # (3) body, gauss
FIELD: Final = 3  # (3) frame i, gauss
GYRO: Final = 6  # (3) body, rad/s
DELAY: Final = 9  # s
N: Final = 10

# One filter.
F_X: Final = 0  # (N)
F_P: Final = F_X + N  # (N*N) full and symmetric
F_H: Final = F_P + N * N  # (N) scratch: row, gain's numerator, gain
F_PH: Final = F_H + N
F_K: Final = F_PH + N
F_E: Final = F_K + N  # mean of innovation² over what an undisturbed one has, over rotation that could tell
F_E_RAD: Final = F_E + 1  # rotation that it was taken over, rad
F_E_S: Final = F_E + 2  # and time, s
F_E_ALL: Final = F_E + 3  # the same mean over all of that rotation
F_SIZE: Final = F_E + 4

# Shared memory.
C_Q: Final = 0  # (4) q_ib at the newest step
C_T: Final = 4  # its end, ns; NEVER before the first
C_W: Final = 5  # (3) measured rate over it, rad/s
C_STARTED: Final = 8  # 1 = there is a field
# The open block.
C_B_DT: Final = 9  # s
C_B_R: Final = 10  # (9) ∫ R dt
C_B_TURN: Final = 19  # (3) ∫ measured rate dt, rad
C_B_PATH: Final = 22  # ∫ |measured rate| dt, rad
C_B_N: Final = 23  # magnetic samples
C_B_Z: Final = 24  # (3) Σ R m
C_B_RM: Final = 27  # (9) Σ R
C_B_W: Final = 36  # (3) Σ R ω
C_B_Z2: Final = 39  # Σ |m|²
C_B_SIZE: Final = 31
# Between blocks.
C_A_Q: Final = 40  # (4) q_ib where the offset was last learned from
C_STILL: Final = 44  # 1 = the last block was at rest
C_STILL_S: Final = 45
C_PATCH2: Final = 46  # unevenness of the field and of the sensor, gauss² per axis
C_RESIDUAL2: Final = 47  # what the strength |m − b| varies by under the best of all offsets, gauss²
C_TURNED: Final = 48  # (6) Σ θ (I − u uᵀ) since the offset changed, rad: xx yy zz xy xz yz
# Two explanations.
C_SUSPECT: Final = 54  # 1 = the field contradicts the offset
C_BAD_RAD: Final = 55  # rotation over which it has, rad
C_JUMP2: Final = 56  # gauss², what the contradiction amounts to
C_T_JUMP: Final = 57  # since when, ns
C_TRY_RAD: Final = 58  # rotation since the second filter was opened, rad
C_TRY_S: Final = 59
C_REFUSED: Final = 60  # constant offsets that failed, and agreements that did not last, one soon after the other
C_CHANGES: Final = 61
C_T_CHANGED: Final = 62
C_T_TRUSTED: Final = 63  # end of the last contradiction, ns
C_A_S: Final = 64  # s since the offset was last learned from
C_WHITE2: Final = 65  # white noise of one sample, gauss² per axis
C_WHITE_N: Final = 66  # samples that told it, bounded
C_U: Final = 67  # (4) mean of (R̄ᵀ z, |z|²), `learning_strength`
C_U_P: Final = C_U + 4  # (4, 4) and its covariance
C_U_RAD: Final = C_U_P + 16  # turning that they were taken over, bounded, rad
C_U_SIZE: Final = 21
C_P: Final = C_U + C_U_SIZE  # (3) body, mean sample of the block before, and how many samples it has
C_P_N: Final = C_P + 3
C_RING: Final = C_P_N + 1  # (RING, 5) end of step ns, q_ib
RING: Final = 64
RING_COLUMNS: Final = 5
C_HEAD: Final = C_RING + RING * RING_COLUMNS
C_SIZE: Final = C_HEAD + 1
NEVER_NS: Final = -1e18

# Parameters.
K_DELAY: Final = 0  # s, magnetometer: a sample stamped t is valid at t − delay
K_NOISE: Final = 1  # gauss, white, of one sample, until rest has told it
K_PATCH: Final = 2  # gauss, first guess at the unevenness
K_PATCH_MIN: Final = 3
K_PATCH_MAX: Final = 4
K_PATCH_RAD: Final = 5  # rad of turning over which it stays the same
K_OFFSET_SIGMA: Final = 6  # gauss
K_OFFSET_WALK: Final = 7  # shares of the unevenness/√s of motion
K_FIELD_WALK: Final = 8  # gauss/√s of motion
K_TURN: Final = 9  # rad/√rad: gyro scale and misalignment
K_GYRO_NOISE: Final = 10  # rad/√s
K_GYRO_SIGMA: Final = 11  # rad/s
K_GYRO_WALK: Final = 12  # rad/s/√s
K_DELAY_SIGMA: Final = 13  # s
K_SIZE: Final = 14


def default_parameters() -> Float:
    """Return the defaults, shape (K_SIZE,): consumer MEMS, indoors or in the air; orders of magnitude, not tuned."""
    k = np.zeros(K_SIZE)
    k[K_NOISE] = 0.007  # as in the attitude mode; BROAD's sensor at rest shows 6.8 mG
    k[K_PATCH] = 0.012  # between a flight in the open and a room
    k[K_PATCH_MIN] = 0.001  # a good sensor in the open air
    k[K_PATCH_MAX] = 0.02  # a place more uneven than that is a disturbance
    k[K_PATCH_RAD] = 1.0
    k[K_OFFSET_SIGMA] = 0.5  # an uncalibrated board beside its power wires
    k[K_OFFSET_WALK] = 0.15  # soft iron and places recur: no offset is known to better than about a quarter of it
    k[K_FIELD_WALK] = 1.5e-3  # 20 mG within a room crossed in some minutes, as in the attitude mode
    k[K_TURN] = 0.01  # 1 % of scale and misalignment, and turns between samples
    k[K_GYRO_NOISE] = 1e-3
    k[K_GYRO_SIGMA] = 0.03  # 1 to 2 °/s as left by the factory
    k[K_GYRO_WALK] = 1e-4
    k[K_DELAY_SIGMA] = 0.02
    return k
