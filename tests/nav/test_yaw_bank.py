"""The yaw bank on motions whose heading is a law, and on a recorded flight: found, honest, never invented."""

import math

import numpy as np
import pytest

from server.nav.ekf import layout as at
from server.nav.ekf.states import X_GYRO_BIAS, X_SIZE
from server.nav.ekf.yaw_bank import bank_predict, bank_result, bank_start, bank_turn, bank_velocity, new_bank
from server.nav.ekf.yaw_hypotheses import B_BANK, B_MOVED, B_Q, HYPOTHESES, K_P, K_SIZE, K_WEIGHT, advance, weigh
from server.nav.preprocess.accumulate import accumulate
from server.nav.preprocess.memory import new_memory
from server.nav.rotation import matrix_from_quat, quat_from_euler, quat_mul, rotvec_from_quat
from server.nav.types import Kind
from server.replay.tlog import TlogLog

G_M_S2 = 9.80665


def wrapped(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi


def waltz(t):
    """Horizontal acceleration of a multirotor that moves sideways as well as forward, from 4 s on; mean zero."""
    if t < 4.0:
        return np.zeros(2)
    return np.array([1.5 * math.sin(1.1 * (t - 4.0)), 1.2 * math.sin(0.7 * (t - 4.0))])


def hover(t):
    return np.zeros(2)


class Quadrotor:
    """A flight whose thrust makes its acceleration: tilt follows from it, the heading is free and turns slowly."""

    def __init__(self, accel, seed=0, hz=200.0, duration_s=40.0, yaw0=None, rate=0.1, tilt_deg=2.0, lever=(0, 0, 0)):
        rng = np.random.default_rng(seed)
        self.rng, self.dt, self.lever = rng, 1.0 / hz, np.array(lever, dtype=float)
        yaw0 = rng.uniform(-math.pi, math.pi) if yaw0 is None else yaw0
        t = np.arange(round(duration_s * hz) + 1) * self.dt
        self.yaw = yaw0 + rate * t
        self.q = np.array([self._attitude(accel(x), y) for x, y in zip(t, self.yaw, strict=True)])
        middle = [accel(x + 0.5 * self.dt) for x in t[:-1]]
        self.v = np.vstack([np.zeros(2), np.cumsum(middle, axis=0) * self.dt])
        self.steps = self._steps(middle, t, accel)
        error = rng.standard_normal(2) * math.radians(tilt_deg)
        tilt = quat_from_euler(error[0], error[1], rng.uniform(-math.pi, math.pi))
        self.x = np.zeros(X_SIZE)
        self.x[:4] = quat_mul(*tilt, *self.q[0])  # what the main filter says before the first fix
        self.par = np.zeros(at.PAR_SIZE)
        self.par[at.PAR_LEVER : at.PAR_LEVER + 3] = self.lever

    @staticmethod
    def _attitude(a, yaw):
        """Body down along gravity less acceleration, body x towards the heading."""
        ax, ay = math.cos(yaw) * a[0] + math.sin(yaw) * a[1], -math.sin(yaw) * a[0] + math.cos(yaw) * a[1]
        pitch = -math.atan2(ax, G_M_S2)
        return quat_from_euler(math.atan2(ay, math.hypot(G_M_S2, ax)), pitch, yaw)

    def _steps(self, middle, t, accel):
        steps = np.zeros((len(t) - 1, at.U_SIZE))
        for k in range(len(steps)):
            a, b = self.q[k], self.q[k + 1]
            turn = rotvec_from_quat(*quat_mul(a[0], -a[1], -a[2], -a[3], *b))
            force = np.array([*middle[k], -G_M_S2]) * self.dt
            steps[k, at.U_T], steps[k, at.U_DT] = t[k + 1] * 1e9, self.dt
            steps[k, at.U_DTHETA : at.U_DTHETA + 3] = turn
            steps[k, at.U_GYRO : at.U_GYRO + 3] = np.array(turn) / self.dt
            steps[k, at.U_DVEL : at.U_DVEL + 3] = matrix_from_quat(a).T @ force
        return steps

    def spoiled(self, gyro_bias=1e-3, accel_bias=0.1, noise=0.05):
        """Add a bias on every axis and white noise, as a MEMS sensor that has warmed up has them."""
        n = (len(self.steps), 3)
        self.steps[:, at.U_DTHETA : at.U_DTHETA + 3] += self.rng.choice([-1, 1], 3) * gyro_bias * self.dt
        self.steps[:, at.U_DVEL : at.U_DVEL + 3] += self.rng.choice([-1, 1], 3) * accel_bias * self.dt
        self.steps[:, at.U_DVEL : at.U_DVEL + 3] += noise * math.sqrt(self.dt) * self.rng.standard_normal(n)
        return self

    def velocity(self, k):
        """True velocity of the antenna at the end of step k."""
        swing = matrix_from_quat(self.q[k + 1]) @ np.cross(self.steps[k, at.U_GYRO : at.U_GYRO + 3], self.lever)
        return self.v[k + 1] + swing[:2]

    def fly(self, fix_hz=5.0, sigma=0.1, late_s=0.0, said_late_s=None, glitch=(), s=None, noise=None):
        """Run a bank over the flight; return rows of time s, heading error rad and σ rad at each fix."""
        s = new_bank() if s is None else s
        every, back = round(1.0 / (fix_hz * self.dt)), round(late_s / self.dt)
        said = late_s if said_late_s is None else said_late_s
        noise = sigma if noise is None else noise
        rows = []
        for k, u in enumerate(self.steps):
            bank_predict(u, self.x, self.par, s)
            if (k + 1) % every or k < back + 2:
                continue
            v = self.velocity(k - back) + noise * self.rng.standard_normal(2)
            v = v + (50.0 if len(rows) in glitch else 0.0)
            bank_velocity(u[at.U_T] - said * 1e9, v[0], v[1], sigma, s)
            yaw, sd = bank_result(s)
            rows.append((u[at.U_T] * 1e-9, wrapped(yaw - self.yaw[k + 1]), sd))
        return np.array(rows)


def test_a_multirotor_that_moves_sideways_shows_its_heading_whatever_it_is():
    """Twelve headings around the circle; the manoeuvres begin at 4 s, at 1 to 2 m/s²."""
    for k in range(12):
        flight = Quadrotor(waltz, seed=k, yaw0=k * math.pi / 6).spoiled()
        t, error, sigma = flight.fly().T
        known = t[np.argmax(sigma < math.radians(10.0))]
        assert 4.0 < known < 12.0
        assert np.abs(error[t > 20.0]).max() < math.radians(3.0)
        assert sigma[-1] < math.radians(5.0)


def test_the_error_is_what_sigma_says():
    """Over forty flights the error in units of σ is neither above one nor far below it, from the start on."""
    z = []
    for seed in range(40):
        t, error, sigma = Quadrotor(waltz, seed=100 + seed, duration_s=14.0).spoiled().fly(sigma=0.2).T
        z.append((error / sigma)[(t > 5.0) & (sigma < math.radians(30.0))])
    rms = math.sqrt(np.mean(np.concatenate(z) ** 2))
    assert 0.2 < rms < 1.1
    assert max(np.abs(x).max() for x in z) < 3.5


@pytest.mark.parametrize("seed", range(5))
def test_without_acceleration_no_heading_is_invented(seed):
    """A minute of hover with a tilt 2° wrong, biased sensors and receiver noise: the circle stays open."""
    _, _, sigma = Quadrotor(hover, seed=seed, duration_s=60.0).spoiled().fly(sigma=0.2).T
    assert sigma.min() > math.radians(45.0)


def test_a_late_velocity_is_used_at_its_own_time():
    """0.2 s late and said so: as good as punctual. Not said: worse by several times."""

    def rms(**late):
        t, error, _ = Quadrotor(waltz, seed=3, yaw0=1.0, rate=0.3).fly(fix_hz=10.0, noise=0.0, **late).T
        return math.sqrt(np.mean(error[t > 15.0] ** 2))

    punctual = rms()
    assert rms(late_s=0.2) < punctual + math.radians(0.1)
    assert rms(late_s=0.2, said_late_s=0.0) > 3.0 * punctual + math.radians(1.0)


def test_a_velocity_older_than_the_ring_or_than_the_last_is_not_used():
    flight, s = Quadrotor(waltz, duration_s=10.0), new_bank()
    flight.fly(s=s)
    before = s.copy()
    assert not bank_velocity(1e9, 0.0, 0.0, 0.1, s)  # before the last
    assert not bank_velocity(math.nan, 0.0, 0.0, 0.1, s)
    assert not bank_velocity(10.1e9, math.nan, 0.0, 0.1, s)
    assert np.array_equal(s, before)
    bank_start(s)
    for u in flight.steps:
        bank_predict(u, flight.x, flight.par, s)
    assert not bank_velocity(4.0e9, 0.0, 0.0, 0.1, s)  # 1024 steps of 5 ms reach to 4.9 s


@pytest.mark.parametrize("hz", [50.0, 400.0])
def test_the_navigation_rate_does_not_matter(hz):
    t, error, _ = Quadrotor(waltz, seed=5, hz=hz, duration_s=25.0).fly(noise=0.02).T
    assert np.abs(error[t > 15.0]).max() < math.radians(2.0)


def test_a_start_ten_degrees_from_level_is_levelled_on_the_way():
    t, error, sigma = Quadrotor(waltz, seed=8, tilt_deg=7.0, duration_s=30.0).spoiled().fly().T
    assert np.abs(error[t > 20.0]).max() < math.radians(3.0)
    assert (np.abs(error) < 3.0 * sigma + 1e-3).all()


def test_an_antenna_off_the_centre_is_no_velocity_of_the_vehicle():
    """Half a metre at 2 rad/s is 1 m/s; told the lever, the bank takes none of it for motion."""
    flight = Quadrotor(waltz, seed=9, rate=2.0, lever=(0.5, 0.1, 0.0), duration_s=25.0)
    s, t_e_s = new_bank(), flight.fly(noise=0.02)
    late = t_e_s[t_e_s[:, 0] > 15.0]
    assert np.abs(late[:, 1]).max() < math.radians(3.0)
    flight.par[:] = 0.0  # not told
    wrong = flight.fly(noise=0.02, s=s)
    assert np.abs(wrong[wrong[:, 0] > 15.0, 1]).max() > 2.0 * np.abs(late[:, 1]).max()


def test_one_wild_velocity_moves_nothing_and_many_start_anew():
    clean = Quadrotor(waltz, seed=11, duration_s=30.0).fly()
    one = Quadrotor(waltz, seed=11, duration_s=30.0).fly(glitch=(100,))
    assert np.abs(wrapped(one[100:, 1] - clean[100:, 1])).max() < clean[100, 2]
    many = Quadrotor(waltz, seed=11, duration_s=30.0).fly(glitch=range(100, 106))
    assert many[100:110, 2].max() > 1.5
    assert abs(many[-1, 1]) < 3.0 * many[-1, 2]


def test_the_turn_is_told_to_a_state_in_any_attitude():
    """Turned by it, the main filter's attitude has the bank's heading; also when the body points straight up."""
    for pitch in (0.3, math.pi / 2):
        s, flight = new_bank(), Quadrotor(waltz, seed=12, duration_s=20.0, tilt_deg=0.0)
        flight.fly(s=s, noise=0.0)
        s[B_Q : B_Q + 4] = quat_mul(*s[B_Q : B_Q + 4], *quat_from_euler(0.0, pitch, 0.0))
        x = flight.x.copy()
        pitched = quat_mul(*flight.q[-1], *quat_from_euler(0.0, pitch, 0.0))
        x[:4] = quat_mul(*(*quat_from_euler(0.0, 0.0, 2.0), *pitched))
        angle, sigma = bank_turn(x, s)
        assert wrapped(angle + 2.0) == pytest.approx(0.0, abs=math.radians(2.0))
        assert sigma == bank_result(s)[1]


def test_a_hypothesis_is_the_textbook_filter():
    """One prediction and one correction against F P Fᵀ + Q and the joint two-dimensional update."""
    rng = np.random.default_rng(2)
    s, k, dt, variance = new_bank(), B_BANK + 3 * K_SIZE, 0.2, 0.3
    for j in range(HYPOTHESES):
        s[B_BANK + j * K_SIZE + K_WEIGHT] = 1.0 / HYPOTHESES
        s[B_BANK + j * K_SIZE + K_P : B_BANK + j * K_SIZE + K_P + 25] = np.eye(5).ravel()
    root = rng.standard_normal((5, 5)) * 0.3
    x, P = rng.standard_normal(5), root @ root.T
    s[k : k + 5], s[k + K_P : k + K_P + 25] = x, P.ravel()
    moved = np.array([6.0, -5.0])
    s[B_MOVED : B_MOVED + 2] = moved
    s[k + K_WEIGHT] = 0.5  # the heaviest, so that none is surprised
    advance(s, k, dt)
    c, n = math.cos(x[2]), math.sin(x[2])
    R = np.array([[c, -n], [n, c]])
    a = moved + x[3:] * dt
    gained = R @ a
    told = (a @ a / dt**2) / (a @ a / dt**2 + 0.09)
    F = np.eye(5)
    F[:2, 2] = told * np.array([-gained[1], gained[0]])
    F[:2, 3:] = R * dt
    x[:2] += gained
    P = F @ P @ F.T + np.diag([0.01, 0.01, 1e-4, 9e-4, 9e-4]) * dt
    np.testing.assert_allclose(s[k : k + 5], x, rtol=1e-12)
    np.testing.assert_allclose(s[k + K_P : k + K_P + 25].reshape(5, 5), P, rtol=1e-10, atol=1e-15)
    z = x[:2] + np.array([0.4, -0.2])
    weigh(s, z[0], z[1], variance)
    H = np.eye(2, 5)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + variance * np.eye(2))
    np.testing.assert_allclose(s[k : k + 5], x + K @ (z - x[:2]), rtol=1e-9)
    np.testing.assert_allclose(s[k + K_P : k + K_P + 25].reshape(5, 5), P - K @ H @ P, rtol=1e-8, atol=1e-12)
    weights = s[B_BANK + K_WEIGHT : B_BANK + HYPOTHESES * K_SIZE : K_SIZE]
    assert weights.sum() == pytest.approx(1.0)


