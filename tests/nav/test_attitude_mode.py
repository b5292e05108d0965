"""The nine-axis attitude mode: laws on motions whose truth is known, and recorded motion against optical truth."""

import math

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.spatial.transform import Rotation
from vqf import VQF

from server.nav.ekf import layout as at
from server.nav.ekf.attitude import layout as cols
from server.nav.ekf.attitude import parameters as par_at
from server.nav.ekf.attitude.block import run_block
from server.nav.ekf.attitude.start import set_field
from server.nav.preprocess.accumulate import accumulate
from server.nav.preprocess.memory import new_memory as new_preprocessing
from server.nav.types import Kind

RATE_HZ = 200.0
G_M_S2 = 9.80665
FIELD_GAUSS = np.array([0.2, 0.0, 0.45])  # dips 66°
BIAS_RAD_S = np.array([0.008, -0.011, 0.006])
NOISES = {"gyro": 2e-3, "accel": 0.03, "mag": 0.0}


def still(t):
    return np.zeros((len(t), 3))


def wobble(after_s):
    """Euler angles (yaw, pitch, roll) that start smoothly after a rest and turn the board through many poses."""

    def angles(t):
        u = np.clip(t - after_s, 0.0, None)
        grow = np.clip(u / 3.0, 0.0, 1.0) ** 2
        return grow[:, None] * np.stack((1.6 * np.sin(0.9 * u), 0.9 * np.sin(1.3 * u), 1.4 * np.sin(0.7 * u)), axis=1)

    return angles


class Motion:
    """A board's samples from laws: attitude from Euler angles, specific force from a path, a field in NED."""

    def __init__(self, duration_s, angles, path=None, start_heading_rad=0.0, seed=1, noises=NOISES):
        rng = np.random.default_rng(seed)
        self.t = np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ
        fine = Rotation.from_euler("z", start_heading_rad) * Rotation.from_euler("ZYX", angles(self.t))
        step = Rotation.from_euler("z", start_heading_rad) * Rotation.from_euler("ZYX", angles(self.t + 1e-4))
        back = Rotation.from_euler("z", start_heading_rad) * Rotation.from_euler("ZYX", angles(self.t - 1e-4))
        self.truth = fine
        self.gyro = (back.inv() * step).as_rotvec() / 2e-4 + BIAS_RAD_S
        h = 1e-3
        accel_n = (
            (path(self.t + h) - 2 * path(self.t) + path(self.t - h)) / h**2 if path else np.zeros((len(self.t), 3))
        )
        self.accel = fine.inv().apply(accel_n - [0.0, 0.0, G_M_S2])
        self.mag = fine.inv().apply(FIELD_GAUSS)
        self.gyro = self.gyro + noises["gyro"] * rng.standard_normal(self.gyro.shape)
        self.accel = self.accel + noises["accel"] * rng.standard_normal(self.accel.shape)
        self.mag = self.mag + noises["mag"] * rng.standard_normal(self.mag.shape)

    def steps(self, nav_rate_hz=50.0, with_mag=True):
        n = len(self.t)
        data, kind = np.full((2 * n, 14), np.nan), np.tile(np.array([Kind.MAG, Kind.IMU], dtype=np.uint8), n)
        data[0::2, :3], data[1::2, :3], data[1::2, 3:6] = self.mag, self.gyro, self.accel
        keep = slice(None) if with_mag else slice(1, None, 2)
        t_ns = np.repeat(np.rint(self.t * 1e9).astype(np.int64), 2)
        return preprocessed(kind[keep], t_ns[keep], data[keep], nav_rate_hz)


def preprocessed(kind, t_ns, data, nav_rate_hz):
    """The steps and measurements that the engine's preprocessing makes of samples."""
    s, counters = new_preprocessing()
    steps, meas = np.empty((len(kind), at.U_SIZE)), np.empty((len(kind), at.M_SIZE))
    kind, t_ns, data = (np.ascontiguousarray(a) for a in (kind, t_ns, data))
    n, k = accumulate(kind, t_ns, data, 0, nav_rate_hz, s, counters, steps, meas)
    return steps[:n], meas[:k]


