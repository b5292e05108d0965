"""Learning in flight inside the engine: run only watches, apply moves the field by little, whatever the cuts."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from server.nav.calibration.applied import Calibration
from server.nav.engine import NavEngine
from server.nav.field_learning import MOST_GAUSS
from server.nav.types import EngineSettings, Kind, SampleBlock
from server.rows import merged

from .synthetic import field_model

FIELD_N = np.array([0.25, 0.0, 0.433])
MAGNET = np.array([0.06, -0.05, 0.04])
RATE_HZ = 100.0


@pytest.fixture(scope="module")
def turned():
    """A board turned by hand about all axes for a minute, with a magnet on it."""
    rng = np.random.default_rng(12)
    t = np.arange(0.0, 60.0, 1.0 / RATE_HZ)
    w = np.stack([1.2 * np.sin(0.7 * t), 1.0 * np.sin(0.9 * t + 1.0), 0.8 * np.cos(0.5 * t)], axis=1)
    w[t < 3.0] = 0.0
    R_nb = [Rotation.identity()]
    for one in w[:-1]:
        R_nb.append(R_nb[-1] * Rotation.from_rotvec(one / RATE_HZ))
    down = np.array([r.inv().apply([0.0, 0.0, -9.806]) for r in R_nb])
    field_b = np.array([r.inv().apply(FIELD_N) for r in R_nb]) + MAGNET
    imu, mag = np.full((len(t), 14), np.nan), np.full((len(t), 14), np.nan)
    imu[:, :3], imu[:, 3:6] = w + 1e-3 * rng.normal(size=w.shape), down + 0.02 * rng.normal(size=w.shape)
    mag[:, :3] = field_b + 2e-3 * rng.normal(size=w.shape)
    data = np.stack([mag, imu], axis=1).reshape(-1, 14)
    t_ns = np.repeat(np.round(t * 1e9).astype(np.int64), 2)
    kind = np.tile(np.array([Kind.MAG, Kind.IMU], dtype=np.uint8), len(t))
    keep = (np.arange(len(kind)) % 4) != 2  # the magnetometer at half the rate
    return SampleBlock(kind=kind[keep], t_ns=t_ns[keep], t_rx_ns=t_ns[keep], data=np.ascontiguousarray(data[keep]))


def fly(block, run, apply, edges=(), lanes=("ins_ekf", "vqf")):
    engine = NavEngine(EngineSettings(lanes=lanes), field_model)
    engine.set_mag_learning(run, apply)
    names = ("kind", "t_ns", "t_rx_ns", "data")
    edges = [0, *sorted(edges), len(block.kind)]
    parts = [SampleBlock(**{n: getattr(block, n)[a:b] for n in names}) for a, b in pairwise(edges)]
    return merged([engine.step(part) for part in parts if len(part.kind)]), engine


def test_what_only_runs_learns_and_changes_nothing(turned):
    plain, _ = fly(turned, run=False, apply=False)
    watched, engine = fly(turned, run=True, apply=False)
    for one, other in zip(plain.lanes, watched.lanes, strict=True):
        np.testing.assert_array_equal(one.data, other.data)
    state = engine.mag_learning()
    assert state.converged
    np.testing.assert_allclose(state.offset_gauss, MAGNET, atol=0.01)
    np.testing.assert_array_equal(engine.mag_learned_gauss, 0.0)


def test_what_is_applied_reaches_the_field_in_small_moves(turned):
    result, engine = fly(turned, run=True, apply=True)
    np.testing.assert_allclose(engine.mag_learned_gauss, MAGNET, atol=0.01)
    state = engine.mag_learning()
    np.testing.assert_allclose(state.offset_gauss, MAGNET, atol=0.01)  # and is not learned twice
    rows = next(rows for rows in result.stages if rows.sensor == "mag")
    raw = turned.data[(turned.kind == Kind.MAG) & np.isin(turned.t_ns, rows.t_ns), :3]
    taken = raw - rows.data[:, :3]
    steps = np.linalg.norm(np.diff(taken, axis=0), axis=1)
    assert 0.005 < steps.max() <= MOST_GAUSS + 1e-9
    strength = np.linalg.norm(rows.data[-500:, :3], axis=1)
    np.testing.assert_allclose(strength, np.linalg.norm(FIELD_N), atol=0.02)


@given(st.lists(st.integers(1, 8000), max_size=5))
@settings(max_examples=6, deadline=None)
def test_the_moves_do_not_depend_on_the_cuts(turned, cuts):
    whole, _ = fly(turned, run=True, apply=True)
    pieces, _ = fly(turned, run=True, apply=True, edges=[c for c in cuts if c < len(turned.kind)])
    for one, other in zip(whole.lanes, pieces.lanes, strict=True):
        np.testing.assert_array_equal(one.data, other.data)


def test_switched_off_the_field_goes_back_to_the_calibrated_one(turned):
    engine = NavEngine(EngineSettings(lanes=("ins_ekf",)), field_model)
    engine.set_mag_learning(run=True, apply=True)
    names = ("kind", "t_ns", "t_rx_ns", "data")
    half = int(len(turned.kind) * 0.75)
    engine.step(SampleBlock(**{n: getattr(turned, n)[:half] for n in names}))
    assert np.abs(engine.mag_learned_gauss).max() > 0.02
    engine.set_mag_learning(run=True, apply=False)
    engine.step(SampleBlock(**{n: getattr(turned, n)[half:] for n in names}))
    np.testing.assert_array_equal(engine.mag_learned_gauss, 0.0)
    assert engine.mag_learning() is not None


def test_another_magnetic_calibration_takes_the_learned_offset_over_and_learning_starts_anew(turned):
    """What an in-flight calibration stores is what was learned: it must not be taken off twice."""
    engine = NavEngine(EngineSettings(lanes=("ins_ekf",)), field_model)
    engine.set_mag_learning(run=True, apply=True)
    names = ("kind", "t_ns", "t_rx_ns", "data")
    half = int(len(turned.kind) * 0.75)
    engine.step(SampleBlock(**{n: getattr(turned, n)[:half] for n in names}))
    engine.set_calibration(Calibration(mag_offset=engine.mag_learned_gauss))
    np.testing.assert_array_equal(engine.mag_learned_gauss, 0.0)
    result = engine.step(SampleBlock(**{n: getattr(turned, n)[half:] for n in names}))
    rows = next(rows for rows in result.stages if rows.sensor == "mag")
    np.testing.assert_allclose(np.linalg.norm(rows.data[:, :3], axis=1), np.linalg.norm(FIELD_N), atol=0.03)
    np.testing.assert_allclose(engine.mag_learning().offset_gauss, 0.0, atol=0.02)
