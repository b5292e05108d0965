"""One navigation step of state and covariance, against the same in NumPy and against the bare covariance, in one run.

Both do all of it: rotation, velocity with gravity and Coriolis, position on the ellipsoid, F P Fᵀ + Q. The kernel is
called as the engine calls it, many steps in one compiled loop. Target: ≥ 100 ×. The second yardstick is what remains
when everything but F P Fᵀ + Q of all 23 states is left out, as one straight-line function: target ≤ 2 ×.
"""

from time import perf_counter

import numpy as np
from numba import njit

from server.nav.ekf import derivation
from server.nav.ekf import layout as at
from server.nav.ekf.predict import predict
from server.nav.ekf.states import ACCEL_BIAS, ATT, FIELD, GYRO_BIAS, MAG_BIAS, POS, VEL, WIND, X_SIZE
from server.nav.ekf.states import WITH_WIND as N

LOWER = np.tril_indices(N)
ROUNDS = 7
EARTH = 7.292115e-5


@njit
def many(steps, x, P, u, par, aux, ctl, work):
    """Predict `steps` times, as the engine's loop does."""
    for _ in range(steps):
        predict(x, P, u, par, aux, ctl, work)


def straight_line():
    """Compile F P Fᵀ + Q of 23 states without a loop or a guard, and a loop that calls it."""
    text = "def bare(P, u):\n" + "".join(f"    {line}\n" for line in derivation.body(N))
    space: dict = {}
    exec(compile(text, "straight-line", "exec"), space)
    bare = njit("void(float64[::1], float64[::1])", fastmath={"contract"})(space["bare"])

    @njit("void(int64, float64[::1], float64[::1])")
    def repeat(steps, P, u):
        for _ in range(steps):
            bare(P, u)

    return repeat


def exp_quat(v):
    """Exp of a rotation vector as a quaternion."""
    angle = np.linalg.norm(v)
    if angle < 1e-12:
        return np.array([1.0, *(0.5 * v)])
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) / angle * v])


