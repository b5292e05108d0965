"""`ahrs_fixed_gain` over a block of navigation steps: integrate, level, turn towards the field and the motion."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import ALIGNING, FUSED, GNSS
from server.nav.ekf.layout import M_KIND, M_STATUS, M_T, U_DT, U_GAP_S
from server.nav.kernel import kernel
from server.nav.lanes.attitude import (
    FIELD_GAP_S,
    GAP_RESTART_S,
    LARGEST_TILT,
    LEAST_NORTH_GAUSS,
    MAGNETIC,
    NO_HEADING,
    PAR_GNSS,
    PAR_IMU,
    S_AGE,
    S_BIAS,
    S_HEADING,
    S_SINCE_FIELD,
    S_STARTED,
    TRUE,
    blank,
    fail,
    feed_bias,
    finite,
    heading_error,
    integrate,
    publish,
    start,
    take_field,
    tilt_error,
    turn_n,
    usable,
    weights,
)
from server.nav.lanes.ground_heading import (
    LONGEST_S,
    O_ACCEL,
    O_ANGLE,
    O_CHANGE,
    O_COURSE,
    O_SECONDS,
    O_SPEED,
    O_TILT,
    S_ACROSS,
    S_ALONG,
    S_SINCE_FIX,
    SIZE,
    forget_motion,
    note_step,
    take_velocity,
)
from server.nav.types import Float

PAR_TILT: Final = 3  # after the delays: weights a second of angle (1/s) and bias (1/s²), for each measurement
PAR_FIELD: Final = 5
PAR_MOTION: Final = 7
PAR_COURSE: Final = 9
PAR_LEVEL: Final = 11
PAR_HAS_COURSE: Final = 13
PAR_SPEED: Final = 14  # m/s
PAR_BESIDE: Final = 15  # (2) share of the weights of motion and course that is left beside a field
REFERENCE_ACCEL_M_S2: Final = 2.0
"""Acceleration whose direction shows as well as the lane's noise density says; less shows less."""
STEADY_M_S2: Final = 1.0  # above the noise of a receiver's velocities at 5 to 10 Hz
FIELD_FRESH_S: Final = 5.0
CREDIBLE_RAD: Final = math.radians(60.0)  # a motion that disagrees by more is noise once there is a heading
FIRST_MOTION_M2_S2: Final = 16.0  # (4 m/s)² of agreed velocity change show a first heading to a few degrees

ARRAYS: Final = (
    "void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1], float64[:, ::1], float64[::1])"
)


@kernel("void(float64[::1], int64, float64, float64, float64, float64[::1])")
def _level_by(par: Float, i: int, seconds: float, x_rad: float, y_rad: float, s: Float) -> None:
    """Correct the tilt with the weights at par[i] for so many seconds of measurement."""
    k, kb = weights(par[i], par[i + 1], seconds, s[S_AGE])
    turn_n(s, k * x_rad, k * y_rad, 0.0)
    feed_bias(s, kb, x_rad, y_rad, 0.0)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def _to_gravity(u: Float, o: Float, par: Float, s: Float) -> None:
    """Level by the accelerometer alone, unless the receiver says that it speeds up, where to it cannot yet say."""
    if s[S_SINCE_FIX] > LONGEST_S or (s[S_HEADING] == NO_HEADING and o[O_CHANGE] < STEADY_M_S2):
        ex, ey = tilt_error(u, s)
        _level_by(par, PAR_TILT, u[U_DT], ex, ey, s)


@kernel("void(float64[::1], float64)")
def _set_heading(s: Float, angle_rad: float) -> None:
    turn_n(s, 0.0, 0.0, angle_rad)
    forget_motion(s)


