"""Alignment: the first attitude from gravity and the magnetic field, at rest; in motion when rest does not come."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import ATTITUDE, CAR
from server.nav.ekf.aiding.mag import observe
from server.nav.ekf.blocks import start_mix, switch_mag_on
from server.nav.ekf.layout import (
    A_ACCEL_MEAN,
    A_ACCEL_SUM,
    A_ACCEL_VAR,
    A_DECLINATION,
    A_FIELD_D,
    A_FIELD_H,
    A_GYRO_MEAN,
    A_GYRO_SUM,
    A_GYRO_VAR,
    A_MAG_SUM,
    A_MAG_WEIGHT,
    A_T_START,
    C_ALIGN_STEPS,
    C_ALIGNED_BEFORE,
    C_HAS_FIELD,
    C_HAS_HEADING,
    C_MODE,
    C_STILL_STEPS,
    NEVER_NS,
    PAR_ACCEL_BIAS_SIGMA,
    PAR_GYRO_CROSS,
    PAR_GYRO_SCALE,
    PAR_MAG_BIAS_SIGMA,
    PAR_MAG_NOISE,
    PAR_VEHICLE,
    U_ACCEL_MEAN,
    U_DT,
    U_GYRO_MEAN,
    U_T,
    W_DX,
)
from server.nav.ekf.predict import gravity_here
from server.nav.ekf.states import (
    ACCEL_BIAS,
    ATT,
    GYRO_BIAS,
    MAG_BIAS,
    POS,
    VEL,
    X_ACCEL_BIAS,
    X_FIELD,
    X_GYRO_BIAS,
    X_MAG_BIAS,
    X_Q,
    N,
    packed,
)
from server.nav.ekf.update import correction_seen, fuse, inject, project, reset_axis, rotate_tilt
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float, Int

REST_S: Final = 2.0  # S0 §3.1.2 averages 50 to 100 samples at 50 Hz
PATIENCE_S: Final = 5.0  # then the mean of a moving board must do: in flight rest may never come
PATIENCE_AGAIN_S: Final = 1.0  # after a hole in the data: there was motion before it, and a person waits
STILL_GYRO_RAD_S: Final = 0.02  # spread of step means; a hand or a running motor is past it
IDLING_GYRO_RAD_S: Final = 0.05  # a car may stand with its engine on
STILL_ACCEL_M_S2: Final = 0.25
STILL_RATE_RAD_S: Final = 0.09  # 5 °/s: larger than a MEMS gyro's bias at power-up
STILL_GRAVITY_M_S2: Final = 0.6
STILL_BLEND_S: Final = 0.4
LEAST_NORTH_GAUSS: Final = 0.02  # below it, within 3° of a magnetic pole, the field shows no direction
HEADING_SIGMA_RAD: Final = math.radians(5.0)  # hard iron left over from a rough calibration
TILT_NOISE_RAD: Final = math.radians(0.2)
MOVING_TILT_SIGMA_RAD: Final = math.radians(10.0)
GYRO_BIAS_SIGMA_REST_RAD_S: Final = 1e-3
GYRO_BIAS_SIGMA_MOVING_RAD_S: Final = 0.02
GYRO_BIAS_SIGMA_AGAIN_RAD_S: Final = 2e-3


@kernel("boolean(float64[::1], float64[::1], float64[::1], int64[::1], float64)")
def rest(u: Float, par: Float, aux: Float, ctl: Int, gravity_m_s2: float) -> bool:
    """Update the running spread of rate and specific force; return whether the board looks still."""
    blend = min(1.0, u[U_DT] / STILL_BLEND_S)
    still = True
    norm2 = 0.0
    gyro = IDLING_GYRO_RAD_S if par[PAR_VEHICLE] == CAR else STILL_GYRO_RAD_S
    for i in range(3):
        dg = u[U_GYRO_MEAN + i] - aux[A_GYRO_MEAN + i]
        da = u[U_ACCEL_MEAN + i] - aux[A_ACCEL_MEAN + i]
        aux[A_GYRO_MEAN + i] += blend * dg
        aux[A_ACCEL_MEAN + i] += blend * da
        aux[A_GYRO_VAR + i] += blend * (dg * dg - aux[A_GYRO_VAR + i])
        aux[A_ACCEL_VAR + i] += blend * (da * da - aux[A_ACCEL_VAR + i])
        still = still and aux[A_GYRO_VAR + i] < gyro * gyro and aux[A_ACCEL_VAR + i] < STILL_ACCEL_M_S2**2
        still = still and abs(aux[A_GYRO_MEAN + i]) < STILL_RATE_RAD_S
        norm2 += aux[A_ACCEL_MEAN + i] ** 2
    still = still and abs(math.sqrt(norm2) - gravity_m_s2) < STILL_GRAVITY_M_S2
    ctl[C_STILL_STEPS] = ctl[C_STILL_STEPS] + 1 if still else 0
    return still


@kernel("void(float64[::1], float64[::1])")
def _collect(u: Float, aux: Float) -> None:
    for i in range(3):
        aux[A_GYRO_SUM + i] += u[U_GYRO_MEAN + i]
        aux[A_ACCEL_SUM + i] += u[U_ACCEL_MEAN + i]


@kernel("void(float64[::1], int64[::1])")
def restart(aux: Float, ctl: Int) -> None:
    """Forget what was averaged: the board moved. The field keeps its newest sample only (`intake`)."""
    for i in range(3):
        aux[A_GYRO_SUM + i] = aux[A_ACCEL_SUM + i] = 0.0
    ctl[C_ALIGN_STEPS] = 0


@kernel("void(float64[::1], float64[::1], float64)")
def turn_about_down(x: Float, P: Float, angle_rad: float) -> None:
    """Add an angle to the heading; the tilt error turns with it (`rotate_tilt`)."""
    rotate_tilt(P, angle_rad)
    t = quat_from_rotvec(0.0, 0.0, angle_rad)
    q = quat_mul(t[0], t[1], t[2], t[3], x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3] = q


@kernel("boolean(float64[::1], float64[::1])")
def _shows_north(x: Float, aux: Float) -> bool:
    """Return whether the mean field has a horizontal part that is worth a heading."""
    w = aux[A_MAG_WEIGHT]
    if w <= 0.0:
        return False
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    mx, my = aux[A_MAG_SUM] / w - x[X_MAG_BIAS], aux[A_MAG_SUM + 1] / w - x[X_MAG_BIAS + 1]
    mz = aux[A_MAG_SUM + 2] / w - x[X_MAG_BIAS + 2]
    return math.hypot(R[0] * mx + R[1] * my + R[2] * mz, R[3] * mx + R[4] * my + R[5] * mz) > LEAST_NORTH_GAUSS


@kernel("void(float64[::1], float64[::1], float64[::1])")
def _heading_from_field(x: Float, P: Float, aux: Float) -> None:
    """Turn x about the vertical so that the mean field points to magnetic north, declination added."""
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    w = aux[A_MAG_WEIGHT]
    mx, my = aux[A_MAG_SUM] / w - x[X_MAG_BIAS], aux[A_MAG_SUM + 1] / w - x[X_MAG_BIAS + 1]
    mz = aux[A_MAG_SUM + 2] / w - x[X_MAG_BIAS + 2]
    north, east = R[0] * mx + R[1] * my + R[2] * mz, R[3] * mx + R[4] * my + R[5] * mz
    turn_about_down(x, P, aux[A_DECLINATION] - math.atan2(east, north))


@kernel("void(float64[::1], float64[::1])")
def _field_from_mean(x: Float, aux: Float) -> None:
    """Take the field measured at alignment as the local one, because no model is known yet."""
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    w = aux[A_MAG_WEIGHT]
    mx, my = aux[A_MAG_SUM] / w - x[X_MAG_BIAS], aux[A_MAG_SUM + 1] / w - x[X_MAG_BIAS + 1]
    mz = aux[A_MAG_SUM + 2] / w - x[X_MAG_BIAS + 2]
    north, east = R[0] * mx + R[1] * my + R[2] * mz, R[3] * mx + R[4] * my + R[5] * mz
    aux[A_FIELD_H] = math.sqrt(north * north + east * east)
    aux[A_FIELD_D] = R[6] * mx + R[7] * my + R[8] * mz


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])")
def _couple_heading(x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Say what a heading taken from the field carries: the errors of tilt, Earth field and magnetic bias.

    Heading known to a radian, then the mean field fused as any later one will be: at 64° north four times the tilt's
    error goes into the heading that way.
    """
    bias_var = par[PAR_MAG_BIAS_SIGMA] ** 2
    kept = (x[X_MAG_BIAS], x[X_MAG_BIAS + 1], x[X_MAG_BIAS + 2])
    switch_mag_on(x, P, par, aux, ctl, work)
    for i in range(3):
        x[X_MAG_BIAS + i] = kept[i]
        P[packed(MAG_BIAS + i, MAG_BIAS + i)] = bias_var
    w = aux[A_MAG_WEIGHT]
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    m = (aux[A_MAG_SUM] / w - kept[0], aux[A_MAG_SUM + 1] / w - kept[1], aux[A_MAG_SUM + 2] / w - kept[2])
    for i in range(N):
        work[W_DX + i] = 0.0
    for i in range(3):
        observe(x, u, work, i)
        innovation = R[3 * i] * m[0] + R[3 * i + 1] * m[1] + R[3 * i + 2] * m[2] - x[X_FIELD + i]
        total = project(P, work) + par[PAR_MAG_NOISE] ** 2
        fuse(P, work, innovation - correction_seen(work), total)
    inject(x, P, work)


