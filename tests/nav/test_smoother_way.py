"""The recorded way of the real filter with every slow error told: its law of motion, and the pass back over it."""

import math

import numpy as np
import pytest

from server.nav.ekf import layout as at
from server.nav.ekf.smooth import layout as rec
from server.nav.ekf.states import BARO, JITTER, MIX, POS, WANDER, X_POS, X_VEL, N
from server.nav.engine import NavEngine
from server.nav.lanes import smoother
from server.nav.lanes.smoother_filter import Carried, Tape, Way, _chunks
from server.nav.types import LANE_COLUMNS, EngineSettings, Kind

from .synthetic import circle, field_model
from .test_smoother import DELAYS, SITE
from .test_smoother_algebra import LOWER, transition

TOLD = {"gnss_jitter_m": 0.02, "gnss_jitter_tau_s": 1.0, "gyro_scale": 0.01, "gyro_cross": 0.01}
BARO_STARTS_S, WANDER_STARTS_S, OUTAGE = 17.0, 13.0, (15.0, 20.0)


def dense(packed):
    P = np.zeros((N, N))
    P[LOWER] = packed
    return P + np.tril(P, -1).T


def gain_back(P, A, ahead):
    """Return P Aᵀ ahead⁻¹, states without variance left out."""
    scale = np.sqrt(np.diag(ahead)) + (np.diag(ahead) == 0.0)
    both = np.outer(scale, scale)
    return P @ A.T @ (np.linalg.pinv(ahead / both, rcond=1e-13, hermitian=True) / both)


class Recorded:
    """One window over everything: the tape, and the rows that the pass back made of it."""

    def __init__(self, start, steps, meas, t_ns):
        recorder = start()
        self.way = Way(steps=steps, meas=meas, t_ns=t_ns, rows=np.empty((len(steps), len(LANE_COLUMNS))))
        self.tape = Tape(len(steps) + recorder.room)
        self.way.run(recorder, _chunks(steps, recorder.chunk), self.tape)
        self.way.back(recorder, self.tape, Carried(recorder.states))
        self.result = self.way.rows, recorder.t
        self.count, logged = self.tape.count
        ends = self.tape.s[: self.count, rec.Z_LOG_END].astype(int)
        self.log = [self.tape.log[a:b] for a, b in zip([0, *ends], [*ends, logged], strict=False)]
        self.first = int(np.flatnonzero(self.tape.s[: self.count, rec.Z_WAS_POSITIONED])[0])

    def row(self, k):
        return self.way.rows[np.searchsorted(self.way.steps[:, at.U_T], self.tape.u[k, at.U_T])]

    def predicted(self, k):
        """Return P before the measurements of slot k, and them, the last one first, with P after each."""
        P, done = dense(self.tape.P[k]), []
        for entry in self.log[k][::-1]:
            turn = np.eye(N)
            c, s = math.cos(entry[rec.L_TURN]), math.sin(entry[rec.L_TURN])
            turn[:2, :2] = [[c, -s], [s, c]]
            P = turn.T @ P @ turn
            done.append((turn, entry, P))
            if entry[rec.L_KIND] == rec.SCALAR:
                P = P + np.outer(entry[rec.L_PH :], entry[rec.L_PH :]) / entry[rec.L_VARIANCE]
            else:
                assert entry[rec.L_KIND] == rec.DATUM
                P = P.copy()
                P[BARO] = P[:, BARO] = 0.0
        return P, done


@pytest.fixture(scope="module")
def recorded():
    stream, _ = circle(duration_s=28.0, gyro_bias=(0.01, -0.013, -0.006), accel_bias=(0.05, -0.03, 0.02))
    stream.rows = [row for row in stream.rows if row[3] != Kind.BARO or row[4] >= BARO_STARTS_S]
    for row in stream.rows:
        if row[3] == Kind.GNSS and row[4] < WANDER_STARTS_S:
            row[5][9] = 6.0  # a carrier-phase fix, which does not wander
    kept = []

    def spy(start, steps, meas, t_ns):
        kept.append(Recorded(start, steps, meas, t_ns))
        return kept[0].result

    settings = EngineSettings(
        lanes=("smoother",),
        lane_parameters={"smoother": TOLD},
        t_origin_ns=0,
        gnss_withheld_s=(OUTAGE,),
        **DELAYS,
        **SITE,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(smoother, "smooth_all", spy)
        engine = NavEngine(settings, field_model)
        engine.step(stream.block())
        engine.finish()
    return kept[0]


def test_every_slow_error_is_there_and_two_have_started_on_the_way(recorded):
    t = recorded.tape.u[: recorded.count, at.U_T] * 1e-9
    variance = np.array([np.diag(dense(P)) for P in recorded.tape.P[: recorded.count]])
    for state, begin in ((BARO, BARO_STARTS_S), (WANDER, WANDER_STARTS_S), (JITTER, 0.0), (MIX, 0.0)):
        has = variance[:, state] > 0.0
        assert has[-1]
        assert begin - 0.1 < t[has.argmax()] < begin + 3.0
    datum = [k for k in range(recorded.count) if (recorded.log[k][:, rec.L_KIND] == rec.DATUM).any()]
    assert len(datum) == 1
    assert t[datum[0]] == pytest.approx(BARO_STARTS_S, abs=0.05)


def test_beside_the_transition_the_filter_adds_noise_to_single_states_alone(recorded):
    for k in range(recorded.first + 1, recorded.count):
        P, _ = recorded.predicted(k)
        F = transition(recorded.tape.f[k])
        scale = np.sqrt(np.diag(P)) + (np.diag(P) == 0.0)
        Q = (P - F @ dense(recorded.tape.P[k - 1]) @ F.T) / np.outer(scale, scale)
        assert np.abs(Q - np.diag(np.diag(Q))).max() < 1e-12
        assert np.diag(Q).min() > -1e-12


def test_the_rows_are_those_of_rauch_tung_and_striebel_over_the_same_way(recorded):
    tape, last = recorded.tape, recorded.count - 1
    x, P = np.zeros(N), dense(tape.P[last])
    start = np.eye(N)
    start[BARO] = -np.eye(N)[POS + 2]
    rounding = np.repeat([0.0, 0.003, 0.005], 3) ** 2
    for k in range(last, recorded.first, -1):
        row, sigma = recorded.row(k), np.sqrt(np.diag(P)[:9] + rounding)
        np.testing.assert_allclose(row[13:19], sigma[3:], rtol=1e-5)
        np.testing.assert_allclose(row[10:13], sigma[:3], rtol=5e-3)  # tilt turns with the heading afterwards
        np.testing.assert_allclose(row[4:7], tape.x[k, X_VEL : X_VEL + 3] + x[3:6], atol=1e-9)
        assert row[9] == pytest.approx(tape.x[k, X_POS + 2] - x[POS + 2], abs=1e-9)
        ahead, done = recorded.predicted(k)
        for turn, entry, after in done:
            x, P = turn.T @ x, turn.T @ P @ turn
            if entry[rec.L_KIND] == rec.SCALAR:
                x = x + entry[rec.L_PH :] * entry[rec.L_INNOVATION] / entry[rec.L_VARIANCE]
            else:
                before = after.copy()
                before[BARO] = before[:, BARO] = 0.0
                G = gain_back(before, start, after)
                x, P = G @ x, before + G @ (P - after) @ G.T
        before = dense(tape.P[k - 1])
        G = gain_back(before, transition(tape.f[k]), ahead)
        x, P = G @ x, before + G @ (P - ahead) @ G.T
