"""The state table of the attitude mode: nominal state, error state, memory, output; one flat array `s`.

Errors: the attitude error is a small rotation vector in NED, q_true = Exp(δθ_n) ⊗ q_nominal. Velocity and field errors
are what is left when that rotation is taken off, ξ = δx − δθ × x. All others are true minus nominal. Heading is
magnetic: the local field has no east component on average, by definition.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.constants import STANDARD_GRAVITY_M_S2
from server.nav.types import Float

# Error state; the nominal values stand in the same order at S_X (the attitude's three places there stay zero).
ATT: Final = 0  # (3) NED rad
VEL: Final = 3  # (3) NED m/s, bounded: nothing held in a hand or flown in a room keeps a speed for long
GYRO_BIAS: Final = 6  # (3) rad/s
GYRO_SCALE: Final = 9  # (9) scale and misalignment M, row by row: true rate = w − M w with w = measured − bias
ACCEL_BIAS: Final = 18  # (3) m/s²
MAG_OFFSET: Final = 21  # (3) body gauss: hard iron left over, and attached magnets
FIELD: Final = 24  # (3) field at this place, magnetic-north NED, gauss
MAG_DELAY: Final = 27  # s, age of the magnetometer's value at its stamp
N: Final = 28

S_Q: Final = 0  # (4) q_nb at the newest step, without the lead of the output
S_X: Final = 4  # (N)
S_P: Final = S_X + N  # (N*N) covariance, full and symmetric
S_DX: Final = S_P + N * N  # (N) correction being collected
S_PH: Final = S_DX + N  # (N) P Hᵀ
S_H: Final = S_PH + N  # (N) one row of H
# What the open block has collected: about 20 ms whatever the navigation rate.
S_B_DT: Final = S_H + N  # s
S_B_R: Final = S_B_DT + 1  # (9) ∫ R_nb dt
S_B_RW: Final = S_B_R + 9  # (27) ∫ R_nb[i, j] w[k] dt at 9 i + 3 j + k
S_B_GYRO: Final = S_B_RW + 27  # (3) ∫ measured rate dt
S_B_ACCEL: Final = S_B_GYRO + 3  # (3) ∫ measured specific force dt
S_B_TURN: Final = S_B_ACCEL + 3  # ∫ |w| dt, rad
S_B_VIBRATION: Final = S_B_TURN + 1  # m/s², largest
S_B_GAP: Final = S_B_VIBRATION + 1  # s, longest
S_B_SIZE: Final = S_B_GAP + 1 - S_B_DT
# Magnetic samples collected since the last fusion, and the account of contradictions.
S_M_COUNT: Final = S_B_DT + S_B_SIZE
S_M_Z: Final = S_M_COUNT + 1  # (3) Σ R_nb m
S_M_R: Final = S_M_Z + 3  # (9) Σ R_nb
S_M_W: Final = S_M_R + 9  # (3) Σ rate NED
S_M_SIZE: Final = 16
S_M_T: Final = S_M_COUNT + S_M_SIZE  # time of the last fusion, ns
S_M_MEAN: Final = S_M_T + 1  # (3) running mean of the innovation in the body, gauss
S_REF: Final = S_M_MEAN + 3  # (2) usual horizontal and downward field, gauss
S_HAS_REF: Final = S_REF + 2  # 1 = the usual field comes from a model, 0 = learned
# Rest detection: running means, variances summed over the axes.
S_R_GYRO: Final = S_HAS_REF + 1  # (3) rad/s
S_R_ACCEL: Final = S_R_GYRO + 3  # (3) m/s²
S_R_GYRO_VAR: Final = S_R_ACCEL + 3
S_R_ACCEL_VAR: Final = S_R_GYRO_VAR + 1
S_R_STILL_S: Final = S_R_ACCEL_VAR + 1  # s
S_REST: Final = S_R_STILL_S + 1  # 1 = at rest
# Status.
S_STARTED: Final = S_REST + 1  # 1 = there is an attitude
S_AGAIN: Final = S_STARTED + 1  # 1 = there was one before: biases are known
S_HEADING: Final = S_AGAIN + 1  # H_*
S_DISTURBED: Final = S_HEADING + 1  # D_*
S_T: Final = S_DISTURBED + 1  # end of the newest step, ns
S_W: Final = S_T + 1  # (3) newest corrected rate, body rad/s
S_GRAVITY: Final = S_W + 3  # m/s²
S_FAILURES: Final = S_GRAVITY + 1  # times the state was no number and was started again
S_SIZE: Final = S_FAILURES + 1

H_NONE: Final = 0.0
H_PROVISIONAL: Final = 0.5  # taken while the tilt was poorly known; taken anew with every sample until it is known
H_KNOWN: Final = 1.0

# Why the magnetometer is not believed.
D_NONE: Final = 0.0
D_NO_MAG: Final = 1.0  # none was heard, or none for a second
D_GATE: Final = 2.0  # it contradicts the filter by more than the gate; not used
D_ATTACHED: Final = 3.0  # it does so steadily in the body's frame: its offset is being learned anew

# Output row of one step.
O_Q: Final = 0  # (4) q_nb, magnetic north, w ≥ 0, carried forward over the IMU's own delay
O_GYRO_BIAS: Final = 4  # (3) rad/s
O_ATT_SIGMA: Final = 7  # (3) NED rotation vector, rad
O_BIAS_SIGMA: Final = 10  # (3) rad/s
O_MAG_OFFSET: Final = 13  # (3) body gauss
O_OFFSET_SIGMA: Final = 16  # (3) gauss
O_DISTURBED: Final = 19  # D_*
O_REST: Final = 20  # 1 = at rest
O_HEADING: Final = 21  # H_*
O_SIZE: Final = 22


def new_memory() -> Float:
    """Return s, shape (S_SIZE,), as before the first step."""
    s = np.zeros(S_SIZE)
    s[S_Q], s[S_GRAVITY], s[S_DISTURBED], s[S_M_T] = 1.0, STANDARD_GRAVITY_M_S2, D_NO_MAG, -1e18
    return s
