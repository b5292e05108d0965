"""The pass back against dense algebra: Rauch, Tung and Striebel's recursion, and the statistics of a known model."""

import numpy as np
import pytest

from server.nav.ekf.layout import W_DIM, W_SIZE
from server.nav.ekf.smooth import layout as rec
from server.nav.ekf.smooth.adjoint import back_over_datum, back_over_prediction, back_over_scalar, correct, forget
from server.nav.ekf.states import (
    ACCEL_BIAS,
    ATT,
    BARO,
    GYRO_BIAS,
    INERTIAL,
    JITTER,
    MIX,
    PACKED,
    POS,
    VEL,
    WANDER,
    WITH_BARO,
    WITH_WANDER,
    X_BARO,
    X_POS,
    X_Q,
    X_SIZE,
    X_VEL,
    N,
)

STEPS = 60
DATUM_STARTS, AGAIN, WANDER_STARTS, POSITION_SET = 7, 45, 12, 50
LOWER = np.tril_indices(N)
SIGMA = np.concatenate(
    (
        np.repeat([1e-3, 0.1, 1.0, 1e-3, 0.01, 0.01, 0.01], 3),
        [1.0, 1.0],
        [0.1],
        [1.0],
        np.repeat([0.7, 0.2], 3),
        [0.01] * 9,
    )
)


def transition(f):
    """F of `ekf.derivation` and after it that of the slow errors, dense."""
    F, slow = np.eye(N), np.eye(N)
    A = f[3:12].reshape(3, 3)
    F[ATT : ATT + 3, GYRO_BIAS : GYRO_BIAS + 3] = F[VEL : VEL + 3, ACCEL_BIAS : ACCEL_BIAS + 3] = -A
    F[VEL : VEL + 3, ATT : ATT + 3] = -np.array([[0, -f[2], f[1]], [f[2], 0, -f[0]], [-f[1], f[0], 0]])
    F[POS : POS + 3, VEL : VEL + 3] = f[12] * np.eye(3)
    slow[WANDER : WANDER + 3, WANDER : WANDER + 3] *= f[rec.F_WANDER]
    slow[JITTER : JITTER + 3, JITTER : JITTER + 3] *= f[rec.F_JITTER]
    slow[ATT : ATT + 3, MIX : MIX + 9] = -A / f[12] @ np.kron(np.eye(3), f[rec.F_DTHETA : rec.F_DTHETA + 3])
    return slow @ F


def started(k, n):
    """Return (T, Q) of what starts or is set at step k after the prediction, or None."""
    T, Q = np.eye(N), np.zeros((N, N))
    states: list[int] = []
    if k in (DATUM_STARTS, AGAIN) and n > BARO:  # δb = −δd + noise
        T[BARO] = 0.0
        T[BARO, POS + 2] = -1.0
        Q[BARO, BARO] = 0.04
    elif k == WANDER_STARTS and n > WANDER:
        states = list(range(WANDER, WANDER + 3))
    elif k == POSITION_SET:
        states = [*range(VEL, POS + 3), *range(WANDER, min(n, MIX))]
    else:
        return None
    for i in states:
        T[i] = 0.0
        Q[i, i] = SIGMA[i] ** 2
    return T, Q, list(states)


