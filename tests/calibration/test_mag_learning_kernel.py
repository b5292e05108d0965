"""The filter's kernel against the same algebra written with matrices."""

import numpy as np
from scipy.spatial.transform import Rotation

from server.nav.calibration import learning_layout as at
from server.nav.calibration.learning_filter import correct, predict
from server.nav.calibration.learning_strength import departure2, learn_unevenness, remember_strength

N = at.N


def state_of(rng):
    s = np.zeros(at.F_SIZE)
    s[at.F_X : at.F_X + N] = 0.3 * rng.standard_normal(N)
    s[at.F_X + at.GYRO : at.F_X + N] *= 0.01
    root = 0.05 * rng.standard_normal((N, N))
    s[at.F_P : at.F_P + N * N] = (root @ root.T + 1e-3 * np.eye(N)).ravel()
    return s


def block_of(rng):
    c = np.zeros(at.C_SIZE)
    R = Rotation.random(8, random_state=3).as_matrix()
    c[at.C_B_DT], c[at.C_B_PATH], c[at.C_B_N], c[at.C_PATCH2] = 0.16, 0.2, 8, 4e-4
    c[at.C_B_R : at.C_B_R + 9] = 0.02 * R.sum(axis=0).ravel()
    c[at.C_B_RM : at.C_B_RM + 9] = R.sum(axis=0).ravel()
    c[at.C_B_Z : at.C_B_Z + 3] = 8 * 0.4 * rng.standard_normal(3)
    c[at.C_B_W : at.C_B_W + 3] = 8 * rng.standard_normal(3)
    return c


def cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def test_the_prediction_turns_the_field_and_its_errors_by_the_gyro_bias():
    rng = np.random.default_rng(1)
    s, c, par = state_of(rng), block_of(rng), at.default_parameters()
    x, P = s[:N].copy(), s[at.F_P : at.F_P + N * N].reshape(N, N).copy()
    W, f = c[at.C_B_R : at.C_B_R + 9].reshape(3, 3), x[at.FIELD : at.FIELD + 3]
    turn = W @ x[at.GYRO : at.GYRO + 3]
    F, Q = np.eye(N), np.zeros((N, N))
    F[3:6, 3:6] += cross(turn)
    F[3:6, 6:9] = -cross(f) @ W
    f_after = f + np.cross(turn, f)
    f_after *= np.linalg.norm(f) / np.linalg.norm(f_after)
    across2 = par[at.K_GYRO_NOISE] ** 2 * 0.16 + par[at.K_TURN] ** 2 * 0.2
    Q[3:6, 3:6] = across2 * (f @ f * np.eye(3) - np.outer(f_after, f_after)) + par[
        at.K_FIELD_WALK
    ] ** 2 * 0.16 * np.eye(3)
    Q[:3, :3] = par[at.K_OFFSET_WALK] ** 2 * 4e-4 * 0.16 * np.eye(3)
    Q[6:9, 6:9] = par[at.K_GYRO_WALK] ** 2 * 0.16 * np.eye(3)
    predict(s, c, par, True)
    np.testing.assert_allclose(s[at.FIELD : at.FIELD + 3], f_after, rtol=1e-12)
    np.testing.assert_allclose(s[at.F_P : at.F_P + N * N].reshape(N, N), F @ P @ F.T + Q, rtol=1e-9, atol=1e-15)


def test_a_correction_is_kalmans_and_one_that_spares_the_offset_is_schmidts():
    for first, end in ((0, N), (at.FIELD, N), (at.FIELD, at.GYRO)):
        rng = np.random.default_rng(2)
        s, c = state_of(rng), block_of(rng)
        x, P = s[:N].copy(), s[at.F_P : at.F_P + N * N].reshape(N, N).copy()
        for i in range(3):
            f, w = x[at.FIELD : at.FIELD + 3], c[at.C_B_W : at.C_B_W + 3] / 8
            R = c[at.C_B_RM : at.C_B_RM + 9].reshape(3, 3) / 8
            expected = f + R @ x[:3] + x[at.DELAY] * np.cross(w, f)
            H = np.zeros(N)
            H[:3], H[at.FIELD + i], H[at.DELAY] = R[i], 1.0, np.cross(w, f)[i]
            K = P @ H / (H @ P @ H + 1e-3)
            K[:first] = K[end:] = 0.0
            x = x + K * (c[at.C_B_Z + i] / 8 - expected[i])
            J = np.eye(N) - np.outer(K, H)
            P = J @ P @ J.T + 1e-3 * np.outer(K, K)
        correct(s, c, 1e-3, first, end)
        np.testing.assert_allclose(s[:N], x, rtol=1e-9, atol=1e-14)
        np.testing.assert_allclose(s[at.F_P : at.F_P + N * N].reshape(N, N), P, rtol=1e-8, atol=1e-14)


def readings(rng, count, offset, uneven):
    """Yield (turn, mean sample, c of that block alone) of a board whose samples are single and not turned."""
    for one in Rotation.random(count, random_state=5).as_matrix():
        m = one.T @ [0.2, 0.0, 0.43] * (1.0 + uneven * rng.standard_normal()) + offset
        block = np.zeros(at.C_SIZE)
        block[at.C_B_N] = 1.0
        block[at.C_B_Z : at.C_B_Z + 3], block[at.C_B_RM : at.C_B_RM + 9] = one @ m, one.ravel()
        yield rng.uniform(0.1, 0.5), m, block


def test_the_unevenness_is_what_the_best_offset_leaves_of_the_strength_whatever_offset_is_held():
    rng, par = np.random.default_rng(3), at.default_parameters()
    par[at.K_PATCH], par[at.K_PATCH_MAX] = 1e-9, 1.0
    c, turns, samples = np.zeros(at.C_SIZE), [], []
    for rad, m, block in readings(rng, 40, np.array([0.1, -0.2, 0.05]), 0.02):
        c[at.C_B_N], c[at.C_B_Z : at.C_B_RM + 9] = 1.0, block[at.C_B_Z : at.C_B_RM + 9]
        remember_strength(c, rad)
        turns.append(rad)
        samples.append(m)
    weight, m = np.array(turns) / np.sum(turns), np.array(samples)
    A = np.concatenate([2.0 * m, np.ones((len(m), 1))], axis=1) * np.sqrt(weight)[:, None]
    y = (m**2).sum(axis=1) * np.sqrt(weight)
    left2 = float(np.sum((y - A @ np.linalg.lstsq(A, y)[0]) ** 2))
    readings_told = np.sum(turns) / 0.35
    for held in (np.zeros(3), np.array([0.1, -0.2, 0.05])):
        s = np.zeros(at.F_SIZE)
        s[at.F_X : at.F_X + 3] = held
        mean2 = weight @ ((m - held) ** 2).sum(axis=1)
        learn_unevenness(s, c, par)
        expected2 = left2 / (4.0 * mean2) * readings_told / (0.7 + readings_told - 4.0)
        np.testing.assert_allclose(c[at.C_RESIDUAL2], expected2, rtol=5e-3)  # but for the ridge
        strength = np.linalg.norm(m[-1] - held)
        np.testing.assert_allclose(departure2(s, c), (strength - np.sqrt(mean2)) ** 2, rtol=1e-9)