@kernel("void(float64[::1], float64[::1], float64, float64, float64, float64[::1], float64[::1], int64[::1])")
def _set(x: Float, P: Float, ax: float, ay: float, az: float, par: Float, aux: Float, ctl: Int) -> None:
    """Set attitude and covariance from a mean specific force in m/s²; heading from the mean field if there is one."""
    roll, pitch = math.atan2(-ay, -az), math.atan2(ax, math.sqrt(ay * ay + az * az))
    cr, sr, cp, sp = math.cos(roll / 2), math.sin(roll / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3] = cr * cp, sr * cp, cr * sp, -sr * sp
    ctl[C_HAS_HEADING] = 0
    if _shows_north(x, aux):
        _heading_from_field(x, P, aux)
        ctl[C_HAS_HEADING] = 1
        if not ctl[C_HAS_FIELD]:
            _field_from_mean(x, aux)
    for i in range(3):
        x[X_ACCEL_BIAS + i] = 0.0
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    g = gravity_here(x, aux, ctl)
    for k in range(P.shape[0]):
        P[k] = 0.0
    b2 = par[PAR_ACCEL_BIAS_SIGMA] ** 2
    tilt2 = b2 / (g * g) + TILT_NOISE_RAD**2
    P[packed(ATT, ATT)] = P[packed(ATT + 1, ATT + 1)] = tilt2
    P[packed(ATT + 2, ATT + 2)] = 1.0 if ctl[C_HAS_HEADING] else math.pi**2
    for j in range(3):  # at rest R δb = g (−δθ_y, δθ_x): δθ_x = (R δb)_e / g, δθ_y = −(R δb)_n / g
        P[packed(ACCEL_BIAS + j, ACCEL_BIAS + j)] = b2
        P[packed(ATT, ACCEL_BIAS + j)] = R[3 + j] / g * b2
        P[packed(ATT + 1, ACCEL_BIAS + j)] = -R[j] / g * b2
        P[packed(VEL + j, VEL + j)] = 1.0
        P[packed(POS + j, POS + j)] = 1.0
    ctl[C_MODE] = ATTITUDE


