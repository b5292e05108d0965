"""The smoother through the engine, on motions whose truth is a law."""

import math

import numpy as np
import pytest

from server.nav.engine import NavEngine
from server.nav.lanes import smoother
from server.nav.lanes.registry import AFTERWARDS
from server.nav.lanes.smoother_filter import smooth_all
from server.nav.types import LANE_COLUMNS, EngineSettings, LaneStatus, SampleBlock, VehicleClass

from .synthetic import LAT_DEG, LON_DEG, circle, field_model, heading_of, pieces

SITE = {"site_lat_deg": LAT_DEG, "site_lon_deg": LON_DEG, "site_alt_m": 0.0}
DELAYS = {"gnss_delay_s": 0.0, "mag_delay_s": 0.0, "imu_delay_s": 0.0, "baro_delay_s": 0.0}
OUTAGE = (45.0, 65.0)
PUBLISHED = slice(0, 26)


def navigate(block, cut=10**9, lanes=("ins_ekf", "smoother"), **told):
    """Run filter and smoother; return {lane: rows}, both at the stamps that come first."""
    engine = NavEngine(EngineSettings(lanes=lanes, t_origin_ns=0, **DELAYS | told), field_model)
    results = [*(engine.step(piece) for piece in pieces(block, cut)), engine.finish()]
    names = {lane.lane for result in results for lane in result.lanes}
    rows = {n: np.concatenate([x.data for r in results for x in r.lanes if x.lane == n]) for n in names}
    stamps = {n: np.concatenate([x.t_ns for r in results for x in r.lanes if x.lane == n]) for n in names}
    assert all(np.array_equal(t, stamps["smoother"]) for t in stamps.values())
    return stamps["smoother"] * 1e-9, rows, results


def errors(t, rows, truth):
    """Return position, velocity (horizontal) and heading errors."""
    expected = np.array([truth(x) for x in t])
    heading = (heading_of(rows) - expected[:, 4] + math.pi) % (2 * math.pi) - math.pi
    return rows[:, 26:28] - expected[:, :2], rows[:, 4:6] - expected[:, 2:4], heading


def rms(values):
    return float(np.sqrt((values**2).mean()))


@pytest.fixture(scope="module")
def flown():
    stream, truth = circle(duration_s=90.0, gyro_bias=(0.01, -0.013, -0.006), accel_bias=(0.05, -0.03, 0.02))
    block = stream.block()
    return block, truth, *navigate(block, gnss_withheld_s=(OUTAGE,), **SITE)


def test_it_is_better_than_the_filter_everywhere_and_far_better_inside_an_outage(flown):
    _, truth, t, rows, _ = flown
    for begin, end, share in ((12, 30, 0.8), (30, 45, 0.8), (*OUTAGE, 1 / 3), (65, 89, 0.8)):
        part = (t > begin) & (t < end)
        ours = errors(t[part], rows["smoother"][part], truth)
        theirs = errors(t[part], rows["ins_ekf"][part], truth)
        assert rms(ours[0]) < share * rms(theirs[0])
        assert rms(ours[1]) < share * rms(theirs[1])
        assert rms(ours[2]) < rms(theirs[2])


def test_its_errors_stay_inside_its_own_three_sigma(flown):
    _, truth, t, rows, _ = flown
    part = t > 12.0
    own = rows["smoother"][part]
    position, velocity, heading = errors(t[part], own, truth)
    for error, sigma in ((position, own[:, 16:18]), (velocity, own[:, 13:15]), (heading, own[:, 12])):
        assert (np.abs(error) < 3 * sigma).mean() > 0.99


def test_its_sigma_is_nowhere_larger_than_the_filter_s(flown):
    _, _, t, rows, _ = flown
    part = t > 3.0
    ours, theirs = rows["smoother"][part, 10:19] ** 2, rows["ins_ekf"][part, 10:19] ** 2
    assert (ours < (theirs + np.repeat([0.0, 0.003, 0.005], 3) ** 2) * (1.0 + 1e-6)).all()


def test_inside_an_outage_both_ends_are_known_so_it_navigates_and_sigma_is_largest_in_the_middle(flown):
    _, _, t, rows, _ = flown
    part = (t > OUTAGE[0] + 1.5) & (t < OUTAGE[1])
    assert (rows["ins_ekf"][part, 25] == LaneStatus.DEAD_RECKONING).any()
    assert (rows["smoother"][part, 25] == LaneStatus.NAVIGATING).all()
    sigma, before = np.hypot(*rows["smoother"][part, 16:18].T), np.hypot(*rows["ins_ekf"][part, 16:18].T)
    assert 0.2 < t[part][sigma.argmax()] / np.mean(OUTAGE) < 1.2
    assert sigma.argmax() not in (0, len(sigma) - 1)
    assert sigma.max() < 0.5 * before.max()