@kernel("void(float64[::1], float64[::1])")
def _to_field(par: Float, s: Float) -> None:
    """Turn the heading towards the field's; at once when it is the first."""
    angle, north = heading_error(s)
    if north <= LEAST_NORTH_GAUSS:
        return
    if s[S_HEADING] == NO_HEADING:
        _set_heading(s, angle)
        s[S_HEADING] = MAGNETIC
    else:
        since_s = min(FIELD_GAP_S, s[S_SINCE_FIELD])
        k, kb = weights(par[PAR_FIELD], par[PAR_FIELD + 1], since_s, s[S_AGE])
        turn_n(s, 0.0, 0.0, k * angle)
        feed_bias(s, kb, 0.0, 0.0, angle)
    s[S_SINCE_FIELD] = 0.0


@kernel("void(float64[::1], int64, float64, float64, float64[::1])")
def _turn_by(par: Float, i: int, seconds: float, angle_rad: float, s: Float) -> None:
    """Correct the heading with the weights at par[i] for so many seconds of measurement."""
    turn_n(s, 0.0, 0.0, (1.0 - math.exp(-par[i] * seconds)) * angle_rad)
    feed_bias(s, par[i + 1] * seconds, 0.0, 0.0, angle_rad)


@kernel("void(float64[::1], float64[::1], float64[::1])")
def _to_motion(o: Float, par: Float, s: Float) -> None:
    """Turn tilt and heading towards what two fixes show; the heading at once when there was none."""
    if s[S_HEADING] != NO_HEADING:
        x, y = o[O_TILT], o[O_TILT + 1]
        share = min(1.0, LARGEST_TILT / max(1e-12, math.sqrt(x * x + y * y)))
        _level_by(par, PAR_LEVEL, o[O_SECONDS], share * x, share * y, s)
    course = par[PAR_HAS_COURSE] != 0.0 and o[O_SPEED] > par[PAR_SPEED]
    if s[S_HEADING] == NO_HEADING:
        strength = math.sqrt(s[S_ALONG] * s[S_ALONG] + s[S_ACROSS] * s[S_ACROSS])
        if course or strength > FIRST_MOTION_M2_S2:
            _set_heading(s, o[O_COURSE] if course else math.atan2(s[S_ACROSS], s[S_ALONG]))
            s[S_HEADING] = TRUE
        return
    alone = s[S_HEADING] != MAGNETIC or s[S_SINCE_FIELD] > FIELD_FRESH_S
    if abs(o[O_ANGLE]) < CREDIBLE_RAD:
        share = min(1.0, (o[O_ACCEL] / REFERENCE_ACCEL_M_S2) ** 2) * (1.0 if alone else par[PAR_BESIDE])
        _turn_by(par, PAR_MOTION, share * o[O_SECONDS], o[O_ANGLE], s)
    if course:
        share = 1.0 if alone else par[PAR_BESIDE + 1]
        _turn_by(par, PAR_COURSE, share * o[O_SECONDS], o[O_COURSE], s)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[:, ::1], float64[::1])")
def _advance(u: Float, par: Float, s: Float, ring: Float, o: Float) -> None:
    note_step(u, s, ring)
    integrate(u, s)
    s[S_AGE] += u[U_DT]
    s[S_SINCE_FIELD] += u[U_DT]
    _to_gravity(u, o, par, s)


@kernel(ARRAYS)
def run(steps: Float, meas: Float, par: Float, s: Float, rows: Float, ring: Float, o: Float) -> None:
    """Run over navigation steps; see `KernelLane`. A gyro bias learned before a hole is kept."""
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
            start(u, s)
            forget_motion(s)
        else:
            _advance(u, par, s, ring, o)
        first = k
        k, count = take_field(meas, k, n, u, par, s)
        if s[S_STARTED] == 0.0:
            continue
        if count:
            _to_field(par, s)
        for i in range(first, k):
            m = meas[i]
            t_ns = m[M_T] + (par[PAR_IMU] - par[PAR_GNSS]) * 1e9
            if int(m[M_KIND]) == GNSS and int(m[M_STATUS]) == FUSED and take_velocity(m, t_ns, s, ring, o):
                _to_motion(o, par, s)
        if not finite(s, SIZE):
            fail(s, rows[n])
            continue
        publish(u, s, par[PAR_IMU], rows[n])
        for i in range(3):
            rows[n, 19 + i] = s[S_BIAS + i]
