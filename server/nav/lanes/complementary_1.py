"""First-order complementary filter, one axis at a time [S4 §1]: `angle = K1·angle_acc + (1 − K1)·(angle + rate·dt)`.

S4 prints neither K1 nor dt, so the weight is given as the time constant τ that it means at any rate,
K1 = 1 − exp(−dt/τ). The MPU6050 firmware that this formula comes from runs K1 = 0.02 at 200 Hz, which is τ = 0.25 s and
takes every acceleration for tilt (6° on a quadrotor's mission; the default 3°). Nor does S4 say whose rate: here it is
the angle's own, which the three body rates make together (the body axis' rate alone is wrong by tens of degrees as soon
as a tilted board turns). Near ±90° of pitch roll and yaw mean nothing, which is part of the comparison. Six-axis: the
heading is the first magnetic one, then the integrated rate.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

from server.nav.codes import ALIGNING
from server.nav.ekf.layout import U_DT, U_GAP_S
from server.nav.kernel import kernel
from server.nav.lanes.attitude import (
    GAP_RESTART_S,
    LEAST_FORCE_M_S2,
    LEAST_NORTH_GAUSS,
    MAGNETIC,
    NO_HEADING,
    PAR_IMU,
    PAR_OWN,
    S_HEADING,
    S_OWN,
    S_Q,
    S_STARTED,
    angles_after,
    blank,
    fail,
    finite,
    force_at_end,
    heading_error,
    level,
    publish,
    quat_of,
    start,
    take_field,
    usable,
    wrap,
)
from server.nav.lanes.base import Parameter, Provides
from server.nav.lanes.kernel_lane import ARRAYS, KernelLane
from server.nav.types import Float

S_ANGLE: Final = S_OWN  # (3) roll, pitch, yaw, rad
SIZE: Final = S_OWN + 3


@kernel("void(float64[::1])")
def _set_quaternion(s: Float) -> None:
    q = quat_of(s[S_ANGLE], s[S_ANGLE + 1], s[S_ANGLE + 2])
    for i in range(4):
        s[S_Q + i] = q[i]


@kernel("void(float64[::1], float64, float64[::1])")
def _advance(u: Float, tau_s: float, s: Float) -> None:
    """Take one step: the three rates, then roll and pitch towards the accelerometer's."""
    s[S_ANGLE], s[S_ANGLE + 1], s[S_ANGLE + 2] = angles_after(s[S_ANGLE], s[S_ANGLE + 1], s[S_ANGLE + 2], u)
    f = force_at_end(u)
    if math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]) >= LEAST_FORCE_M_S2:
        K1 = 1.0 - math.exp(-u[U_DT] / tau_s)
        angle = level(f[0], f[1], f[2])
        for i in range(2):
            s[S_ANGLE + i] = wrap(s[S_ANGLE + i] + K1 * wrap(angle[i] - s[S_ANGLE + i]))


@kernel(ARRAYS)
def run(steps: Float, meas: Float, par: Float, s: Float, rows: Float) -> None:
    """Run over navigation steps; see `KernelLane`."""
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        if not usable(u):
            fail(s, rows[n])
            continue
        blank(rows[n], ALIGNING)
        if u[U_GAP_S] > GAP_RESTART_S:
            s[S_STARTED] = 0.0
        elif s[S_STARTED] == 0.0:
            if start(u, s):
                f = force_at_end(u)
                s[S_ANGLE], s[S_ANGLE + 1] = level(f[0], f[1], f[2])
                s[S_ANGLE + 2] = 0.0
        else:
            _advance(u, par[PAR_OWN], s)
            _set_quaternion(s)
        k, count = take_field(meas, k, n, u, par, s)
        if s[S_STARTED] == 0.0:
            continue
        if count and s[S_HEADING] == NO_HEADING:
            angle, north = heading_error(s)
            if north > LEAST_NORTH_GAUSS:
                s[S_ANGLE + 2] = wrap(s[S_ANGLE + 2] + angle)
                s[S_HEADING] = MAGNETIC
                _set_quaternion(s)
        if finite(s, SIZE):
            publish(u, s, par[PAR_IMU], rows[n])
        else:
            fail(s, rows[n])


class Complementary1(KernelLane):
    """The smallest filter there is, and the noisiest under acceleration."""

    name: ClassVar[str] = "complementary_1"
    provides: ClassVar[Provides] = "attitude"
    size: ClassVar[int] = SIZE
    kernel = staticmethod(run)
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            name="time_constant_s", unit="s", default=5.0, minimum=0.02, maximum=100.0,
            meaning="Time in which the accelerometer's angle wins over the gyro's; larger is smoother and drifts more.",
        ),
    )  # fmt: skip

    def _turn(self, angle_rad: float) -> None:
        self._s[S_ANGLE + 2] = wrap(self._s[S_ANGLE + 2] + angle_rad)
        _set_quaternion(self._s)