def run(steps, meas, s=None, **changes):
    """Return (rows, s); the laws' board has no delay of its own."""
    par = par_at.default_parameters()
    par[par_at.K_IMU_DELAY] = 0.0
    for name, value in changes.items():
        par[getattr(par_at, name)] = value
    s = cols.new_memory() if s is None else s
    rows = np.empty((len(steps), cols.O_SIZE))
    run_block(np.ascontiguousarray(steps), np.ascontiguousarray(meas), 0.0, s, par, rows)
    return rows, s


def attitude_errors(motion, steps, rows):
    """Rotation vector in NED from the estimate to the truth, rad, one row per step."""
    index = np.rint(steps[:, at.U_T] * 1e-9 * RATE_HZ).astype(int)
    estimate = Rotation.from_quat(rows[:, [1, 2, 3, 0]])
    return (motion.truth[index] * estimate.inv()).as_rotvec()


def tilt_deg(error):
    return np.degrees(np.hypot(error[:, 0], error[:, 1]))


def after(steps, t_s):
    return steps[:, at.U_T] * 1e-9 > t_s


def test_rest_gives_attitude_and_gyro_bias_within_their_sigma():
    motion = Motion(20.0, lambda t: np.tile([0.7, 0.3, -0.5], (len(t), 1)), noises={**NOISES, "mag": 0.005})
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    error = attitude_errors(motion, steps, rows)
    assert rows[-1, cols.O_REST] == 1.0
    assert tilt_deg(error)[-1] < 0.05
    assert abs(math.degrees(error[-1, 2])) < 0.5
    np.testing.assert_allclose(rows[-1, cols.O_GYRO_BIAS : cols.O_GYRO_BIAS + 3], BIAS_RAD_S, atol=2e-4)
    late = after(steps, 3.0)
    assert (np.abs(error[late]) < 3 * rows[late, cols.O_ATT_SIGMA : cols.O_ATT_SIGMA + 3]).mean() > 0.99
    bias_error = rows[late, cols.O_GYRO_BIAS : cols.O_GYRO_BIAS + 3] - BIAS_RAD_S
    assert (np.abs(bias_error) < 3 * rows[late, cols.O_BIAS_SIGMA : cols.O_BIAS_SIGMA + 3]).mean() > 0.95


def test_a_start_in_motion_finds_the_attitude_without_ever_resting():
    begun = wobble(-10.0)
    motion = Motion(30.0, begun, path=lambda t: 0.3 * np.stack((np.sin(3 * t), np.sin(4 * t), np.sin(5 * t)), axis=1))
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    error = attitude_errors(motion, steps, rows)
    assert rows[:, cols.O_REST].max() == 0.0
    late = after(steps, 5.0)
    assert tilt_deg(error)[late].max() < 3.0
    assert np.abs(np.degrees(error[late, 2])).max() < 12.0
    assert tilt_deg(error)[after(steps, 20.0)].max() < 1.0
    assert (np.abs(error) < 3 * rows[:, cols.O_ATT_SIGMA : cols.O_ATT_SIGMA + 3]).mean() > 0.97


@pytest.mark.parametrize("turn_deg", [90.0, 180.0, -37.0])
def test_a_scene_that_starts_at_another_heading_gives_the_same_motion_turned(turn_deg):
    turn = math.radians(turn_deg)
    quiet = {"gyro": 0.0, "accel": 0.0, "mag": 0.0}  # a tilt error makes a heading error that depends on heading
    one = Motion(40.0, wobble(10.0), noises=quiet)
    other = Motion(40.0, wobble(10.0), start_heading_rad=turn, noises=quiet)
    one.gyro -= BIAS_RAD_S
    other.gyro -= BIAS_RAD_S
    (steps, meas), (turned_steps, turned_meas) = one.steps(), other.steps()
    rows, _ = run(steps, meas)
    turned, _ = run(turned_steps, turned_meas)
    back = Rotation.from_euler("z", -turn) * Rotation.from_quat(turned[:, [1, 2, 3, 0]])
    apart = (back * Rotation.from_quat(rows[:, [1, 2, 3, 0]]).inv()).magnitude()
    assert np.degrees(apart[after(steps, 5.0)]).max() < 0.01


