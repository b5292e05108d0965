"""The straight-line covariance code against dense algebra, and against its own derivation."""

import ast
from pathlib import Path

import numpy as np
import pytest

from server.nav.ekf import covariance, derivation
from server.nav.ekf import layout as at
from server.nav.ekf.covariance import predict_covariance
from server.nav.ekf.predict import fade, predict, predict_columns, predict_slow, turn_mix
from server.nav.ekf.states import (
    ACCEL_BIAS,
    ATT,
    FIELD,
    GYRO_BIAS,
    INERTIAL,
    JITTER,
    MIX,
    PACKED,
    POS,
    VEL,
    WANDER,
    WITH_BARO,
    WITH_DRAG,
    WITH_MAG,
    WITH_WANDER,
    WITH_WIND,
    X_SIZE,
    X_WANDER,
    N,
    packed,
)
from server.nav.ekf.update import correction_seen, fuse, project

LOWER = np.tril_indices(N)
DIMS = (INERTIAL, WITH_MAG, WITH_WIND, WITH_DRAG, WITH_BARO, WITH_WANDER, N)


def random_covariance(rng):
    A = rng.normal(size=(N, N))
    return A @ A.T


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def dense(P, u):
    """F P Fᵀ + Q written as the paper writes it."""
    f, A, dt, q = u[:3], u[3:12].reshape(3, 3), u[12], u[13:18]
    F = np.eye(N)
    F[ATT : ATT + 3, GYRO_BIAS : GYRO_BIAS + 3] = -A
    F[VEL : VEL + 3, ATT : ATT + 3] = -skew(f)
    F[VEL : VEL + 3, ACCEL_BIAS : ACCEL_BIAS + 3] = -A
    F[POS : POS + 3, VEL : VEL + 3] = dt * np.eye(3)
    Q = np.zeros(N)
    for block, value in zip((ATT, VEL, POS, GYRO_BIAS, ACCEL_BIAS), q, strict=True):
        Q[block : block + 3] = value
    return F @ P @ F.T + np.diag(Q)


