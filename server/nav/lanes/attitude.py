"""What the attitude lanes share: start, weights, field and publication as kernels over one state array.

Every lane here keeps `s`, whose first columns are the S_* below, and is given `par`: the delays, then the lane's own
parameters in their order. The state belongs to a step's stamp minus the IMU's delay; `publish` carries it on.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import ATTITUDE, FAILED, FUSED, MAG
from server.nav.constants import STANDARD_GRAVITY_M_S2
from server.nav.ekf.layout import M_DATA, M_KIND, M_STATUS, M_STEP, M_T, U_DT, U_DTHETA, U_DVEL, U_GYRO, U_T
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float

S_Q: Final = 0  # (4) q_nb at the step's end
S_BIAS: Final = 4  # (3) gyro bias, body, rad/s
S_STARTED: Final = 7  # 1 once an attitude was set
S_HEADING: Final = 8  # what the heading counts from: NO_HEADING, MAGNETIC, TRUE
S_AGE: Final = 9  # s since the start
S_SINCE_FIELD: Final = 10  # s since the newest field
S_DECLINATION: Final = 11  # rad
S_FIELD: Final = 12  # (3) mean field of the newest step that had one, body at its end, gauss
S_OWN: Final = 15  # first column of the lane's own

NO_HEADING: Final = 0.0
MAGNETIC: Final = 1.0
TRUE: Final = 2.0

PAR_IMU: Final = 0  # delays, s
PAR_MAG: Final = 1
PAR_GNSS: Final = 2
PAR_OWN: Final = 3

GAP_RESTART_S: Final = 1.0  # as `ekf.run`: past this hole nothing is left of a moving vehicle's attitude
LEAST_FORCE_M_S2: Final = 1.0  # a tenth of gravity: below it, in free fall, the specific force has no direction
LARGEST_TILT: Final = 2.0  # rad: a shock counts no more than two g
FIELD_GAP_S: Final = 0.5  # a field after a longer pause weighs no more than this
START_MEMORY_S: Final = 5.0  # so much is taken as seen before the start: motion in it must not become gyro bias
LEAST_NORTH_GAUSS: Final = 0.02  # within 3° of a magnetic pole the field shows no direction
OLDEST_FIELD_S: Final = 0.5  # a field this late cannot be turned to the present by one rate


@kernel("UniTuple(float64, 3)(float64, float64, float64, float64, float64, float64, float64)")
def rotate(w: float, x: float, y: float, z: float, a: float, b: float, c: float) -> tuple[float, float, float]:
    """Return R(q) (a, b, c)."""
    R = matrix_entries(w, x, y, z)
    return R[0] * a + R[1] * b + R[2] * c, R[3] * a + R[4] * b + R[5] * c, R[6] * a + R[7] * b + R[8] * c


@kernel("float64(float64)")
def wrap(angle_rad: float) -> float:
    """Return the angle in [−π, π)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


@kernel("UniTuple(float64, 3)(float64[::1])")
def force_at_end(u: Float) -> tuple[float, float, float]:
    """Return the step's mean specific force in m/s², in the body frame at the step's end; gravity stays exact."""
    t = quat_from_rotvec(-u[U_DTHETA], -u[U_DTHETA + 1], -u[U_DTHETA + 2])
    f = rotate(t[0], t[1], t[2], t[3], u[U_DVEL], u[U_DVEL + 1], u[U_DVEL + 2])
    return f[0] / u[U_DT], f[1] / u[U_DT], f[2] / u[U_DT]


@kernel("UniTuple(float64, 2)(float64, float64, float64)")
def level(fx: float, fy: float, fz: float) -> tuple[float, float]:
    """Return (roll, pitch) in rad that make a specific force point up."""
    return math.atan2(-fy, -fz), math.atan2(fx, math.sqrt(fy * fy + fz * fz))


