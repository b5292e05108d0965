"""What really happens to the demo board: attitude from differential flatness, rates and specific force from that.

A quadrotor can push along its own −z only. So the path's acceleration, gravity and drag in the wind give the
direction of body z; the heading of the path gives the rest [Mellinger & Kumar 2011, section III]. Near the ground
the wind dies out and the legs hold the body to the slope of the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from server.nav.types import Float
from server.sim import earth
from server.sim.path import PERIOD_S, path_at
from server.sim.settings import SimSettings

TICK_S: Final = 1e-3
"""Truth is tabulated at 1 kHz."""
DRAG_PER_S: Final = 0.25
"""Rotor and frame drag over mass: 5 m/s of air speed lean the body 7°, as multirotors of about 2 kg do."""
SLOPE_N_M_S2: Final = np.array([0.18, -0.26, 0.0])
"""Share of gravity along the slope of the field, NED: it tilts the standing board by 1.8°."""
SHELTER_M: Final = 10.0
"""Height from which on the wind is undisturbed."""
LEGS_M: Final = 0.4
"""Height at which the legs have let go."""
WIND_FROM_RAD: Final = math.radians(250.0)
GUST_CYCLES: Final = np.array([4.0, 7.0, 11.0, 17.0, 29.0])
"""Cycles of the gusts in one flight: whole numbers, so that they close with it; periods of 34 to 5 s."""
GUST_SHARE: Final = 0.25
"""RMS of the gusts over the mean wind: open country, IEC 61400-1 says 0.12 to 0.2 for the long ones, plus margin."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TruthState:
    """Truth at given times, one row each.

    Attributes:
        t_s: shape (n,), seconds since power-up.
        pos_n_m, vel_n_m_s: shape (n, 3), NED from the site.
        wind_n_m_s: shape (n, 3).
        q_nb: shape (n, 4), continuous in sign along one call.
        R_nb: shape (n, 3, 3).
        accel_b_m_s2: shape (n, 3), specific force.
        spin_b_rad_s: shape (n, 3), rotation of the local frame in inertial space, seen in the body.
        flying: shape (n,), 0 on the legs, 1 in the air.
    """

    t_s: Float
    pos_n_m: Float
    vel_n_m_s: Float
    wind_n_m_s: Float
    q_nb: Float
    R_nb: Float
    accel_b_m_s2: Float
    spin_b_rad_s: Float
    flying: Float


class FlightTruth:
    """The endless flight of one board."""

    def __init__(self, settings: SimSettings) -> None:
        rng = np.random.default_rng([settings.seed, 1])
        self._mean_m_s = -settings.wind_m_s * np.array([math.cos(WIND_FROM_RAD), math.sin(WIND_FROM_RAD), 0.0])
        self._phase_rad = rng.uniform(0.0, 2.0 * math.pi, (3, GUST_CYCLES.size))
        weight = GUST_CYCLES**-0.5
        weight *= GUST_SHARE * settings.wind_m_s * math.sqrt(2.0) / np.linalg.norm(weight)
        self._gust_m_s = weight * np.array([[1.0], [0.8], [0.3]])

    def wind_at(self, t_s: Float, height_m: Float) -> Float:
        """Return the wind, NED m/s, shape (n, 3): mean and gusts, fading towards the ground."""
        angle = (2.0 * math.pi / PERIOD_S * GUST_CYCLES)[:, None] * np.mod(t_s, PERIOD_S)
        gust = np.stack([self._gust_m_s[i] @ np.sin(angle + self._phase_rad[i][:, None]) for i in range(3)], axis=1)
        return np.asarray((self._mean_m_s + gust) * smooth(height_m / SHELTER_M)[:, None])

    def at(self, t_s: Float) -> TruthState:
        """Return the truth at any times since power-up, shape (n,)."""
        place, speed, pull = path_at(t_s)
        pos, vel = place[:, :3], speed[:, :3]
        height = -pos[:, 2]
        flying = smooth(height / LEGS_M)
        wind = self.wind_at(t_s, height)
        force = pull[:, :3] - np.outer(earth.gravity_m_s2(earth.SITE_ALT_M + height), [0.0, 0.0, 1.0])
        thrust = force + DRAG_PER_S * (vel - wind) * flying[:, None] + SLOPE_N_M_S2 * (1.0 - flying[:, None])
        q_nb, R_nb = attitude_of(thrust, place[:, 3])
        turn = earth.turn_rate_n_rad_s(vel)
        force += np.cross(2.0 * earth.EARTH_RATE_N_RAD_S + turn, vel)  # Coriolis, as seen from the turning frame
        return TruthState(
            t_s=t_s,
            pos_n_m=pos,
            vel_n_m_s=vel,
            wind_n_m_s=wind,
            q_nb=q_nb,
            R_nb=R_nb,
            accel_b_m_s2=_body(R_nb, force),
            spin_b_rad_s=_body(R_nb, earth.EARTH_RATE_N_RAD_S + turn),
            flying=flying,
        )


