"""Slow errors of receiver and baro as states: when they are there, what they hold, and whether P tells the truth."""

import numpy as np
import pytest

from server.montecarlo.campaign import Campaign
from server.montecarlo.run import run_campaign
from server.montecarlo.statistics import nees_curves, nis_curves
from server.nav.ekf import layout as at
from server.nav.ekf.states import BARO, WANDER, WITH_BARO, WITH_WANDER, X_BARO, X_WANDER, packed
from server.nav.types import LANE_COLUMNS, Aid, AidStatus, Kind

from .synthetic import METRES_PER_DEG_LAT, circle, navigate

SIGMA_N = LANE_COLUMNS.index("sigma_pos_n_m")
FIX_TYPE, H_ACC = 9, 6


def lane_of(engine):
    return engine._bank._running["ins_ekf"]


def fixes_of(stream):
    return [row for row in stream.rows if row[3] == Kind.GNSS]


def as_carrier_phase(stream):
    for row in fixes_of(stream):
        row[5][FIX_TYPE] = 6.0
    return stream


def test_a_carrier_phase_receiver_pays_for_no_wander_and_a_board_without_baro_for_no_datum():
    *_, engine = navigate(as_carrier_phase(circle(duration_s=20.0)[0]).block())
    assert lane_of(engine)._work[at.W_DIM] == WITH_BARO
    *_, engine = navigate(as_carrier_phase(circle(duration_s=20.0, baro=False)[0]).block())
    assert lane_of(engine)._work[at.W_DIM] < WITH_BARO
    *_, engine = navigate(circle(duration_s=20.0)[0].block())
    assert lane_of(engine)._work[at.W_DIM] == WITH_WANDER


def test_the_published_sigma_of_a_stand_alone_receiver_holds_what_no_fix_shows():
    """h_acc 0.1 m, fixes that agree to 2 cm: 0.07 m stay, for the fixes of one minute err alike."""
    _, rows, _, engine = navigate(circle(duration_s=40.0)[0].block())
    assert 0.05 < rows[-1, SIGMA_N] < 0.08
    _, P = lane_of(engine).covariance()
    assert P[6, 6] == pytest.approx(rows[-1, SIGMA_N] ** 2)
    full = lane_of(engine)._P
    assert full[packed(6, WANDER)] < -0.8 * np.sqrt(full[packed(6, 6)] * full[packed(WANDER, WANDER)])


def test_the_datum_is_the_height_less_the_baros():
    _, rows, _, engine = navigate(circle(duration_s=40.0)[0].block())
    assert lane_of(engine)._x[X_BARO] == pytest.approx(-100.0, abs=0.3)
    assert lane_of(engine)._P[packed(BARO, BARO)] > 0.0
    assert abs(rows[-1, 9]) < 0.3


def test_a_fix_far_away_is_refused_and_moves_no_slow_error():
    stream, _ = circle(duration_s=30.0)
    clean = navigate(stream.block())
    fix = fixes_of(stream)[-1]
    fix[5][0] += 50.0 / METRES_PER_DEG_LAT
    _, _, results, engine = navigate(stream.block())
    status = [r.aids.data[r.aids.data[:, 0] == Aid.GNSS_POSITION, 1] for r in results]
    assert np.concatenate(status)[-1] == AidStatus.REFUSED_GATE
    moved = lane_of(engine)._x[X_WANDER] - lane_of(clean[3])._x[X_WANDER]
    assert abs(moved) < 0.01


def test_told_what_the_board_is_like_the_filter_is_consistent():
    """Twelve flights: bounds for sums of correlated squares, about three times as wide as for one epoch alone."""
    flights = run_campaign(Campaign(runs=12, seconds=40.0, told="sheet"), processes=1)
    nees = {curve.name: curve.average(slice(30, None)) for curve in nees_curves(flights, full=True)}
    assert 0.75 < nees["attitude"] < 1.3
    assert 0.75 < nees["velocity"] < 1.3
    assert 0.6 < nees["position"] < 1.5
    assert 0.8 < nees["all nine"] < 1.25
    nis = {curve.name: curve.average(slice(30, None)) for curve in nis_curves(flights)}
    for name in ("gnss_position", "gnss_velocity", "baro_height", "mag_field"):
        assert 0.85 < nis[name] < 1.15, name