@pytest.mark.parametrize("nav_rate_hz", [100.0, 200.0])
def test_the_navigation_rate_does_not_change_the_attitude(nav_rate_hz):
    motion = Motion(40.0, wobble(10.0))
    steps, meas = motion.steps(50.0)
    finer, finer_meas = motion.steps(nav_rate_hz)
    rows, _ = run(steps, meas)
    finer_rows, _ = run(finer, finer_meas)
    index = np.searchsorted(finer[:, at.U_T], steps[:, at.U_T])
    same = finer_rows[np.minimum(index, len(finer_rows) - 1)]
    apart = (Rotation.from_quat(rows[:, [1, 2, 3, 0]]).inv() * Rotation.from_quat(same[:, [1, 2, 3, 0]])).magnitude()
    assert np.degrees(apart[after(steps, 5.0)]).max() < 0.3


def test_cutting_the_block_changes_nothing():
    motion = Motion(15.0, wobble(3.0))
    steps, meas = motion.steps()
    whole, _ = run(steps, meas)
    s, parts = None, []
    for begin in range(0, len(steps), 37):
        chosen = meas[(meas[:, at.M_STEP] >= begin) & (meas[:, at.M_STEP] < begin + 37)].copy()
        chosen[:, at.M_STEP] -= begin
        part, s = run(steps[begin : begin + 37], chosen, s)
        parts.append(part)
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_horizontal_translation_does_not_tilt():
    def path(t):
        u = np.clip(t - 10.0, 0.0, None)
        return np.stack((0.25 * np.sin(6.0 * u) * np.minimum(u, 1), 0.2 * np.sin(4.0 * u) * np.minimum(u, 1), 0 * u), 1)

    motion = Motion(60.0, still, path=path)
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    moving = after(steps, 12.0)
    lean = np.degrees(np.arctan2(np.hypot(*steps[moving, at.U_ACCEL_MEAN : at.U_ACCEL_MEAN + 2].T), G_M_S2))
    assert lean.max() > 40.0
    assert tilt_deg(attitude_errors(motion, steps, rows))[moving].max() < 0.4


def test_a_single_magnetic_spike_is_refused_and_said():
    motion = Motion(40.0, wobble(5.0))
    hit = (motion.t > 30.0) & (motion.t < 30.1)
    clean_steps, clean_meas = motion.steps()
    clean, _ = run(clean_steps, clean_meas)
    motion.mag[hit] += [0.1, 0.4, 0.1]
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    during = (steps[:, at.U_T] > 30.02e9) & (steps[:, at.U_T] < 30.09e9)
    assert (rows[during, cols.O_DISTURBED] == cols.D_GATE).all()
    apart = (Rotation.from_quat(rows[:, [1, 2, 3, 0]]).inv() * Rotation.from_quat(clean[:, [1, 2, 3, 0]])).magnitude()
    assert np.degrees(apart.max()) < 0.1
    assert rows[-1, cols.O_DISTURBED] == cols.D_NONE


@pytest.mark.parametrize("strength_gauss", [0.08, 0.26, 0.6])
def test_a_magnet_put_on_is_learned_in_motion_and_forgotten_when_removed(strength_gauss):
    motion = Motion(120.0, wobble(15.0), noises={**NOISES, "mag": 0.005})
    magnet = strength_gauss * np.array([0.6, -0.48, 0.64])
    worn = (motion.t > 10.0) & (motion.t < 70.0)
    motion.mag[worn] += magnet
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    t_s = steps[:, at.U_T] * 1e-9
    offset, sigma = (
        rows[:, cols.O_MAG_OFFSET : cols.O_MAG_OFFSET + 3],
        rows[:, cols.O_OFFSET_SIGMA : cols.O_OFFSET_SIGMA + 3],
    )
    for at_s, truth in ((68.0, magnet), (118.0, np.zeros(3))):
        n = np.searchsorted(t_s, at_s)
        np.testing.assert_allclose(offset[n], truth, atol=0.015)
        assert (np.abs(offset[n] - truth) < 3 * sigma[n]).all()
    assert (rows[(t_s > 10.5) & (t_s < 15.0), cols.O_DISTURBED] >= cols.D_GATE).any()
    assert np.abs(np.degrees(attitude_errors(motion, steps, rows)[after(steps, 5.0), 2])).max() < 2.5