@kernel("boolean(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])")
def _done(x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> bool:
    """Close an alignment. A gyro bias learned before a hole in the data is better than a mean that may hold a turn."""
    if ctl[C_ALIGNED_BEFORE]:
        for i in range(3):
            P[packed(GYRO_BIAS + i, GYRO_BIAS + i)] = GYRO_BIAS_SIGMA_AGAIN_RAD_S**2
    ctl[C_ALIGNED_BEFORE] = 1
    if par[PAR_GYRO_SCALE] + par[PAR_GYRO_CROSS] > 0.0:
        start_mix(P, work, par[PAR_GYRO_SCALE], par[PAR_GYRO_CROSS])
    if ctl[C_HAS_HEADING]:
        _couple_heading(x, P, u, par, aux, ctl, work)
    return True


@kernel("boolean(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])")
def align(x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> bool:
    """Take one step of alignment; return True when the attitude has just been set.

    At rest the mean specific force gives the tilt and the mean rate the gyro bias (S0 §3.1.2); the tilt error and the
    accelerometer bias are then the same unknown, and the covariance says so. Moving, the running mean must do.
    """
    if aux[A_T_START] == NEVER_NS:  # the running means start at the first step, not at zero
        aux[A_T_START] = u[U_T]
        for i in range(3):
            aux[A_GYRO_MEAN + i], aux[A_ACCEL_MEAN + i] = u[U_GYRO_MEAN + i], u[U_ACCEL_MEAN + i]
    still = rest(u, par, aux, ctl, gravity_here(x, aux, ctl))
    if not still:
        restart(aux, ctl)
        if (u[U_T] - aux[A_T_START]) * 1e-9 < (PATIENCE_AGAIN_S if ctl[C_ALIGNED_BEFORE] else PATIENCE_S):
            return False
        _set(x, P, aux[A_ACCEL_MEAN], aux[A_ACCEL_MEAN + 1], aux[A_ACCEL_MEAN + 2], par, aux, ctl)
        for i in range(3):
            P[packed(ATT + i, ATT + i)] += MOVING_TILT_SIGMA_RAD**2
            P[packed(GYRO_BIAS + i, GYRO_BIAS + i)] = GYRO_BIAS_SIGMA_MOVING_RAD_S**2
        return _done(x, P, u, par, aux, ctl, work)
    _collect(u, aux)
    ctl[C_ALIGN_STEPS] += 1
    n = ctl[C_ALIGN_STEPS]
    if n * u[U_DT] < REST_S:
        return False
    _set(x, P, aux[A_ACCEL_SUM] / n, aux[A_ACCEL_SUM + 1] / n, aux[A_ACCEL_SUM + 2] / n, par, aux, ctl)
    for i in range(3):
        if not ctl[C_ALIGNED_BEFORE]:
            x[X_GYRO_BIAS + i] = aux[A_GYRO_SUM + i] / n
        P[packed(GYRO_BIAS + i, GYRO_BIAS + i)] = GYRO_BIAS_SIGMA_REST_RAD_S**2
    return _done(x, P, u, par, aux, ctl, work)


@kernel("void(float64[::1], float64[::1], float64, float64)")
def set_heading(x: Float, P: Float, angle_rad: float, sigma_rad: float) -> None:
    """Turn the heading by an angle after which it is known to sigma_rad, uncorrelated with everything else."""
    turn_about_down(x, P, angle_rad)
    reset_axis(P, ATT + 2, sigma_rad * sigma_rad)