def recorded(path):
    """Return (steps, GNSS rows, reference time ns, reference heading) of a flight with its first stamp at zero."""
    blocks = list(TlogLog(path).blocks(10**7))
    kind, t_ns = (np.concatenate([getattr(b, n) for b in blocks]) for n in ("kind", "t_ns"))
    data = np.concatenate([b.data for b in blocks])
    keep = np.isin(kind, (Kind.IMU, Kind.GNSS))
    n, t0 = int(keep.sum()), int(t_ns[keep][0])
    steps, meas = np.empty((n, at.U_SIZE)), np.empty((n, at.M_SIZE))
    a, b = accumulate(kind[keep], t_ns[keep], np.ascontiguousarray(data[keep]), t0, 333.0, *new_memory(), steps, meas)
    meas = meas[:b]
    truth = kind == Kind.REFERENCE
    w, x, y, z = data[truth, :4].T
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    gnss = meas[(meas[:, at.M_KIND] == Kind.GNSS) & np.isfinite(meas[:, at.M_DATA + 3])]
    return steps[:a], gnss, t_ns[truth] - t0, heading


def test_the_recorded_multirotor_has_its_heading_seconds_after_take_off_without_a_magnetometer(shared_data):
    """Two seconds of rest give tilt and gyro bias; GNSS is valid 98 ms before its stamp, the IMU 11 ms."""
    steps, gnss, t_ref, heading = recorded(shared_data / "ardupilot_sitl" / "mission.tlog")
    rest = steps[: int(2.0 / np.median(steps[:, at.U_DT]))]
    fx, fy, fz = rest[:, at.U_ACCEL_MEAN : at.U_ACCEL_MEAN + 3].mean(axis=0)
    x, par, s, rows, k = np.zeros(X_SIZE), np.zeros(at.PAR_SIZE), new_bank(), [], 0
    x[:4] = quat_from_euler(math.atan2(-fy, -fz), math.atan2(fx, math.hypot(fy, fz)), 1.0)
    x[X_GYRO_BIAS : X_GYRO_BIAS + 3] = rest[:, at.U_GYRO_MEAN : at.U_GYRO_MEAN + 3].mean(axis=0)
    for n, u in enumerate(steps):
        bank_predict(u, x, par, s)
        while k < len(gnss) and gnss[k, at.M_STEP] <= n:
            m = gnss[k, at.M_DATA :]
            bank_velocity(gnss[k, at.M_T] - 87e6, m[3], m[4], m[8], s)
            rows.append((u[at.U_T], *bank_result(s), math.hypot(m[3], m[4])))
            k += 1
    t, yaw, sigma, speed = np.array(rows).T
    error = wrapped(yaw - np.interp(t, t_ref, np.unwrap(heading)))
    moves, known = t[np.argmax(speed > 1.0)], t[np.argmax(sigma < math.radians(10.0))]
    assert abs(known - moves) < 2e9
    assert (np.abs(error[t >= known]) < 3.0 * sigma[t >= known]).mean() > 0.99
    assert math.sqrt(np.mean(error[t > known + 10e9] ** 2)) < math.radians(3.0)
