"""The main lane under another calibration: biases, history and running means are moved, the covariance stays."""

from __future__ import annotations

from server.nav.codes import AIRSPEED_AID, BARO_HEIGHT, MAG_FIELD
from server.nav.ekf import layout as at
from server.nav.ekf.attitude import layout as mode
from server.nav.ekf.states import X_ACCEL_BIAS, X_BARO, X_GYRO_BIAS, X_MAG_BIAS
from server.nav.preprocess.rebase import Affine, Rebase, move_steps
from server.nav.types import Float, Int


def rebase_filter(change: Rebase, x: Float, aux: Float, ctl: Int, r_u: Float, r_x: Float, r_m: Float) -> None:
    """Move everything of the navigation filter that is in calibrated units.

    Args:
        change: what the new calibration does to calibrated values.
        x: shape (X_SIZE,). aux, ctl: memory, `ekf.layout`.
        r_u, r_x, r_m: history of steps, states and measurements, so that what comes late is re-run in the new units.
    """
    biases = ((X_GYRO_BIAS, change.gyro), (X_ACCEL_BIAS, change.accel), (X_MAG_BIAS, change.mag))
    for place, one in biases if ctl[at.C_ALIGNED_BEFORE] else ():  # until then they are assumed zero, in any units
        _move(x, place, one)
        r_x[:, place : place + 3] = r_x[:, place : place + 3] @ one[0].T + one[1]
    x[X_BARO] -= change.baro_m
    r_x[:, X_BARO] -= change.baro_m
    move_steps(r_u, change)
    _move_history(r_m, change)
    _move_means(change, aux, ctl)


def _move(x: Float, place: int, one: Affine, weight: float = 1.0) -> None:
    A, d = one
    x[place : place + 3] = A @ x[place : place + 3] + weight * d


def _move_history(r_m: Float, change: Rebase) -> None:
    """Move the measurements kept, shape (slots, SLOT_MEASUREMENTS, H_SIZE); unused rows hold numbers of no meaning."""
    aid = r_m[:, :, at.H_AID]
    A, d = change.mag
    field = aid == MAG_FIELD
    first = r_m[:, :, at.H_DATA : at.H_DATA + 3]
    first[field] = first[field] @ A.T + d
    r_m[:, :, at.H_DATA][aid == BARO_HEIGHT] += change.baro_m
    r_m[:, :, at.H_DATA][aid == AIRSPEED_AID] += change.diff_pressure_pa


def _move_means(change: Rebase, aux: Float, ctl: Int) -> None:
    """Move what alignment and the detection of rest have averaged."""
    if aux[at.A_T_START] > at.NEVER_NS:  # before, the means are zeros that stand for nothing
        _move(aux, at.A_GYRO_MEAN, change.gyro)
        _move(aux, at.A_ACCEL_MEAN, change.accel)
    steps = float(ctl[at.C_ALIGN_STEPS])
    _move(aux, at.A_GYRO_SUM, change.gyro, steps)
    _move(aux, at.A_ACCEL_SUM, change.accel, steps)
    _move(aux, at.A_MAG_SUM, change.mag, float(aux[at.A_MAG_WEIGHT]))


def rebase_attitude(change: Rebase, s: Float) -> None:
    """Move the attitude mode's memory likewise, shape (S_SIZE,)."""
    if not s[mode.S_STARTED]:
        return
    dt = float(s[mode.S_B_DT])
    for place, one, weight in (
        (mode.S_X + mode.GYRO_BIAS, change.gyro, 1.0),
        (mode.S_X + mode.ACCEL_BIAS, change.accel, 1.0),
        (mode.S_X + mode.MAG_OFFSET, change.mag, 1.0),
        (mode.S_R_GYRO, change.gyro, 1.0),
        (mode.S_R_ACCEL, change.accel, 1.0),
        (mode.S_B_GYRO, change.gyro, dt),
        (mode.S_B_ACCEL, change.accel, dt),
    ):
        _move(s, place, one, weight)
    s[mode.S_M_COUNT : mode.S_M_COUNT + mode.S_M_SIZE] = 0.0  # a few samples, summed in another frame
