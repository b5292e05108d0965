"""The sensors' errors have the sizes and the colours that they are said to have."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from server.nav.types import Float
from server.sim import SimSettings
from server.sim.noise import GaussMarkov, LowPass
from server.sim.sensors import ACCEL_NOISE_M_S2_RTHZ, BLOCK, GYRO_NOISE_RAD_S_RTHZ, SensorBlock, Sensors


def blocks(settings: SimSettings, seconds: float) -> Iterator[SensorBlock]:
    sensors = Sensors(settings)
    for _ in range(round(seconds * 1000 / BLOCK)):
        yield sensors.step()


def imu(settings: SimSettings, seconds: float) -> Float:
    return np.concatenate([block.imu for block in blocks(settings, seconds)])


def test_at_rest_the_allan_deviation_at_one_second_is_the_noise_density() -> None:
    """40 boards, each for its 12 s of standing: N/√τ at τ = 1 s, which the 20 Hz filter does not touch."""
    differences = []
    for seed in range(40):
        second = imu(SimSettings(seed=seed), 12.0)[1000:].reshape(11, 1000, 6).mean(axis=1)
        differences.append(np.diff(second, axis=0))
    deviation = np.sqrt(0.5 * np.mean(np.concatenate(differences) ** 2, axis=0))
    np.testing.assert_allclose(deviation[:3], GYRO_NOISE_RAD_S_RTHZ, rtol=0.12)
    np.testing.assert_allclose(deviation[3:], ACCEL_NOISE_M_S2_RTHZ, rtol=0.12)


def test_two_boards_differ_in_their_biases_and_one_board_is_itself_again() -> None:
    first, again, other = (imu(SimSettings(seed=seed), 4.0) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    apart = np.abs(first.mean(axis=0) - other.mean(axis=0))
    assert apart[:3].max() > math.radians(0.05)
    assert apart[3:].max() > 0.005


def test_the_mean_at_rest_is_truth_plus_the_bias_it_declares() -> None:
    some = list(blocks(SimSettings(seed=4), 10.0))
    error = np.concatenate([b.imu - b.imu_true for b in some]).mean(axis=0)
    bias = np.mean([np.concatenate([b.gyro_bias_rad_s, b.accel_bias_m_s2]) for b in some], axis=0)
    np.testing.assert_allclose(error[:3], bias[:3], atol=2e-4)
    np.testing.assert_allclose(error[3:5], bias[3:5], atol=6e-3)
    assert abs(error[5] - bias[5]) < 0.013  # scale error times gravity


def test_the_gyro_drifts_as_the_board_warms_up() -> None:
    some = list(blocks(SimSettings(seed=2), 120.0))
    assert some[-1].temperature_degc - some[0].temperature_degc > 5.0
    drift = np.abs(some[-1].gyro_bias_rad_s - some[0].gyro_bias_rad_s).max()
    assert math.radians(0.005) < drift < math.radians(0.1)


def test_an_ideal_board_has_no_error_but_its_delay() -> None:
    """Slow signals leave the filter 11 ms late: the middle of each millisecond, 10.5 ms before its stamp."""
    some = list(blocks(SimSettings(noise=0.0), 60.0))
    held, true = np.concatenate([b.imu for b in some]), np.concatenate([b.imu_true for b in some])
    stamp_s = np.arange(1, len(held) + 1) * 1e-3
    for column in (2, 3, 5):
        errors = [
            np.std(held[200:, column] - np.interp(stamp_s[200:] - delay, stamp_s - 5e-4, true[:, column]))
            for delay in np.arange(0.008, 0.0141, 0.001)
        ]
        assert int(np.argmin(errors)) == 3, "least at 11 ms"
        assert errors[3] < 0.02 * np.std(held[:, column])


def test_the_low_pass_is_a_20_hertz_filter_and_does_not_care_how_it_is_cut() -> None:
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((4000, 2))
    whole = LowPass(0.0105, 3, 1e-3).step(rows)
    parts = LowPass(0.0105, 3, 1e-3)
    np.testing.assert_allclose(np.concatenate([parts.step(p) for p in np.split(rows, [1, 7, 900])]), whole, atol=1e-12)
    t_s = np.arange(4000) * 1e-3
    for hz, gain in ((2.0, 1.0), (23.7, math.sqrt(0.5)), (163.0, 1.0 / 84.0)):
        out = LowPass(0.0105, 3, 1e-3).step(np.sin(2 * math.pi * hz * t_s)[:, None])[1000:]
        assert math.isclose(math.sqrt(2.0) * float(out.std()), gain, rel_tol=0.1)


def test_a_gauss_markov_error_has_its_size_and_its_memory() -> None:
    source = GaussMarkov(np.random.default_rng(1), np.full(4000, 0.25), 10.0, 0.2)
    start = source.value.copy()
    assert start.std() == pytest.approx(0.25, rel=0.05)
    for _ in range(50):
        source.step()
    assert source.value.std() == pytest.approx(0.25, rel=0.05)
    assert float(np.corrcoef(start, source.value)[0, 1]) == pytest.approx(math.exp(-1.0), abs=0.05)


def test_rotors_shake_the_board_only_while_they_turn() -> None:
    held = imu(SimSettings(wind_m_s=0.0), 30.0)
    ripple = [np.diff(held[a:b, 5], n=2).std() for a, b in ((2000, 10000), (20000, 24000))]
    assert ripple[1] > 3.0 * ripple[0]
