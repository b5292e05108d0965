"""Boards on motions that are laws, as the attitude mode gets them, and the errors against their truth."""

import numpy as np
from scipy.spatial.transform import Rotation

from server.nav.ekf import layout as at
from server.nav.ekf.attitude import layout as cols
from server.nav.ekf.attitude import parameters as par_at
from server.nav.ekf.attitude.block import run_block
from server.nav.preprocess.accumulate import accumulate
from server.nav.preprocess.memory import new_memory as new_preprocessing
from server.nav.types import Kind

RATE_HZ = 200.0
G_M_S2 = 9.80665
FIELD_GAUSS = np.array([0.2, 0.0, 0.45])  # dips 66°
BIAS_RAD_S = np.array([0.008, -0.011, 0.006])
NOISES = {"gyro": 2e-3, "accel": 0.03, "mag": 0.0}


def still(t):
    return np.zeros((len(t), 3))


def wobble(after_s):
    """Euler angles (yaw, pitch, roll) that start smoothly after a rest and turn the board through many poses."""

    def angles(t):
        u = np.clip(t - after_s, 0.0, None)
        grow = np.clip(u / 3.0, 0.0, 1.0) ** 2
        return grow[:, None] * np.stack((1.6 * np.sin(0.9 * u), 0.9 * np.sin(1.3 * u), 1.4 * np.sin(0.7 * u)), axis=1)

    return angles


class Motion:
    """A board's samples from laws: attitude from Euler angles, specific force from a path, a field in NED."""

    def __init__(self, duration_s, angles, path=None, start_heading_rad=0.0, seed=1, noises=NOISES):
        rng = np.random.default_rng(seed)
        self.t = np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ
        fine = Rotation.from_euler("z", start_heading_rad) * Rotation.from_euler("ZYX", angles(self.t))
        step = Rotation.from_euler("z", start_heading_rad) * Rotation.from_euler("ZYX", angles(self.t + 1e-4))
        back = Rotation.from_euler("z", start_heading_rad) * Rotation.from_euler("ZYX", angles(self.t - 1e-4))
        self.truth = fine
        self.gyro = (back.inv() * step).as_rotvec() / 2e-4 + BIAS_RAD_S
        h = 1e-3
        accel_n = (
            (path(self.t + h) - 2 * path(self.t) + path(self.t - h)) / h**2 if path else np.zeros((len(self.t), 3))
        )
        self.accel = fine.inv().apply(accel_n - [0.0, 0.0, G_M_S2])
        self.mag = fine.inv().apply(FIELD_GAUSS)
        self.gyro = self.gyro + noises["gyro"] * rng.standard_normal(self.gyro.shape)
        self.accel = self.accel + noises["accel"] * rng.standard_normal(self.accel.shape)
        self.mag = self.mag + noises["mag"] * rng.standard_normal(self.mag.shape)

    def steps(self, nav_rate_hz=50.0, with_mag=True):
        n = len(self.t)
        data, kind = np.full((2 * n, 14), np.nan), np.tile(np.array([Kind.MAG, Kind.IMU], dtype=np.uint8), n)
        data[0::2, :3], data[1::2, :3], data[1::2, 3:6] = self.mag, self.gyro, self.accel
        keep = slice(None) if with_mag else slice(1, None, 2)
        t_ns = np.repeat(np.rint(self.t * 1e9).astype(np.int64), 2)
        return preprocessed(kind[keep], t_ns[keep], data[keep], nav_rate_hz)


def preprocessed(kind, t_ns, data, nav_rate_hz):
    """The steps and measurements that the engine's preprocessing makes of samples."""
    s, counters = new_preprocessing()
    steps, meas = np.empty((len(kind), at.U_SIZE)), np.empty((len(kind), at.M_SIZE))
    kind, t_ns, data = (np.ascontiguousarray(a) for a in (kind, t_ns, data))
    n, k = accumulate(kind, t_ns, data, 0, nav_rate_hz, s, counters, steps, meas)
    return steps[:n], meas[:k]


def run(steps, meas, s=None, **changes):
    """Return (rows, s); the laws' board has no delay of its own."""
    par = par_at.default_parameters()
    par[par_at.K_IMU_DELAY] = 0.0
    for name, value in changes.items():
        par[getattr(par_at, name)] = value
    s = cols.new_memory() if s is None else s
    rows = np.empty((len(steps), cols.O_SIZE))
    run_block(np.ascontiguousarray(steps), np.ascontiguousarray(meas), 0.0, s, par, rows)
    return rows, s


def attitude_errors(motion, steps, rows):
    """Rotation vector in NED from the estimate to the truth, rad, one row per step."""
    index = np.rint(steps[:, at.U_T] * 1e-9 * RATE_HZ).astype(int)
    estimate = Rotation.from_quat(rows[:, [1, 2, 3, 0]])
    return (motion.truth[index] * estimate.inv()).as_rotvec()


def tilt_deg(error):
    return np.degrees(np.hypot(error[:, 0], error[:, 1]))


def after(steps, t_s):
    return steps[:, at.U_T] * 1e-9 > t_s
