"""The attitude that the board's motion processor computes itself (MPU6050 and kin), normalised [S4 §3].

Six-axis: its heading counts from wherever the board was switched on, and no declination applies. Between its samples
the rate carries it on, so a row is valid at its stamp; Euler angles are for people and follow S4's formulas, which are
those of `rotation.euler_from_quat`.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

from server.nav.codes import ALIGNING, DMP, FUSED
from server.nav.ekf.layout import M_DATA, M_KIND, M_STATUS, M_STEP, M_T, U_DT, U_DTHETA, U_GAP_S, U_T
from server.nav.kernel import kernel
from server.nav.lanes.attitude import (
    PAR_OWN,
    S_AGE,
    S_OWN,
    S_Q,
    S_STARTED,
    blank,
    fail,
    finite,
    integrate,
    publish,
    usable,
)
from server.nav.lanes.base import Parameter, Provides
from server.nav.lanes.kernel_lane import ARRAYS, KernelLane
from server.nav.rotation import quat_from_rotvec, quat_mul
from server.nav.types import Float

NORM_TOLERANCE: Final = 0.1  # a quaternion of another length is damage, not rounding of Q14 (1e-4)


@kernel("boolean(float64[::1], float64[::1], float64[::1])")
def _take(m: Float, u: Float, s: Float) -> bool:
    """Set the attitude from one sample, turned by the rate from its stamp to the step's end; False when damaged."""
    q = m[M_DATA : M_DATA + 4]
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if not abs(norm - 1.0) < NORM_TOLERANCE:
        return False
    age_s = max(-0.5, min(0.5, (u[U_T] - m[M_T]) * 1e-9))
    a = age_s / u[U_DT]
    t = quat_from_rotvec(a * u[U_DTHETA], a * u[U_DTHETA + 1], a * u[U_DTHETA + 2])
    turned = quat_mul(q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm, t[0], t[1], t[2], t[3])
    for i in range(4):
        s[S_Q + i] = turned[i]
    s[S_STARTED], s[S_AGE] = 1.0, age_s
    return True


@kernel(ARRAYS)
def run(steps: Float, meas: Float, par: Float, s: Float, rows: Float) -> None:
    """Run over navigation steps; see `KernelLane`. Without a sample for `hold_s` there is no attitude."""
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        if not usable(u):
            fail(s, rows[n])
            continue
        blank(rows[n], ALIGNING)
        integrate(u, s)
        s[S_AGE] += u[U_DT]
        if s[S_AGE] > par[PAR_OWN] or u[U_GAP_S] > par[PAR_OWN]:
            s[S_STARTED] = 0.0
        while k < meas.shape[0] and meas[k, M_STEP] <= n:
            if int(meas[k, M_KIND]) == DMP and int(meas[k, M_STATUS]) == FUSED:
                _take(meas[k], u, s)
            k += 1
        if not finite(s, S_OWN):
            fail(s, rows[n])
        elif s[S_STARTED] != 0.0:
            publish(u, s, 0.0, rows[n])


class Dmp(KernelLane):
    """Repeats the board's own quaternion at the navigation rate."""

    name: ClassVar[str] = "dmp"
    provides: ClassVar[Provides] = "attitude"
    size: ClassVar[int] = S_OWN
    kernel = staticmethod(run)
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            name="hold_s", unit="s", default=0.5, minimum=0.01, maximum=10.0,
            meaning="How long the last quaternion is carried on by the gyro before the attitude counts as lost.",
        ),
    )  # fmt: skip