def multiply(a, b):
    """Hamilton product."""
    return np.concatenate(
        [[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + np.array(np.cross(a[1:], b[1:]))]
    )


def matrix(q):
    """R_nb of q_nb."""
    w, v = q[0], q[1:]
    return np.outer(v, v) + w * w * np.eye(3) + 2 * w * skew(v) + skew(v) @ skew(v)


def skew(v):
    """[v]×."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def numpy_predict(x, P, u, par):
    """The textbook in NumPy: the same equations as the kernel, dense covariance."""
    q, v, lat, lon, h, bg, ba = x[:4], x[4:7], x[7], x[8], x[9], x[10:13], x[13:16]
    dt, dtheta, dvel = u[at.U_DT], u[at.U_DTHETA : at.U_DTHETA + 3], u[at.U_DVEL : at.U_DVEL + 3]
    e2, a = 6.69437999014e-3, 6378137.0
    w2 = 1 - e2 * np.sin(lat) ** 2
    prime = a / np.sqrt(w2)
    meridian = prime * (1 - e2) / w2
    earth = EARTH * np.array([np.cos(lat), 0, -np.sin(lat)])
    transport = np.array([v[1] / (prime + h), -v[0] / (meridian + h), -v[1] * np.tan(lat) / (prime + h)])
    R = matrix(q)
    fn = R @ (dvel - ba * dt)
    q = multiply(exp_quat(-(earth + transport) * dt), multiply(q, exp_quat(dtheta - bg * dt)))
    q = q / np.linalg.norm(q)
    s2, k = np.sin(lat) ** 2, h / a
    g = 9.7803253359 * (1 + 0.00193185265241 * s2) / np.sqrt(w2)
    g *= 1 - 2 * (1 + 1 / 298.257223563 + 0.00344978650684 - 2 / 298.257223563 * s2) * k + 3 * k * k
    new = v + fn + (np.array([0, 0, g]) - np.cross(2 * earth + transport, v)) * dt
    move = 0.5 * dt * (v + new)
    position = [lat + move[0] / (meridian + h), lon + move[1] / ((prime + h) * np.cos(lat)), h - move[2]]
    F = np.eye(N)
    F[ATT : ATT + 3, GYRO_BIAS : GYRO_BIAS + 3] = -R * dt
    F[VEL : VEL + 3, ATT : ATT + 3] = -skew(fn)
    F[VEL : VEL + 3, ACCEL_BIAS : ACCEL_BIAS + 3] = -R * dt
    F[POS : POS + 3, VEL : VEL + 3] = dt * np.eye(3)
    Q = np.zeros(N)
    Q[ATT : ATT + 3] = par[at.PAR_GYRO_NOISE] ** 2 * dt
    Q[VEL : VEL + 3] = par[at.PAR_ACCEL_NOISE] ** 2 * dt
    Q[GYRO_BIAS : GYRO_BIAS + 3] = par[at.PAR_GYRO_WALK] ** 2 * dt
    Q[ACCEL_BIAS : ACCEL_BIAS + 3] = par[at.PAR_ACCEL_WALK] ** 2 * dt
    Q[FIELD : FIELD + 3] = par[at.PAR_FIELD_WALK] ** 2 * dt
    Q[MAG_BIAS : MAG_BIAS + 3] = par[at.PAR_MAG_BIAS_WALK] ** 2 * dt
    Q[WIND:] = par[at.PAR_WIND_WALK] ** 2 * dt
    return np.concatenate([q, new, position, bg, ba, x[16:]]), F @ P @ F.T + np.diag(Q)


def main():
    """Check that both agree, then print seconds a step and their ratio, median of interleaved rounds."""
    rng = np.random.default_rng(1)
    A = rng.normal(size=(N, N))
    P = A @ A.T * 1e-3
    x, u = np.zeros(X_SIZE), np.zeros(at.U_SIZE)
    x[:10] = [0.8, 0.0, 0.0, 0.6, 3.0, -2.0, 0.1, 0.8, 0.15, 500.0]
    u[at.U_DT], u[at.U_DTHETA : at.U_DVEL + 3] = 0.02, [1e-3, -2e-3, 4e-3, 0.01, 0.02, -0.196]
    par, aux, ctl, work = (
        np.full(at.PAR_SIZE, 1e-3),
        np.zeros(at.A_SIZE),
        np.zeros(at.C_SIZE, np.int64),
        np.zeros(at.W_SIZE),
    )
    work[at.W_DIM] = N
    ctl[at.C_HAS_SITE] = ctl[at.C_POSITIONED] = 1
    kx, kP = x.copy(), P[LOWER].copy()
    many(1, kx, kP, u, par, aux, ctl, work)
    nx, nP = numpy_predict(x, P, u, par)
    np.testing.assert_allclose(kx, nx, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(kP, nP[LOWER], rtol=1e-9, atol=1e-12)
    bare, bare_u = straight_line(), np.full(18, 1e-3)
    ratios, ours, bares = [], [], []
    for _ in range(ROUNDS):
        t = perf_counter()
        many(20_000, x.copy(), P[LOWER].copy() * 1e-6, u, par, aux, ctl, work)
        kernel_s = (perf_counter() - t) / 20_000
        kP = P[LOWER].copy() * 1e-6
        t = perf_counter()
        bare(20_000, kP, bare_u)
        bares.append(kernel_s / ((perf_counter() - t) / 20_000))
        t = perf_counter()
        for _ in range(300):
            numpy_predict(x, P, u, par)
        ratios.append((perf_counter() - t) / 300 / kernel_s)
        ours.append(kernel_s)
    print(f"predict, {N} states: {np.median(ours) * 1e9:.0f} ns a step")
    print(f"kernel / bare straight-line covariance: {np.median(bares):.2f} x (max {max(bares):.2f}); target 2")
    print(f"NumPy / kernel: {np.median(ratios):.0f} x (min {min(ratios):.0f}); target 100")


if __name__ == "__main__":
    main()