class Flight:
    """Random error dynamics of n states, a truth drawn from them, and the filter over it; the nominal is zero."""

    def __init__(self, seed, n):
        rng = np.random.default_rng(seed)
        self.n = n
        sigma = np.zeros(N)
        sigma[:n] = SIGMA[:n]
        sigma[BARO : WANDER + 3] = 0.0  # these start on the way
        P = np.diag(sigma**2)
        x, truth = np.zeros(N), rng.standard_normal(N) * sigma
        self.truth, self.x, self.P, self.predicted, self.F, self.f, self.log = [], [], [], [], [], [], []
        for k in range(STEPS):
            turn = np.linalg.qr(rng.normal(size=(3, 3)))[0].ravel()
            f = np.concatenate((rng.normal(0, 0.2, 3), turn * 0.1, [0.1], rng.normal(0, 0.3, 3), [0.9, 0.4]))
            F = transition(f)
            Q = np.diag(np.where(np.diag(P) > 0.0, SIGMA**2 * 1e-2, 0.0))
            Q[POS : POS + 3] = 0.0
            truth = F @ truth + np.sqrt(np.diag(Q)) * rng.standard_normal(N)
            x, P = F @ x, F @ P @ F.T + Q
            entries = []
            start = started(k, n)
            if start is not None:
                T, Q, states = start
                truth = T @ truth + np.sqrt(np.diag(Q)) * rng.standard_normal(N)
                x, P, F = T @ x, T @ P @ T.T + Q, T @ F
                entries.append(states)
            self.predicted.append((x, P))
            for _ in range(rng.integers(0, 4) if k < 20 or k > 40 else 0):  # an outage in the middle
                H = np.zeros(N)
                H[rng.integers(0, n, 2)] = rng.normal(size=2)
                R = 0.1 * H @ P @ H + 1e-6
                entry = np.zeros(rec.L_SIZE)
                entry[rec.L_H : rec.L_H + N], entry[rec.L_PH : rec.L_PH + N] = H, P @ H
                entry[rec.L_VARIANCE] = S = H @ P @ H + R
                entry[rec.L_INNOVATION] = nu = H @ truth + np.sqrt(R) * rng.standard_normal() - H @ x
                K = P @ H / S
                x, P = x + K * nu, P - np.outer(K, H @ P)
                entries.append(entry)
            for kept, value in zip(
                (self.truth, self.x, self.P, self.F, self.f, self.log), (truth, x, P, F, f, entries), strict=True
            ):
                kept.append(value)

    def smoothed(self):
        """Run the kernels; return states and the covariances of the first nine, last step first."""
        lam, Lam, g = np.zeros(N), np.zeros((N, N)), np.zeros(N)
        for k in range(STEPS - 1, -1, -1):
            yield self._state(k, lam, Lam)
            for entry in reversed(self.log[k]):
                if len(entry) == rec.L_SIZE:
                    back_over_scalar(lam, Lam, entry, g, self.n)
                elif entry:
                    for i in entry:
                        forget(lam, Lam, i)
                else:
                    back_over_datum(lam, Lam)
            back_over_prediction(lam, Lam, self.f[k], self.n)

    def _state(self, k, lam, Lam):
        x, P, work = np.zeros(X_SIZE), self.P[k][LOWER].copy(), np.zeros(W_SIZE)
        x[X_Q], work[W_DIM] = 1.0, self.n
        assert len(P) == PACKED
        correct(x, np.zeros((N, N)), P, np.zeros((POS + 3, N)), lam, work, Lam, self.n)
        full = np.zeros((N, N))
        full[LOWER] = P
        change = self.P[k] @ lam
        assert 2 * x[X_Q + 1 : X_Q + 4] == pytest.approx(change[:3], abs=1e-4)  # the state moves by P λ
        assert x[X_VEL : X_VEL + 3] == pytest.approx(change[VEL : VEL + 3])
        assert -x[X_POS + 2] == pytest.approx(change[POS + 2])
        assert x[X_BARO : X_BARO + self.n - BARO] == pytest.approx(change[BARO : self.n])
        back = np.eye(9)  # the correction has turned the tilt error with the heading
        c, s = np.cos(change[2]), np.sin(change[2])
        back[:2, :2] = [[c, s], [-s, c]]
        return self.x[k] + change, back @ (full[:9, :9] + np.tril(full[:9, :9], -1).T) @ back.T

    def rauch_tung_striebel(self):
        """Return what the textbook gives, last step first; states without variance by pseudo-inverse."""
        x, P = self.x[-1], self.P[-1]
        yield x, P[:9, :9]
        for k in range(STEPS - 2, -1, -1):
            ahead, cov = self.predicted[k + 1]
            scale = np.sqrt(np.diag(cov)) + (np.diag(cov) == 0)
            C = self.P[k] @ self.F[k + 1].T @ (np.linalg.pinv(cov / np.outer(scale, scale)) / np.outer(scale, scale))
            x, P = self.x[k] + C @ (x - ahead), self.P[k] + C @ (P - cov) @ C.T
            yield x, P[:9, :9]


@pytest.mark.parametrize("n", [INERTIAL, 21, WITH_BARO, WITH_WANDER, N])
def test_one_pass_back_equals_rauch_tung_and_striebel(n):
    flight = Flight(n, n)
    for (x, P), (x_textbook, P_textbook) in zip(flight.smoothed(), flight.rauch_tung_striebel(), strict=True):
        sigma = np.sqrt(np.diag(P_textbook))
        np.testing.assert_allclose(x[:9] / sigma, x_textbook[:9] / sigma, atol=1e-5)
        np.testing.assert_allclose(P / np.outer(sigma, sigma), P_textbook / np.outer(sigma, sigma), atol=1e-5)


def test_its_errors_are_as_large_as_its_covariance_says_and_smaller_than_the_filter_s():
    """Two hundred random flights: squared error over covariance of nine states averages nine, filter and smoother."""
    runs = 200
    smooth, filtered, gain = np.zeros(STEPS), np.zeros(STEPS), np.zeros(STEPS)
    for seed in range(runs):
        flight = Flight(1000 + seed, INERTIAL)
        for k, (x, P) in zip(range(STEPS - 1, -1, -1), flight.smoothed(), strict=True):
            e, before = (x - flight.truth[k])[:9], (flight.x[k] - flight.truth[k])[:9]
            smooth[k] += e @ np.linalg.solve(P, e) / runs
            filtered[k] += before @ np.linalg.solve(flight.P[k][:9, :9], before) / runs
            gain[k] += np.trace(P[6:, 6:]) / np.trace(flight.P[k][6:9, 6:9]) / runs
    low, high = 9 - 4 * np.sqrt(18 / runs), 9 + 4 * np.sqrt(18 / runs)  # χ²: mean 9, variance 18
    assert ((smooth > low) & (smooth < high)).all()
    assert ((filtered > low) & (filtered < high)).all()
    assert (gain <= 1.0 + 1e-9).all()
    assert gain[30] < 0.5
    assert gain[-1] == pytest.approx(1.0)
