"""Vertical motions made from laws, and the lanes run over them one step array at a time."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from server.nav.engine import NavEngine
from server.nav.lanes.registry import defaults_of, make
from server.nav.types import LANE_COLUMNS, EngineSettings, Kind

from .synthetic import Stream, field_model, pieces

G_M_S2 = 9.80665  # without a site the lanes take standard gravity
COLUMN = {name: i for i, name in enumerate(LANE_COLUMNS)}
STATUS, POS_D, VEL_D, ALT = COLUMN["status"], COLUMN["pos_d_m"], COLUMN["vel_d_m_s"], COLUMN["alt_m"]


def climb(t, rest_s=8.0):
    """Height, speed and acceleration up: rest, a climb to 20 m in 16 s that starts and ends smoothly, then waves."""
    u = min(max((t - rest_s) / 16.0, 0.0), 1.0)
    h = 20.0 * (u - math.sin(2 * math.pi * u) / (2 * math.pi))
    v = 20.0 / 16.0 * (1 - math.cos(2 * math.pi * u)) if 0 < u < 1 else 0.0
    a = 20.0 / 16.0**2 * 2 * math.pi * math.sin(2 * math.pi * u) if 0 < u < 1 else 0.0
    if t > rest_s + 20.0:  # 2 m up and down every 6 s
        w, s = 2 * math.pi / 6.0, t - rest_s - 20.0
        h, v, a = h + 1 - math.cos(w * s), v + w * math.sin(w * s), a + w * w * math.cos(w * s)
    return h, v, a


def stream_of(
    motion=climb, duration_s=60.0, rate_hz=200.0, baro_hz=25.0, accel_bias=(0.0, 0.0, 0.0), noise=1.0, seed=1,
    baro_error=lambda t: 0.0, baro_delay_s=0.0, baro_off=(math.inf, math.inf), imu_off=(math.inf, math.inf),
    gnss_height_m=None,
):  # fmt: skip
    """A level board moves along the vertical; its barometer reads 100 m at the start."""
    rng, stream = np.random.default_rng(seed), Stream()
    for k in range(round(duration_s * rate_hz) + 1):
        t = k / rate_hz
        accel = np.array([0.0, 0.0, -G_M_S2 - motion(t)[2]]) + accel_bias + noise * 0.02 * rng.standard_normal(3)
        gyro = noise * 1e-3 * rng.standard_normal(3)
        if not imu_off[0] < t < imu_off[1]:
            stream.add(Kind.IMU, t, [*gyro, *accel])
    for k in range(round(duration_s * baro_hz)):
        t = k / baro_hz
        h = 100.0 + motion(t - baro_delay_s)[0] + baro_error(t) + noise * 0.06 * rng.standard_normal()
        if not baro_off[0] < t < baro_off[1]:
            stream.add(Kind.BARO, t, [math.nan, h])
    for k in range(round(duration_s * 10)):
        stream.add(Kind.MAG, k / 10, [0.25, 0.0, 0.433])
    for k in range(round(duration_s * 5)) if gnss_height_m is not None else ():
        stream.add(Kind.GNSS, k / 5, [45.0, 10.0, gnss_height_m + 50.0 * (k % 7), 3.0, -2.0, 9.0, 0.5, 0.8, 0.1, 3.0])
    return stream.block()


def calls_of(block, cut=10**9, **settings):
    """Return what the engine would hand to every lane, in order: ("start", context), ("site", s), ("step", arrays)."""
    calls: list[tuple[str, Any]] = []
    engine = NavEngine(EngineSettings(lanes=("ins_ekf",), **settings), field_model)
    bank: Any = engine._bank
    bank.start = lambda context: calls.append(("start", context))
    bank.set_site = lambda site: calls.append(("site", site))
    bank.step = lambda steps, meas, t_ns: calls.append(("step", (steps.copy(), meas.copy(), t_ns.copy()))) or []
    for piece in pieces(block, cut):
        engine.step(piece)
    return calls


def fly(name: str, calls: Any, values: Any = None, spoil: Any = None) -> tuple[Any, Any]:
    """Run one lane over the calls; return (t_s, rows).

    Args:
        values: parameters that differ from the defaults; a function of the time in s changes them while it runs.
        spoil: changes (steps, meas) before the lane sees them.
    """
    lane: Any = None
    context: Any = None
    t: list[Any] = []
    rows: list[Any] = []
    given = values if callable(values) else lambda _: values or {}
    for what, content in calls:
        if what == "site":
            lane.set_site(content)
            continue
        if what == "start":
            context = content
        at_s = t[-1][-1] * 1e-9 if t else 0.0
        own = replace(context, values=defaults_of(name) | given(at_s))
        if lane is None:
            lane = make(name, own)
        elif what == "start" or callable(values):
            lane.configure(own)
        if what == "step":
            steps, meas, t_ns = content
            if spoil is not None:
                steps, meas = spoil(steps.copy(), meas.copy())
            result = lane.step(steps, meas, t_ns)
            assert result.rows.lane == name
            t.append(result.rows.t_ns)
            rows.append(result.rows.data)
    return np.concatenate(t) * 1e-9, np.concatenate(rows)


def truth_of(t_s, motion=climb):
    """Return the true height and speed, up, at the given times."""
    both = np.array([motion(t)[:2] for t in t_s])
    return both[:, 0], both[:, 1]


def rms(values):
    """Return the root of the mean square; NaN stays NaN."""
    return float(np.sqrt(np.mean(np.square(values))))


def errors(t_s, rows, after_s, motion=climb):
    """Return the RMS of height and speed errors after a time."""
    h, v = truth_of(t_s, motion)
    late = t_s > after_s
    return rms((-rows[:, POS_D] - h)[late]), rms((-rows[:, VEL_D] - v)[late])


def aggressive(t):
    """S3's flight: after 20 s a 3 m stroke up and down every 4 s, for 40 s."""
    if not 20.0 < t < 60.0:
        return 0.0, 0.0, 0.0
    w, s = 2 * math.pi / 4.0, t - 20.0
    return 1.5 * (1 - math.cos(w * s)), 1.5 * w * math.sin(w * s), 1.5 * w * w * math.cos(w * s)


def airflow(t):
    """S3's disturbance: the barometer shows up to 5 m too much, in pulses of a second every 5 s, in those 40 s."""
    s = (t - 20.0) % 5.0
    return 2.5 * (1 - math.cos(2 * math.pi * s)) if 20.0 < t < 60.0 and s < 1.0 else 0.0


def followed(name, error, after_s, until_s, **values):
    """Return the largest height error that a baro error leaves in a lane on a board at rest."""
    still = lambda _: (0.0, 0.0, 0.0)  # noqa: E731
    calls = calls_of(stream_of(still, duration_s=until_s + 5.0, baro_error=error))
    t, rows = fly(name, calls, values)
    return float(np.abs(rows[(t > after_s) & (t < until_s), POS_D]).max())