@kernel("UniTuple(float64, 4)(float64, float64, float64)")
def quat_of(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """Return q_nb of ZYX angles; any finite angles, pitch past ±π/2 included."""
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


@kernel("UniTuple(float64, 3)(float64, float64, float64, float64[::1])")
def angles_after(roll_rad: float, pitch_rad: float, yaw_rad: float, u: Float) -> tuple[float, float, float]:
    """Return ZYX angles after a step: each plus the integral of its own (Euler) rate, exact also past gimbal lock."""
    q = quat_of(roll_rad, pitch_rad, yaw_rad)
    t = quat_from_rotvec(u[U_DTHETA], u[U_DTHETA + 1], u[U_DTHETA + 2])
    e = quat_mul(q[0], q[1], q[2], q[3], t[0], t[1], t[2], t[3])
    R = matrix_entries(e[0], e[1], e[2], e[3])
    return math.atan2(R[7], R[8]), math.asin(max(-1.0, min(1.0, -R[6]))), math.atan2(R[3], R[0])


@kernel("void(float64[::1], float64, float64, float64)")
def turn_n(s: Float, x_rad: float, y_rad: float, z_rad: float) -> None:
    """Rotate the attitude by a NED rotation vector and normalise it: q = Exp(v) ⊗ q."""
    t = quat_from_rotvec(x_rad, y_rad, z_rad)
    q = quat_mul(t[0], t[1], t[2], t[3], s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3])
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        s[S_Q + i] = q[i] / norm


@kernel("void(float64[::1], float64[::1])")
def integrate(u: Float, s: Float) -> None:
    """Carry the attitude over a step, bias removed: q = q ⊗ Exp(Δθ − b dt) [Solà 2017, eq. 101]."""
    dt = u[U_DT]
    t = quat_from_rotvec(
        u[U_DTHETA] - s[S_BIAS] * dt, u[U_DTHETA + 1] - s[S_BIAS + 1] * dt, u[U_DTHETA + 2] - s[S_BIAS + 2] * dt
    )
    q = quat_mul(s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3], t[0], t[1], t[2], t[3])
    for i in range(4):
        s[S_Q + i] = q[i]


@kernel("UniTuple(float64, 2)(float64[::1], float64[::1])")
def tilt_error(u: Float, s: Float) -> tuple[float, float]:
    """Return the NED rotation (north, east) in rad that makes the step's specific force point up; 0 in free fall.

    Linear in the force, so that accelerations to and fro cancel; their angles do not. Hanging over, the full angle.
    """
    f = force_at_end(u)
    n = rotate(s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3], f[0], f[1], f[2])
    across = math.sqrt(n[0] * n[0] + n[1] * n[1])
    if across < 1e-12 or math.sqrt(across * across + n[2] * n[2]) < LEAST_FORCE_M_S2:
        return 0.0, 0.0
    angle = math.atan2(across, -n[2]) if n[2] > 0.0 else min(across / STANDARD_GRAVITY_M_S2, LARGEST_TILT)
    return -n[1] * angle / across, n[0] * angle / across


@kernel("void(float64[::1], float64, float64, float64, float64)")
def feed_bias(s: Float, k: float, x_rad: float, y_rad: float, z_rad: float) -> None:
    """Take the share k, 1/s, of a NED attitude error as gyro bias: what turned too little was biased high."""
    e = rotate(s[S_Q], -s[S_Q + 1], -s[S_Q + 2], -s[S_Q + 3], x_rad, y_rad, z_rad)
    for i in range(3):
        s[S_BIAS + i] -= k * e[i]


@kernel("UniTuple(float64, 2)(float64, float64, float64, float64)")
def weights(angle_per_s: float, bias_per_s2: float, dt: float, age_s: float) -> tuple[float, float]:
    """Return a correction's weights (angle, bias in 1/s) for dt seconds of measurement.

    The lane's own, but while the start is recent those of the growing-memory line fit, 4/T and 6/T² a second, which
    is what a Kalman filter without prior knowledge does before its weights settle.
    """
    T = age_s + START_MEMORY_S
    return 1.0 - math.exp(-max(angle_per_s, 4.0 / T) * dt), max(bias_per_s2, 6.0 / (T * T)) * dt


@kernel("boolean(float64[::1])")
def usable(u: Float) -> bool:
    """Return whether a step's numbers may enter a state."""
    ok = math.isfinite(u[U_T]) and u[U_DT] > 0.0
    for i in range(3):
        ok = ok and math.isfinite(u[U_DTHETA + i]) and math.isfinite(u[U_DVEL + i]) and math.isfinite(u[U_GYRO + i])
    return bool(ok)


