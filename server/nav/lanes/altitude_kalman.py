"""`altitude_kalman`: state [down, speed, acceleration, acceleration bias] (NED vertical) [S3, algorithm 3].

The acceleration is a random walk driven by white jerk, the bias a slow random walk. Measured are the baro height and,
every step, the vertical acceleration plus its bias. S3 gives the states and measurements; the densities are chosen here
and are per √Hz, so that the result does not depend on the rates.

What this lane does with a baro spike: it refuses what lies outside its gate; a level that stays is accepted after
`reaccept_s`, with a variance that lets the height go there at once.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from server.nav.codes import FAILED
from server.nav.ekf.layout import M_DATA, M_STEP, U_DT, U_DVEL, U_T
from server.nav.kernel import kernel
from server.nav.lanes.altitude_base import ZERO_PARAMETERS, AltitudeLane
from server.nav.lanes.base import LaneContext, Parameter
from server.nav.lanes.vertical import (
    BROKEN,
    COMPUTING,
    P_IMU_DELAY,
    P_OWN,
    V_A,
    V_D,
    V_G,
    V_OWN,
    V_RUN,
    V_SIZE,
    V_T_BARO,
    V_V,
    V_ZERO,
    altitude_row,
    baro_time,
    begin_step,
    correct_past,
    down_at,
    down_axis,
    empty_row,
    forget,
    is_baro,
    remember,
    sane,
    slot_at,
    starts,
)
from server.nav.lanes.vertical_covariance import N, propagate, take_off
from server.nav.types import Float, Int

P_JERK: Final = P_OWN
P_ACCEL: Final = P_OWN + 1
P_WALK: Final = P_OWN + 2
P_BARO: Final = P_OWN + 3
P_GATE: Final = P_OWN + 4
P_REACCEPT: Final = P_OWN + 5
S_BIAS: Final = V_OWN  # m/s², down
S_REFUSED: Final = V_OWN + 1  # baro heights refused in a row
S_BIAS_KNOWN: Final = V_OWN + 2  # variance of the bias at the last good moment, (m/s²)²; 0 = never

SPEED_SIGMA_M_S: Final = 1.0  # at the start: a person's hand, a climb-out
ACCEL_SIGMA_M_S2: Final = 1.0
REACCEPT_COUNT: Final = 3.0
BIAS_SIGMA_M_S2: Final = 0.15  # zero-g offset of a consumer accelerometer after board mounting, 15 mg

PARAMETERS: Final = (
    *ZERO_PARAMETERS,
    Parameter(
        name="jerk_noise_m_s3_rthz", unit="m/s³/√Hz", default=10.0, minimum=0.01, maximum=1000.0,
        meaning="How fast the true acceleration changes; larger follows quick motion with less delay and more noise.",
    ),
    Parameter(
        name="accel_noise_m_s2_rthz", unit="m/s²/√Hz", default=0.05, minimum=1e-4, maximum=10.0,
        meaning="Noise density of the vertical acceleration, tilt errors and vibration included.",
    ),
    Parameter(
        name="accel_bias_walk_m_s3_rthz", unit="m/s³/√Hz", default=2e-3, minimum=1e-8, maximum=1.0,
        meaning="How fast the acceleration's bias may wander; larger learns it faster and less steadily.",
    ),
    Parameter(
        name="baro_noise_m", unit="m", default=0.3, minimum=0.01, maximum=50.0,
        meaning="Noise of a baro height, airflow included; larger trusts it less.",
    ),
    Parameter(
        name="gate_sigma", unit="", default=5.0, minimum=2.0, maximum=100.0,
        meaning="A baro height further from its prediction than this many standard deviations is refused.",
    ),
    Parameter(
        name="reaccept_s", unit="s", default=5.0, minimum=0.1, maximum=60.0,
        meaning="So long after the last one that was taken, three refused in a row are right: the height goes there.",
    ),
)  # fmt: skip


@kernel("void(float64, float64, float64[::1], float64[::1], float64[:, ::1])")
def _advance(raw: float, dt: float, s: Float, par: Float, P: Float) -> None:
    """Carry the state over a step and take the step's mean vertical acceleration, bias included, as measured.

    The mean over the step is not the acceleration at its end: it is the one at its start plus what the jerk since
    added, the very jerk that drives the state. With that correlation kept, C = F P Hᵀ + E[w w̄], the result does not
    depend on the step's length [Kalman filter with correlated process and measurement noise].
    """
    q = par[P_JERK] ** 2
    h0, h1, h2, h3 = P[0, 2] + P[0, 3], P[1, 2] + P[1, 3], P[2, 2] + P[2, 3], P[3, 2] + P[3, 3]
    c0 = h0 + dt * h1 + 0.5 * dt * dt * h2 + q * dt**3 / 8.0
    c1 = h1 + dt * h2 + q * dt**2 / 3.0
    c2 = h2 + q * dt / 2.0
    total = h2 + h3 + q * dt / 3.0 + par[P_ACCEL] ** 2 / dt
    e = (raw - s[V_A] - s[S_BIAS]) / total
    propagate(P, dt, q, par[P_WALK])
    take_off(P, c0, c1, c2, h3, total)
    s[V_D] += s[V_V] * dt + 0.5 * s[V_A] * dt * dt + c0 * e
    s[V_V] += s[V_A] * dt + c1 * e
    s[V_A] += c2 * e
    s[S_BIAS] += h3 * e


@kernel("void(float64[::1], float64[::1], float64[:, ::1])")
def _begin(s: Float, par: Float, P: Float) -> None:
    """Set the covariance of a start; a bias learned before a hole in the data stays as it was known."""
    P[:] = 0.0
    P[0, 0] = par[P_BARO] ** 2
    P[1, 1] = SPEED_SIGMA_M_S**2
    P[2, 2] = ACCEL_SIGMA_M_S2**2
    P[3, 3] = s[S_BIAS_KNOWN] if s[S_BIAS_KNOWN] > 0.0 else BIAS_SIGMA_M_S2**2
    s[S_REFUSED] = 0.0


@kernel("boolean(float64, float64, float64[::1], float64[::1], float64[:, ::1])")
def _passes(e: float, t_ns: float, s: Float, par: Float, P: Float) -> bool:
    """Return whether an innovation passes the gate, or the refusals have lasted; then the variance makes room."""
    variance = P[0, 0] + par[P_BARO] ** 2
    inside = e * e <= par[P_GATE] ** 2 * variance
    s[S_REFUSED] = 0.0 if inside else s[S_REFUSED] + 1.0
    lasting = s[S_REFUSED] >= REACCEPT_COUNT and (t_ns - s[V_T_BARO]) * 1e-9 >= par[P_REACCEPT]
    if inside or not lasting:
        return bool(inside)
    for i in range(N):
        P[0, i] = P[i, 0] = 0.0
    P[0, 0] = e * e
    s[S_REFUSED] = 0.0
    return True


@kernel("void(float64, float64, float64[::1], float64[::1], float64[:, ::1], float64[:, ::1], int64[::1])")
def _update(height_m: float, t_ns: float, s: Float, par: Float, P: Float, r: Float, c: Int) -> None:
    """Correct with a baro height of time t_ns; the gain is the present's, the innovation that time's."""
    back = slot_at(t_ns, r, c)
    if back == 0 or t_ns <= s[V_T_BARO]:
        return
    e = s[V_ZERO] - height_m - down_at(t_ns, back, r, c)
    if not _passes(e, t_ns, s, par, P):
        return
    c0, c1, c2, c3 = P[0, 0], P[0, 1], P[0, 2], P[0, 3]
    total = c0 + par[P_BARO] ** 2
    take_off(P, c0, c1, c2, c3, total)
    dd, dv = c0 / total * e, c1 / total * e
    newest = (c[0] - 1) % r.shape[0]
    s[V_D] += dd + dv * (r[newest, 0] - t_ns) * 1e-9
    s[V_V] += dv
    s[V_A] += c2 / total * e
    s[S_BIAS] += c3 / total * e
    s[S_BIAS_KNOWN] = P[3, 3]
    correct_past(t_ns, back, dd, dv, r, c)
    s[V_T_BARO] = t_ns


@kernel("boolean(float64[:, ::1])")
def _positive(P: Float) -> bool:
    ok = True
    for i in range(N):
        ok = ok and P[i, i] >= 0.0 and math.isfinite(P[i, i])
    return ok


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[:, ::1], float64[::1])")
def _publish(u: Float, att: Float, s: Float, par: Float, P: Float, out: Float) -> None:
    """Write one row with its standard deviations and the bias along the vertical, seen in the body."""
    altitude_row(u[U_T], s, par, out)
    if s[V_RUN] == 0.0:
        return
    z = down_axis(u, att, par[P_IMU_DELAY])
    for i in range(3):
        out[22 + i] = z[i] * s[S_BIAS]
    out[15], out[18] = math.sqrt(P[1, 1]), math.sqrt(P[0, 0])


@kernel(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1],"
    " float64[:, ::1], int64[::1], float64[:, ::1])"
)
def run_kalman(
    steps: Float, meas: Float, att: Float, s: Float, par: Float, P: Float, r: Float, c: Int, out: Float
) -> None:
    """Advance over a block of steps; arguments as `altitude_complementary.run_complementary`, P shape (4, 4)."""
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        mode = begin_step(u, att[n], s, c)
        level = mode != BROKEN and math.isfinite(att[n, 0]) and u[U_DT] > 0.0
        if mode == COMPUTING:
            z = down_axis(u, att[n], par[P_IMU_DELAY])
            raw = (z[0] * u[U_DVEL] + z[1] * u[U_DVEL + 1] + z[2] * u[U_DVEL + 2]) / u[U_DT] + s[V_G]
            _advance(raw, u[U_DT], s, par, P)
            remember(u[U_T] - par[P_IMU_DELAY] * 1e9, s, r, c)
        while k < meas.shape[0] and meas[k, M_STEP] <= n:
            m = meas[k]
            k += 1
            if mode == BROKEN or not is_baro(m):
                continue
            if s[V_RUN] == 1.0:
                _update(m[M_DATA + 1], baro_time(m, par), s, par, P, r, c)
            elif starts(m[M_DATA + 1], baro_time(m, par), level, s, par):
                _begin(s, par, P)
                remember(u[U_T] - par[P_IMU_DELAY] * 1e9, s, r, c)
        if mode == BROKEN or not sane(s, V_SIZE) or not _positive(P):
            forget(s, c)
            P[:] = 0.0
            empty_row(FAILED, out[n])
            continue
        _publish(u, att[n], s, par, P, out[n])


class AltitudeKalman(AltitudeLane):
    """S3's third algorithm; attitude from its own `complementary`."""

    name: ClassVar[str] = "altitude_kalman"
    parameters: ClassVar[tuple[Parameter, ...]] = PARAMETERS

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        super().__init__(context)
        self._P = np.zeros((N, N))

    def _run(self, steps: Float, meas: Float, attitude: Float, rows: Float) -> None:
        run_kalman(steps, meas, attitude, self._s, self._par, self._P, self._r, self._c, rows)