def test_noise_at_rest_moves_neither_heading_nor_offset():
    motion = Motion(200.0, still, noises={**NOISES, "mag": 0.007})
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    late = after(steps, 10.0)
    heading = np.degrees(2 * np.arctan2(rows[late, 3], rows[late, 0]))
    assert np.ptp(heading) < 0.5
    assert np.ptp(rows[late, cols.O_MAG_OFFSET : cols.O_MAG_OFFSET + 3], axis=0).max() < 0.001


def test_a_magnet_beside_a_resting_board_does_not_turn_it():
    motion = Motion(60.0, still)
    motion.mag[motion.t > 20.0] += [0.03, 0.15, 0.05]
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    error = np.degrees(attitude_errors(motion, steps, rows)[:, 2])
    assert np.abs(error[after(steps, 20.0)] - error[after(steps, 19.0)][0]).max() < 0.5
    assert (rows[after(steps, 20.1), cols.O_DISTURBED] >= cols.D_GATE).any()


def test_another_place_with_another_field_turns_the_heading_only_slowly():
    """Ten degrees of false north in the room's other corner; a filter that believed it would show them at once."""
    motion = Motion(40.0, wobble(5.0))
    beyond = motion.t > 20.0
    motion.mag[beyond] = (
        motion.truth[beyond].inv().apply(Rotation.from_euler("z", 10.0, degrees=True).apply(FIELD_GAUSS))
    )
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    error = np.abs(np.degrees(attitude_errors(motion, steps, rows)[:, 2]))
    before_s = steps[:, at.U_T] * 1e-9
    assert error[(before_s > 6.0) & (before_s < 25.0)].max() < 2.5
    assert 3.0 < error[-1] < 7.0


def test_the_magnetometers_delay_is_found_in_motion():
    motion = Motion(90.0, wobble(5.0))
    late = 4 / RATE_HZ
    motion.mag = np.concatenate((np.repeat(motion.mag[:1], 4, axis=0), motion.mag[:-4]))
    steps, meas = motion.steps()
    _, s = run(steps, meas)
    assert abs(s[cols.S_X + cols.MAG_DELAY] - late) < 0.004


def test_gyro_scale_is_learned_from_gravity_alone():
    motion = Motion(120.0, wobble(5.0))
    motion.gyro = (motion.gyro - BIAS_RAD_S) * [1.01, 0.99, 1.0] + BIAS_RAD_S
    steps, meas = motion.steps(with_mag=False)
    _, s = run(steps, meas)
    scale = s[cols.S_X + cols.GYRO_SCALE : cols.S_X + cols.GYRO_SCALE + 9].reshape(3, 3)
    np.testing.assert_allclose(np.diag(scale)[:2], [0.01, -0.01], atol=0.003)


def test_a_slow_steady_turn_is_not_taken_for_a_bias():
    def angles(t):
        return np.stack((math.radians(2.0) * np.clip(t - 15.0, 0.0, None), 0 * t, 0 * t), axis=1)

    motion = Motion(45.0, angles)
    steps, meas = motion.steps(with_mag=False)
    rows, _ = run(steps, meas)
    turned = np.degrees(2 * np.arctan2(rows[-1, 3], rows[-1, 0]) - 2 * np.arctan2(rows[700, 3], rows[700, 0]))
    assert turned == pytest.approx(60.0, abs=1.0)
    np.testing.assert_allclose(rows[-1, cols.O_GYRO_BIAS + 2], BIAS_RAD_S[2], atol=5e-4)


def test_without_a_magnetometer_tilt_is_kept_and_heading_is_said_to_be_unknown():
    motion = Motion(60.0, wobble(5.0))
    steps, meas = motion.steps(with_mag=False)
    rows, _ = run(steps, meas)
    late = after(steps, 5.0)
    assert tilt_deg(attitude_errors(motion, steps, rows))[late].max() < 1.5
    assert (rows[late, cols.O_DISTURBED] == cols.D_NO_MAG).all()
    assert (rows[:, cols.O_HEADING] == cols.H_NONE).all()
    assert rows[late, cols.O_ATT_SIGMA + 2].min() > math.radians(90.0)