@kernel("boolean(float64[::1], int64)")
def finite(s: Float, n: int) -> bool:
    """Return whether the first n numbers are finite."""
    for i in range(n):
        if not math.isfinite(s[i]):
            return False
    return True


@kernel("boolean(float64[::1], float64[::1])")
def start(u: Float, s: Float) -> bool:
    """Set the attitude from one step's mean force, heading 0 until a field shows it; False in free fall."""
    f = force_at_end(u)
    if math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]) < LEAST_FORCE_M_S2:
        return False
    angles = level(f[0], f[1], f[2])
    q = quat_of(angles[0], angles[1], 0.0)
    for i in range(4):
        s[S_Q + i] = q[i]
    s[S_STARTED], s[S_HEADING], s[S_AGE], s[S_SINCE_FIELD] = 1.0, NO_HEADING, 0.0, 0.0
    return True


@kernel("UniTuple(int64, 2)(float64[:, ::1], int64, int64, float64[::1], float64[::1], float64[::1])")
def take_field(meas: Float, k: int, n: int, u: Float, par: Float, s: Float) -> tuple[int, int]:
    """Keep the mean field that came with step n, turned to its end by the rate; return (next row, samples used).

    A sample stamped t is valid at t − its delay, the attitude at the step's stamp − the IMU's.
    """
    count = 0
    sx = sy = sz = 0.0
    while k < meas.shape[0] and meas[k, M_STEP] <= n:
        m = meas[k]
        k += 1
        age = (u[U_T] - m[M_T]) * 1e-9 - par[PAR_IMU] + par[PAR_MAG]
        if int(m[M_KIND]) != MAG or int(m[M_STATUS]) != FUSED or not abs(age) < OLDEST_FIELD_S:
            continue
        a = -age / u[U_DT]
        b = age
        t = quat_from_rotvec(
            a * u[U_DTHETA] + b * s[S_BIAS], a * u[U_DTHETA + 1] + b * s[S_BIAS + 1],
            a * u[U_DTHETA + 2] + b * s[S_BIAS + 2],
        )  # fmt: skip
        v = rotate(t[0], t[1], t[2], t[3], m[M_DATA], m[M_DATA + 1], m[M_DATA + 2])
        sx, sy, sz, count = sx + v[0], sy + v[1], sz + v[2], count + 1
    if count:
        s[S_FIELD], s[S_FIELD + 1], s[S_FIELD + 2] = sx / count, sy / count, sz / count
    return k, count


@kernel("UniTuple(float64, 2)(float64[::1])")
def heading_error(s: Float) -> tuple[float, float]:
    """Return (rad to turn clockwise so that the kept field points to magnetic north, its horizontal part in gauss)."""
    v = rotate(s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3], s[S_FIELD], s[S_FIELD + 1], s[S_FIELD + 2])
    return wrap(s[S_DECLINATION] - math.atan2(v[1], v[0])), math.sqrt(v[0] * v[0] + v[1] * v[1])


@kernel("void(float64[::1], float64)")
def blank(out: Float, status: float) -> None:
    """Write a row that knows nothing but its status."""
    for i in range(out.shape[0]):
        out[i] = math.nan
    out[25], out[29] = status, 0.0


@kernel("void(float64[::1], float64[::1], float64, float64[::1])")
def publish(u: Float, s: Float, delay_s: float, out: Float) -> None:
    """Write the attitude, carried on by the last rate over the IMU's delay, into a blank row."""
    d = delay_s
    t = quat_from_rotvec(
        d * (u[U_GYRO] - s[S_BIAS]), d * (u[U_GYRO + 1] - s[S_BIAS + 1]), d * (u[U_GYRO + 2] - s[S_BIAS + 2])
    )
    q = quat_mul(s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3], t[0], t[1], t[2], t[3])
    sign = -1.0 if q[0] < 0.0 else 1.0
    for i in range(4):
        out[i] = sign * q[i]
    out[25] = ATTITUDE


@kernel("void(float64[::1], float64[::1])")
def fail(s: Float, out: Float) -> None:
    """Forget all but the declination, and say so."""
    declination = s[S_DECLINATION]
    s[:] = 0.0
    s[S_DECLINATION] = declination
    blank(out, FAILED)
