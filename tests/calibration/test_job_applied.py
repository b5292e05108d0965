"""What a result becomes in force: laws of the calibrated field and force, with a level and matrices that are not I."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.calibration.options import options_from
from server.nav.calibration.applied import Calibration, conditioned, in_words_of, merged
from server.nav.calibration.registry import collector_for
from server.nav.calibration.types import CalKind, Options, Sensor
from server.nav.types import ROW_WIDTH, Float, Kind
from server.wire_calibration import OptionsIn

EARTH = np.array([0.215, 0.013, 0.432])
GRAVITY = 9.80665
LEVEL = Rotation.from_euler("ZYX", [4.0, -7.0, 11.0], degrees=True).as_matrix()
SOFT = np.array([[1.06, 0.03, -0.02], [0.03, 0.94, 0.01], [-0.02, 0.01, 1.02]])
HARD = np.array([0.11, -0.07, 0.05])
CROSS = np.array([[1.01, 0.02, 0.0], [0.0, 0.99, 0.01], [-0.01, 0.0, 1.02]])


def sensor_of(truth: Calibration, kind: Kind, calibrated: Float) -> Float:
    """Raw rows of a sensor whose perfect calibration is `truth`, for calibrated values of shape (n, 3)."""
    rows = np.full((len(calibrated), ROW_WIDTH), np.nan)
    if kind is Kind.MAG:
        rows[:, :3] = calibrated @ np.linalg.inv(truth.level @ truth.mag_matrix).T + truth.mag_offset
    else:
        rows[:, :3] = truth.gyro_offset
        rows[:, 3:6] = calibrated @ np.linalg.inv(truth.level @ truth.accel_matrix).T + truth.accel_offset
    return rows


TRUTH = Calibration(level=LEVEL, mag_matrix=SOFT, mag_offset=HARD, accel_matrix=CROSS, accel_offset=HARD)


@pytest.mark.parametrize("before", [np.zeros(3), np.array([0.3, -0.2, 0.1])], ids=["first", "over-an-older-one"])
def test_after_a_fixed_heading_the_calibrated_field_is_the_earths_in_the_body(before: Float) -> None:
    present = replace(TRUTH, mag_offset=before)  # level and soft iron known, hard iron not
    attitude = Rotation.from_euler("ZYX", [130.0, 6.0, -9.0], degrees=True)
    field, force = attitude.inv().apply([EARTH, EARTH]), attitude.inv().apply([[0, 0, -GRAVITY]] * 2)
    options = Options(heading_rad=np.radians(130.0), field_n_gauss=tuple(EARTH), strength=float(np.linalg.norm(EARTH)))
    collector = collector_for(CalKind.MAG_FIXED_HEADING, options)
    for i in range(600):  # six seconds
        for kind, value in ((Kind.IMU, force), (Kind.MAG, field)):
            rows = conditioned(CalKind.MAG_FIXED_HEADING, kind, sensor_of(TRUTH, kind, value)[:1], present)
            collector.feed(kind, np.array([i * 10_000_000]), rows)
    fit = collector.fit()
    assert fit.ok, fit.failure
    after = present.having(Sensor.MAG, merged(fit.kind, fit.parameters, fit.sigma, present))
    raw = sensor_of(TRUTH, Kind.MAG, field)
    np.testing.assert_allclose(after.rows(Kind.MAG, raw)[:, :3], field, atol=1e-9)
    assert collector.check(fit.parameters).ok
    old = collector.check(in_words_of(fit.kind, present)).residual.value
    left = np.linalg.norm(present.rows(Kind.MAG, raw)[0, :3] - field[0])
    assert old == pytest.approx(left, abs=1e-6)  # the present one is judged by what it leaves


def test_an_offset_learned_in_flight_composes_with_what_is_in_force() -> None:
    present = replace(TRUTH, mag_offset=np.array([0.02, 0.01, -0.03]))
    field = Rotation.random(50, rng=np.random.default_rng(1)).apply(EARTH)
    raw = sensor_of(TRUTH, Kind.MAG, field)
    left = present.rows(Kind.MAG, raw)[:, :3] - field  # constant in the body: what is to be learned
    np.testing.assert_allclose(left, left[:1].repeat(50, axis=0), atol=1e-12)
    after = present.having(Sensor.MAG, merged(CalKind.MAG_IN_FLIGHT, {"offset": left[0]}, {}, present))
    np.testing.assert_allclose(after.rows(Kind.MAG, raw)[:, :3], field, atol=1e-12)


def test_a_level_over_an_accelerometer_calibration_turns_the_calibrated_force_upright() -> None:
    present = Calibration(accel_matrix=CROSS, accel_offset=HARD, level=Rotation.from_rotvec([0, 0.3, 0]).as_matrix())
    down = Rotation.from_euler("ZYX", [0.0, -7.0, 11.0], degrees=True).as_matrix()
    upright = np.array([[0.0, 0.0, -GRAVITY]])
    raw = sensor_of(replace(present, level=down), Kind.IMU, upright)
    raw[:, :3] = 0.0
    collector = collector_for(CalKind.LEVEL, Options())
    rows = conditioned(CalKind.LEVEL, Kind.IMU, raw.repeat(2000, axis=0), present)
    collector.feed(Kind.IMU, np.arange(2000) * 5_000_000, rows)
    fit = collector.fit()
    assert fit.ok, fit.failure
    after = present.having(Sensor.BOARD, merged(fit.kind, fit.parameters, fit.sigma, present))
    np.testing.assert_allclose(after.rows(Kind.IMU, raw)[:, 3:6], upright, atol=1e-6)
    np.testing.assert_array_equal(after.accel_matrix, CROSS)


def test_a_second_accelerometer_calibration_replaces_the_first_and_is_found_from_the_same_raw_samples() -> None:
    once = Calibration().having(Sensor.ACCEL, {"matrix": CROSS, "offset": HARD})
    rows = sensor_of(TRUTH, Kind.IMU, np.array([[0.0, 0.0, -GRAVITY]]))
    for kind in (CalKind.ACCEL_MULTI_POSE, CalKind.ACCEL_SIX_POSITION, CalKind.GYRO_BIAS, CalKind.GYRO_SCALE):
        np.testing.assert_array_equal(conditioned(kind, Kind.IMU, rows, once), rows)
    found = {"matrix": np.diag([1.1, 1.2, 1.3]), "offset": -HARD}
    twice = once.having(Sensor.ACCEL, merged(CalKind.ACCEL_MULTI_POSE, found, {}, once))
    np.testing.assert_array_equal(twice.accel_matrix, found["matrix"])
    np.testing.assert_array_equal(twice.accel_offset, found["offset"])


def test_a_turntable_keeps_the_axes_that_were_not_turned_and_a_bias_keeps_the_whole_matrix() -> None:
    present = Calibration(gyro_matrix=np.diag([1.03, 0.97, 1.01]))
    found = {"scale": np.array([1.0, 1.0, 1.05]), "bias": np.full(3, 0.01)}
    sigma = {"scale": np.array([np.nan, np.nan, 1e-4]), "bias": np.full(3, 1e-5)}
    after = present.having(Sensor.GYRO, merged(CalKind.GYRO_SCALE, found, sigma, present))
    np.testing.assert_array_equal(after.gyro_matrix, np.diag([1.03, 0.97, 1.05]))
    crossed = Calibration(gyro_matrix=CROSS)  # by an import
    only_bias = merged(CalKind.GYRO_BIAS, {"bias": found["bias"]}, {}, crossed)
    after = crossed.having(Sensor.GYRO, only_bias)
    np.testing.assert_array_equal(after.gyro_matrix, CROSS)
    np.testing.assert_array_equal(after.gyro_offset, found["bias"])


@pytest.mark.parametrize("sensor", Sensor)
def test_what_a_sensor_says_of_itself_puts_it_back_as_it_was(sensor: Sensor) -> None:
    whole = replace(TRUTH, gyro_matrix=CROSS, gyro_offset=HARD, baro_bias_m=3.0, diff_pressure_bias_pa=4.0)
    blank = whole.having(sensor, {})
    assert not np.array_equal(blank.flat(), whole.flat())
    np.testing.assert_array_equal(blank.having(sensor, whole.of(sensor)).flat(), whole.flat())


def test_every_option_reaches_the_collector_and_a_persons_word_wins_over_the_sites() -> None:
    site = SimpleNamespace(field_n_gauss=tuple(EARTH), gravity_m_s2=9.81)
    told = OptionsIn(
        axis="z",
        turns=3.0,
        ellipsoid_parameters=6,
        duration_s=7.0,
        heading_deg=90.0,
        heading_sigma_deg=5.0,
        height_m=480.0,
        strength_gauss=0.5,
        gravity_m_s2=9.79,
    )
    found = options_from(told, site)
    assert (found.unit, found.axis, found.turns, found.ellipsoid_parameters, found.duration_s) == (
        "si",
        "z",
        3.0,
        6,
        7.0,
    )
    assert (found.heading_rad, found.heading_sigma_rad) == pytest.approx((np.pi / 2, np.radians(5.0)))
    assert (found.height_m, found.strength, found.gravity_m_s2) == (480.0, 0.5, 9.79)
    np.testing.assert_allclose(found.field_n_gauss, EARTH * 0.5 / np.linalg.norm(EARTH), rtol=1e-12)
    untold = options_from(OptionsIn(), site)
    assert untold.strength == pytest.approx(float(np.linalg.norm(EARTH)))
    assert (untold.field_n_gauss, untold.gravity_m_s2) == (tuple(EARTH), 9.81)
    nowhere = options_from(OptionsIn(), None)
    assert np.isnan(nowhere.strength)
    assert (nowhere.field_n_gauss, nowhere.gravity_m_s2) == ((), 9.80665)
