"""Noise: white noise is found as its own σ, motion and slow errors do not count."""

import numpy as np
import pytest

from server.compare.noise import jitter, noise
from server.compare.signals import quiet_steps
from tests.compare.made import rows_at

T_S = np.arange(0.0, 60.0, 0.02)
T_NS = np.round(T_S * 1e9).astype(np.int64)
CALM = np.ones(len(T_S), dtype=bool)


def test_white_noise_is_its_own_sigma():
    white = 0.3 * np.random.default_rng(1).standard_normal((len(T_S), 2))
    assert jitter(T_NS, white, CALM) == pytest.approx(0.3, rel=0.05)


def test_offsets_drifts_and_slow_errors_do_not_count():
    white = 0.01 * np.random.default_rng(1).standard_normal(len(T_S))
    slow = 5.0 + 0.1 * T_S + 0.5 * np.sin(0.3 * T_S)
    assert jitter(T_NS, (white + slow)[:, None], CALM) == pytest.approx(jitter(T_NS, white[:, None], CALM), rel=0.01)


def test_a_heading_that_passes_south_is_not_noise():
    turning = np.remainder(0.1 * T_S + np.pi, 2 * np.pi)[:, None] - np.pi
    assert jitter(T_NS, turning, CALM, period=2 * np.pi) == pytest.approx(0.0, abs=1e-9)
    assert jitter(T_NS, turning, CALM) != pytest.approx(0.0, abs=1e-3)


def test_only_quiet_stretches_count():
    gyro, accel = np.zeros((len(T_S), 3)), np.tile([0.0, 0.0, -9.8], (len(T_S), 1))
    gyro[1500:, 0] = np.sin(20.0 * T_S[1500:])
    quiet = quiet_steps(T_NS, gyro, accel)
    assert quiet[100:1400].all()
    assert not quiet[1550:].any()
    rows = rows_at(T_S)
    rows.data[:] = rows.data[0]
    rows.data[:, 6] += 0.02 * np.random.default_rng(3).standard_normal(len(T_S))
    rows.data[1500:, 6] += 100.0 * np.random.default_rng(4).standard_normal(1500)
    found = noise(rows, T_NS, quiet)
    assert found.height_m == pytest.approx(0.02, rel=0.06)
    assert noise(rows, T_NS, np.zeros(len(T_S))) is None


def test_a_constant_gyro_bias_is_quiet_and_shaking_is_not():
    gyro, accel = np.full((len(T_S), 3), 0.2), np.tile([0.0, 0.0, -9.8], (len(T_S), 1))
    assert quiet_steps(T_NS, gyro, accel).all()
    shaken = accel + 3.0 * np.random.default_rng(1).standard_normal(accel.shape)
    assert not quiet_steps(T_NS, gyro, shaken).any()
