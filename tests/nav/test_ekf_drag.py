"""A multirotor's drag: it tells the wind and its own size, it carries through an outage, and it is left out on legs."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.nav.ekf import layout as at
from server.nav.ekf.aiding.drag import observe
from server.nav.ekf.states import ATT, DRAG, PACKED, WIND, WITH_DRAG, X_DRAG, X_Q, X_SIZE, X_VEL, X_WIND
from server.nav.ekf.update import inject
from server.nav.types import Aid, AidStatus, VehicleClass

from .ekf_flights import GRID_S, Floats, Motion, Sensors, ramp, rest, stream_of
from .ekf_flown import Flown, attitude_error, fly, position_error
from .synthetic import G_M_S2

KNOWN = {"imu_delay_s": 0.0, "mag_delay_s": 0.0, "gnss_delay_s": 0.0, "baro_delay_s": 0.0}
DRAG_PER_S = 0.4
WIND_M_S = (4.0, -3.0)
START_S, LAND_S = 10.0, 100.0
BIASED = {"accel_bias": (0.1, -0.1, 0.1), "gyro_bias": (0.003, -0.002, 0.002), "mag_noise": 3e-3}
CHEAP = Sensors(accel_noise=0.1, **BIASED)  # type: ignore[arg-type]
SHAKEN = Sensors(accel_noise=0.7, **BIASED)  # type: ignore[arg-type]
OFF = {"drag_sigma_m_s2": 0.0}
DRAG_OFF = {"lane_parameters": {"ins_ekf": OFF}}


class Rotorcraft(Motion):
    """Level loops in the wind: a multirotor pushes along its own −z only, and its drag leans it into the wind."""

    def __init__(self, drag_per_s: float, wind_m_s: tuple[float, float] = WIND_M_S, duration_s: float = LAND_S) -> None:
        super().__init__(duration_s, np.zeros_like, lambda t: 0.2 * ramp(t, 14.0, 4.0) * np.sin(0.11 * t), False)
        t = self.t_s
        flying = ramp(t, START_S, 3.0) * (1.0 - ramp(t, LAND_S - 3.0, 3.0))
        north, east = 6.0 * np.sin(2 * np.pi * (t - START_S) / 23.0), 4.0 * np.sin(2 * np.pi * (t - START_S) / 17.0)
        self.vel_n = flying[:, None] * np.stack([north, east, np.zeros_like(t)], 1)
        self.pos_n = np.cumsum(self.vel_n, axis=0) * GRID_S
        self.pos_n -= np.array([np.interp(0.0, t, self.pos_n[:, i]) for i in range(3)])
        against_air = flying[:, None] * (self.vel_n - [*wind_m_s, 0.0])
        push = np.gradient(self.vel_n, GRID_S, axis=0) - [0.0, 0.0, G_M_S2] + drag_per_s * against_air
        self.R_nb = upright(push, self.yaw)


def upright(push_n: Floats, yaw_rad: Floats) -> Rotation:
    """Return the attitudes with body z against a push, at these headings."""
    z = -push_n / np.linalg.norm(push_n, axis=1, keepdims=True)
    ahead = np.stack([np.cos(yaw_rad), np.sin(yaw_rad), np.zeros_like(yaw_rad)], 1)
    y = np.cross(z, ahead)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return Rotation.from_matrix(np.stack([np.cross(y, z), y, z], axis=2))


FLIGHT = Rotorcraft(DRAG_PER_S)


def flown(motion: Motion = FLIGHT, sensors: Sensors = CHEAP, **settings: object) -> Flown:
    return fly(stream_of(motion, sensors).block(), **({"vehicle": VehicleClass.MULTIROTOR} | KNOWN | settings))


def drag_times(run: Flown) -> NDArray[np.float64]:
    return np.asarray(run.aids[run.aids[:, 0] == Aid.DRAG, 15] * 1e-9, np.float64)


@pytest.mark.parametrize("wind_m_s", [WIND_M_S, (0.0, 0.0), (-8.0, 2.0)])
@pytest.mark.parametrize("drag_per_s", [0.2, 0.4])
def test_wind_and_drag_are_found(wind_m_s: tuple[float, float], drag_per_s: float) -> None:
    run = flown(Rotorcraft(drag_per_s, wind_m_s))
    wind, drag = np.abs(run.states(X_WIND, 2) - wind_m_s), abs(run.states(X_DRAG, 1)[0] - drag_per_s)
    assert (wind < 3.0 * run.sigmas(WIND, 2)).all()
    assert wind.max() < 0.5
    assert run.sigmas(WIND, 2).max() < 1.0
    assert drag < 3.0 * run.sigmas(DRAG, 1)[0] < 0.3
    assert drag < 0.04
    assert (run.statuses(Aid.DRAG) == AidStatus.FUSED).mean() > 0.98


def test_it_shortens_the_way_of_an_outage_and_its_sigma_covers_the_error() -> None:
    told, peaks = {"accel_noise_m_s2_rthz": 0.05}, []
    for given in (told, told | OFF):
        settings = {"lane_parameters": {"ins_ekf": given}, "gnss_withheld_s": ((50.0, 90.0),), "t_origin_ns": 0}
        run = flown(sensors=SHAKEN, **settings)  # type: ignore[arg-type]
        during = run.between(50.0, 90.0)
        error = position_error(run, FLIGHT)[during]
        assert (np.abs(error) < 3.0 * run.rows[during, 16:18]).all()
        peaks.append(np.linalg.norm(error, axis=1).max())
    assert peaks[0] < 0.7 * peaks[1]


def test_with_gnss_it_changes_next_to_nothing() -> None:
    with_it, without = flown(), flown(**DRAG_OFF)  # type: ignore[arg-type]
    late = with_it.t_s > 30.0
    rms = [np.sqrt((attitude_error(run, FLIGHT)[late] ** 2).mean()) for run in (with_it, without)]
    assert rms[0] < 1.02 * rms[1]
    far = [np.sqrt((position_error(run, FLIGHT)[late] ** 2).mean()) for run in (with_it, without)]
    assert far[0] < 1.02 * far[1]


def test_an_airframe_without_drag_has_its_drag_found_as_none_and_is_not_led_astray() -> None:
    slick = Rotorcraft(0.0)
    run = flown(slick)
    assert run.states(X_DRAG, 1)[0] < 0.03
    outage = {"gnss_withheld_s": ((60.0, 85.0),), "t_origin_ns": 0}
    peaks = []
    for settings in (outage, outage | DRAG_OFF):
        lost = flown(slick, **settings)  # type: ignore[arg-type]
        during = lost.between(60.0, 85.0)
        error = position_error(lost, slick)[during]
        assert (np.abs(error) < 3.0 * lost.rows[during, 16:18]).all()
        peaks.append(np.linalg.norm(error, axis=1).max())
    assert peaks[0] < 1.1 * peaks[1]


def test_on_a_slope_there_is_no_drag() -> None:
    slope = rest(40.0)
    slope.R_nb = Rotation.from_euler("ZYX", np.tile([0.0, 0.1, -0.05], (len(slope.t_s), 1)))
    run = flown(slope)
    assert not len(drag_times(run))
    assert not run.has(DRAG)


def test_it_is_used_from_take_off_to_landing() -> None:
    times = drag_times(flown(Rotorcraft(DRAG_PER_S, duration_s=LAND_S + 20.0)))
    assert times.min() > START_S
    assert times.max() < LAND_S
    assert len(times) > 5.0 * 0.6 * (LAND_S - START_S)


@pytest.mark.parametrize("vehicle", [v for v in VehicleClass if v != VehicleClass.MULTIROTOR])
def test_other_vehicles_have_none(vehicle: VehicleClass) -> None:
    run = flown(vehicle=vehicle)
    assert not len(drag_times(run))
    assert not run.has(DRAG)


def test_zero_switches_it_off() -> None:
    run = flown(**DRAG_OFF)  # type: ignore[arg-type]
    assert not len(drag_times(run))
    assert not run.has(WIND)


def test_its_row_of_h_is_the_derivative_of_the_law() -> None:
    """Every state moved a little through `inject` moves the predicted force by H times as much."""
    rng, step = np.random.default_rng(3), 1e-6
    work = np.zeros(at.W_SIZE)
    work[at.W_DIM] = WITH_DRAG
    x = np.zeros(X_SIZE)
    x[X_Q : X_Q + 4] = Rotation.random(random_state=4).as_quat(scalar_first=True)
    x[X_VEL : X_VEL + 3], x[X_WIND : X_WIND + 2], x[X_DRAG] = rng.normal(0, 5, 3), rng.normal(0, 5, 2), 0.3
    for axis in range(2):
        before = observe(x, work, axis)
        H = work[at.W_H : at.W_H + WITH_DRAG].copy()
        for state in (*range(ATT, ATT + 6), WIND, WIND + 1, DRAG):
            moved, P = x.copy(), np.zeros(PACKED)
            work[at.W_DX + state] = step
            inject(moved, P, work)
            assert (observe(moved, work, axis) - before) / step == pytest.approx(H[state], abs=1e-5)
