"""Biases that run with the temperature: how the slope is followed, and what it adds."""

import math

import numpy as np

from server.nav.ekf import layout as at
from server.nav.ekf.states import ACCEL_BIAS, GYRO_BIAS, PACKED, packed
from server.nav.ekf.warming import (
    ACCEL_DRIFT_M_S3,
    ACCEL_LEARNED_S,
    GYRO_DRIFT_RAD_S2,
    GYRO_LEARNED_S,
    note_temperature,
    walk,
    walk_with_temperature,
)

DT_S = 0.02


def followed(temperatures):
    u, aux = np.zeros(at.U_SIZE), np.zeros(at.A_SIZE)
    u[at.U_DT], aux[at.A_TEMPERATURE] = DT_S, math.nan
    for t in temperatures:
        u[at.U_TEMPERATURE] = t
        note_temperature(u, aux)
    return aux[at.A_WARMING]


def test_a_ramp_is_followed_by_its_slope_and_a_settled_board_has_none():
    ramp = 28.0 + 0.06 * DT_S * np.arange(6000)
    assert abs(followed(ramp) - 0.06) < 0.001
    assert abs(followed(np.concatenate((ramp, np.full(6000, ramp[-1]))))) < 0.001


def test_hundredths_of_a_kelvin_and_missing_temperatures_are_no_warming():
    rng = np.random.default_rng(1)
    assert abs(followed(np.round(40.0 + 0.02 * rng.standard_normal(5000), 2))) < 0.001
    assert followed(np.full(100, math.nan)) == 0.0


def test_a_warming_board_adds_the_walk_that_goes_as_far_as_the_ramp_while_it_is_learned():
    P, u, par, aux = np.zeros(PACKED), np.zeros(at.U_SIZE), np.zeros(at.PAR_SIZE), np.zeros(at.A_SIZE)
    u[at.U_DT], aux[at.A_WARMING] = DT_S, -0.05  # cooling moves a bias as well
    par[at.PAR_GYRO_PER_K] = GYRO_DRIFT_RAD_S2 / 0.05
    par[at.PAR_ACCEL_PER_K] = 2.0 * ACCEL_DRIFT_M_S3 / 0.05
    for _ in range(round(GYRO_LEARNED_S / DT_S)):
        walk_with_temperature(P, u, par, aux)
    gyro = P[packed(GYRO_BIAS, GYRO_BIAS)]
    np.testing.assert_allclose(gyro, (GYRO_DRIFT_RAD_S2 * GYRO_LEARNED_S) ** 2, rtol=1e-9)
    accel = P[packed(ACCEL_BIAS + 2, ACCEL_BIAS + 2)]
    learned_s = ACCEL_LEARNED_S * 0.5**0.4  # twice the drift, learned sooner
    np.testing.assert_allclose(accel, (2.0 * ACCEL_DRIFT_M_S3) ** 2 * learned_s * GYRO_LEARNED_S, rtol=1e-9)
    assert np.count_nonzero(P) == 6


def test_a_bias_that_no_temperature_moves_gets_nothing():
    assert walk(0.0, GYRO_DRIFT_RAD_S2, GYRO_LEARNED_S) == 0.0