@pytest.mark.parametrize("seed", range(5))
def test_prediction_equals_dense_algebra(seed):
    rng = np.random.default_rng(seed)
    P, u = random_covariance(rng), rng.normal(size=18)
    out = P[LOWER].copy()
    predict_covariance(out, u)
    predict_columns(out, u, FIELD, N)
    np.testing.assert_allclose(out, dense(P, u)[LOWER], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("n", DIMS)
def test_a_filter_without_the_later_blocks_is_a_prefix_of_the_whole_one(n):
    rng = np.random.default_rng(n)
    P, u = random_covariance(rng), rng.normal(size=18)
    out, work = P[LOWER].copy(), np.zeros(at.W_SIZE)
    rest = out[n * (n + 1) // 2 :].copy()
    work[at.W_DIM] = n
    predict_covariance(out, u)
    predict_columns(out, u, FIELD, n)
    work[at.W_H : at.W_H + n] = rng.normal(size=n)
    fuse(out, work, 0.3, project(out, work) + 1.0)
    H = work[at.W_H : at.W_H + n]
    small = dense(P, u)[:n, :n]
    small -= np.outer(small @ H, small @ H) / (H @ small @ H + 1.0)
    np.testing.assert_allclose(out[: n * (n + 1) // 2], small[np.tril_indices(n)], rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(out[n * (n + 1) // 2 :], rest)


@pytest.mark.parametrize("first", [WANDER, JITTER])
def test_fading_is_a_gauss_markov_step_of_three_states_in_dense_algebra(first):
    P = random_covariance(np.random.default_rng(first))
    F, Q = np.eye(N), np.zeros(N)
    F[range(first, first + 3), range(first, first + 3)] = 0.97
    Q[first : first + 3] = 0.2, 0.2, 0.5
    out = P[LOWER].copy()
    fade(out, first, N, 0.97, 0.2, 0.5)
    np.testing.assert_allclose(out, (F @ P @ F.T + np.diag(Q))[LOWER], rtol=1e-12, atol=1e-12)


def test_a_block_that_was_never_started_does_not_come_by_noise():
    P = random_covariance(np.random.default_rng(2))
    P[WANDER : WANDER + 3, :] = P[:, WANDER : WANDER + 3] = 0.0
    out = P[LOWER].copy()
    fade(out, WANDER, N, 0.97, 0.2, 0.5)
    np.testing.assert_array_equal(out, P[LOWER])


def test_errors_of_the_gyros_scale_and_axes_turn_the_attitude_as_in_dense_algebra():
    rng = np.random.default_rng(8)
    P, u, dtheta = random_covariance(rng), rng.normal(size=18), rng.normal(size=3)
    F = np.eye(N)
    F[ATT : ATT + 3, MIX : MIX + 9] = -u[3:12].reshape(3, 3) @ np.kron(np.eye(3), dtheta) / u[12]
    out = P[LOWER].copy()
    turn_mix(out, u, dtheta, N)
    np.testing.assert_allclose(out, (F @ P @ F.T)[LOWER], rtol=1e-11, atol=1e-11)


def test_a_receivers_slow_error_settles_at_its_long_term_variance_and_forgets_its_value():
    x, P, u = np.zeros(X_SIZE), np.zeros(PACKED), np.zeros(at.U_SIZE)
    par, aux, ctl, work = np.zeros(at.PAR_SIZE), np.zeros(at.A_SIZE), np.zeros(at.C_SIZE, np.int64), np.zeros(at.W_SIZE)
    x[0], u[at.U_DT], work[at.W_DIM] = 1.0, 0.5, WITH_WANDER
    x[X_WANDER : X_WANDER + 3] = 1.0, -2.0, 3.0
    par[at.PAR_GNSS_WANDER_TAU], par[at.PAR_VIBRATION_BANDWIDTH] = 60.0, 100.0
    aux[at.A_GNSS_WANDER_VAR], aux[at.A_GNSS_WANDER_VAR_D] = 0.25, 0.64
    P[packed(WANDER, WANDER)] = 1e-4  # just measured
    P[packed(WANDER + 2, WANDER + 2)] = 1e-4
    for _ in range(120):
        predict(x, P, u, par, aux, ctl, work)
        predict_slow(x, P, u, par, aux, work)
    np.testing.assert_allclose(x[X_WANDER : X_WANDER + 3], np.array([1.0, -2.0, 3.0]) * np.exp(-1.0), rtol=1e-9)
    left = np.exp(-2.0)
    np.testing.assert_allclose(P[packed(WANDER, WANDER)], left * 1e-4 + (1 - left) * 0.25, rtol=1e-9)
    np.testing.assert_allclose(P[packed(WANDER + 2, WANDER + 2)], left * 1e-4 + (1 - left) * 0.64, rtol=1e-9)


def test_the_code_is_what_its_derivation_writes():
    written = Path(covariance.__file__).read_text(encoding="utf-8")
    assert ast.dump(ast.parse(written)) == ast.dump(ast.parse(derivation.source()))


def test_packed_index_runs_through_the_lower_triangle():
    assert [packed(i, j) for i, j in zip(*LOWER, strict=True)] == list(range(PACKED))
    assert packed(7, 2) == packed(2, 7)


def test_two_scalar_updates_equal_one_vector_update_in_joseph_form():
    rng = np.random.default_rng(3)
    P = random_covariance(rng)
    H, R, z = rng.normal(size=(2, N)), np.diag([0.3, 0.7]), rng.normal(size=2)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    left = np.eye(N) - K @ H
    expected_P, expected_x = left @ P @ left.T + K @ R @ K.T, K @ z
    out, work = P[LOWER].copy(), np.zeros(at.W_SIZE)
    work[at.W_DIM] = N
    for i in range(2):
        work[at.W_H : at.W_H + N] = H[i]
        variance = project(out, work) + R[i, i]
        fuse(out, work, z[i] - correction_seen(work), variance)
    np.testing.assert_allclose(out, expected_P[LOWER], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(work[at.W_DX : at.W_DX + N], expected_x, rtol=1e-9, atol=1e-9)


def test_a_day_of_predictions_and_updates_stays_positive_definite():
    """86,400 s at 10 Hz with exact position updates: the hardest case for rounding."""
    rng = np.random.default_rng(5)
    sigma2 = [*np.repeat([1e-4, 1.0, 1.0, 1e-6, 1e-3, 1e-4, 1e-4], 3), 9.0, 9.0, 0.04, 4.0, *[0.1] * 6, *[1e-6] * 9]
    P = np.diag(sigma2)[LOWER].copy()
    work, u = np.zeros(at.W_SIZE), np.zeros(18)
    work[at.W_DIM] = N
    u[12], u[13:18] = 0.1, [1e-8, 1e-5, 0.0, 1e-9, 1e-8]
    for k in range(864_00):
        u[:3] = [0.1 * np.sin(k / 50), 0.1 * np.cos(k / 70), -0.98]
        u[3:12] = (0.1 * np.eye(3)).ravel()
        predict_covariance(P, u)
        predict_columns(P, u, FIELD, N)
        for axis in range(3):
            work[at.W_H : at.W_H + N] = 0.0
            work[at.W_H + POS + axis] = 1.0
            fuse(P, work, float(rng.normal()) * 1e-3, project(P, work) + 1e-8)
    full = np.zeros((N, N))
    full[LOWER] = P
    full += np.tril(full, -1).T
    scale = 1 / np.sqrt(np.diag(full))
    assert np.linalg.eigvalsh(full * np.outer(scale, scale)).min() > 0.0
