"""Each step of the chain by itself, against scipy or a law."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.spatial.transform import Rotation

from server.chain_values import chain_values, changed_chain
from server.nav.preprocess import chain_layout as at
from server.nav.preprocess import memory
from server.nav.preprocess.airspeed import air_density, airspeed_from_pressure
from server.nav.preprocess.butterworth import butterworth, design, group_delay, settle
from server.nav.preprocess.clipping import clipped
from server.nav.preprocess.limit import limit
from server.nav.preprocess.lowpass import lowpass, lowpass_delay, weight
from server.nav.preprocess.units import MOUNTINGS, mounting_deg, mounting_matrix
from server.nav.preprocess.window import window, window_delay

RATE_HZ = 200.0
COEFFICIENTS, STATES = 0, 5 * at.SECTIONS


def channel():
    """An array with room for coefficients and the states of one channel."""
    return np.zeros(STATES + at.Z_SIZE)


def designed(order, cutoff_hz, rate_hz=RATE_HZ):
    c = channel()
    c[COEFFICIENTS:STATES:5] = 1.0
    sections = design(order, cutoff_hz, 1.0 / rate_hz, c[:STATES])
    return c, sections


def noise(n=500, seed=3):
    return np.random.default_rng(seed).normal(size=n)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("cutoff_hz", [0.5, 20.0, 85.0])
def test_butterworth_is_scipys(order, cutoff_hz):
    c, sections = designed(order, cutoff_hz)
    x = noise()
    got = [butterworth(c, COEFFICIENTS, sections, STATES, value) for value in x]
    expected = signal.sosfilt(signal.butter(order, cutoff_hz, fs=RATE_HZ, output="sos"), x)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("cutoff_hz", [2.0, 30.0])
def test_the_delay_told_is_the_group_delay_at_frequency_zero(order, cutoff_hz):
    c, sections = designed(order, cutoff_hz)
    b, a = signal.butter(order, cutoff_hz, fs=RATE_HZ)
    h = 1e-3  # rad per sample: the slope of the phase there
    _, response = signal.freqz(b, a, worN=[h])
    expected = -np.angle(response[0]) / h / RATE_HZ
    assert group_delay(c[:STATES], sections, 1.0 / RATE_HZ) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_ramp_comes_out_late_by_the_delay_told(order):
    c, sections = designed(order, 10.0)
    ramp = np.arange(1000) / RATE_HZ
    out = [butterworth(c, COEFFICIENTS, sections, STATES, value) for value in ramp]
    assert ramp[-1] - out[-1] == pytest.approx(group_delay(c[:STATES], sections, 1.0 / RATE_HZ), rel=1e-9)


def test_a_cutoff_the_rate_does_not_allow_leaves_the_filter_out():
    assert designed(2, 95.0)[1] == 0
    assert designed(2, 0.0)[1] == 0
    assert designed(2, 80.0)[1] == 1


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_settled_filter_answers_its_constant_from_the_first_sample_on(order):
    c, sections = designed(order, 7.0)
    settle(c, COEFFICIENTS, STATES, -9.81, 1.0)
    assert [butterworth(c, COEFFICIENTS, sections, STATES, -9.81) for _ in range(50)] == pytest.approx([-9.81] * 50)


def test_the_low_pass_halves_the_power_at_its_cutoff_and_a_ramp_is_late_by_rc():
    """The analog law, for samples close enough. With the weights as S0 has them 5 Hz would pass almost untouched."""
    cutoff_hz, rate_hz = 5.0, 5000.0
    c, a = channel(), weight(1.0 / rate_hz, cutoff_hz)
    t = np.arange(20000) / rate_hz
    out = np.array([lowpass(c, STATES, value, a) for value in np.sin(2 * np.pi * cutoff_hz * t)])
    assert np.ptp(out[10000:]) / 2.0 == pytest.approx(math.sqrt(0.5), rel=0.01)
    c = channel()
    ramp = [lowpass(c, STATES, value, a) for value in t]
    assert t[-1] - ramp[-1] == pytest.approx(lowpass_delay(cutoff_hz), rel=1e-3)
    np.testing.assert_allclose(lowpass_delay(cutoff_hz), 1 / (2 * np.pi * cutoff_hz))


@pytest.mark.parametrize(("samples", "lag"), [(1, 0), (3, 0), (64, 0), (1, 5), (4, 9)])
def test_the_window_is_the_mean_of_its_samples_and_waits_as_told(samples, lag):
    c, x = channel(), noise(200)
    out = np.array([window(c, STATES, i % at.WINDOW_MAX, v, samples, lag, min(i, 64)) for i, v in enumerate(x)])
    mean = np.convolve(x, np.ones(samples) / samples)[: len(x)]
    begin = samples + lag
    np.testing.assert_allclose(out[begin:], mean[begin - lag : len(x) - lag], atol=1e-12)
    assert window_delay(samples, lag, 0.01) == pytest.approx(0.01 * ((samples - 1) / 2 + lag))
    assert out[0] == x[0]


@pytest.mark.parametrize("seen", [1, 2, 5])
def test_a_window_that_is_not_full_is_the_mean_of_what_there_is(seen):
    c, x = channel(), noise(seen)
    out = [window(c, STATES, i, value, 10, 0, i) for i, value in enumerate(x)]
    assert out[-1] == pytest.approx(x.mean())


def test_a_spike_is_replaced_and_a_new_level_is_accepted_after_so_many_rejections():
    c = channel()
    values = [0.0, 0.4, 9.0, 0.5, *[20.0] * 6]
    out = [limit(c, STATES, value, 0.5, 3.0) for value in values]
    assert out == [0.0, 0.4, 0.4, 0.5, 0.5, 0.5, 0.5, 20.0, 20.0, 20.0]


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=60))
@settings(max_examples=60, deadline=None)
def test_the_limit_never_sticks_longer_than_its_count(values):
    c, count = channel(), 4
    out = [limit(c, STATES, value, 1.0, float(count)) for value in values]
    away = [abs(o - v) > 1e-12 for o, v in zip(out, values, strict=True)]
    longest = max((len(run) for run in "".join("x" if a else " " for a in away).split()), default=0)
    assert longest <= count


def test_clipping_is_the_largest_value_twice_in_a_row_or_the_full_scale_that_was_told():
    s = np.zeros(2)
    full = 2000.0 / 180.0 * math.pi
    seen = [clipped(v, 0.0, 2.0, s, 0) for v in (0.1, 0.1, 3.0, full, full, -full, 5.0, 5.0, full, 0.1, 0.1)]
    assert seen == [False, False, False, False, True, True, False, False, False, False, False]
    assert [clipped(v, 20.0, 2.0, s, 0) for v in (19.9, 19.99, 20.0, -20.0)] == [False, True, True, True]
    assert memory.N_CLIPPED < memory.N_COUNTERS


def test_mountings_by_name_are_the_rotations_that_they_say():
    """About down first, then right, then forward, by a second implementation of Euler angles."""
    assert len(set(MOUNTINGS)) == 4 * 4 * 8
    for name in MOUNTINGS:
        roll, pitch, yaw = mounting_deg(name)
        expected = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix()
        np.testing.assert_allclose(mounting_matrix(roll, pitch, yaw), expected, atol=1e-15)
    np.testing.assert_array_equal(mounting_matrix(180.0, 0.0, 0.0), np.diag([1.0, -1.0, -1.0]))
    assert mounting_deg("Roll180_Yaw45") == (180.0, 0.0, 45.0)
    for wrong in ("roll", "yaw30", "yaw90roll90", "upside", ""):
        with pytest.raises(ValueError, match="no mounting"):
            mounting_deg(wrong)


def test_airspeed_follows_from_pressure_and_density():
    """ISA: at sea level 61.25 Pa is 10 m/s; at 5000 m the density is 0.7361 kg/m³."""
    assert airspeed_from_pressure(61.25, 1.225) == pytest.approx(10.0)
    assert airspeed_from_pressure(-3.0, 1.225) == 0.0
    assert air_density(101325.0, 15.0) == pytest.approx(1.225, rel=1e-4)
    assert air_density(54019.9, math.nan) == pytest.approx(0.7361, rel=1e-3)
    assert air_density(math.nan, 20.0) == 1.225
    assert air_density(54019.9, -17.5) == pytest.approx(0.7361, rel=1e-3)


def test_texts_name_sensors_together_and_mountings():
    texts = ["imu.butterworth_hz=40", "gyro.butterworth_hz=50", "board.mounting=roll180", "baro.window_samples=3"]
    found = chain_values(texts)
    assert found["gyro"] == {"butterworth_hz": 50.0, "roll_deg": 180.0, "pitch_deg": 0.0, "yaw_deg": 0.0}
    assert found["accel"]["butterworth_hz"] == 40.0
    assert found["mag"]["roll_deg"] == 180.0
    assert changed_chain(found)["mag"] == {"roll_deg": 180.0}
    for wrong in ("gyro", "gyro.butterworth_hz", "gyro.butterworth_hz=fast", "mag.mounting=sideways"):
        with pytest.raises(ValueError, match=r"SENSOR|LANE|number|mounting"):
            chain_values([wrong])