def test_a_hole_in_the_data_starts_again_with_the_bias_that_was_learned():
    motion = Motion(40.0, wobble(35.0))
    steps, meas = motion.steps()
    holed = steps.copy()
    n = int(np.searchsorted(steps[:, at.U_T], 20e9))
    holed[n, at.U_GAP_S] = 3.0
    rows, _ = run(holed, meas)
    assert rows[n, cols.O_ATT_SIGMA] > 0.1
    np.testing.assert_allclose(rows[n, cols.O_GYRO_BIAS : cols.O_GYRO_BIAS + 3], BIAS_RAD_S, atol=3e-4)
    assert tilt_deg(attitude_errors(motion, steps, rows))[n + 150] < 0.1


def test_numbers_that_are_none_do_not_stay():
    motion = Motion(20.0, still)
    steps, meas = motion.steps()
    meas[100:120, at.M_DATA] = math.nan
    steps[500, at.U_DTHETA] = math.nan
    rows, s = run(steps, meas)
    assert s[cols.S_FAILURES] == 1.0
    assert np.isfinite(rows[-1]).all()
    assert tilt_deg(attitude_errors(motion, steps[-1:], rows[-1:]))[0] < 0.1


def test_a_free_fall_at_the_start_is_waited_for():
    motion = Motion(10.0, still)
    motion.accel[motion.t < 2.0] *= 0.05
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    assert np.isnan(rows[steps[:, at.U_T] < 1.9e9, :4]).all()
    assert tilt_deg(attitude_errors(motion, steps[150:], rows[150:]))[-1] < 0.1


def test_a_model_of_the_field_is_kept_and_without_one_it_is_learned():
    motion = Motion(60.0, wobble(5.0))
    steps, meas = motion.steps()
    s = cols.new_memory()
    set_field(s, 0.5, math.radians(60.0))
    _, s = run(steps, meas, s)
    np.testing.assert_allclose(s[cols.S_REF : cols.S_REF + 2], [0.25, 0.433], atol=1e-3)
    _, learned = run(steps, meas)
    np.testing.assert_allclose(learned[cols.S_REF : cols.S_REF + 2], FIELD_GAUSS[[0, 2]], atol=0.02)


def test_the_covariance_stays_symmetric_and_positive_over_an_hour_of_turns():
    motion = Motion(60.0, wobble(0.0), noises={**NOISES, "mag": 0.005})
    steps, meas = motion.steps()
    s = cols.new_memory()
    for k in range(60):
        later, later_meas = steps.copy(), meas.copy()
        later[:, at.U_T] += k * 60e9
        later_meas[:, at.M_T] += k * 60e9
        rows, s = run(later, later_meas, s)
    P = s[cols.S_P : cols.S_P + cols.N**2].reshape(cols.N, cols.N)
    np.testing.assert_allclose(P, P.T, rtol=1e-9, atol=1e-15)
    scale = np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > -1e-9
    assert s[cols.S_FAILURES] == 0.0
    assert np.isfinite(rows).all()


# Recorded motion: BROAD [Laidig et al. 2021], optical truth, sensor frame x, y, z-up and ENU.
TRIALS = {
    "01_undisturbed_slow_rotation_A": (1.99, 1.89, 0.60),
    "06_undisturbed_fast_rotation_A": (4.03, 3.95, 0.80),
    "10_undisturbed_slow_translation_A": (1.80, 1.78, 0.30),
    "15_undisturbed_fast_translation_A": (2.31, 2.26, 0.47),
    "21_undisturbed_fast_combined": (4.08, 3.70, 1.72),
    "28_disturbed_stationary_magnet_A": (4.04, 3.86, 1.21),
    "33_disturbed_attached_magnet_2cm": (3.75, 3.70, 0.60),
    "36_disturbed_attached_magnet_5cm": (2.39, 2.22, 0.88),
}
MAGNET = ("33", "36")
BODY_FROM_SENSOR = np.array([1.0, -1.0, -1.0])
ENU_FROM_NED = Rotation.from_quat([math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0])
SENSOR_IN_BODY = Rotation.from_quat([1.0, 0.0, 0.0, 0.0])