def test_the_last_row_is_the_filter_s(flown):
    _, _, _, rows, _ = flown
    ours, theirs = rows["smoother"][-1], rows["ins_ekf"][-1]
    np.testing.assert_allclose(ours[:13], theirs[:13], atol=1e-9)
    np.testing.assert_allclose(ours[19:26], theirs[19:26], atol=1e-9)
    np.testing.assert_allclose(ours[16:18] ** 2, theirs[16:18] ** 2 + 0.005**2, rtol=1e-6)


@pytest.mark.parametrize("cut", [997, 40])
def test_it_does_not_depend_on_the_cuts(flown, cut):
    block, _, _, rows, _ = flown
    _, again, _ = navigate(block, cut, lanes=("smoother",), gnss_withheld_s=(OUTAGE,), **SITE)
    assert np.array_equal(again["smoother"], rows["smoother"], equal_nan=True)


def test_it_does_not_depend_on_how_much_is_kept_at_once(flown, monkeypatch):
    block, _, _, rows, _ = flown
    windows = []

    def small(start, steps, meas, t_ns):
        windows.append(len(steps) // 512)
        return smooth_all(start, steps, meas, t_ns, window_steps=512)

    monkeypatch.setattr(smoother, "smooth_all", small)
    _, again, _ = navigate(block, lanes=("smoother",), gnss_withheld_s=(OUTAGE,), **SITE)
    assert windows[0] > 5
    np.testing.assert_allclose(again["smoother"], rows["smoother"], atol=1e-12)


def test_without_a_later_fix_it_says_dead_reckoning_and_is_the_filter(flown):
    block = flown[0]
    t, rows, _ = navigate(block, gnss_withheld_s=((70.0, 100.0),), **SITE)
    lost = rows["ins_ekf"][:, 25] == LaneStatus.DEAD_RECKONING
    assert lost.sum() > 800
    assert (rows["smoother"][t > 71.5, 25] == LaneStatus.DEAD_RECKONING).all()
    assert (rows["smoother"][(t > 15.0) & (t < 70.0), 25] == LaneStatus.NAVIGATING).all()
    np.testing.assert_allclose(rows["smoother"][-1, 29], rows["ins_ekf"][-1, 29])
    assert rows["smoother"][-1, 16] == pytest.approx(rows["ins_ekf"][-1, 16], rel=1e-3)


def test_a_heading_found_later_holds_for_the_time_before_it():
    """Without a magnetometer a fixed wing learns its heading from its motion; at rest before, it was the same board."""
    stream, truth = circle(duration_s=40.0, mag=False, rest_s=10.0)
    t, rows, _ = navigate(stream.block(), vehicle=VehicleClass.FIXED_WING, **SITE)
    unknown = (rows["ins_ekf"][:, 12] > 1.0) & (t > 5.0) & (t < 10.0)
    assert unknown.sum() > 200
    own = rows["smoother"][unknown]
    heading = errors(t[unknown], own, truth)[2]
    assert np.abs(heading).max() < 0.2
    assert (np.abs(heading) < 3 * own[:, 12]).all()


def test_a_hole_in_the_data_parts_the_recording_and_it_says_so():
    block = circle(duration_s=60.0)[0].block()
    kept = (block.t_ns < 30e9) | (block.t_ns > 33e9)
    holed = SampleBlock(
        kind=block.kind[kept], t_ns=block.t_ns[kept], t_rx_ns=block.t_rx_ns[kept], data=block.data[kept]
    )
    t, rows, results = navigate(holed, **SITE)
    again = (rows["smoother"][:, 25] != LaneStatus.NAVIGATING) & (t > 33.0)
    assert 0 < again.sum() < 500
    assert (t[again] < 43.0).all()
    event = next(e for e in results[-1].events if e.code == "smoothed")
    assert dict(event.values)["stretches"] == 2.0
    assert "2 stretches" in event.text
    before = np.flatnonzero(t < 30.0)[-1]  # nothing later tells about the end of the first stretch: it is the filter's
    np.testing.assert_allclose(rows["smoother"][before, 4:9], rows["ins_ekf"][before, 4:9], atol=1e-6)


def test_one_that_raises_is_put_aside_and_takes_nothing_down(flown, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("no way back")

    monkeypatch.setattr(smoother, "smooth_all", broken)
    engine = NavEngine(EngineSettings(lanes=("ins_ekf", "smoother")), field_model)
    engine.step(flown[0])
    (failed,) = engine.finish().lanes
    assert failed.lane == "smoother"
    assert failed.data[0, LANE_COLUMNS.index("status")] == LaneStatus.FAILED
    assert "no way back" in next(x.failure for x in engine.snapshot().lanes if x.lane == "smoother")


def test_a_live_board_is_not_offered_it():
    engine = NavEngine(EngineSettings(), field_model)
    for name in AFTERWARDS:
        assert name not in [one.name for one in engine.lanes()]
        with pytest.raises(ValueError, match="no lane called"):
            engine.choose_lanes(("ins_ekf", name))
        with pytest.raises(ValueError, match="no lane called"):
            engine.set_lane_parameters(name, {"gate_sigma": 4.0})


def test_nothing_in_nothing_out():
    engine = NavEngine(EngineSettings(lanes=("smoother",)), field_model)
    assert engine.finish().lanes == ()
