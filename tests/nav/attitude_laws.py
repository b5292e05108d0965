"""A tumbling board made from a law of motion, and what every attitude lane must do with it."""

import math

import numpy as np

from server.nav.engine import NavEngine
from server.nav.types import EngineSettings, Kind
from tests.nav.synthetic import G_M_S2, Stream, field_model, pieces

SIX_AXIS = ("complementary_1", "kalman_angle_bias")
NINE_AXIS = ("complementary", "ahrs_fixed_gain", "vqf")
LANES = (*SIX_AXIS, *NINE_AXIS, "dmp")
FIELD_N_GAUSS = np.array([0.25, 0.0, 0.433])


def product(a, b):
    """Hamilton product of [w, x, y, z]."""
    w, v, W, V = a[0], a[1:], b[0], b[1:]
    return np.array([w * W - v @ V, *(w * V + W * v + np.cross(v, V))])


def attitude(t_s, yaw_rad=0.0):
    """q_nb of a hand that rests for ten seconds, then tilts to and fro and turns; `yaw_rad` turns the whole scene."""
    u = max(0.0, t_s - 10.0)
    roll, pitch = 0.5 * math.sin(0.7 * u) ** 2, 0.4 * math.sin(0.5 * u) ** 2
    yaw = yaw_rad + 0.3 + 0.6 * (1.0 - math.cos(0.3 * u))
    halves = [(math.cos(a / 2), math.sin(a / 2)) for a in (yaw, pitch, roll)]
    (cz, sz), (cy, sy), (cx, sx) = halves
    return product(product(np.array([cz, 0, 0, sz]), np.array([cy, 0, sy, 0])), np.array([cx, sx, 0, 0]))


def matrix(q):
    """R_nb, column by column the body's axes."""
    conjugate = q * [1, -1, -1, -1]
    return np.array([product(product(q, np.array([0.0, *axis])), conjugate)[1:] for axis in np.eye(3)]).T


def rate(t_s, h_s=1e-4):
    """Body rate in rad/s by central difference: independent of anything the lanes use."""
    before, after = attitude(t_s - h_s), attitude(t_s + h_s)
    d = product(before * [1, -1, -1, -1], after)
    return 2.0 * d[1:] / (2.0 * h_s) * math.copysign(1.0, d[0])


def tumbling(duration_s=40.0, rate_hz=200.0, mag_hz=20.0, yaw_rad=0.0, bias=(0.0, 0.0, 0.0), noise=1.0, dmp_hz=0.0):
    """A stream of IMU, field and, when asked, DMP samples."""
    rng, stream = np.random.default_rng(5), Stream()
    for k in range(round(duration_s * rate_hz) + 1):
        t = k / rate_hz
        up = matrix(attitude(t)).T @ np.array([0.0, 0.0, -G_M_S2])
        gyro = rate(t) + bias + noise * 1e-3 * rng.standard_normal(3)
        stream.add(Kind.IMU, t, [*gyro, *(up + noise * 2e-2 * rng.standard_normal(3))])
    for k in range(round(duration_s * mag_hz)):
        stream.add(Kind.MAG, k / mag_hz, matrix(attitude(k / mag_hz, yaw_rad)).T @ FIELD_N_GAUSS)
    for k in range(round(duration_s * dmp_hz)):
        stream.add(Kind.DMP, k / dmp_hz, attitude(k / dmp_hz))
    return stream


def run(block, lane, cut=10**9, lane_parameters=None, **settings):
    """Rows of one lane: (t in s, rows, engine)."""
    parameters = {} if lane_parameters is None else {lane: lane_parameters}
    engine = NavEngine(EngineSettings(lanes=(lane,), lane_parameters=parameters, **settings), field_model)
    rows = [r for piece in pieces(block, cut) for r in engine.step(piece).lanes]
    return np.concatenate([r.t_ns for r in rows]) * 1e-9, np.concatenate([r.data for r in rows]), engine


def errors_deg(t_s, rows, yaw_rad=0.0, after_s=0.0):
    """(tilt, heading) error angles in degrees of the rows after a time."""
    chosen = t_s > after_s
    found = []
    for t, row in zip(t_s[chosen], rows[chosen], strict=True):
        e = product(row[:4], attitude(t, yaw_rad) * [1, -1, -1, -1])
        found.append((2 * math.acos(min(1.0, math.hypot(e[0], e[3]))), abs(2 * math.atan2(e[3], e[0]))))
    tilt, heading = np.degrees(np.array(found)).T
    return tilt, np.minimum(heading, 360.0 - heading)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))
