"""Averaging into steps, and what is refused on the way."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from server.nav.ekf import layout as at
from server.nav.preprocess import memory
from server.nav.preprocess.accumulate import accumulate
from server.nav.preprocess.check import decade_scale, height_from_pressure
from server.nav.types import AidStatus, Kind


def run(kind, t_s, data, rate_hz=50.0, cuts=()):
    s, n = memory.new_memory()
    kind, t_ns = np.asarray(kind, dtype=np.uint8), np.asarray(np.round(np.asarray(t_s) * 1e9), dtype=np.int64)
    rows = np.full((len(kind), 14), np.nan)
    for i, values in enumerate(data):
        rows[i, : len(values)] = values
    steps, meas = [], []
    edges = [0, *cuts, len(kind)]
    for a, b in pairwise(edges):
        u, m = np.empty((b - a, at.U_SIZE)), np.empty((b - a, at.M_SIZE))
        i, k = accumulate(kind[a:b], t_ns[a:b], rows[a:b], int(t_ns[0]), rate_hz, s, n, u, m)
        steps.append(u[:i])
        meas.append(m[:k])
    return np.concatenate(steps), np.concatenate(meas), s, n


def coning(t):
    """Attitude of classic coning motion: half angle 0.05 rad at 5 Hz; and its body rate by fine differences."""
    a, w = 0.05, 2 * np.pi * 5
    return Rotation.from_rotvec(np.stack([a * np.cos(w * t), a * np.sin(w * t), 0 * t], axis=-1))


def test_coning_is_kept_where_a_plain_mean_loses_it():
    rate = 1000.0
    t = np.arange(0, 2.0005, 1 / rate)
    h = 1e-6
    body_rate = (coning(t - h).inv() * coning(t + h)).as_rotvec() / (2 * h)
    steps, *_ = run([Kind.IMU] * len(t), t, np.hstack([body_rate, np.tile([0, 0, -9.8], (len(t), 1))]))
    total, plain = Rotation.identity(), Rotation.identity()
    for u in steps:
        total = total * Rotation.from_rotvec(u[at.U_DTHETA : at.U_DTHETA + 3])
        plain = plain * Rotation.from_rotvec(u[at.U_GYRO_MEAN : at.U_GYRO_MEAN + 3] * u[at.U_DT])
    true = coning(np.array([0.0])).inv() * coning(np.array([steps[-1, at.U_T] * 1e-9]))
    kept = np.linalg.norm((total.inv() * true[0]).as_rotvec())
    lost = np.linalg.norm((plain.inv() * true[0]).as_rotvec())
    assert kept < 1e-4
    assert lost > 20 * kept


def test_velocity_of_a_turning_board_is_that_of_its_circle():
    """Constant turn and constant centripetal force: the velocity increments, chained, turn with the board."""
    rate, w, a = 500.0, 2.0, 3.0
    t = np.arange(0, 1.0005, 1 / rate)
    steps, *_ = run([Kind.IMU] * len(t), t, np.tile([0, 0, w, 0, a, 0], (len(t), 1)))
    q, v = Rotation.identity(), np.zeros(3)
    for u in steps:
        v += q.apply(u[at.U_DVEL : at.U_DVEL + 3])
        q = q * Rotation.from_rotvec(u[at.U_DTHETA : at.U_DTHETA + 3])
    angle = w * steps[-1, at.U_T] * 1e-9
    np.testing.assert_allclose(v, [a / w * (np.cos(angle) - 1), a / w * np.sin(angle), 0], atol=1e-5)


@given(st.lists(st.integers(1, 399), max_size=20))
@settings(max_examples=40, deadline=None)
def test_steps_do_not_depend_on_the_cuts(cuts):
    rng = np.random.default_rng(11)
    kind = np.where(rng.random(400) < 0.2, int(Kind.MAG), int(Kind.IMU))
    t = np.cumsum(rng.uniform(0.002, 0.006, 400))
    data = rng.normal(size=(400, 6))
    whole = run(kind, t, data)
    cut = run(kind, t, data, cuts=sorted(set(cuts)))
    assert np.array_equal(whole[0], cut[0], equal_nan=True)
    assert np.array_equal(np.delete(whole[1], at.M_STEP, 1), np.delete(cut[1], at.M_STEP, 1), equal_nan=True)


def test_bad_samples_are_counted_by_reason_and_never_used():
    good = [0.01, 0.02, 0.03, 0.0, 0.0, -9.8]
    t = np.arange(60) * 0.01
    data = [[g + 1e-6 * i for g in good] for i in range(60)]
    data[10][0] = np.nan
    data[20][5] = 1e6
    t[30] = t[28]
    t[40] = t[39]
    steps, _, _, n = run([Kind.IMU] * 60, t, data)
    counters = n[Kind.IMU]
    assert counters[memory.N_RANGE] == 2
    assert counters[memory.N_ORDER] == 1
    assert counters[memory.N_REPEATED] == 1
    assert np.isfinite(steps[:, : at.U_TEMPERATURE]).all()
    assert np.abs(steps[:, at.U_GYRO_MEAN]).max() < 0.011


def test_a_sensor_that_freezes_after_it_lived_is_refused_and_a_constant_one_is_not():
    rng = np.random.default_rng(2)
    lively = rng.normal(size=(200, 6)) * 0.01 + [0, 0, 0, 0, 0, -9.8]
    frozen = np.tile(lively[-1], (200, 1))
    _, _, _, n = run([Kind.IMU] * 400, np.arange(400) * 0.01, np.vstack([lively, frozen]))
    assert n[Kind.IMU, memory.N_STUCK] == pytest.approx(150, abs=2)
    _, _, _, n = run([Kind.IMU] * 400, np.arange(400) * 0.01, np.tile(frozen[:1], (400, 1)))
    assert n[Kind.IMU, memory.N_STUCK] == 0


@pytest.mark.parametrize(
    ("unit", "factor"), [("gauss", 1.0), ("mG", 1e3), ("uT", 1e2), ("nT", 1e5), ("mG x 1000", 1e6)]
)
def test_the_unit_of_the_field_is_found_from_its_strength(unit, factor):
    for norm in (0.23, 0.48, 0.66):
        assert decade_scale(norm * factor) == pytest.approx(1 / factor)


def test_standard_atmosphere_at_known_heights():
    """ISA table: 0 m 101325 Pa, 1000 m 89874.6 Pa, 5000 m 54019.9 Pa."""
    for height_m, pressure_pa in ((0.0, 101325.0), (1000.0, 89874.6), (5000.0, 54019.9)):
        assert height_from_pressure(pressure_pa) == pytest.approx(height_m, abs=0.5)


def test_a_receiver_without_a_fix_is_not_believed():
    row = [47.0, 8.0, 500.0, 0.0, 0.0, np.nan, 0.3, 0.3, 0.1]
    _, meas, _, _ = run([Kind.GNSS] * 3, [0.0, 0.2, 0.4], [[*row, 1.0], [*row, 3.0], [0.0, 0.0, *row[2:], 3.0]])
    expected = [AidStatus.REFUSED_NO_FIX, AidStatus.FUSED, AidStatus.REFUSED_RANGE]
    assert meas[:, at.M_STATUS].tolist() == expected