def imu_between(state: TruthState) -> tuple[Float, Float]:
    """Return what an ideal strapped-down IMU averages between neighbouring rows of `state`.

    Returns:
        Rotation rate in inertial space, rad/s, and specific force, m/s², body, each of shape (n − 1, 3): the rate is
        the exact rotation vector between the two attitudes over the time between them.
    """
    dt_s = np.diff(state.t_s)[:, None]
    w0, v0 = state.q_nb[:-1, :1], state.q_nb[:-1, 1:]
    w1, v1 = state.q_nb[1:, :1], state.q_nb[1:, 1:]
    vector = w0 * v1 - w1 * v0 - np.cross(v0, v1)  # imaginary part of conj(q0) ⊗ q1
    sine = np.linalg.norm(vector, axis=1, keepdims=True)
    scalar = np.sum(w0 * w1, axis=1, keepdims=True) + np.sum(v0 * v1, axis=1, keepdims=True)
    ratio = np.divide(np.arcsin(np.minimum(sine, 1.0)), sine, out=np.ones_like(sine), where=sine > 1e-12)
    rate = 2.0 * np.sign(scalar) * ratio * vector / dt_s
    return rate + _mean(state.spin_b_rad_s), _mean(state.accel_b_m_s2)


def attitude_of(thrust_n: Float, yaw_rad: Float) -> tuple[Float, Float]:
    """Return q_nb (n, 4) and R_nb (n, 3, 3) with body z against `thrust_n` (n, 3) and the given ZYX yaw (n,)."""
    z = -thrust_n / np.linalg.norm(thrust_n, axis=1, keepdims=True)
    cy, sy = np.cos(yaw_rad), np.sin(yaw_rad)
    x1, y1 = cy * z[:, 0] + sy * z[:, 1], cy * z[:, 1] - sy * z[:, 0]
    roll, pitch = np.arcsin(-y1), np.arctan2(x1, z[:, 2])
    x = np.column_stack([cy * np.cos(pitch), sy * np.cos(pitch), -np.sin(pitch)])
    y = np.cross(z, x)
    return _quat_from_euler(roll, pitch, yaw_rad), np.stack([x, y, z], axis=2)


def _quat_from_euler(roll_rad: Float, pitch_rad: Float, yaw_rad: Float) -> Float:
    cr, sr = np.cos(0.5 * roll_rad), np.sin(0.5 * roll_rad)
    cp, sp = np.cos(0.5 * pitch_rad), np.sin(0.5 * pitch_rad)
    cy, sy = np.cos(0.5 * yaw_rad), np.sin(0.5 * yaw_rad)
    q_cols = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return np.stack(q_cols, axis=1)


def smooth(x: Float) -> Float:
    """Return 0 below 0, 1 above 1 and a C³ step between, shape as `x`."""
    u = np.clip(x, 0.0, 1.0)
    return np.asarray(u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3))


def _body(R_nb: Float, vector_n: Float) -> Float:
    return np.asarray(np.matvec(np.swapaxes(R_nb, 1, 2), np.broadcast_to(vector_n, R_nb.shape[:2])))


def _mean(rows: Float) -> Float:
    return 0.5 * (rows[1:] + rows[:-1])
