"""What a change of calibration does to values that were calibrated the old way, so that nothing jumps.

calibrated c = M (raw − o) − l, so c_new = A c_old + d with A = M2 M1⁻¹ and d = M2 (o1 − o2) + A l1 − l2. A bias that
an estimator has learned (true = c − b) is a difference of calibrated values and moves likewise: A (c − b) is the new
true value, hence b_new = A b_old + d.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from server.nav.calibration.applied import Calibration
from server.nav.codes import AIRSPEED, BARO, MAG
from server.nav.ekf import layout as cols
from server.nav.preprocess import chain_layout as at
from server.nav.preprocess import memory as acc
from server.nav.rotation import quat_from_rotvec, rotvec_from_quat
from server.nav.types import Float

LEARNED_ON: Final = ("gyro_matrix", "mag_matrix", "mag_offset", "level")
Affine = tuple[Float, Float]
"""A, shape (3, 3), and d, shape (3,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rebase:
    """c_new = A c_old + d for each vector sensor; a number moves by its shift.

    Attributes:
        gyro, accel, mag: (A, d) in rad/s, m/s², gauss.
        baro_m: added to a calibrated height. diff_pressure_pa: added to a calibrated differential pressure.
        is_level_changed: the body frame itself has turned; states in it mean nothing any more.
        keeps_learning: what is being learned of the magnetometer in flight still holds.
    """

    gyro: Affine
    accel: Affine
    mag: Affine
    baro_m: float
    diff_pressure_pa: float
    is_level_changed: bool
    keeps_learning: bool

    @property
    def turns_vectors(self) -> bool:
        """True when a vector sensor reads otherwise from now on."""
        return any(d.any() or not np.array_equal(A, np.eye(3)) for A, d in (self.gyro, self.accel, self.mag))

    def by_sensor(self) -> dict[int, Affine]:
        """Return the sensors' numbers in the chain with (A, d), d of shape (1,) and A (1, 1) for a number."""
        one = np.ones((1, 1))
        return {
            at.GYRO: self.gyro,
            at.ACCEL: self.accel,
            at.MAG: self.mag,
            at.BARO: (one, np.array([self.baro_m])),
            at.AIRSPEED: (one, np.array([self.diff_pressure_pa])),
        }


def rebase_between(
    old: Calibration, new: Calibration, learned_old: Float, learned_new: Float, temperature_degc: float
) -> Rebase:
    """Return what becomes of calibrated values.

    Args:
        old, new: the calibrations.
        learned_old, learned_new: shape (3,), magnetic offset taken off after either, gauss.
        temperature_degc: of the IMU; NaN unknown.
    """
    warm_old, warm_new = (np.nan_to_num(temperature_degc - one.reference_degc) for one in (old, new))
    gyro = _affine(
        (old.level @ old.gyro_matrix, old.gyro_offset + warm_old * old.gyro_per_k),
        (new.level @ new.gyro_matrix, new.gyro_offset + warm_new * new.gyro_per_k),
    )
    accel = _affine(
        (old.level @ old.accel_matrix, old.accel_offset + warm_old * old.accel_per_k),
        (new.level @ new.accel_matrix, new.accel_offset + warm_new * new.accel_per_k),
    )
    A, d = _affine((old.level @ old.mag_matrix, old.mag_offset), (new.level @ new.mag_matrix, new.mag_offset))
    return Rebase(
        gyro=gyro,
        accel=accel,
        mag=(A, d + A @ learned_old - learned_new),
        baro_m=old.baro_bias_m - new.baro_bias_m,
        diff_pressure_pa=old.diff_pressure_bias_pa - new.diff_pressure_bias_pa,
        is_level_changed=not np.array_equal(old.level, new.level),
        keeps_learning=not gyro[1].any()
        and all(np.array_equal(getattr(old, name), getattr(new, name)) for name in LEARNED_ON),
    )


def _affine(old: Affine, new: Affine) -> Affine:
    """Return (A, d) from two (M, o)."""
    if np.array_equal(old[0], new[0]):  # no rounding where nothing turns or stretches
        return np.eye(3), np.asarray(new[0] @ (old[1] - new[1]))
    A = new[0] @ np.linalg.inv(old[0])
    return A, np.asarray(new[0] @ (old[1] - new[1]))


def move_open_step(s: Float, change: Rebase) -> None:
    """Carry over what the open navigation step has collected; s: shape (S_SIZE,), the preprocessing's memory."""
    if s[acc.S_T_LAST] == acc.NEVER_NS:
        return
    elapsed = (s[acc.S_T_LAST] - s[acc.S_T_START]) * 1e-9
    (A_g, d_g), (A_a, d_a) = change.gyro, change.accel
    turned = np.array(rotvec_from_quat(*s[acc.S_Q : acc.S_Q + 4].tolist()))
    s[acc.S_Q : acc.S_Q + 4] = quat_from_rotvec(*(A_g @ turned + elapsed * d_g).tolist())
    for place, A, d, weight in (
        (acc.S_GYRO, A_g, d_g, 1.0),
        (acc.S_GYRO_SUM, A_g, d_g, s[acc.S_COUNT]),
        (acc.S_ACCEL, A_a, d_a, 1.0),
        (acc.S_SLOW, A_a, d_a, 1.0),
        (acc.S_ACCEL_SUM, A_a, d_a, s[acc.S_COUNT]),
        (acc.S_DVEL, A_a, d_a, elapsed),
    ):
        s[place : place + 3] = A @ s[place : place + 3] + weight * d


def move_measurements(meas: Float, change: Rebase) -> None:
    """Carry over measurements that wait for their step, shape (k, M_SIZE), in place."""
    data = meas[:, cols.M_DATA :]
    mag, baro, air = (meas[:, cols.M_KIND] == kind for kind in (MAG, BARO, AIRSPEED))
    A, d = change.mag
    data[mag, :3] = data[mag, :3] @ A.T + d
    data[baro, 1] += change.baro_m
    data[air, 0] += change.diff_pressure_pa
    if change.diff_pressure_pa != 0.0:
        data[air, 1] = np.where(np.isfinite(data[air, 0]), np.nan, data[air, 1])  # follows from the pressure


def move_steps(u: Float, change: Rebase) -> None:
    """Carry over navigation steps, shape (n, U_SIZE), in place."""
    (A_g, d_g), (A_a, d_a) = change.gyro, change.accel
    dt = u[:, cols.U_DT : cols.U_DT + 1]
    for place, A, d, weight in (
        (cols.U_DTHETA, A_g, d_g, dt),
        (cols.U_GYRO, A_g, d_g, 1.0),
        (cols.U_GYRO_MEAN, A_g, d_g, 1.0),
        (cols.U_DVEL, A_a, d_a, dt),
        (cols.U_ACCEL, A_a, d_a, 1.0),
        (cols.U_ACCEL_MEAN, A_a, d_a, 1.0),
    ):
        u[:, place : place + 3] = u[:, place : place + 3] @ A.T + weight * d