def scored(q_wxyz, truth_wxyz, chosen):
    """Return (RMSE (3,), error (n, 3)) of total, heading, inclination in degrees, NaN truth left out."""
    chosen = chosen & np.isfinite(truth_wxyz[:, 0])
    estimate = Rotation.from_quat(q_wxyz[chosen][:, [1, 2, 3, 0]])
    _, _, z, w = (estimate * Rotation.from_quat(truth_wxyz[chosen][:, [1, 2, 3, 0]]).inv()).as_quat().T
    heading = (2 * np.arctan2(z, w) + np.pi) % (2 * np.pi) - np.pi
    errors = np.stack(
        (2 * np.arccos(np.minimum(np.abs(w), 1)), heading, 2 * np.arccos(np.minimum(np.hypot(w, z), 1))), 1
    )
    return np.degrees(np.sqrt((errors**2).mean(0))), errors, chosen


class Trial:
    """One recording: VQF's scores at its full rate, ours at a navigation rate."""

    def __init__(self, path):
        self.mat = loadmat(path, squeeze_me=True)
        self.rate_hz = float(self.mat["sampling_rate"])
        self.movement = self.mat["movement"].astype(bool)

    def vqf(self):
        sensors = (np.ascontiguousarray(self.mat[name]) for name in ("imu_gyr", "imu_acc", "imu_mag"))
        q = VQF(1.0 / self.rate_hz).updateBatch(*sensors)["quat9D"]
        return scored(q, self.mat["opt_quat"], self.movement)[0]

    def ours(self, nav_rate_hz=50.0):
        n = len(self.movement)
        data = np.full((2 * n, 14), np.nan)
        data[0::2, :3] = self.mat["imu_mag"] * BODY_FROM_SENSOR / 100.0
        data[1::2, :3] = self.mat["imu_gyr"] * BODY_FROM_SENSOR
        data[1::2, 3:6] = self.mat["imu_acc"] * BODY_FROM_SENSOR
        t_ns = np.repeat(np.rint(np.arange(n) * 1e9 / self.rate_hz).astype(np.int64), 2)
        kind = np.tile(np.array([Kind.MAG, Kind.IMU], dtype=np.uint8), n)
        steps, meas = preprocessed(kind, t_ns, data, nav_rate_hz)
        s, rows = cols.new_memory(), np.empty((len(steps), cols.O_SIZE))
        run_block(steps, meas, 0.0, s, par_at.default_parameters(), rows)
        index = np.rint(steps[:, at.U_T] * 1e-9 * self.rate_hz).astype(int)
        q = (ENU_FROM_NED * Rotation.from_quat(rows[:, [1, 2, 3, 0]]) * SENSOR_IN_BODY).as_quat()[:, [3, 0, 1, 2]]
        rmse, errors, chosen = scored(q, self.mat["opt_quat"][index], self.movement[index])
        sigma = rows[chosen, cols.O_ATT_SIGMA : cols.O_ATT_SIGMA + 3]
        inside = np.array(
            [
                (np.abs(errors[:, 1]) < 3 * sigma[:, 2]).mean(),
                (errors[:, 2] < 3 * np.hypot(sigma[:, 0], sigma[:, 1])).mean(),
            ]
        )
        return rmse, inside


@pytest.fixture(scope="module")
def trials(shared_data):
    return {name: Trial(shared_data / "broad" / f"{name}.mat") for name in TRIALS}


@pytest.fixture(scope="module")
def vqf_scores(trials):
    return {name: trial.vqf() for name, trial in trials.items()}


def test_our_scoring_gives_the_published_figures_of_vqf(vqf_scores):
    for name, published in TRIALS.items():
        np.testing.assert_allclose(vqf_scores[name], published, atol=0.02, err_msg=name)


@pytest.mark.parametrize("nav_rate_hz", [50.0, 100.0])
def test_recorded_motion_is_followed_better_than_vqf_does(trials, vqf_scores, nav_rate_hz):
    ours = {name: trial.ours(nav_rate_hz) for name, trial in trials.items()}
    for name, (rmse, inside) in ours.items():
        assert rmse[0] <= 1.2 * vqf_scores[name][0], (name, rmse)
        assert inside.min() > 0.99, (name, inside)
        if name[:2] in MAGNET:
            assert rmse[1] <= vqf_scores[name][1], (name, rmse)
    mean = np.mean([rmse for rmse, _ in ours.values()], axis=0)
    yardstick = np.mean(list(vqf_scores.values()), axis=0)
    assert (mean <= 0.7 * yardstick).all(), (mean, yardstick)
