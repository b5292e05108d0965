"""Kalman filter of one angle and one gyro bias, once for roll and once for pitch [S4 §2 with S1 (3.17)].

State [angle, bias], `angle −= bias·dt − rate·dt`, measured by the accelerometer's angle. S4 prints no Q and R. All
noises are densities, so the filter is the same at every rate: R = r²/dt. The rate is the angle's own, as in
`complementary_1`, and so is its bias: the body axis' one while the board is near level. Six-axis: the yaw axis has no
measurement, so it is the first magnetic heading, then the integrated rate, without bias.
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
    S_BIAS,
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
S_P: Final = S_OWN + 3  # (2, 3) of roll, pitch: variance of the angle, covariance, variance of the bias
SIZE: Final = S_OWN + 9
PAR_GYRO: Final = PAR_OWN  # rad/s/√Hz
PAR_WALK: Final = PAR_OWN + 1  # rad/s²/√Hz
PAR_ANGLE: Final = PAR_OWN + 2  # rad/√Hz
PAR_BIAS: Final = PAR_OWN + 3  # rad/s
START_SIGMA_RAD: Final = math.radians(10.0)  # one accelerometer mean of a vehicle that may be moving


@kernel("void(float64[::1])")
def _set_quaternion(s: Float) -> None:
    q = quat_of(s[S_ANGLE], s[S_ANGLE + 1], s[S_ANGLE + 2])
    for i in range(4):
        s[S_Q + i] = q[i]


@kernel("void(float64[::1], float64[::1], float64[::1])")
def _start_axes(u: Float, par: Float, s: Float) -> None:
    f = force_at_end(u)
    s[S_ANGLE], s[S_ANGLE + 1] = level(f[0], f[1], f[2])
    s[S_ANGLE + 2] = 0.0
    for i in range(2):
        s[S_P + 3 * i], s[S_P + 3 * i + 1] = START_SIGMA_RAD**2, 0.0
        s[S_P + 3 * i + 2] = par[PAR_BIAS] ** 2


@kernel("void(int64, float64[::1], float64[::1], float64[::1])")
def _predict(i: int, u: Float, par: Float, s: Float) -> None:
    """Take the bias off an angle whose rate is added already; P = A P Aᵀ + Q [S4 §2], A = [[1, −dt], [0, 1]]."""
    dt = u[U_DT]
    s[S_ANGLE + i] -= s[S_BIAS + i] * dt
    p = s[S_P + 3 * i : S_P + 3 * i + 3]
    p[0] += -2.0 * dt * p[1] + dt * dt * p[2] + par[PAR_GYRO] ** 2 * dt
    p[1] -= dt * p[2]
    p[2] += par[PAR_WALK] ** 2 * dt


@kernel("void(int64, float64, float64, float64[::1])")
def _correct(i: int, angle_rad: float, r: float, s: Float) -> None:
    """Take the accelerometer's angle with variance r in rad²: K = P Hᵀ/(H P Hᵀ + R), x += K (z − H x) [S4 §2]."""
    p = s[S_P + 3 * i : S_P + 3 * i + 3]
    K0, K1 = p[0] / (p[0] + r), p[1] / (p[0] + r)
    innovation = wrap(angle_rad - s[S_ANGLE + i])
    s[S_ANGLE + i] = wrap(s[S_ANGLE + i] + K0 * innovation)
    s[S_BIAS + i] += K1 * innovation
    p[2] -= K1 * p[1]
    p[1] -= K0 * p[1]
    p[0] -= K0 * p[0]


@kernel("void(float64[::1], float64[::1], float64[::1])")
def _advance(u: Float, par: Float, s: Float) -> None:
    s[S_ANGLE], s[S_ANGLE + 1], s[S_ANGLE + 2] = angles_after(s[S_ANGLE], s[S_ANGLE + 1], s[S_ANGLE + 2], u)
    f = force_at_end(u)
    angle = level(f[0], f[1], f[2])
    measured = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]) >= LEAST_FORCE_M_S2
    for i in range(2):
        _predict(i, u, par, s)
        if measured:
            _correct(i, angle[i], par[PAR_ANGLE] ** 2 / u[U_DT], s)


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
                _start_axes(u, par, s)
        else:
            _advance(u, par, s)
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
        if not finite(s, SIZE):
            fail(s, rows[n])
            continue
        publish(u, s, par[PAR_IMU], rows[n])
        rows[n, 19], rows[n, 20] = s[S_BIAS], s[S_BIAS + 1]


class KalmanAngleBias(KernelLane):
    """The balancing robot's filter: two axes that do not know of each other."""

    name: ClassVar[str] = "kalman_angle_bias"
    provides: ClassVar[Provides] = "attitude"
    size: ClassVar[int] = SIZE
    kernel = staticmethod(run)
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            name="gyro_noise_rad_s_rthz", unit="rad/s/√Hz", default=1e-3, minimum=1e-6, maximum=1.0,
            meaning="Gyro noise density; larger trusts the accelerometer's angle more.",
        ),
        Parameter(
            name="gyro_bias_walk_rad_s2_rthz", unit="rad/s²/√Hz", default=1e-4, minimum=1e-9, maximum=1.0,
            meaning="How fast the gyro bias may wander; larger follows it sooner and takes more motion for bias.",
        ),
        Parameter(
            name="accel_angle_noise_rad_rthz", unit="rad/√Hz", default=0.1, minimum=1e-4, maximum=100.0,
            meaning="Noise density of the accelerometer's angle, accelerations included; larger trusts it less.",
        ),
        Parameter(
            name="gyro_bias_sigma_rad_s", unit="rad/s", default=0.02, minimum=1e-5, maximum=1.0,
            meaning="Standard deviation of the gyro bias at the start; larger learns it faster in the first seconds.",
        ),
    )  # fmt: skip

    def _turn(self, angle_rad: float) -> None:
        self._s[S_ANGLE + 2] = wrap(self._s[S_ANGLE + 2] + angle_rad)
        _set_quaternion(self._s)
